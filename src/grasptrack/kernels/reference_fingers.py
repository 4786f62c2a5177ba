# SPDX-License-Identifier: Apache-2.0
"""What of an outline lies in the rectangle that a finger sweeps."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_places import find_place
from grasptrack.typing import Floats, Ints

# Of half the width: what only touches a finger's side is not in its way.
WITHIN_PAD = 1 - 1e-9


def finger_clearance(
    points: Floats,
    offsets: Ints,
    contacts: Floats,
    directions: Floats,
    places: Floats | None,
    width: float,
    depth: float,
    reach: float,
) -> Floats:
    """How far the outline protrudes into each finger's rectangle under the pad, and what else of it lies there.

    The rectangle reaches from the contact `depth` px against the finger's direction, and width / 2 to either side.
    Segments, not points, are looked at, and a rectangle whose far end lies in material is not free either.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        contacts: (k, 2) px, the middle of each pad.
        directions: (k, 2) unit vectors in which each finger pushes.
        places: (k, >= 2) rows of contour, position of each contact; None where the outline is another object's, of
            which nothing lies under a pad.
        width: px, above 0.
        depth: px; with next to 0 there is no rectangle.
        reach: px of arc length on either side of a contact; segments that begin within it are under the pad.

    Returns:
        (k, 2) the largest distance behind the pad's face of what is under it, 0 where nothing protrudes; the least
        of anything else in the rectangle, inf where there is nothing. Both px.

    Raises:
        ValueError: lengths that differ, a place out of range, a width not above 0, depth or reach below 0.
    """
    count = len(contacts)
    if len(directions) != count or (places is not None and len(places) != count):
        raise ValueError("each contact needs its direction and its place")
    if not (width > 0 and math.isfinite(width)) or not 0 <= depth < math.inf or not 0 <= reach < math.inf:
        raise ValueError(f"width must be above 0, depth and reach at least 0, not {width:g}, {depth:g} and {reach:g}")
    ends = points[_segment_end_indices(offsets)]
    out = np.empty((count, 2))
    for k, (row, contact, direction) in enumerate(zip(out, contacts, directions, strict=True)):
        under = np.zeros(len(points), dtype=np.bool_)
        if places is not None:
            under = _segments_under_pad(points, offsets, places[k], reach)
        row[:] = _finger_clearance(points, ends, contact, direction, under, width, depth)
    return out


def _segment_end_indices(offsets: Ints) -> Ints:
    """(N,) index of the point that ends each segment."""
    index: Ints = np.arange(1, offsets[-1] + 1)
    index[offsets[1:] - 1] = offsets[:-1]
    return index


def _segments_under_pad(points: Floats, offsets: Ints, place: Floats, reach: float) -> NDArray[np.bool_]:
    """(N,) which segments begin within `reach` px of arc length of a place, the place's own among them."""
    first, n, i, f = find_place(offsets, place)
    contour = points[first : first + n]
    under = np.zeros(len(points), dtype=np.bool_)
    under[first + i] = True

    def side(j: int) -> float:
        return math.dist(contour[j], contour[(j + 1) % n])

    for way, left in ((1, reach - (1 - f) * side(i)), (-1, reach - f * side(i))):
        j = (i + way) % n
        for _ in range(n - 1):
            if not left > 0:
                break
            under[first + j] = True
            left -= side(j)
            j = (j + way) % n
    return under


def _finger_clearance(
    points: Floats,
    ends: Floats,
    contact: Floats,
    direction: Floats,
    under: NDArray[np.bool_],
    width: float,
    depth: float,
) -> tuple[float, float]:
    """Protrusion under the pad, and distance of what else lies in the rectangle."""
    least = 1e-9 * width  # of a rectangle, and of what lies in it: less is rounding
    if not depth > least:
        return 0.0, math.inf
    half = width / 2 * WITHIN_PAD
    frame = np.array([[-direction[1], direction[0]], [-direction[0], -direction[1]]])
    (px, py), (qx, qy) = frame @ (points - contact).T, frame @ (ends - contact).T
    with np.errstate(divide="ignore", invalid="ignore"):
        t, u = (-half - px) / (qx - px), (half - px) / (qx - px)
    level = px == qx
    start = np.where(level, 0.0, np.clip(np.minimum(t, u), 0.0, None))
    end = np.where(level, 1.0, np.clip(np.maximum(t, u), None, 1.0))
    y0, y1 = py + start * (qy - py), py + end * (qy - py)
    low, high = np.minimum(y0, y1), np.maximum(y0, y1)
    beside = ((px >= half) & (qx >= half)) | ((px <= -half) & (qx <= -half))
    there = ~beside & (high > least) & (low < depth)
    protrusion = float(high[there & under].max(initial=0.0))
    nearest = float(np.maximum(low[there & ~under], 0.0).min(initial=math.inf))
    if nearest == math.inf and _contains_point(points, ends, contact - depth * direction):
        nearest = 0.0
    return protrusion, nearest


def _contains_point(points: Floats, ends: Floats, at: Floats) -> bool:
    """Even-odd, so that holes are outside."""
    astride = (points[:, 1] > at[1]) != (ends[:, 1] > at[1])
    p, q = points[astride], ends[astride]
    crossing = p[:, 0] + (at[1] - p[:, 1]) / (q[:, 1] - p[:, 1]) * (q[:, 0] - p[:, 0])
    return bool((at[0] < crossing).sum() % 2)
