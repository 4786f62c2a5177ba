# SPDX-License-Identifier: Apache-2.0
"""What the tracker promises: statuses with reasons, contacts in their order, errors for bad input, the same answer twice."""

import math
from typing import Any

import cv2
import numpy as np
import pytest

from grasptrack import GraspTracker
from grasptrack.errors import GraspError, InputError, SourceError, StrategyError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.closure_probability import CHANCE
from grasptrack.tracking.result import TrackResult
from grasptrack_bench.simulation import SHAPES, Shape, brushed_texture, plain_texture
from stages import EVEN, HEIGHT, WIDTH, Run, photo, pose, regular

BRACKET, PLATE, GASKET = (SHAPES[n]() for n in ("bracket", "notched-plate", "gasket"))
STRATEGIES = ("auto", "homography", "grasp-line", "rrp")
POSES = [pose(150.0 + 4 * k, 115.0 + 2 * k, 4.0 * k) for k in range(6)]
IMAGES = [photo([(BRACKET, H)], seed=k) for k, H in enumerate(POSES)]


def track(images: list[np.ndarray], **options: object) -> list[TrackResult]:
    tracker = GraspTracker(**options)  # type: ignore[arg-type]
    return [tracker.update(image) for image in images]


def followed(shape: Shape, look: dict[str, Any] | None = None, **options: object) -> Run:
    """A part at all of `POSES`."""
    run = Run(**options)
    for k, H in enumerate(POSES):
        run.see(photo([(shape, H)], seed=k, **look or {}), H)
    return run


def beside() -> np.ndarray:
    """Two places on the bracket of the first image that do not face each other."""
    (start,) = track(IMAGES[:1])
    assert start.view is not None
    outline = start.view.outer.points
    return np.array([outline[0], outline[len(outline) // 8]])


# --- statuses ------------------------------------------------------------------------------------


@pytest.mark.sampled(1)
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_tracked_frame_tells_all_there_is(strategy: str) -> None:
    results = track(IMAGES, strategy=strategy, grasp=[[215.0, 110.0], [104.5, 113.3]])
    assert [r.status for r in results] == ["tracked"] * 6
    assert [r.frame for r in results] == list(range(6))
    for k, r in enumerate(results):
        assert (r.reason, r.reason_code) == ("", "") and r.notice == ("tilt-open" if r.chance < CHANCE else "")
        assert r.grasp_id == 1
        assert r.strategy == strategy or strategy == "auto"
        assert r.contacts is not None and r.contacts.shape == (2, 2)
        assert r.seen is not None and (r.seen > 0.99).all()
        assert r.analysis is not None and r.analysis.stable and r.analysis.judged_in == "plane"
        assert 0.8 < r.confidence <= 1.0
        assert r.latency_ms > 0.0
        assert r.view is not None
        truth = POSES[k] @ np.linalg.inv(POSES[0])
        assert results[0].contacts is not None
        assert np.abs(r.contacts - apply_homography(truth, results[0].contacts)).max() < 0.5


def test_the_search_goes_on_until_there_is_an_object() -> None:
    results = track([photo([]), photo([]), *IMAGES[:2]])
    assert [r.status for r in results][2:] == ["tracked", "tracked"]
    assert results[3].grasp_id == 1


def test_an_unstable_grasp_keeps_its_contacts_and_says_why() -> None:
    results = track(IMAGES, grasp=beside())
    assert {r.status for r in results} == {"unstable"}
    assert all(r.reason and r.contacts is not None and r.grasp_id == 1 for r in results)


def test_resynthesize_gives_a_new_grasp_and_a_new_number() -> None:
    results = track(IMAGES, grasp=beside(), resynthesize=True)
    assert (results[1].status, results[1].grasp_id) == ("unstable", 1)
    assert (results[2].status, results[2].grasp_id) == ("tracked", 2)
    assert (results[5].status, results[5].grasp_id) == ("tracked", 2)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_grasp_that_closes_only_where_it_is_does_not_close_for_sure(strategy: str) -> None:
    (start,) = track(IMAGES[:1])
    assert start.contacts is not None and start.analysis is not None
    for room in (0.2, 0.01, 0.001):  # rad of the friction angle to spare
        friction = math.tan(math.atan(0.5) - start.analysis.margin + room)
        results = track(IMAGES, grasp=start.contacts, friction=friction, strategy=strategy)
        assert (results[0].status, results[0].notice) == ("tracked", "tilt-open")
        for r in results[1:]:
            assert r.analysis is not None and r.contacts is not None and 0.0 <= r.chance <= 1.0
            assert r.status == "tracked" or r.chance < CHANCE or not r.analysis.stable
            assert r.grasp_id == 1
            told = {"unstable": ("not-closing", "open-margin", "slips"), "tracked": ("",)}[r.status]
            assert r.reason_code in told and (r.reason_code == "not-closing") == (not r.analysis.stable)
            assert (r.chance < CHANCE) == bool(r.reason_code or r.notice) or r.reason_code == "not-closing"
            # the plane is known better and better, but no view changes the margin by more than it was unsure of
            assert abs(r.analysis.margin - room) < 2.0 * r.margin_sd
        chances = [r.chance for r in results[1:]]
        if room >= 0.2:
            assert chances[-1] > 0.95
        if room <= 0.001:
            assert max(chances) < CHANCE
        # views that tell nothing of the plane: a low chance asks for no other grasp
        same = [IMAGES[0], *[IMAGES[1]] * 3]
        results = track(same, grasp=start.contacts, friction=friction, strategy=strategy, resynthesize=True)
        assert all(r.analysis is not None and r.analysis.stable and r.grasp_id == 1 for r in results)


def test_three_fingers_have_a_chance_too_and_a_lost_grasp_has_none() -> None:
    results = track([*IMAGES[:3], photo([])], fingers=3)
    assert [r.chance > 0.9 for r in results] == [True] * 3 + [False] and math.isnan(results[3].chance)


# --- a given grasp -------------------------------------------------------------------------------


def test_given_contacts_are_moved_to_the_outline() -> None:
    """As a user would click them: a little off."""
    found = track(IMAGES[:1])[0].contacts
    assert found is not None
    given = found + np.array([[1.2, -0.8], [-0.9, 1.1]])
    (r,) = track(IMAGES[:1], grasp=given)
    assert r.contacts is not None and r.view is not None
    assert np.hypot(*(r.contacts - given).T).max() < 2.0
    distance = np.hypot(*(r.view.points[:, None] - r.contacts[None]).transpose(2, 0, 1)).min(axis=0)
    assert (distance < 0.8).all()


def test_given_contacts_choose_the_object_and_the_number_of_fingers() -> None:
    small = pose(255.0, 120.0, 0.0, 32.0)
    image = photo([(GASKET, pose(110.0, 120.0)), (PLATE, small)])
    outline = apply_homography(small, PLATE.outer)
    contacts = outline[[0, len(outline) // 3, 2 * len(outline) // 3]] + 0.7
    tracker = GraspTracker(grasp=contacts)
    assert tracker.fingers == 3
    r = tracker.update(image)
    assert r.contacts is not None and len(r.contacts) == 3
    assert np.abs(r.contacts - contacts).max() < 2.0


def test_contacts_that_are_on_no_object_are_refused() -> None:
    with pytest.raises(GraspError, match="px from the nearest object's outline"):
        track(IMAGES[:1], grasp=[(5.0, 5.0), (10.0, 200.0)])


def test_a_grasp_on_a_hole_is_carried() -> None:
    followed(GASKET, {"ground": EVEN}, grasp=apply_homography(POSES[0], GASKET.holes[0][[0, 45]])).check()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("strategy", ["auto", "homography", "rrp"])
def test_three_fingers(strategy: str) -> None:
    run = followed(BRACKET, fingers=3, strategy=strategy)
    assert all(r.contacts is not None and len(r.contacts) == 3 for r in run.results)
    run.check()


# --- options and input ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"strategy": "magic"}, StrategyError, "auto, rrp, grasp-line, homography"),
        ({"strategy": "grasp-line", "fingers": 3}, StrategyError, "2 fingers"),
        ({"fingers": 1}, GraspError, "at least 2"),
        ({"fingers": 4}, StrategyError, "give the contacts"),
        ({"grasp": [(1.0, 2.0)]}, GraspError, "k >= 2"),
        ({"grasp": [(1.0, float("nan")), (2.0, 3.0)]}, GraspError, "finite"),
        ({"friction": 0.0}, InputError, "friction"),
    ],
)
def test_bad_options_are_refused_at_once(options: dict[str, object], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        GraspTracker(**options)  # type: ignore[arg-type]


def test_an_image_of_another_size_is_an_error_and_says_both() -> None:
    tracker = GraspTracker()
    tracker.update(IMAGES[0])
    with pytest.raises(SourceError, match="200x200 px, but the first was 320x240"):
        tracker.update(np.zeros((200, 200), np.uint8))
    assert tracker.update(IMAGES[1]).status == "tracked"


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((1, 1), np.uint8),
        np.zeros((240, 320), np.float64),
        np.zeros((240, 320, 2), np.uint8),
        np.zeros(7, np.uint8),
    ],
    ids=["1x1", "float", "two-channels", "flat"],
)
def test_what_is_no_image_is_an_error(image: np.ndarray) -> None:
    with pytest.raises(SourceError):
        GraspTracker().update(image)


def test_a_mask_of_another_size_is_an_error() -> None:
    with pytest.raises(InputError, match="mask"):
        GraspTracker().update(IMAGES[0], mask=np.ones((10, 10), np.uint8))
    with pytest.raises(InputError, match="ignore mask"):
        GraspTracker(ignore=np.ones((10, 10), np.uint8)).update(IMAGES[0])


def test_every_kind_of_image_gives_the_answer_of_its_grey_one() -> None:
    grey = track(IMAGES)
    kinds = {
        "deep": [(i.astype(np.uint16) << 8) + 77 for i in IMAGES],
        "colour": [cv2.cvtColor(i, cv2.COLOR_GRAY2BGR) for i in IMAGES],
        "alpha": [cv2.cvtColor(i, cv2.COLOR_GRAY2BGRA) for i in IMAGES],
        "channel": [i[:, :, None] for i in IMAGES],
        "strided": [np.asfortranarray(i) for i in IMAGES],
    }
    for name, images in kinds.items():
        for a, b in zip(grey, track(images), strict=True):
            assert a.status == b.status, name
            assert np.array_equal(a.contacts, b.contacts), name  # type: ignore[arg-type]


def test_masks_take_the_images_place() -> None:
    run = Run()
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)
    for H in POSES:
        mask = np.zeros((HEIGHT, WIDTH), np.uint8)
        polygons = [np.rint(apply_homography(H, p) * 16).astype(np.int32) for p in PLATE.polygons]
        cv2.fillPoly(mask, polygons, 1, shift=4)
        run.see(noise, H, mask=mask)
    assert run.statuses == ["tracked"] * 6
    run.check()


# --- behaviour -----------------------------------------------------------------------------------


def test_light_objects_on_dark_ground() -> None:
    light, dark = brushed_texture(3, colour=(190, 195, 200), extent=4.0), plain_texture(3, colour=(45, 45, 45))
    run = followed(PLATE, {"ground": dark, "surface": light})
    assert run.statuses == ["tracked"] * 6
    run.check()


def test_a_disc_is_never_claimed_to_be_fixed() -> None:
    followed(SHAPES["disc"]()).check(1)


def test_a_regular_polygon_is_followed_while_it_stays_in_sight() -> None:
    run = followed(regular(5))
    assert run.statuses == ["tracked"] * 6
    run.check()


def test_a_strip_of_which_little_tells_of_its_motion_along_itself_is_never_wrong() -> None:
    corners = np.array([[-2.2, -0.22], [1.0, -0.22], [1.0, -0.05], [1.4, -0.05], [1.4, -0.22], [2.2, -0.22]])
    strip = Shape.of("strip", np.vstack([corners, [[2.2, 0.22], [-2.2, 0.22]]]))
    run = Run()
    for k in range(10):
        H = pose(150.0 + 2 * k, 118.0 + k, 3.0 * k, scale=48.0 + 0.4 * k, tilt=0.6 * k)
        run.see(photo([(strip, H)], seed=k), H)
    run.check(8)
    assert run.results[1].located or run.results[1].reason_code == "uncertain"
