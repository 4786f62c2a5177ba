# SPDX-License-Identifier: Apache-2.0
"""A belt full of equal parts, and a moment in the dark in which each goes to the place of the next: nobody can tell them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from datasets import SILHOUETTES
from grasptrack import GraspTracker
from grasptrack_bench.method import chosen_grasp
from grasptrack_bench.scenes import make_scene_cases, parts_from_silhouettes

PLATE = np.array([[0.0, 0], [70, 6], [66, 30], [34, 33], [28, 66], [-4, 60]])
FINER = 4


def belt(moved: float, space: float, seed: int, ahead: int) -> np.ndarray:
    """Plates `space` px apart that have moved by so many px, on an even ground with noise; so many are ahead of the first."""
    large = np.full((480 * FINER, 640 * FINER), 170, np.uint8)
    for k in range(-4, ahead + 1):
        corners = PLATE + np.array([25.0 + moved + k * space, 200.0])
        cv2.fillPoly(large, [np.rint(corners * FINER).astype(np.int32)], 60)
    image = cv2.GaussianBlur(cv2.resize(large, (640, 480), interpolation=cv2.INTER_AREA), (0, 0), 0.8)
    return np.clip(image + np.random.default_rng(seed).normal(0, 1.2, image.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("speed", "dark"), [(10.0, 8), (16.0, 4), (16.0, 8), (24.0, 3), (24.0, 6)])
@pytest.mark.parametrize("ahead", [4, 0])  # with none ahead, the first image shows but one
def test_an_equal_that_came_to_its_place_is_not_taken_for_it(speed: float, dark: int, ahead: int) -> None:
    tracker, first, found = GraspTracker(object_at=(45.0, 230.0)), None, 0
    for k in range(5 + dark + 5):
        seen = not 5 <= k < 5 + dark
        image = belt(speed * k, speed * (dark + 1), k, ahead) if seen else np.full((480, 640), 12, np.uint8)
        result = tracker.update(image)
        if result.contacts is None:
            continue
        first = result.contacts if first is None else first
        assert np.hypot(*(result.contacts - first - (speed * k, 0.0)).T).max() < 3.0
        found += 1
    assert found >= 5


@pytest.mark.slow
@pytest.mark.skipif(not SILHOUETTES.is_dir(), reason="needs the silhouettes of ../shared/data")
def test_an_equal_beside_the_object_that_a_hand_covers_is_not_taken_for_it() -> None:
    """The first view showed but half of the equal; later one image shows both, and the next ones the equal alone, clearly."""
    (part,) = [p for p in parts_from_silhouettes(str(SILHOUETTES)) if p.shape.name == "beetle-6"]
    (case,) = make_scene_cases([part], ["mixed"], frames=40, seed=9002)
    scene = case.scene()
    contacts = chosen_grasp(scene[0].outline)
    tracker, found = GraspTracker(grasp=contacts), 0
    for k in range(30):
        result = tracker.update(scene[k].image, time=scene[k].time)
        if result.contacts is not None:
            assert np.hypot(*(result.contacts - scene[k].carry(contacts)).T).max() < 8.0, k
            found += 1
    assert found > 10
