# SPDX-License-Identifier: Apache-2.0
"""Many parts at once: each followed as one alone is, no two in one place, and none taken for another one."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import grasptrack as gt
from grasptrack.errors import InputError, SourceError
from grasptrack.tracking.scene import Footprint
from scenery import drawn

HOOK = np.array([[-30.0, -30], [40, -24], [36, 0], [4, 3], [-2, 36], [-34, 30]])
SIZE = (300, 640)

Placed = tuple[float, float, float]


def turned(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return HOOK @ np.array([[c, s], [-s, c]])


def tray(placed: Sequence[Placed], seed: int = 0) -> np.ndarray:
    """(H, W) parts at x, y, each turned."""
    shapes, places = [turned(t) for *_, t in placed], tuple((x, y) for x, y, _ in placed)
    return drawn(*shapes, centres=places, angle=0.0, size=SIZE, seed=seed)


@cache
def hook() -> gt.Part:
    image = tray([(320.0, 150.0, 0.0)], 9)
    view = gt.first_look(image)[0].view
    return gt.Part.of(image, view, gt.synthesize(view, 2, top=1), name="hook")


SPREAD = ((90.0, 80.0, 0.3), (300.0, 200.0, 2.0), (500.0, 110.0, 4.0))
ROW = tuple((80.0 + 100.0 * k, 150.0, 0.0) for k in range(4))
ENDLESS = tuple((20.0 + 100.0 * k, 150.0, 0.0) for k in range(-8, 15))


def moved(placed: Sequence[Placed], x: float, y: float = 0.0) -> list[Placed]:
    return [(u + x, v + y, t) for u, v, t in placed]


def track(
    placed: Sequence[Placed], step: float, images: int = 3, **options: object
) -> tuple[list[gt.SceneResult], list[str]]:
    """Results, and for each image and instance whether it is located, wrong, or why it is lost."""
    tracker, told, words = gt.SceneTracker(hook(), **options), [], []  # type: ignore[arg-type]
    for k in range(images + 1):
        told.append(tracker.update(tray(moved(placed, k * step), k), time=k / 30.0))
        for number, result in told[-1].results.items():
            start = told[0].results[number].contacts
            if result.contacts is None or start is None:
                words.append(result.reason_code)
            else:
                off = np.hypot(*(result.contacts - start - (k * step, 0.0)).T).max()
                words.append("located" if off < 3.0 else "wrong")
    return told, words


def test_all_are_followed_each_by_its_number() -> None:
    told, words = track(SPREAD, 4.0)
    assert set(words) == {"located"} and told[0].entered == (1, 2, 3) and not any(r.entered for r in told[1:])
    for result in told:
        assert list(result.results) == [1, 2, 3] and result.left == ()
        assert all(r.instance_id == k and r.part_id == "hook" for k, r in result.results.items())


def test_the_order_of_instances_decides_nothing_but_their_numbers() -> None:
    found = [one for one in gt.find(tray(SPREAD), hook()) if one.found]
    orders = found, [found[2], found[0], found[1]]
    first, second = (gt.SceneTracker(hook(), instances=each) for each in orders)
    for k in range(4):
        image = tray(moved(SPREAD, 5.0 * k), k)
        one, other = first.update(image).results, second.update(image).results
        for a, b in ((1, 2), (2, 3), (3, 1)):
            assert one[a].status == other[b].status
            np.testing.assert_array_equal(one[a].contacts, other[b].contacts)


def test_one_alone_is_followed_as_a_tracker_of_one_object_follows_it() -> None:
    place = SPREAD[:1]
    (one,) = gt.find(tray(place), hook())
    scene = gt.SceneTracker(hook(), instances=[one])
    alone = gt.GraspTracker(grasp=one.contacts, outline=one.view.outer.points)
    for k in range(5):
        image = tray(moved(place, 6.0 * k, k), k)
        ours, own = scene.update(image).results[1], alone.update(image)
        assert ours.status == own.status
        np.testing.assert_allclose(ours.contacts, own.contacts, atol=0.3)


def test_an_instance_is_known_no_better_later_than_it_was_found() -> None:
    """Its first image was taken for exact: a half-disc that was found 2 px beside its place was followed there, sure of it."""
    (one,) = gt.find(tray(SPREAD[:1]), hook())
    vague = replace(one, covariance=one.covariance + np.diag([4.0, 1.0]), confidence=0.998)
    told = [gt.SceneTracker(hook(), instances=[each]) for each in (one, vague)]
    for k in range(3):
        image = tray(moved(SPREAD[:1], 6.0 * k), k)
        sure, open_ = (scene.update(image).results[1] for scene in told)
        np.testing.assert_array_equal(sure.contacts, open_.contacts)
        np.testing.assert_allclose(open_.covariance - sure.covariance, [np.diag([4.0, 1.0])] * 2, atol=0.3)
        assert open_.confidence <= 0.998 and (k > 0 or np.array_equal(sure.covariance, one.covariance))


@pytest.mark.parametrize("step", [5.0, 30.0, -30.0])
def test_a_row_that_ends_in_view_keeps_its_identities(step: float) -> None:
    told, words = track(moved(ROW, 150.0 * (step < 0.0)), step)
    assert len(told[0].results) == 4 and set(words) == {"located"}


@pytest.mark.parametrize("step", [50.0, 70.0, -60.0])
@pytest.mark.parametrize("placed", [ROW, ENDLESS])
def test_steps_of_more_than_half_the_pitch_are_told_as_such(placed: Sequence[Placed], step: float) -> None:
    _, words = track(moved(placed, 100.0 * (step < 0.0)), step)
    assert "wrong" not in words and {"lookalike", "other-place"} & set(words)


def test_a_row_without_ends_shows_no_step_until_its_motion_is_told() -> None:
    _, words = track(ENDLESS, 30.0)
    assert "wrong" not in words and "lookalike" in words
    told, words = track(ENDLESS, 30.0, images=2, belt=(900.0, 0.0))
    assert len(told[0].results) >= 5 and "wrong" not in words and words.count("located") > 10


def test_turns_tell_parts_of_a_row_apart() -> None:
    told, words = track([(x, y, 0.4 * k) for k, (x, y, _) in enumerate(ENDLESS)], 30.0)
    assert len(told[0].results) >= 5 and "wrong" not in words
    inside = [r for r in told[1].results.values() if r.contacts is not None]
    assert len(inside) >= 4


def test_no_two_are_ever_given_in_one_place() -> None:
    pair = ((150.0, 150.0, 0.2), (330.0, 150.0, 0.2))
    tracker = gt.SceneTracker(hook())
    tracker.update(tray(pair))
    for k, x in enumerate((240.0, 245.0, 330.0, 150.0), 1):
        located = [r.view for r in tracker.update(tray([(x, 150.0, 0.2)], k)).results.values() if r.located]
        assert len(located) <= 1
    (one, *_) = gt.find(tray(pair), hook())
    assert Footprint(one.view).is_shared(Footprint(one.view))
    assert len(gt.SceneTracker(hook(), instances=[one, one]).update(tray(pair)).results) == 1


def test_what_comes_is_found_by_a_look_and_what_goes_is_told() -> None:
    tracker, left, entered = gt.SceneTracker(hook()), list[int](), list[int]()
    for k in range(20):
        if k == 4:
            assert len(tracker.look()) == 1
        result = tracker.update(tray([(500.0 + 15.0 * k, 90.0, 0.0), (30.0 + 15.0 * k, 200.0, 1.0)], k))
        left += result.left
        entered += result.entered
    assert entered == [1, 2] and left == [1] and list(result.results) == [2]
    assert result.results[2].located
    own = gt.SceneTracker(hook(), look_every=0.1)
    for k in range(6):
        result = own.update(tray([(500.0 + 15.0 * k, 90.0, 0.0), (30.0 + 15.0 * k, 200.0, 1.0)], k), time=k / 30.0)
    assert 2 in result.results


def test_what_is_no_scene_is_told_in_one_line() -> None:
    (one,) = gt.find(tray(SPREAD[:1]), hook())
    other = gt.Part.of(hook().image, hook().view, list(hook().grasps), name="other")
    for wrong in ({"instances": ["hook"]}, {"risk": 2.0}, {"look_every": 0.0}, {"belt": (1.0,)}):
        with pytest.raises(InputError):
            gt.SceneTracker(hook(), **wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="some of these parts"):
        gt.SceneTracker(other, instances=[one])
    with pytest.raises(InputError):
        gt.SceneTracker([])
    tracker = gt.SceneTracker(hook())
    with pytest.raises(InputError, match="call update"):
        tracker.look()
    tracker.update(tray(SPREAD[:1]))
    with pytest.raises(SourceError, match="one size"):
        tracker.update(tray(SPREAD[:1])[:200])


def test_nothing_found_is_no_error() -> None:
    empty = drawn(size=SIZE, centres=())
    tracker = gt.SceneTracker(hook())
    assert tracker.update(empty).results == {} and tracker.update(empty).results == {}
