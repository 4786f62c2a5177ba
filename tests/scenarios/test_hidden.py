# SPDX-License-Identifier: Apache-2.0
"""What is hidden: a camera on a hand sees its own fingers, and what they show is nobody's edge."""

import cv2
import numpy as np
import pytest

from grasptrack import GraspTracker
from grasptrack_bench.simulation import SHAPES, Conditions, Path, Scene

FINGER = (300, 0, 44, 480)
"""Left, top, width and height of a bar before the camera; it is marked 4 px wider on each side."""


def finger(image: np.ndarray, grey: int) -> np.ndarray:
    left, top, width, height = FINGER
    out = image.copy()
    cv2.rectangle(out, (left, top), (left + width, top + height), grey, -1)
    return out


def mark() -> np.ndarray:
    left, _, width, _ = FINGER
    out = np.zeros((480, 640), np.uint8)
    out[:, left - 4 : left + width + 5] = 255
    return out


@pytest.mark.sampled(1)
@pytest.mark.parametrize("grey", [0, 255])
def test_a_part_is_followed_behind_the_hand_that_reaches_for_it(grey: int) -> None:
    """The reference shows it beside the finger; it then passes behind."""
    count, zero = 22, np.zeros(22)
    target = np.column_stack([np.linspace(0.75, -0.35, count), zero])
    path = Path(target, np.full(count, 4.0), zero + 0.3, zero, zero)
    frames = Scene(SHAPES["bracket"](), path, conditions=Conditions(noise=1.0), seed=3)
    tracker, first, found = GraspTracker(ignore=mark()), None, 0
    for frame in frames:
        result = tracker.update(finger(frame.image, grey))
        if result.contacts is None:
            continue
        first = result.contacts if first is None else first
        assert np.hypot(*(result.contacts - frame.carry(first)).T).max() < 3.0
        found += result.status != "lost"
    assert found == len(frames)
