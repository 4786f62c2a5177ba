# SPDX-License-Identifier: Apache-2.0
"""What `track` says first: how well the object can be tracked, found in a thread of its own while the run goes on."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from grasptrack.errors import GraspTrackError

if TYPE_CHECKING:
    from grasptrack.trackability import Suitability
    from grasptrack.tracking.initialization import FirstScene

BEAT = 0.05
"""s between two looks at whether Ctrl-C was pressed."""


class _UnwantedError(Exception):
    """The verdict is not wanted any more."""


class BackgroundVerdict:
    """Of one scene; leaving its context ends the thread."""

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        self._stopped = False
        self._lines: list[str] = []

    def __enter__(self) -> BackgroundVerdict:
        """Nothing is begun yet."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the thread where it has not: left alone, native code would be cut off at the end of the process."""
        self._stopped = True
        if self._thread is not None:
            self._thread.join()

    @property
    def is_begun(self) -> bool:
        """Whether a scene was given."""
        return self._thread is not None

    def begin(self, scene: FirstScene) -> None:
        """Judge a scene, in the background."""
        self._thread = threading.Thread(target=self._judge_scene, args=(scene,), name="grasptrack-verdict", daemon=True)
        self._thread.start()

    def take_lines(self) -> list[str]:
        """The lines, once, as soon as they are known."""
        lines: list[str] = []
        if self._thread is not None and not self._thread.is_alive():
            lines, self._lines = self._lines, lines
        return lines

    def wait_for_lines(self, check: Callable[[], None]) -> list[str]:
        """The lines, unless they were taken; `check` is called while it waits."""
        while self._thread is not None and self._thread.is_alive():
            check()
            self._thread.join(BEAT)
        return self.take_lines()

    def _judge_scene(self, scene: FirstScene) -> None:
        from grasptrack.trackability import inspect_scene

        try:
            self._lines = verdict_lines(inspect_scene(scene, check=self._raise_if_stopped))
        except _UnwantedError:
            pass
        except GraspTrackError as error:
            self._lines = [f"how well the object can be tracked is not known: {error}"]
        except Exception as error:  # no reason to end the run
            self._lines = [
                f"how well the object can be tracked is not known: internal error, {type(error).__name__}: {error}"
            ]

    def _raise_if_stopped(self) -> None:
        if self._stopped:
            raise _UnwantedError


def verdict_lines(found: Suitability) -> list[str]:
    """The level with what to expect of a run; and below it, where there is one, the first thing to mind."""
    from grasptrack.trackability.report import describe_expectation, describe_reasons

    told, reasons = describe_expectation(found), describe_reasons(found)
    lines = [found.level.upper() + (f". Expected: {told}" if told else "")]
    if reasons:
        more = f" ({len(reasons) - 1} more: grasptrack inspect)" if len(reasons) > 1 else ""
        lines.append(f"To mind: {reasons[0]}{more}")
    return lines
