# SPDX-License-Identifier: Apache-2.0
"""Where the contacts truly are: on the part, in the image, and before the hand that closes."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.approach.case import Row
from grasptrack.bench.approach.choosing import turn_between
from grasptrack.bench.physics import World
from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.decision import contact_tolerance
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.typing import Floats


def on_part(world: World, contacts: Floats) -> Floats:
    """(k, 2) m, where contacts (k, 2) px lie on the part's upper face now."""
    return apply_homography(np.linalg.inv(world.outline_to_image()), contacts)


def record_closing_errors(row: Row, world: World, chosen: Floats, contacts: Floats) -> None:
    """Fill in what is true when the hand begins to close: contact_error_px, right, aside_mm, turned_deg.

    Args:
        row: of the trial.
        world: now.
        chosen: (k, 2) m, the contacts that were chosen, on the part.
        contacts: (k, 2) px, where the tracker says that they are.
    """
    seen, rings = apply_homography(world.outline_to_image(), chosen), _outline_in_image(world)
    row.contact_error_px = float(np.hypot(*(contacts - seen).T).max())
    row.right = max(row.contact_error_px, _max_outline_distance(seen, rings)) <= _contact_tolerance(rings)
    part, hand = world.part_pose(), world.pose()
    places = np.column_stack([chosen[:, 0], -chosen[:, 1], np.full(len(chosen), world.setting.part.thickness)])
    local = (places @ part[:3, :3].T + part[:3, 3] - hand[:3, 3]) @ hand[:3, :3]
    row.aside_mm = 1e3 * float(np.hypot(*local.mean(axis=0)[:2]))
    row.turned_deg = math.degrees(turn_between(local[:, :2], world.hand.tips(1.0)[:, :2]))


def _outline_in_image(world: World) -> list[NDArray[np.float32]]:
    """Rings (n, 2) px of the part's outline in the image, the outer one first."""
    size, H = world.setting.part.size, world.outline_to_image()
    return [apply_homography(H, ring * size).astype(np.float32) for ring in world.shape.polygons]


def _max_outline_distance(points: Floats, rings: list[NDArray[np.float32]]) -> float:
    """px, the farthest of some points (k, 2) from an outline."""
    return max(min(abs(cv2.pointPolygonTest(ring, (x, y), True)) for ring in rings) for x, y in points.tolist())


def _contact_tolerance(rings: list[NDArray[np.float32]]) -> float:
    """px within which contacts on an outline are right."""
    areas = [cv2.contourArea(ring) for ring in rings]
    return contact_tolerance(max(2.0 * areas[0] - sum(areas), 0.0), NUMBERS)
