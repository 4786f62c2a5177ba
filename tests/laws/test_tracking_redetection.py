# SPDX-License-Identifier: Apache-2.0
"""Laws of the search for a lost object: it is found wherever it lies, at a bounded number of tries, and nothing raises."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.pose import Hypothesis, max_contact_distance
from grasptrack.tracking.redetection import MATCHED, MAX_SOLVED, MAX_WAYS, wide_prior
from grasptrack.tracking.target import build_pyramid
from grasptrack_bench.simulation import SHAPES, Shape
from stages import HEIGHT, WIDTH, bar, photo, pose

FIRST = pose(160.0, 120.0, -40.0)
AWAY, SOON = 10, 5
"""Images without the object, and those within which it is found again."""
FLAT = np.full((HEIGHT, WIDTH), 128, np.uint8)


class Begun(NamedTuple):
    """A follower, the object's shape, and its contacts (2, 2) in table units."""

    follower: Follower
    shape: Shape
    contacts: np.ndarray

    def at(self, H: np.ndarray) -> np.ndarray:
        """(2, 2) px, the contacts at a pose."""
        return apply_homography(H, self.contacts)


def outline(points: np.ndarray, hole: bool = False) -> Contour:
    ahead = np.roll(points, -1, axis=0) - points
    count = np.maximum(1, np.round(np.hypot(*ahead.T))).astype(int)
    pieces = [a + np.arange(n)[:, None] / n * d for a, d, n in zip(points, ahead, count, strict=True)]
    return Contour(np.concatenate(pieces), hole=hole)


def begun(name: str) -> Begun:
    """Seen three times."""
    shape = SHAPES[name]()
    rings = [apply_homography(FIRST, p) for p in shape.polygons]
    contacts = shape.outer[[0, len(shape.outer) // 2]]
    view = View([outline(p, k > 0) for k, p in enumerate(rings)])
    follower = Follower(photo([(shape, FIRST)]), view, apply_homography(FIRST, contacts))
    for k in range(2):
        assert follower.update(photo([(shape, FIRST)], seed=k)).is_accepted
    return Begun(follower, shape, contacts)


@pytest.mark.parametrize(("name", "turns"), [("gear", 14), ("star", 5), ("hex-nut", 6), ("bracket", 1)])
def test_all_turns_under_which_an_outline_fits_itself_are_known(name: str, turns: int) -> None:
    found = begun(name).follower.target.turns
    angles = sorted(math.degrees(math.atan2(T[1, 0], T[0, 0])) % 360.0 for T in found)
    assert angles == pytest.approx([360.0 / turns * k for k in range(1, turns)], abs=0.3)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", ["bracket", "hook", "half-disc"])
@pytest.mark.parametrize("degrees", [-40.0, 30.0, 100.0, 170.0, 240.0])
def test_what_comes_back_is_found_soon_wherever_and_however_it_lies(name: str, degrees: float) -> None:
    scene = begun(name)
    for k in range(AWAY):
        assert not scene.follower.update(photo([], seed=10 + k)).is_accepted
    H = pose(105.0 + 0.4 * degrees, 115.0, degrees, tilt=15.0)  # the table is seen: nothing on it becomes smaller
    for k in range(SOON):
        decision = scene.follower.update(photo([(scene.shape, H)], seed=30 + k))
        if decision.is_accepted:
            break
    assert decision.is_accepted and decision.estimate is not None
    assert max_contact_distance(decision.estimate.contacts, scene.at(H)) < 3.0
    assert scene.follower.state.sighted is None


def test_images_of_nothing_raise_nothing_and_show_nothing() -> None:
    scene = begun("bracket")
    noise = np.random.default_rng(1).integers(0, 256, FLAT.shape).astype(np.uint8)
    for image in (np.zeros_like(FLAT), FLAT, np.full_like(FLAT, 255), noise, photo([], [(bar(150.0, 60.0), 30.0)])):
        for _ in range(4):
            assert not scene.follower.update(image).is_accepted


def test_no_search_asks_for_more_than_a_few_solutions() -> None:
    scene = begun("bracket")
    redetection, state = scene.follower.redetection, scene.follower.state
    # as alike as may be: parts of it, and its own shape in other sizes, all over the view
    parts = [(scene.shape, pose(60.0 + 100.0 * i, 60.0 + 100.0 * j, 50.0 * i + 20.0 * j, 30.0 + 8.0 * i)) for i in range(3)
             for j in range(2)]  # fmt: skip
    levels = build_pyramid(photo(parts))
    for turn in range(7):
        state.lost = turn
        assert len(redetection.search_image(state, levels)) <= MAX_WAYS + MAX_SOLVED


def test_the_share_that_is_seen_tells_a_pose_from_another() -> None:
    scene = begun("hook")
    redetection, target = scene.follower.redetection, scene.follower.target
    image = photo([(scene.shape, FIRST)])
    assert redetection.edge_share(image, target.A) > 0.9
    assert redetection.edge_share(photo([]), target.A) < 0.3
    assert redetection.edge_share(image, np.diag([-1.0, 1.0, 1.0]) @ target.A) == 0.0  # from behind
    assert redetection.edge_share(image, np.full((3, 3), math.nan)) == 0.0


def test_one_place_is_solved_once_and_what_shows_nothing_never() -> None:
    scene = begun("hook")
    redetection, target = scene.follower.redetection, scene.follower.target
    levels, wide = build_pyramid(photo([(scene.shape, FIRST)])), wide_prior(target)
    away, near = np.eye(3), np.eye(3)
    away[0, 2], near[0, 2] = 90.0, 1.0
    tried = [Hypothesis(str(k), M @ target.A, wide) for k, M in enumerate((away, np.eye(3), near))]
    assert len(redetection.promising(levels, tried)) == 1
    assert redetection.worth_solving(levels, tried[:1]) == tried[:1]  # continuity has a say in any case


def test_all_ways_in_which_a_symmetric_outline_lies_are_rivals() -> None:
    scene = begun("rectangle")
    state = scene.follower.state
    H = pose(100.0, 110.0, 60.0, 60.0)
    found = scene.follower.redetection.matches_in(state.located, build_pyramid(photo([(scene.shape, H)])))
    places = [scene.follower.target.carried_contacts(h.G) for h in found if h.origin == MATCHED]
    there = scene.at(H)
    assert min(max_contact_distance(p, there) for p in places) < 3.0
    assert min(max_contact_distance(p, there[::-1]) for p in places) < 3.0  # its contacts lie opposite each other


def test_what_slides_along_itself_keeps_its_tilt() -> None:
    scene = begun("half-disc")
    state, target = scene.follower.state, scene.follower.target
    H = pose(100.0, 110.0, 60.0, 60.0)
    for h in scene.follower.redetection.matches_in(state.located, build_pyramid(photo([(scene.shape, H)]))):
        moved = target.homography(h.G) @ np.linalg.inv(target.homography(state.located.G))
        assert abs(moved[2, :2] / moved[2, 2]).max() < 1e-9
        assert max_contact_distance(target.carried_contacts(h.G), scene.at(H)) < 3.0
