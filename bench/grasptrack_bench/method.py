# SPDX-License-Identifier: Apache-2.0
"""The one small interface behind which everything that follows a grasp is measured, and a sequence shown to all of it."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.errors import GraspError
from grasptrack.geometry.contours import Contour, View
from grasptrack.tracking.follower import AUTO
from grasptrack.tracking.initialization import synthesize_grasps
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats
from grasptrack_bench.metrics.score import FrameScore, Score, Truth


@dataclass(frozen=True)
class MethodStart:
    """What a method is told before the first image.

    Attributes:
        contacts: (k, 2) px of the grasp in the first image.
        outline: polygons of the object in the first image in px, outer first, then holes; () where it is not known.
            A method that needs to know which pixels are the object's may use it: more than a user could tell it.
        size: width and height of the images in px.
        object_at: (x, y) px of the object in the first image, where the user pointed at it.
        by_hand: the user drew that outline, so that the tracker is told of it too.
    """

    contacts: Floats
    outline: tuple[Floats, ...]
    size: tuple[int, int]
    object_at: tuple[float, float] | None = None
    by_hand: bool = False


class Method(Protocol):
    """Follows one grasp through one sequence."""

    def update(self, image: NDArray[Any], time: float | None) -> TrackResult:
        """Look at the next image, the first one included.

        Args:
            image: (H, W) 8 bit grey, or (H, W, 3) BGR.
            time: s.

        Returns:
            The contacts in this image, or a status other than tracked and the reason. `confidence` orders the answers
            of one method; NaN where it has none. `latency_ms` is measured by who calls.
        """
        ...


Maker = Callable[[MethodStart], Method]
"""Makes a fresh method for one sequence."""


class MethodFrame(NamedTuple):
    """One frame as the methods see it, (H, W) grey or (H, W, 3) BGR, and what is true of it; None where that is not known."""

    image: NDArray[Any]
    time: float | None
    truth: Truth | None


def score_sequence(
    frames: Iterable[MethodFrame], methods: Mapping[str, Maker], start: MethodStart, first: int = 0
) -> dict[str, list[FrameScore]]:
    """Show every frame to every method, and score what they say.

    Args:
        frames: in order; the contacts of `start` are in the first one.
        methods: makers by name.
        start: what each method is told beforehand.
        first: number of the first of the frames.

    Returns:
        Scored frames by method. A latency is that of the whole update, in ms.
    """
    running = {name: (make(start), Score(name, given=start.contacts)) for name, make in methods.items()}
    for index, shown in enumerate(frames, first):
        for method, score in running.values():
            began = clock.perf_counter()
            result = method.update(shown.image, shown.time)
            taken = 1e3 * (clock.perf_counter() - began)
            score.add(replace(result, frame=index, latency_ms=taken), shown.truth)
    return {name: score.frames for name, (_, score) in running.items()}


def chosen_grasp(outline: Iterable[Floats], fingers: int = 2, friction: float = 0.5) -> Floats:
    """(k, 2) px, the contacts that all methods are to follow: the grasp that the tracker would choose on this outline."""
    found, reason = synthesize_grasps(outline_of(outline), AUTO, fingers, friction, None, [])
    if not found:
        raise GraspError(f"no stable grasp: {reason}")
    return found[0].contacts


def outline_of(polygons: Iterable[Floats], spacing: float = 1.0) -> View:
    """Polygons (N, 2) px, outer first, as contours with a point at about every `spacing` px."""
    contours = []
    for i, polygon in enumerate(polygons):
        length = float(np.hypot(*(np.roll(polygon, -1, axis=0) - polygon).T).sum())
        count = max(24, round(length / spacing))
        points = kernels.resample(np.ascontiguousarray(polygon, dtype=np.float64), count, 0.0)
        contours.append(Contour(points, hole=i > 0))
    return View(contours)
