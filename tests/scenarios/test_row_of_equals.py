# SPDX-License-Identifier: Apache-2.0
"""A belt full of equal parts, and a moment in the dark in which each goes to the place of the next: nobody can tell them."""

import cv2
import numpy as np
import pytest

from datasets import SILHOUETTES
from grasptrack import GraspTracker
from grasptrack_bench.method import chosen_grasp
from grasptrack_bench.scenes import make_scene_cases, parts_from_silhouettes

PLATE = np.array([[0.0, 0], [70, 6], [66, 30], [34, 33], [28, 66], [-4, 60]])
FINER = 4


def belt(moved: float, space: float, seed: int, ahead: int, behind: int = 4) -> np.ndarray:
    """Plates `space` px apart that have moved by so many px, on an even ground; so many are ahead of the first and behind."""
    large = np.full((480 * FINER, 640 * FINER), 170, np.uint8)
    for k in range(-behind, ahead + 1):
        corners = PLATE + np.array([25.0 + moved + k * space, 200.0])
        cv2.fillPoly(large, [np.rint(corners * FINER).astype(np.int32)], 60)
    image = cv2.GaussianBlur(cv2.resize(large, (640, 480), interpolation=cv2.INTER_AREA), (0, 0), 0.8)
    return np.clip(image + np.random.default_rng(seed).normal(0, 1.2, image.shape), 0, 255).astype(np.uint8)


STARTING = np.cumsum([0.0, 0.05, 0.15, 0.3, 0.5, 0.75, 1.0])
"""How far a belt goes in its first images, in ways of an image at its speed."""


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("speed", "dark"), [(10.0, 8), (16.0, 4), (16.0, 8), (24.0, 3), (24.0, 6)])
@pytest.mark.parametrize("ahead", [4, 0])  # with none ahead, the first image shows but one
def test_an_equal_that_came_to_its_place_is_not_taken_for_it(speed: float, dark: int, ahead: int) -> None:
    tracker, first, found, lit = GraspTracker(object_at=(45.0, 230.0)), None, 0, len(STARTING)
    way = speed * np.concatenate([STARTING, STARTING[-1] + np.arange(1, dark + 6)])
    for k, moved in enumerate(way.tolist()):
        seen = not lit <= k < lit + dark
        image = belt(moved, speed * (dark + 1), k, ahead) if seen else np.full((480, 640), 12, np.uint8)
        if (contacts := tracker.update(image).contacts) is not None:
            first, found = contacts if first is None else first, found + 1
            assert np.hypot(*(contacts - first - (moved, 0.0)).T).max() < 3.0
    assert found >= lit


def followed(way: list[float], rate: float = 30.0, ahead: int = 5, behind: int = 4) -> int:
    """In how many images of a belt that goes this way, px, the plate at x = 365 is found; another one never is."""
    tracker, first, found = GraspTracker(object_at=(365.0, 230.0)), None, 0
    for k, moved in enumerate(way):
        contacts = tracker.update(belt(320.0 + moved, 160.0, k, ahead, behind), time=k / rate).contacts
        if contacts is not None:
            first, found = contacts if first is None else first, found + 1
            assert np.hypot(*(contacts - first - (moved, 0.0)).T).max() < 3.0, k
    return found


@pytest.mark.sampled(3)
@pytest.mark.parametrize("rate", [5.0, 30.0])
@pytest.mark.parametrize("step", [3.0, -150.0, 20.0, 150.0, 85.0, 140.0, 170.0])
def test_the_next_part_is_not_taken_for_it_where_the_step_is_near_the_pitch(step: float, rate: float) -> None:
    """How fast a belt may be, nobody said; a step of a fiftieth of the pitch is no step of all of it."""
    assert followed([step * k for k in range(5)], rate) == (5 if step == 3.0 else 1)


@pytest.mark.parametrize(("step", "found"), [(20.0, 5), (-20.0, 5), (12.0, 5), (140.0, 1), (-140.0, 1)])
def test_a_row_that_ends_in_view_shows_how_far_it_went(step: float, found: int) -> None:
    assert followed([step * k for k in range(5)], ahead=1, behind=int(found < 5)) >= found


@pytest.mark.parametrize(
    "way", [[0.0, 0, 140, 280], [0.0, 0, 0, 140, 140], [0.0, 3, 6, 9, 12, 160], [0.0, 0, 0, 45, 110, 160]]
)
def test_a_belt_that_waits_and_goes_on_by_most_of_the_pitch_is_not_believed(way: list[float]) -> None:
    """An image shown twice, a belt that stops at each station, images that were dropped."""
    assert followed(way) == next(k for k in range(1, len(way)) if abs(way[k] - way[k - 1]) > 30.0)


@pytest.mark.parametrize("way", [[0.0, 2, -1, 3, -3, 4, 0, -4, 2, 5], [0.0, 1, 3, 6, 10, 15, 21, 28, 36, 45]])
def test_a_row_that_a_hand_shakes_or_that_speeds_up_is_followed(way: list[float]) -> None:
    assert followed(way) == len(way)


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
