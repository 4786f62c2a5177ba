# SPDX-License-Identifier: Apache-2.0
"""A thin tool that leaves its place at once: most of it still lies where it lay, or its place is seen without it."""

import cv2
import numpy as np
import pytest

from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.emptiness import place_is_empty
from grasptrack.tracking.target import build_pyramid
from grasptrack.tracking.tracker import GraspTracker
from screwdriver import HEIGHT, MIDDLE, TOOL, WIDTH, Tool, exposed, rough_bench, taken

TURN = 0.4
"""rad, of the tool against the image's height, which its axis points along."""
LARGE = Tool(scale=1.4, handle=190.0, print_sd=30.0)
"""So large and with so much print that its place along itself is known."""
ALONG = np.array([np.sin(TURN), -np.cos(TURN)])


def followed(places: list[np.ndarray]) -> list[float | None]:
    """px by which the worst contact is off in each image; None where no answer is given."""
    image, start = exposed((places[0][0], places[0][1]), TURN, seed=0, tool=LARGE)
    tracker = GraspTracker(outline=apply_homography(start, TOOL + MIDDLE))
    first, found = tracker.update(image, time=0.0).contacts, list[float | None]()
    assert first is not None
    for k, place in enumerate(places[1:], 1):
        image, pose = exposed((place[0], place[1]), TURN, seed=k, tool=LARGE)
        contacts = tracker.update(image, time=k / 30.0).contacts
        away = None if contacts is None else contacts - apply_homography(pose @ np.linalg.inv(start), first)
        found.append(None if away is None else float(np.hypot(*away.T).max()))
    return found


@pytest.mark.parametrize("step", [30.0, 45.0, -45.0])
def test_a_tool_that_is_pushed_along_itself_is_followed_at_once(step: float) -> None:
    """What shows all of it outdoes its own place, most of which it still covers: not both can lie there."""
    places = [np.array([240.0, 200.0]) + max(0, k - 4) * step * ALONG for k in range(7)]
    found = followed(places)
    assert all(off is not None and off < 1.0 for off in found), found


@pytest.mark.parametrize("seed", range(6))
def test_an_empty_place_is_none_that_is_covered(seed: int) -> None:
    """The same bench goes on where the tool was; a cloth of any grain and grey level that goes on there is not that bench."""
    rng = np.random.default_rng(seed)
    image, start = exposed((240.0, 200.0), TURN, seed=0)
    tracker = GraspTracker(outline=apply_homography(start, TOOL + MIDDLE))
    tracker.update(image)
    assert tracker._track is not None
    state = tracker._track.follower.state

    def shows_empty_place(grey: np.ndarray) -> bool:
        return place_is_empty(state.target, state.located, build_pyramid(grey), state.target.A)

    assert shows_empty_place(taken(rough_bench(), seed))
    assert not shows_empty_place(exposed((240.0, 200.0), TURN, seed=seed + 1)[0])
    cloth = rng.normal(size=(HEIGHT, WIDTH)).astype(np.float32)
    cloth = rng.uniform(50.0, 200.0) + 40.0 * cv2.GaussianBlur(cloth, (0, 0), rng.uniform(1.0, 4.0))
    assert not shows_empty_place(taken(cloth, seed))
    half = np.arange(HEIGHT)[:, None] < 200.0
    assert not shows_empty_place(np.where(half, taken(cloth, seed), exposed((240.0, 200.0), TURN, seed=seed + 1)[0]))


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
