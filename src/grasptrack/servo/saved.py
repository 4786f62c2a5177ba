# SPDX-License-Identifier: Apache-2.0
"""Small files of the servo's, goals and calibrations: read with a bound, and written as a whole or not at all."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from grasptrack.errors import InputError
from grasptrack.files import whole_file


def read_keys(file: Path, parse: Callable[[str], Any], most: int, what: str, kind: str) -> dict[str, Any]:
    """The keys of a file.

    Args:
        file: the file.
        parse: what its text holds.
        most: bytes of the largest such file.
        what: it is, for the message: "a goal".
        kind: of the text, for the message: "JSON".

    Raises:
        InputError: it cannot be read, or has no keys.
    """
    try:
        with file.open("rb") as stream:
            data = stream.read(most + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(data) > most:
        raise InputError(f"is larger than {most} bytes: no {what.split()[-1]} is")
    try:
        content = parse(data.decode("utf-8"))
    except UnicodeDecodeError:
        raise InputError("is no text file") from None
    except (ValueError, RecursionError):
        raise InputError(f"is no {kind}") from None
    if not isinstance(content, dict):
        raise InputError(f"is no {kind} with the keys of {what}")
    return content


def write_text(file: Path, text: str, what: str) -> None:
    """Write a file; an InputError where it cannot be written."""
    try:
        with whole_file(file) as part:
            part.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f'{what} "{file}" cannot be written: {error.strerror or error}', path=str(file)) from None


def is_number(value: Any, bound: float = math.inf) -> bool:
    """Whether it is a number below a bound, and neither true nor false."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and (bound == math.inf or abs(value) < bound)
