# SPDX-License-Identifier: Apache-2.0
"""Ranked grasps made by hand: fingers straight behind their contacts, one square to the way in."""

import math

import numpy as np

from grasptrack.geometry.contours import Contour, Outline, as_view
from grasptrack.grasp.contacts import Grasp, GraspList, RankedGrasp, Terms
from grasptrack.grasp.hand import HandPx


def ellipse(a: float, b: float, centre: tuple[float, float], count: int = 200, hole: bool = False) -> Contour:
    t = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    return Contour(np.column_stack([a * np.cos(t), b * np.sin(t)]) + centre, hole=hole)


def hand_for(outline: Outline) -> HandPx:
    size = math.sqrt(as_view(outline).outer.area)
    return HandPx(0.0, math.inf, 0.12 * size, 0.1 * size, 0.05 * size)


def ranked(
    outline: Outline, contacts: object, quality: float = 0.8, *, spread: bool = False, region: float | None = None
) -> RankedGrasp:
    """A grasp whose fingers move toward, or away from, the contacts' middle."""
    view, hand = as_view(outline), hand_for(outline)
    at = Grasp(contacts).snapped(view).contacts  # type: ignore[arg-type]
    ways = at.mean(axis=0) - at
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ways = -ways if spread else ways
    across = np.column_stack([-ways[:, 1], ways[:, 0]]) * 0.5 * hand.finger_width

    def rectangles(depth: float) -> np.ndarray:
        back = at - depth * ways
        return np.stack([at - across, at + across, back + across, back - across], axis=1)

    half = 0.1 * math.sqrt(view.outer.area) if region is None else region
    return RankedGrasp(
        at,
        quality,
        Terms(0.9, 0.95, 0.98, quality, 0.97),
        spread=spread,
        margin=0.3,
        directions=ways,
        regions=np.full(len(at), half),
        fingers=rectangles(hand.finger_thickness),
        swept=rectangles(hand.finger_thickness + hand.clearance),
    )


def across(outline: Outline, count: int = 1, fingers: int = 2, spread: bool = False) -> GraspList:
    """Grasps on the outer contour, contacts evenly spread in index, the i-th list a little farther round."""
    view = as_view(outline)
    curve = view.contours[-1] if spread else view.outer
    grasps = []
    for i in range(count):
        first = i * len(curve) // (fingers * max(count, 1))
        index = [(first + k * len(curve) // fingers) % len(curve) for k in range(fingers)]
        grasps.append(ranked(view, curve.points[index], 0.9 - 0.05 * i, spread=spread))
    return GraspList(grasps)
