# SPDX-License-Identifier: Apache-2.0
"""A thin tool pushed fast before a camera whose shutter is open but for a moment, which nothing says beforehand."""

import numpy as np
import pytest

from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.tracker import GraspTracker
from screwdriver import MIDDLE, TOOL, exposed

TOLERANCE = 3.0
"""px by which a contact of something so small may be off."""


@pytest.mark.parametrize(("step", "way", "turn", "spin"), [(9.0, -1.07, 0.5, 0.01), (4.0, -1.0, 0.2, 0.012)])
def test_a_tool_does_not_slide_along_itself(step: float, way: float, turn: float, spin: float) -> None:
    """Blur that was only believed hid the ends, and print of the bench bore the believed answer out: it was off by 9 px."""
    tracker, first = None, np.empty((0, 2))
    for k in range(16):
        moved = max(0, k - 4)
        place = (200.0 + moved * step * np.cos(way), 200.0 + moved * step * np.sin(way))
        image, pose = exposed(place, turn + spin * moved, seed=k)
        if tracker is None:
            tracker, start = GraspTracker(outline=apply_homography(pose, TOOL + MIDDLE)), pose
        result = tracker.update(image, time=k / 30.0)
        if result.contacts is None:
            continue
        first = result.contacts if k == 0 else first
        away = result.contacts - apply_homography(pose @ np.linalg.inv(start), first)
        assert np.hypot(*away.T).max() < TOLERANCE, (k, away)
