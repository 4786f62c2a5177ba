# SPDX-License-Identifier: Apache-2.0
"""What it means that a grasp still closes, place by place: what the regions are held against."""

from __future__ import annotations

import math

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import Outline
from grasptrack.grasp.force_closure import FINGER_WIDTH
from grasptrack.typing import Bools, Floats


def closes_after(outline: Outline, contacts: Floats, slips: Floats, friction: float) -> Bools:
    """(n,) whether a grasp closes after its contacts have slipped along the outline.

    Args:
        outline: a Contour or View.
        contacts: (k, 2) px, the grasp's; they are moved onto the outline.
        slips: (n, k) px of arc length, along the direction of the contours.
        friction: Coulomb coefficient.
    """
    n, k = slips.shape
    places = np.empty((n, k, 2))
    for i, (contour, position, _) in enumerate(
        kernels.project_to_contour(outline.points, outline.offsets, contacts).tolist()
    ):
        line = outline.contours[int(contour)]
        s = line.arc_length
        here = np.interp(position, np.arange(len(s)), s)
        places[:, i, 0] = contour
        places[:, i, 1] = np.interp(np.mod(here + slips[:, i], line.length), s, np.arange(len(s))) % len(line)
    return _closure_at_places(outline, places.reshape(-1, 2), n, k, friction)


def closes_at(outline: Outline, points: Floats, friction: float) -> Bools:
    """(n,) whether contacts at the places of an outline that are nearest to points (n, k, 2) px close."""
    n, k = points.shape[:2]
    places = kernels.project_to_contour(outline.points, outline.offsets, np.ascontiguousarray(points.reshape(-1, 2)))
    return _closure_at_places(outline, places, n, k, friction)


def _closure_at_places(outline: Outline, places: Floats, n: int, k: int, friction: float) -> Bools:
    area, cx, cy, *_ = kernels.polygon_moments(outline.points, outline.offsets)
    size, angle = math.sqrt(area), math.atan(friction)
    contacts = kernels.point_at(outline.points, outline.offsets, places).reshape(n, k, 2)
    frames = kernels.contact_frames(outline.points, outline.offsets, places, FINGER_WIDTH * size)
    normals = np.ascontiguousarray(frames[:, :2]).reshape(n, k, 2)
    good = np.zeros(n, dtype=np.bool_)
    for i in range(n):
        epsilon, needed = kernels.force_closure(contacts[i], normals[i], cx, cy, 0.5 * size, friction)
        good[i] = epsilon > 0.0 and needed < angle
    return good
