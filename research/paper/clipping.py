# SPDX-License-Identifier: Apache-2.0
"""Outlines of which a straight border hides a share, as they would be extracted from an image that ends there."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.typing import Bools, Floats
from grasptrack_bench.baselines.paper import Seen
from research.paper.footage import POINTS, FilmedPart, Footage, camera_trajectory, moved_curves, path_homographies

CLIPPED = (10, 25, 40)
"""Per cent of the outline's length that the border hides."""
DIRECTIONS = 16
"""Of the border that are tried."""
BESIDE = 2
"""Frames before and after one with such a share that are counted with it."""


def clipped_footage(part: FilmedPart, seed: int) -> Footage | None:
    """An object of which a border hides one per cent more of the outline from frame to frame, while the camera moves.

    Only the outer contour is looked at, because the homography needs no other.

    Returns:
        The footage of 6 DoF, its frame k with k per cent hidden; None where no border leaves the outline in one piece with
        both contacts in view, or a contact is on a hole.
    """
    frames = CLIPPED[-1] + BESIDE + 1
    if Grasp(part.contacts).on(part.reference)[:, 0].any():
        return None
    H = path_homographies(camera_trajectory("6 DoF", frames, seed))
    rng = np.random.default_rng((seed, 43))
    starts = rng.random(frames)
    curves = [moved_curves(part, h)[0] for h in H]
    truth = [apply_homography(h, part.contacts) for h in H]
    for angle in rng.uniform(0.0, 2.0 * math.pi) + np.arange(DIRECTIONS) * (2.0 * math.pi / DIRECTIONS):
        normal = np.array([math.cos(angle), math.sin(angle)])
        views = []
        for k, (curve, contacts) in enumerate(zip(curves, truth, strict=True)):
            view = clipped_view(curve, normal, k / 100.0, float(starts[k]), contacts)
            if view is None:
                break
            views.append(view)
        else:
            areas = np.array([kernels.polygon_moments(c, np.array([0, len(c)])).area for c in curves])
            seen: tuple[Seen, ...] = tuple(views)
            return Footage(part, "resampled", "6 DoF", H, areas, seen, seen, part.contacts, part.contacts)
    return None


def clipped_view(curve: Floats, normal: Floats, share: float, start: float, contacts: Floats) -> View | None:
    """What a border leaves of a curve.

    Args:
        curve: (N, 2) px, closed.
        normal: (2,) unit vector out of the image.
        share: of the curve's length that lies beyond the border.
        start: of the new contour's first point, in its steps.
        contacts: (k, 2) px that have to stay in view.

    Returns:
        The curve sampled as densely as `POINTS` points sample all of it, with the points on the border marked; None where a
        contact is hidden, or what is left is in pieces.
    """
    length = float(kernels.arc_length(curve)[-1])
    dense = kernels.resample(curve, 8 * POINTS, 0.0)
    across = dense @ normal
    border = float(np.quantile(across, 1.0 - share)) if share > 0.0 else float(across.max()) + 1.0
    if (contacts @ normal).max() >= border:
        return None
    kept, cut = clip_polygon(dense, normal, border)
    if cut is None:
        return None
    count = max(24, round(POINTS * float(kernels.arc_length(kept)[-1]) / length))
    moved = np.roll(kernels.resample(kept, 8 * count, 0.0), -round(8 * start), axis=0)[::8]
    return View(Contour.trusted(moved, clipped=np.abs(moved @ normal - border) < 1e-6))


def clip_polygon(points: Floats, normal: Floats, border: float) -> tuple[Floats, Bools | None]:
    """What is left (M, 2) of a closed polygon (N, 2) cut off where normal . x > border, and (M,) which points lie on that.

    None is left where all lies beyond, and the border's piece is between each way out and in. The second is None where pieces
    of it overlap, so that what is left is not in one piece.
    """
    beyond = points @ normal - border
    if (beyond <= 0.0).all():
        return points, np.zeros(len(points), dtype=np.bool_)
    if (beyond > 0.0).all():
        return points[:0], np.zeros(0, dtype=np.bool_)
    first = int(np.flatnonzero(beyond <= 0.0)[0])
    points, beyond = np.roll(points, -first, axis=0), np.roll(beyond, -first)
    kept: list[Floats] = []
    on: list[bool] = []
    ends: list[float] = []
    along = np.array([-normal[1], normal[0]])
    for (a, u), (b, v) in pairwise([*zip(points, beyond.tolist(), strict=True), (points[0], float(beyond[0]))]):
        if u <= 0.0:
            kept.append(a)
            on.append(False)
        if (u <= 0.0) != (v <= 0.0):
            crossing = a + u / (u - v) * (b - a)
            kept.append(crossing)
            on.append(True)
            ends.append(float(crossing @ along))
    pieces = sorted(sorted(pair) for pair in zip(ends[::2], ends[1::2], strict=True))
    apart = all(one[1] <= other[0] for one, other in pairwise(pieces))
    return np.array(kept), np.array(on) if apart else None
