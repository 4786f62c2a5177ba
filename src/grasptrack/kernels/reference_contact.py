# SPDX-License-Identifier: Apache-2.0
"""Normal and flatness of an outline over the width of a finger."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_places import find_place
from grasptrack.typing import Floats

# Relative difference of the two variances below which no direction stands out.
ROUND = 1e-12


def _segments_around_place(contour: Floats, i: int, f: float, half: float) -> tuple[list[tuple[Floats, Floats]], float]:
    """Directed pieces of segments within `half` px of arc length on either side of a place, and their length."""
    n = len(contour)
    pieces: list[tuple[Floats, Floats]] = []
    place = contour[i] + f * (contour[(i + 1) % n] - contour[i])
    total = 0.0
    for way in (1, -1):
        left, here = half, place
        j = (i + 1) % n if way == 1 else i
        for _ in range(n + 1):
            there = contour[j]
            length = math.hypot(*(there - here))
            if length >= left:
                there = here + (left / length) * (there - here) if length > 0 else here
                length = left
            pieces.append((here, there) if way == 1 else (there, here))
            total += length
            left -= length
            if left <= 0:
                break
            here, j = there, (j + way) % n
    return pieces, total


def contact_frames(points: Floats, offsets: NDArray[np.int64], places: Floats, width: float) -> Floats:
    """The straight line that fits the outline best over +-width/2 px of arc length about each place.

    Integrals run along the curve, ends of segments included, so that the answer does not depend on how it is sampled.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        places: (k, >= 2) rows of contour, position.
        width: px, above 0; a wider finger sees less of the noise and more of the shape.

    Returns:
        (k, 4) nx, ny (unit, into the material; across the chord where no direction stands out), flatness (rms distance
        from the line / width), length used / width (below 1 where the contour is shorter).

    Raises:
        ValueError: a place out of range, or a width that is not above 0.
    """
    if not (width > 0 and math.isfinite(width)):
        raise ValueError(f"width must be above 0, not {width:g}")
    out = np.empty((len(places), 4))
    lengths: dict[int, float] = {}
    for row, where in zip(out, places, strict=True):
        first, n, i, f = find_place(offsets, where)
        contour = points[first : first + n]
        if first not in lengths:
            lengths[first] = sum(math.dist(contour[j], contour[(j + 1) % n]) for j in range(n))
        length = lengths[first]
        pieces, used = _segments_around_place(contour, i, f, min(width, length) / 2)
        # Coordinates about the place, x along its segment: a straight stretch then has exactly no variance across.
        side = contour[(i + 1) % n] - contour[i]
        reach = math.hypot(*side)
        tx, ty = side / reach if reach > 0 else (1.0, 0.0)
        origin = contour[i] + f * side
        turn = np.array([[tx, ty], [-ty, tx]])
        p = np.array([turn @ (a - origin) for a, _ in pieces])
        q = np.array([turn @ (b - origin) for _, b in pieces])
        span = np.hypot(*(q - p).T)
        total = float(span.sum())
        if total <= 0:
            raise ValueError("a contour without length has no normal")
        mx, my = (span[:, None] * (p + q)).sum(axis=0) / (2 * total)
        (px, py), (qx, qy) = p.T, q.T
        a = float((span * (px * px + px * qx + qx * qx)).sum()) / (3 * total) - mx * mx
        c = float((span * (py * py + py * qy + qy * qy)).sum()) / (3 * total) - my * my
        b = float((span * (2 * px * py + px * qy + qx * py + 2 * qx * qy)).sum()) / (6 * total) - mx * my
        dx, dy = (q - p).sum(axis=0)
        if used >= length * (1 - 1e-12) or math.hypot(dx, dy) <= 1e-12 * total:
            dx, dy = 1.0, 0.0
        radius = math.hypot((a - c) / 2, b)
        major = (a + c) / 2 + radius
        if 2 * radius <= ROUND * (a + c):
            ex, ey = dx / math.hypot(dx, dy), dy / math.hypot(dx, dy)
        else:
            angle = 0.5 * math.atan2(b, (a - c) / 2)
            ex, ey = math.cos(angle), math.sin(angle)
            lean = ex * dx + ey * dy
            # Across the chord neither sign is better: the segment at the place decides.
            if lean < -ROUND * total or (abs(lean) <= ROUND * total and ex < 0):
                ex, ey = -ex, -ey
        minor = max(a * c - b * b, 0.0) / major
        gx, gy = ex * tx - ey * ty, ex * ty + ey * tx
        row[:] = -gy, gx, math.sqrt(minor) / width, used / width
    return out
