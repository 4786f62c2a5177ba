# SPDX-License-Identifier: Apache-2.0
"""What verbs say beside their results: how well the object is tracked, what else it may be, what to try where it was lost."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasptrack.errors import GraspTrackError
from grasptrack.presentation import REMEDIES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grasptrack.segmentation.candidate import Candidate
    from grasptrack.trackability import Suitability
    from grasptrack.tracking.initialization import FirstScene

MANY = 0.2
"""Share of frames after which advice is given."""
MOST = 2
"""Pieces of advice that are given at once."""


def advice_for(codes: Mapping[str, int], frames: int) -> list[str]:
    """What to try, the most frequent reason first; none where few frames were lost."""
    counted = sorted((n, code) for code, n in codes.items() if code in REMEDIES)
    if not frames or sum(n for n, _ in counted) <= MANY * frames:
        return []
    told = [f"{n} of {frames} frames ({code}): {REMEDIES[code]}" for n, code in reversed(counted) if n > 0.05 * frames]
    return told[:MOST]


PICTURE = "candidates.png"
MORE = "a net of 4.6 MB finds more objects: grasptrack models get u2netp, then --segmenter u2netp"


def note_candidates(
    candidates: Sequence[Candidate],
    image: NDArray[Any] | None,
    output: Path,
    sure: float,
    *,
    meant: bool,
    segmenter: str | None,
) -> list[str]:
    """The lines for a choice that is not sure, having written the picture; nothing where it is, or where a person has chosen.

    Candidates are those that a person would tell apart, the likeliest first; the image is None where there was none. A picture
    of an earlier run is removed from the folder. Where no segmenter was asked for, the small net is offered.
    """
    picture = output / PICTURE
    picture.unlink(missing_ok=True)
    if meant or image is None or not candidates or candidates[0].probability >= sure:
        return []
    from grasptrack.segmentation.candidate import describe_candidate
    from grasptrack.view.draw import draw_candidates
    from grasptrack.view.style import write_picture

    write_picture(picture, draw_candidates(image, candidates))
    told = f"the object was chosen with a probability of {100.0 * candidates[0].probability:.0f} %, which is not sure"
    others = "; ".join(f"{n} lies {describe_candidate(c, candidates[0])}" for n, c in enumerate(candidates[1:], 2))
    also = f" ({others})" if others else ""
    return [
        f"{told}: {picture} shows what else it may be{also}; --choose N takes another, --object or --outline say it",
        *([] if segmenter else [MORE]),
    ]


def names_of_written(paths: Iterable[Path]) -> list[str]:
    """Of a verb's files, to be told in its JSON: all but the candidates' picture where it was not drawn."""
    return [path.name for path in paths if path.name != PICTURE or path.exists()]


def tell_of_picture(output: Path) -> None:
    """Add the candidates' picture, where it was drawn, to what run.json names."""
    if (output / PICTURE).exists():
        from grasptrack.files import write_json

        told = json.loads((output / "run.json").read_bytes())
        write_json(output / "run.json", {**told, "files": [*told["files"], PICTURE]})


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
