# SPDX-License-Identifier: Apache-2.0
"""Laws of the search for a lost object: it is found wherever it lies, at a bounded number of tries, and nothing raises."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack import GraspTracker
from grasptrack.cli.main import main
from grasptrack.errors import InputError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.segmentation.work import WorkBudget
from grasptrack.tracking import redetection as redetecting
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.placements import MAX_SOLVED
from grasptrack.tracking.pose import Hypothesis, Look, max_contact_distance, share_in_view
from grasptrack.tracking.redetection import MATCHED, MAX_WAYS, Keypoints, wide_prior
from grasptrack.tracking.target import build_pyramid
from grasptrack_bench.simulation import SHAPES, Shape
from grasptrack_bench.simulation.coverage import subdivide_polygon
from stages import HEIGHT, WIDTH, bar, photo, pose

FIRST = pose(160.0, 120.0, -40.0)
AWAY, SOON = 10, 5
"""Images without the object, and those within which it is found again."""
WAIT = 12
"""Images in which each kind of search is made at least once, whatever the bound."""
SIDE, STEP, BLURRED = 30, 5.0, 12
"""px, side of a pack; px that a belt carries it a frame; the image that is out of focus."""
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
    return Contour(subdivide_polygon(points, 1.0), hole=hole)


def begun(name: str, at: np.ndarray = FIRST, again: int = 2) -> Begun:
    """Seen once, and so many times again."""
    shape = SHAPES[name]()
    rings = [apply_homography(at, p) for p in shape.polygons]
    contacts = shape.outer[[0, len(shape.outer) // 2]]
    view = View([outline(p, k > 0) for k, p in enumerate(rings)])
    follower = Follower(photo([(shape, at)]), view, apply_homography(at, contacts))
    for k in range(again):
        assert follower.update(photo([(shape, at)], seed=k)).is_accepted
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
        assert len(redetection.search_image(state, levels, WorkBudget())) <= MAX_WAYS + MAX_SOLVED


def searched(name: str, search_ms: float | None, turns: Sequence[int]) -> list[list[tuple[str, Any]]]:
    """What is looked for in each image of a loss, and in which rows."""
    scene, done, told = begun(name), list[tuple[str, Any]](), []
    places = (redetecting.Outlines, "find_poses"), (redetecting, "shifted_looks"), (Keypoints, "find_pose")

    def noted(name: str, own: Any) -> Any:
        return lambda *a, **k: done.append((f"{name} {k.get('fine', '')}", k.get("rows"))) or own(*a, **k)

    with pytest.MonkeyPatch.context() as patch:
        for owner, each in places:
            patch.setattr(owner, each, noted(each, getattr(owner, each)))
        for k, turn in enumerate(turns):
            scene.follower.state.lost = turn
            levels = build_pyramid(photo([], seed=k))
            scene.follower.redetection.search_image(scene.follower.state, levels, WorkBudget(search_ms))
            told.append(done.copy())
            done.clear()
    return told


@given(
    search_ms=st.floats(1e-3, 30.0),
    name=st.sampled_from(["bracket", "hook"]),
    turns=st.sampled_from([range(24), [0] * 24]),  # of a loss, or of images that show it, but too unsurely
)
@settings(max_examples=10)
def test_what_does_not_fit_into_the_bound_is_done_in_the_next_images(
    search_ms: float, name: str, turns: Sequence[int]
) -> None:
    bound, free = searched(name, search_ms, turns), searched(name, None, turns)
    assert searched(name, search_ms, turns) == bound  # work is counted, not time
    assert all(1 <= len(done) <= 3 for done in bound)
    for kind in {kind for done in free for kind, _ in done}:  # nothing starves
        assert all(any(kind == k for done in bound[i : i + WAIT] for k, _ in done) for i in range(len(bound) - WAIT))
    for fine in ("find_pose True", "find_pose False"):  # strips follow one another, with what lies between them
        strips = [rows for done in bound for kind, rows in done if kind == fine]
        for one, other in pairwise(strips):
            assert one.start < other.start < one.stop if other.start else one.stop >= HEIGHT


@pytest.mark.sampled(2)
@pytest.mark.parametrize("search_ms", [1e-3, 2.0, 8.0])
@pytest.mark.parametrize("degrees", [-40.0, 100.0])
def test_a_bound_delays_what_is_found_and_hides_nothing(search_ms: float, degrees: float) -> None:
    scene = begun("bracket")
    scene.follower.search_ms = search_ms
    for k in range(AWAY):
        assert not scene.follower.update(photo([], seed=10 + k)).is_accepted
    H = pose(105.0 + 0.4 * degrees, 115.0, degrees, tilt=15.0)
    found = [scene.follower.update(photo([(scene.shape, H)], seed=30 + k)) for k in range(WAIT)]
    assert found[-1].is_accepted
    for decision in found:
        if decision.is_accepted and decision.estimate is not None:
            assert max_contact_distance(decision.estimate.contacts, scene.at(H)) < 3.0


@pytest.mark.parametrize("search_ms", [0.0, -1.0, math.nan])
def test_a_bound_is_above_0(search_ms: float, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError):
        GraspTracker(search_ms=search_ms)
    assert main(["track", "video.mp4", "--search-ms", str(search_ms)]) == 2
    assert "--search-ms is a number of ms above 0" in capsys.readouterr().err


def test_the_share_that_is_seen_tells_a_pose_from_another() -> None:
    scene = begun("hook")
    redetection, target = scene.follower.redetection, scene.follower.target
    image = photo([(scene.shape, FIRST)])
    assert redetection.samples.edge_share(image, target.A) > 0.9
    assert redetection.samples.edge_share(photo([]), target.A) < 0.3
    assert redetection.samples.edge_share(image, np.diag([-1.0, 1.0, 1.0]) @ target.A) == 0.0  # from behind
    assert redetection.samples.edge_share(image, np.full((3, 3), math.nan)) == 0.0


def test_one_place_is_solved_once_and_what_shows_nothing_never() -> None:
    scene = begun("hook")
    redetection, target = scene.follower.redetection, scene.follower.target
    levels, wide = build_pyramid(photo([(scene.shape, FIRST)])), wide_prior(target)
    away, near = np.eye(3), np.eye(3)
    away[0, 2], near[0, 2] = 90.0, 1.0
    tried = [Hypothesis(str(k), M @ target.A, wide) for k, M in enumerate((away, np.eye(3), near))]
    assert len(redetection.samples.promising(levels[0], tried)) == 1
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


def shows_equal_at_random(name: str, seed: int) -> bool:
    """Of one that lies in the same plane in any turn, more than 0.7 of its outline in view: whether it is known, and where."""
    rng = np.random.default_rng(seed)
    at = pose(*rng.uniform((120, 90), (200, 150)), rng.uniform(0.0, 360.0), 60.0, rng.uniform(0.0, 15.0))
    scene, held = begun(name, at, again=0), 0.0
    while held < 0.7:
        way, turn = rng.uniform(0.0, 2.0 * math.pi, 2)
        c, s, far = math.cos(turn), math.sin(turn), rng.uniform(1.9, 3.0)
        other = at @ np.array([[c, -s, far * math.cos(way)], [s, c, far * math.sin(way)], [0.0, 0.0, 1.0]])
        held = share_in_view(other, outline(scene.shape.outer).points, FLAT)
    state, target = scene.follower.state, scene.follower.target
    look = Look(build_pyramid(photo([(scene.shape, at), (scene.shape, other)], seed=seed)), target.A)
    if not scene.follower.rivals.shows_equals(look):
        return False
    place = np.linalg.inv(target.A) @ other @ np.linalg.inv(at) @ target.A
    middle = apply_homography(place, target.work_contacts).mean(axis=0) - target.work_contacts.mean(axis=0)
    return bool(np.hypot(*(state.equals - middle).T).min() < 0.1 * target.size)


@pytest.mark.parametrize("name", ["bracket", "hook", "key", "half-disc", "spanner"])
def test_an_equal_in_its_plane_is_known_whole_or_cut_by_the_border(name: str) -> None:
    assert sum(shows_equal_at_random(name, seed) for seed in range(12)) >= 11


@pytest.mark.parametrize("name", ["bracket", "gasket", "star"])
def test_alone_in_view_it_has_no_equal(name: str) -> None:
    scene = begun(name, pose(150.0, 110.0, 30.0, 60.0, 20.0), again=0)
    assert not len(scene.follower.state.equals) and not scene.follower.state.lookalike


@pytest.mark.parametrize("alike", [True, False])
def test_a_part_of_its_outline_with_other_print_is_no_equal(alike: bool) -> None:
    """Two cards on a table, a hand on the one."""
    corners = np.array([[0.0, 0.0], [109.0, 0.0], [109.0, 69.0], [0.0, 69.0]])

    def card(seed: int) -> np.ndarray:
        print_ = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal((70, 110)), (0, 0), 2.0)
        return np.clip(200.0 + 40.0 * print_ / print_.std(), 0, 255).astype(np.float32)

    def seen(*cards: tuple[int, float, float], seed: int) -> np.ndarray:
        image = np.full((480, 640), 60.0, np.float32)
        for which, x, degrees in cards:
            H = cv2.getRotationMatrix2D((54.5, 34.5), degrees, 1.0) + np.array([[0.0, 0.0, x], [0.0, 0.0, 200.0]])
            share = cv2.warpAffine(np.ones((70, 110), np.float32), H, (640, 480))
            image = image * (1.0 - share) + cv2.warpAffine(card(which), H, (640, 480)) * share
        noise = np.random.default_rng(seed).normal(0.0, 1.5, image.shape)
        return np.clip(cv2.GaussianBlur(image, (0, 0), 0.7) + noise, 0, 255).astype(np.uint8)

    view = View([outline(corners + np.array([150.0, 200.0]))])
    follower = Follower(seen((1, 150.0, 0.0), seed=0), view, corners[[0, 2]] + np.array([150.0, 200.0]))
    for k in range(1, 4):
        assert follower.update(seen((1, 150.0 + k, 0.0), seed=k)).is_accepted
    both = seen((1, 153.0, 0.0), (1 if alike else 2, 400.0, 70.0), seed=9)
    both[150:320, 130:225] = 120  # a hand lies on it
    assert follower.rivals.shows_equals(Look(build_pyramid(both), follower.state.last.G)) is alike


def images_of_a_pack(seed: int) -> list[np.ndarray]:
    """A soft, small pack on an even belt."""
    rng = np.random.default_rng(seed)
    pack = cv2.GaussianBlur(rng.uniform(60, 160, (SIDE, int(1.3 * SIDE))).astype(np.float32), (0, 0), 2.0)
    pack = (pack - pack.mean()) * 2.0 + 110.0
    images = []
    for k in range(24):
        place = np.array([[1.0, 0.0, 250.0 - STEP * k], [0.0, 1.0, 100.0 + 0.3 * k]])
        share = cv2.warpAffine(np.ones_like(pack), place, (320, 240))
        image = cv2.GaussianBlur(70.0 * (1.0 - share) + cv2.warpAffine(pack, place, (320, 240)), (0, 0), 1.5)
        image = cv2.blur(image, (31, 31)) if k == BLURRED else image
        images.append(np.clip(image + rng.normal(0.0, 2.0, image.shape), 0, 255).astype(np.uint8))
    return images


@pytest.mark.parametrize("seed", [2, 3, 5])
def test_what_moves_on_evenly_is_found_on_its_way(seed: int) -> None:
    """Its print is weak: what each image shows of it is not sure alone, but that it goes on its way shows it anew."""
    tracker = GraspTracker(object_at=(250.0 + 0.65 * SIDE, 100.0 + 0.5 * SIDE))
    results = [tracker.update(image, time=k / 30.0) for k, image in enumerate(images_of_a_pack(seed))]
    assert not results[BLURRED].located
    for k in range(BLURRED + 3, len(results)):
        now, first = results[k].contacts, results[0].contacts
        assert now is not None and first is not None
        assert now - first == pytest.approx(np.tile([-STEP * k, 0.3 * k], (2, 1)), abs=1.0)


@pytest.mark.parametrize("name", ["hex-nut", "star"])
def test_motion_tells_its_turn_after_a_blurred_image(name: str) -> None:
    places = [pose(50.0 + 13.0 * k, 120.0, 2.0 * k) for k in range(16)]
    scene = begun(name, places[0], again=0)
    for k in range(1, 16):
        image = photo([(scene.shape, places[k])], seed=k)
        decision = scene.follower.update(cv2.blur(image, (41, 41)) if k == 10 else image)
    assert decision.is_accepted and decision.estimate is not None
    assert max_contact_distance(decision.estimate.contacts, scene.at(places[15])) < 3.0


@pytest.mark.parametrize("seed", range(4))
def test_print_is_found_smaller_and_turned_among_stronger_corners(seed: int) -> None:
    rng = np.random.default_rng(seed)
    card = np.full((124, 174), 200, np.uint8)
    for x, y, wide, high in rng.uniform((12, 12, 3, 3), (150, 100, 14, 10), (120, 4)).astype(int).tolist():
        cv2.rectangle(card, (x, y), (x + wide, y + high), (int(rng.uniform(60, 190)),), -1)
    ground = cv2.resize(rng.uniform(0, 255, (30, 40)), (640, 480), interpolation=cv2.INTER_NEAREST)

    def seen(H: np.ndarray) -> np.ndarray:
        share = cv2.warpAffine(np.ones(card.shape), H[:2], (640, 480), flags=cv2.INTER_AREA)
        image = ground * (1.0 - share) + cv2.warpAffine(card, H[:2], (640, 480)) * share
        return np.clip(cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)

    corners = np.array([[0.0, 0.0], [173.0, 0.0], [173.0, 123.0], [0.0, 123.0]])
    first, now = (pose_of_card(x, degrees, scale) for x, degrees, scale in ((120.0, 5.0, 1.0), (400.0, 60.0, 0.7)))
    view = View([outline(apply_homography(first, corners))])
    target = Follower(seen(first), view, apply_homography(first, corners[[0, 2]])).target
    G = Keypoints(target, build_pyramid(seen(first))).find_pose(build_pyramid(seen(now)), fine=True)
    assert G is not None
    places = apply_homography(target.homography(G) @ first, corners)
    assert places == pytest.approx(apply_homography(now, corners), abs=3.0)


def pose_of_card(x: float, degrees: float, scale: float) -> np.ndarray:
    """(3, 3) from the card's px to the image's."""
    H = np.eye(3)
    H[:2] = cv2.getRotationMatrix2D((87.0, 62.0), degrees, scale) + np.array([[0.0, 0.0, x], [0.0, 0.0, 150.0]])
    return H
