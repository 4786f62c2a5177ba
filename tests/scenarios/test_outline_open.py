# SPDX-License-Identifier: Apache-2.0
"""A first outline that holds more than the object: a grasp on what stays behind is not given."""

import cv2
import numpy as np
import pytest

from grasptrack import Grasp, GraspTracker
from grasptrack.geometry.contours import View
from grasptrack.tracking.numbers import NUMBERS

GROUND = cv2.GaussianBlur(np.random.default_rng(1).normal(0.0, 1.0, (480, 640)), (0, 0), 2.0)
PRINT = cv2.GaussianBlur(np.random.default_rng(2).normal(0.0, 1.0, (90, 90)), (0, 0), 1.5)
HEIGHT = 240.0


def scene(moved: int, seed: int) -> np.ndarray:
    """A printed plate that slides to the left, away from a thin bar of its tone that it touched, on grained ground."""
    image = 150.0 + 60.0 * GROUND
    left = 300 - moved
    image[200:290, left : left + 90] = 60.0 + 80.0 * PRINT
    image[200:290, 389:399] = 60.0
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    return np.clip(image + np.random.default_rng(seed).normal(0, 1.2, image.shape), 0, 255).astype(np.uint8)


def across(view: View) -> list[Grasp]:
    """Two contacts at the same height, one at either end."""
    points = view.outer.points
    ends = [points[np.argmin(points[:, 0]), 0], points[np.argmax(points[:, 0]), 0]]
    return [Grasp(np.array([points[np.argmin(np.hypot(points[:, 0] - x, points[:, 1] - HEIGHT))] for x in ends]))]


@pytest.mark.parametrize("speed", [2, 6])
def test_a_contact_on_what_stays_behind_is_not_given(speed: int) -> None:
    tracker, codes = GraspTracker(object_at=(340.0, HEIGHT), choose=across), list[str]()
    for k in range(25):
        result = tracker.update(scene(speed * k, k), time=k / 30.0)
        codes.append(result.reason_code)
        if speed * k > 2.0 * NUMBERS.unseen_px and result.contacts is not None:
            assert result.contacts[:, 0].max() - (390.0 - speed * k) < 5.0, k
    assert "outline-open" in codes
