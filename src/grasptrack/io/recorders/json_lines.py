# SPDX-License-Identifier: Apache-2.0
"""One JSON object a frame and line, for a program that reads along."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from grasptrack.errors import InputError
from grasptrack.io.columns import result_fields

if TYPE_CHECKING:
    from grasptrack.io.base import Frame
    from grasptrack.tracking.result import TrackResult

STANDARD_OUTPUT = "-"


class JsonLines:
    """Writes a line for every frame, and passes it on at once.

    Args:
        path: the file, written over; ``-`` for the standard output.
        outline: tell the outline, too: some 300 points a line.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(self, path: Path, *, outline: bool = False) -> None:
        self.path, self._outline = path, outline
        self._own: TextIO | None = None
        if str(path) != STANDARD_OUTPUT:
            try:
                self._own = path.open("w", encoding="utf-8")
            except OSError as error:
                raise InputError(f'"{path}" cannot be written: {error.strerror or error}', path=str(path)) from None

    def write(self, frame: Frame, result: TrackResult) -> None:
        """Add a frame."""
        file = self._own or sys.stdout
        fields = result_fields(frame, result, outline=self._outline)
        file.write(json.dumps(fields, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n")
        file.flush()

    def close(self) -> None:
        """Close the file, if it is one; may be called again."""
        if self._own is not None:
            self._own.close()
