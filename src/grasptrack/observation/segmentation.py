# SPDX-License-Identifier: Apache-2.0
"""The flat objects that stand out in an image seen for the first time: thresholds, judged by one score."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import Contour, View
from grasptrack.errors import ContourError, ObservationError
from grasptrack.observation.images import Grey, to_grey, to_mask
from grasptrack.observation.outline import Localised, localise
from grasptrack.observation.silhouettes import Silhouette, trace
from grasptrack.observation.thresholds import thresholds

Floats = NDArray[np.float64]

MIN_EXTENT = 20
"""px across; a smaller object has no outline worth following."""
MAX_SHARE = 0.85
"""A region that fills more of the image than this is the background."""
CANDIDATES = 8
"""Silhouettes for each threshold that are looked at closely, the largest first."""
HOLE_SHARPNESS = 0.5
"""A hole's edge is at least so strong, relative to the outer one's: what is printed on an object seldom is."""
HOLE_LEVEL = 0.25
"""Through a hole the same ground is seen as around the object, within this fraction of the contrast."""
MAX_HOLES = 12
"""Holes that are looked at, the largest first."""
MIN_STEP = 1.0
"""Across its outline an object differs from the ground by as much as the edge rises in so many px at least: the grain of
a table has slopes, and the same grey on both sides."""
MIN_CONTRAST = 3.0
"""Grey levels per px along the outline; below this, half of any strength is noise."""


class Candidate(NamedTuple):
    """An object that may be meant.

    Attributes:
        view: its outline.
        polarity: +1 darker than its surroundings, -1 lighter.
        inside, outside: grey levels on either side of the outer contour.
        score: 0 to 1: contrasted along its whole outline, complete, smooth, of some size.
        level: grey level of the threshold that separated it from the ground.
    """

    view: View
    polarity: int
    inside: float
    outside: float
    score: float
    level: float = math.nan


def segment(
    image: NDArray[Any], object_at: tuple[float, float] | None = None, ignore: NDArray[Any] | None = None
) -> View:
    """Outline of the flat object that stands out in an image, or of the one under a pixel.

    Args:
        image: 8 or 16 bit, grey, BGR or BGRA.
        object_at: (x, y) px of the object.
        ignore: (H, W) nonzero where nothing belongs to the scene.

    Raises:
        ObservationError: no object, or none there.
    """
    grey = to_grey(image)
    hidden = None if ignore is None else to_mask(ignore, grey.shape, "ignore mask")
    return candidates(grey, object_at=object_at, hidden=grow(hidden))[0].view


def grow(hidden: Grey | None) -> Grey | None:
    """What is hidden and two pixels round it, where edges are its own."""
    return None if hidden is None else np.asarray(cv2.dilate(hidden, np.ones((5, 5), np.uint8)), dtype=np.uint8)


def candidates(
    grey: Grey,
    object_at: tuple[float, float] | None = None,
    hidden: Grey | None = None,
    polarities: tuple[int, ...] = (1, -1),
) -> list[Candidate]:
    """Objects in an image, the most outstanding first.

    Args:
        grey: (H, W).
        object_at: (x, y) px that the object covers.
        hidden: (H, W) nonzero where nothing belongs to the scene.
        polarities: look for dark objects (+1), light ones (-1) or both.

    Raises:
        ObservationError: none, or none under `object_at`.
    """
    soft: Grey = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0), dtype=np.uint8)
    found: list[Candidate] = []
    tiny = 0
    for level in thresholds(soft if hidden is None else soft[hidden == 0]):
        for polarity in polarities:
            for shape in silhouettes(grey, level, polarity, hidden)[:CANDIDATES]:
                if object_at is not None and not shape.contains(*object_at):
                    continue
                if max(shape.box[2:]) < MIN_EXTENT:
                    tiny = max(tiny, *shape.box[2:])
                    continue
                candidate = judge(grey, shape, polarity, hidden)
                if candidate is not None:
                    found.append(candidate._replace(level=level))
    if not found:
        where = "" if object_at is None else f" at {object_at[0]:g},{object_at[1]:g}"
        if tiny >= 5:
            raise ObservationError(
                f"the object{where} is {tiny} px across; at least {MIN_EXTENT} px are needed", extent=tiny
            )
        raise ObservationError(f"no object stands out{where or ' in the image'}", object_at=object_at)
    found.sort(key=lambda c: -c.score)
    return _distinct(found)


def silhouettes(grey: Grey, level: float, polarity: int, hidden: Grey | None, least: float = 30.0) -> list[Silhouette]:
    """Regions darker (polarity +1) or lighter (-1) than a level, of at least so many px^2, the largest first."""
    binary = kernels.soft_threshold(grey, 0, 0, grey.shape[1], grey.shape[0], level, polarity)
    if hidden is not None:
        binary[hidden != 0] = 0
    return trace(binary, least)


def judge(grey: Grey, shape: Silhouette, polarity: int, hidden: Grey | None) -> Candidate | None:
    """The silhouette as a candidate, or None where it cannot be an object."""
    share = shape.area / grey.size
    x, y, w, h = shape.box
    touched = (x <= 0) + (y <= 0) + (x + w >= grey.shape[1]) + (y + h >= grey.shape[0])
    if share > MAX_SHARE or touched >= 3:
        return None
    try:
        edge = localise(grey, shape.outer, hole=False, polarity=polarity, hidden=hidden)
    except ContourError:
        return None
    outer = edge.contour
    cut = 0.0 if outer.clipped is None else float(outer.clipped.mean())
    if cut > 0.5 or outer.strength is None:
        return None
    strength = outer.strength if outer.clipped is None else outer.strength[~outer.clipped]
    slope, step = float(np.median(strength)), (edge.outside - edge.inside) * polarity
    if not (slope > 0.0 and step >= MIN_STEP * slope):
        return None
    weakest = fifth(strength)
    contrast = weakest / (weakest + MIN_CONTRAST)
    complete = (1.0 - cut) ** 2 * (0.5 if touched else 1.0)
    roundness = 4.0 * math.pi * outer.area / outer.length**2
    smooth = min(1.0, 12.0 * roundness)
    size = min(1.0, math.sqrt(share / 0.02))
    score = contrast * complete * smooth * size
    if score < 0.02:
        return None
    kept = [outer]
    for chain in shape.holes[:MAX_HOLES]:
        hole = true_hole(grey, chain, edge, polarity, hidden)
        if hole is not None:
            kept.append(hole)
    return Candidate(View(kept), polarity, edge.inside, edge.outside, score)


def fifth(values: Floats) -> float:
    """The value that a fifth of the others lie below."""
    k = len(values) // 5
    return float(np.partition(values, k)[k])


def true_hole(
    grey: Grey, chain: NDArray[np.int32], outer: Localised, polarity: int, hidden: Grey | None
) -> Contour | None:
    """The hole's contour if its edge is sharp and the ground is seen through it; of a print seldom both are so."""
    try:
        hole = localise(grey, chain, hole=True, polarity=polarity, hidden=hidden)
    except ContourError:
        return None
    strength, reference = hole.contour.strength, outer.contour.strength
    if strength is None or reference is None:
        return None
    if fifth(strength) < HOLE_SHARPNESS * float(np.median(reference)):
        return None
    if not abs(hole.outside - outer.outside) <= HOLE_LEVEL * abs(outer.outside - outer.inside):
        return None
    return hole.contour


def _distinct(found: list[Candidate]) -> list[Candidate]:
    """The same object found with several thresholds counts once, as its best."""
    kept: list[tuple[float, float, float, Candidate]] = []
    for c in found:
        area = c.view.outer.area
        x, y = c.view.outer.points.mean(axis=0).tolist()
        if not any(0.8 < area / a < 1.25 and math.hypot(x - u, y - v) < 0.1 * math.sqrt(a) for a, u, v, _ in kept):
            kept.append((area, x, y, c))
    return [c for *_, c in kept]
