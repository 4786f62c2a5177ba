# SPDX-License-Identifier: Apache-2.0
"""One sequence, all methods on the same frames, each frame read or rendered once."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.bench.method import Maker, Start
from grasptrack.bench.metrics.score import FrameScore, Score
from grasptrack.bench.metrics.truth import Truth
from grasptrack.errors import GraspError
from grasptrack.geometry.contours import Contour, View
from grasptrack.tracking.follower import AUTO
from grasptrack.tracking.initialization import synthesize_grasps
from grasptrack.typing import Floats


class Shown(NamedTuple):
    """One frame as the methods see it, and what is true of it.

    Attributes:
        image: (H, W) grey or (H, W, 3) BGR.
        time: s, or None.
        truth: None where it is not known.
    """

    image: NDArray[Any]
    time: float | None
    truth: Truth | None


def score_sequence(
    frames: Iterable[Shown], methods: Mapping[str, Maker], start: Start, first: int = 0
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
    """(k, 2) px, the contacts that all methods are to follow: the grasp that the tracker would choose on this outline.

    Args:
        outline: polygons in px, outer first, then holes.
        fingers, friction: as in synthesis.

    Raises:
        GraspError: there is no stable grasp; the message says why.
    """
    contours = []
    for i, polygon in enumerate(outline):
        length = float(np.hypot(*(np.roll(polygon, -1, axis=0) - polygon).T).sum())
        points = kernels.resample(np.ascontiguousarray(polygon, dtype=np.float64), max(24, round(length)), 0.0)
        contours.append(Contour(points, hole=i > 0))
    found, reason = synthesize_grasps(View(contours), AUTO, fingers, friction, None, [])
    if not found:
        raise GraspError(f"no stable grasp: {reason}")
    return found[0].contacts
