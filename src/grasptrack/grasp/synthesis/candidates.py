# SPDX-License-Identifier: Apache-2.0
"""Where contacts may lie: places evenly spread over all contours, with their normals and how flat the outline is there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.contours import View
from grasptrack.typing import Floats

GROUPS = 120
"""Stretches of outline of which each two give at most one pair."""
GROUP = 6
"""Candidates in each of them: a pair that closes only in a narrow place needs them close together."""
LEAST_GROUPS = 4
"""On each contour, however short."""


class Candidates(NamedTuple):
    """Places on an outline at which a finger may stand.

    Attributes:
        places: (m, 2) contour, position.
        contacts: (m, 2) px.
        normals: (m, 2) unit, into the material, over the width of a finger.
        roughness: (m,) rms distance of the outline from a straight line in finger widths: under the pad, or half of
            that over twice the width where this is more, for a finger that slips should still stand on something flat.
        usable: (m,) False within a finger's width of where the image border cuts the object.
        starts: (C + 1,) contour c has the candidates ``starts[c]:starts[c + 1]``.
        steps: (C,) px of arc length between neighbours.
        size: px, sqrt(area).
        centroid: (2,) px.
    """

    places: Floats
    contacts: Floats
    normals: Floats
    roughness: Floats
    usable: NDArray[np.bool_]
    starts: NDArray[np.int64]
    steps: Floats
    size: float
    centroid: Floats


def sample_candidates(view: View, area: float, centroid: Floats, width: float) -> Candidates:
    """Candidates on all contours of a view, for fingers of a width in px."""
    total = sum(c.length for c in view.contours)
    rows, usable, starts, steps = [], [], [0], []
    for index, contour in enumerate(view.contours):
        n = GROUP * max(round(GROUPS * contour.length / total), LEAST_GROUPS)
        s = np.arange(n) * (contour.length / n)
        rows.append(np.empty((n, 2)))
        rows[-1][:, 0] = index
        rows[-1][:, 1] = np.interp(s, contour.arc_length, np.arange(len(contour) + 1, dtype=np.float64))
        usable.append(np.ones(n, dtype=np.bool_))
        if contour.clipped is not None:
            cut = contour.arc_length[:-1][contour.clipped]
            gap = np.abs(s[:, None] - cut[None, :])
            between = (contour.clipped & np.roll(contour.clipped, -1))[rows[-1][:, 1].astype(np.int64)]
            usable[-1] = (np.minimum(gap, contour.length - gap).min(axis=1) > width) & ~between
        starts.append(starts[-1] + n)
        steps.append(contour.length / n)
    places = np.concatenate(rows)
    frames = kernels.contact_frames(view.points, view.offsets, places, width)
    beside = kernels.contact_frames(view.points, view.offsets, places, 2.0 * width)[:, 2]
    return Candidates(
        places,
        kernels.point_at(view.points, view.offsets, places),
        np.ascontiguousarray(frames[:, :2]),
        np.maximum(frames[:, 2], 0.5 * beside),
        np.concatenate(usable),
        np.array(starts, dtype=np.int64),
        np.array(steps),
        math.sqrt(area),
        centroid,
    )


def thin_candidates(at: Candidates, count: int) -> NDArray[np.int64]:
    """Indices of about so many usable candidates, evenly spread, at least two for each of a contour's least groups."""
    lengths = np.diff(at.starts) * at.steps
    rows = []
    for start, end, length in zip(at.starts[:-1], at.starts[1:], lengths, strict=True):
        n = int(end - start)
        few = min(max(round(count * float(length / lengths.sum())), 2 * LEAST_GROUPS), n)
        rows.append(start + np.arange(few) * n // few)
    chosen: NDArray[np.int64] = np.concatenate(rows)
    return chosen[at.usable[chosen]]
