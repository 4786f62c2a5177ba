# SPDX-License-Identifier: Apache-2.0
"""What the terminal shows: our own lines alone, and Ctrl-C at a moment when the files are whole."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from types import FrameType
from typing import Any

INTERRUPTED = 130
"""Exit status after Ctrl-C."""

_held: list[str] = []


def tell_error(message: str) -> None:
    """One line on stderr."""
    print("grasptrack: " + " ".join(message.split()), file=sys.stderr, flush=True)


@contextlib.contextmanager
def only_our_errors() -> Iterator[None]:
    """Keep what C libraries write to stderr while they decode a bad image from hiding the one line that names it."""
    with warnings.catch_warnings():
        warnings.showwarning = _hold_warning
        if os.environ.get("GRASPTRACK_DEBUG") not in (None, "", "0") or not _is_process_stderr():
            yield
            return
        sys.stderr.flush()
        kept, ours = sys.stderr, os.dup(2)
        with open(os.devnull, "wb") as nowhere, open(ours, "w", encoding=kept.encoding, errors="replace") as stream:  # noqa: PTH123
            os.dup2(nowhere.fileno(), 2)
            sys.stderr = stream
            try:
                yield
            finally:
                stream.flush()
                os.dup2(ours, 2)
                sys.stderr = kept


def _is_process_stderr() -> bool:
    try:
        return sys.stderr.fileno() == 2
    except (OSError, ValueError, AttributeError):
        return False


def _hold_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    _held.append(" ".join(str(message).split()))


def held_warnings() -> list[str]:
    """Warnings since the last call. They are kept for the closing table: stderr is for errors, and quiet is quiet."""
    messages = list(dict.fromkeys(_held))
    _held.clear()
    return messages


class Interruption:
    """Ctrl-C, held back until a frame is finished; pressed a second time it strikes at once.

    `check` raises KeyboardInterrupt when it was pressed.
    """

    def __init__(self) -> None:
        self._pressed = False
        self._before: Any = None

    def __enter__(self) -> Interruption:
        """Take over SIGINT, where Python lets us: in the main thread."""
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        """Hand SIGINT back."""
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._pressed:
            raise KeyboardInterrupt
        self._pressed = True

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed; to be called where nothing is half done."""
        if self._pressed:
            raise KeyboardInterrupt
