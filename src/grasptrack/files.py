# SPDX-License-Identifier: Apache-2.0
"""Files that are whole at any moment, or absent: whoever ends the program while it writes leaves no half of one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A path beside a file, to be written to; the file is replaced by it when that is done, and is left as it was otherwise.

    Args:
        path: of the file.
    """
    part = path.with_name(f"{path.name}.part")
    try:
        yield part
        part.replace(path)
    except BaseException as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename is None:  # as of a write
            error.filename = str(path)
        raise
