# SPDX-License-Identifier: Apache-2.0
"""Where the parts of a grasp's drawing lie: cones, and the strips in which contacts may slip."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from grasptrack.segmentation.undistortion import SeenGrasp
from grasptrack.typing import Floats

if TYPE_CHECKING:
    from grasptrack.geometry.contours import View
    from grasptrack.grasp.contacts import RankedGrasp


def grasp_opening(grasp: RankedGrasp) -> float:
    """Px by which the hand opens: two contacts' distance; twice the way of the farthest of more to their mean."""
    contacts = grasp.straight if isinstance(grasp, SeenGrasp) else grasp.contacts
    if len(grasp) == 2:
        return math.dist(contacts[0], contacts[1])
    return 2.0 * float(np.linalg.norm(contacts - contacts.mean(axis=0), axis=1).max())


def sector_polygon(apex: Floats, direction: Floats, half_angle: float, length: float) -> Floats:
    """A sector as a closed polygon (m, 2) px.

    Args:
        apex: (2,) px.
        direction: (2,) of its middle.
        half_angle: rad.
        length: px from apex to arc.
    """
    angles = math.atan2(direction[1], direction[0]) + half_angle * np.linspace(-1.0, 1.0, 17)
    return np.vstack([apex, apex + length * np.column_stack([np.cos(angles), np.sin(angles)])])


def inward_normals(grasp: RankedGrasp, view: View, friction: float) -> Floats:
    """(k, 2) unit normals into the material; where the analysis refuses the outline, the directions of motion."""
    from grasptrack.errors import GraspError
    from grasptrack.grasp.force_closure import analyze

    try:
        return analyze(grasp, view, friction).normals
    except GraspError:
        return grasp.directions


def slip_strips(grasp: RankedGrasp, view: View) -> list[Floats]:
    """For each contact the piece of outline (m, 2) px within its region; empty where it may not slip at all."""
    return [
        contour_strip(view, int(contour), position, region)
        for (contour, position, _), region in zip(grasp.on(view).tolist(), grasp.regions.tolist(), strict=True)
    ]


def contour_strip(view: View, contour: int, position: float, half: float) -> Floats:
    """The piece of one contour that reaches `half` px of arc length to both sides of a position.

    Args:
        view: the outline.
        contour, position: a place on it.
        half: px; the whole contour where it is no longer than twice that.

    Returns:
        (m, 2) px along the outline; (0, 2) where `half` is not positive.
    """
    if not half > 0.0:
        return np.zeros((0, 2))
    curve = view.contours[contour]
    arc, length = curve.arc_length, curve.length
    closed = np.vstack([curve.points, curve.points[:1]])
    half = min(half, 0.5 * length)
    middle = float(np.interp(position, np.arange(len(arc)), arc))
    knots = np.concatenate([arc[:-1] - length, arc[:-1], arc[:-1] + length])
    between = knots[(knots > middle - half) & (knots < middle + half)]
    at = np.concatenate([[middle - half], between, [middle + half]]) % length
    return np.column_stack([np.interp(at, arc, closed[:, axis]) for axis in (0, 1)])
