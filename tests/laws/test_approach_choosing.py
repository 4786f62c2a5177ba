# SPDX-License-Identifier: Apache-2.0
"""What the hand goes for: grasps that leave room for its fingers, however little is known of the part's size."""

import numpy as np
import pytest

from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack_bench.approach.choosing import closing_grasps, hand_for
from grasptrack_bench.approach.trial import KNOWN
from grasptrack_bench.physics.gripper import BESIDE, MAX_OPENING
from grasptrack_bench.simulation import SHAPES
from grasptrack_bench.simulation.coverage import subdivide_polygon

SCALE = 150.0


@pytest.mark.sampled(4)
@pytest.mark.parametrize("told", [1.0 - KNOWN, 1.0 + KNOWN])
@pytest.mark.parametrize("name", ["disc", "rectangle", "guitar", "notched-plate"])
@pytest.mark.parametrize("fingers", [2, 3])
def test_fingers_have_room_beside_a_part_that_is_larger_than_told(name: str, fingers: int, told: float) -> None:
    shape, placed = SHAPES[name](), similarity_transform(SCALE, 0.3, (0.0, 0.0), (320.0, 240.0))
    outline = View([
        Contour(apply_homography(placed, subdivide_polygon(r, 0.02)), hole=k > 0) for k, r in enumerate(shape.polygons)
    ])  # fmt: skip
    for size in (0.05, 0.07, 0.095):
        grasps, _ = closing_grasps(outline, fingers, hand_for(told * size, KNOWN))
        arms = [g.contacts - g.contacts.mean(axis=0) for g in grasps]
        across = [2.0 * np.hypot(*arm.T).mean() * size / SCALE for arm in arms]
        assert max(across, default=0.0) <= MAX_OPENING - 2.0 * BESIDE + 1e-3, size
