# SPDX-License-Identifier: Apache-2.0
"""A first outline that is wrong is found out and mended once; another object, or what lies in front of it, is not."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasptrack import GraspTracker
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.mending import TRIALS, VIEWS, Mender, _longest_open_stretch, _mean_log_ratio, _Trial
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.plane import Plane, outline_extent
from grasptrack.tracking.pose import Look
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.target import build_pyramid
from grasptrack.typing import Floats
from grasptrack_bench.method import chosen_grasp
from grasptrack_bench.scenes import Part, SceneCase
from grasptrack_bench.simulation import SHAPES, Scene, SceneFrame
from grasptrack_bench.simulation.disturbances import DISTURBANCES

Grey = NDArray[np.uint8]

COUNT = VIEWS + TRIALS + 4


def scene(kind: str = "clean-6dof", shape: str = "bracket", seed: int = 5) -> Scene:
    return DISTURBANCES[kind].scene(SHAPES[shape](), COUNT, seed)


def glare(frame: SceneFrame, at: Floats, radius: float) -> Grey:
    """The image with a saturated disc on it."""
    spot = cv2.circle(
        np.zeros(frame.image.shape, np.float32), np.round(at).astype(int).tolist(), round(radius), 1.0, -1
    )
    soft = cv2.GaussianBlur(spot, (0, 0), 1.2)
    return np.asarray(np.round(frame.image + (255.0 - frame.image) * soft), np.uint8)


def gap(frame: SceneFrame, at: Floats, radius: float) -> Grey:
    """The image with a disc in which the object looks like the ground."""
    mask = cv2.fillPoly(np.zeros(frame.image.shape, np.uint8), [np.round(p).astype(int) for p in frame.outline], 255)
    grown = [cv2.dilate(mask, np.ones((k, k), np.uint8)) for k in (7, 15)]
    level = np.median(frame.image[(grown[1] > 0) & (grown[0] == 0)])
    spot = cv2.circle(
        np.zeros(frame.image.shape, np.float32), np.round(at).astype(int).tolist(), round(radius), 1.0, -1
    )
    soft = cv2.GaussianBlur(spot, (0, 0), 1.2) * (mask > 0)
    rough = level + np.random.default_rng(0).normal(0.0, 2.0, frame.image.shape)
    return np.asarray(np.clip(np.round(frame.image * (1.0 - soft) + rough * soft), 0, 255), np.uint8)


def bridge(frame: SceneFrame, start: Floats, way: Floats, width: int) -> Grey:
    """The image with a bar of the object's own grey, from a point of the outline outward."""
    mask = cv2.fillPoly(np.zeros(frame.image.shape, np.uint8), [np.round(p).astype(int) for p in frame.outline], 255)
    level = int(np.median(frame.image[cv2.erode(mask, np.ones((9, 9), np.uint8)) > 0]))
    ends = [np.round(start + k * way).astype(int).tolist() for k in (-2.0, 60.0)]
    bar = cv2.line(np.zeros_like(mask), ends[0], ends[1], 255, width)
    soft = cv2.GaussianBlur(bar, (0, 0), 0.9) / 255.0 * (mask == 0)
    return np.asarray(np.round(frame.image * (1.0 - soft) + level * soft), np.uint8)


def away(frame: SceneFrame, contacts: Floats) -> Floats:
    """(2,) px: the outline's point farthest from all contacts."""
    outline = frame.outline[0]
    gaps = np.hypot(*(outline[:, None] - contacts[None]).transpose(2, 0, 1)).min(axis=1)
    return np.asarray(outline[gaps.argmax()])


def track(frames: list[SceneFrame], first: Grey, **options: object) -> list[TrackResult]:
    tracker = GraspTracker(**options)  # type: ignore[arg-type]
    return [tracker.update(first if i == 0 else f.image, f.time) for i, f in enumerate(frames)]


def overlap(result: TrackResult, frame: SceneFrame) -> float:
    """Of the outer contours' insides, their common share."""
    assert result.view is not None
    masks = [
        cv2.fillPoly(np.zeros(frame.image.shape, np.uint8), [np.round(p).astype(np.int32)], 1)
        for p in (result.view.outer.points, frame.outline[0])
    ]
    return float((masks[0] & masks[1]).sum() / (masks[0] | masks[1]).sum())


def farthest(result: TrackResult, frame: SceneFrame, contacts: Floats) -> float:
    assert result.contacts is not None
    return float(np.hypot(*(result.contacts - frame.carry(contacts)).T).max())


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(3))
def test_a_highlight_in_the_first_image_is_mended_once_and_the_contacts_stay(seed: int) -> None:
    frames = list(scene(seed=seed))
    contacts = chosen_grasp(frames[0].outline)
    results = track(frames, glare(frames[0], away(frames[0], contacts), 20.0), grasp=contacts)
    told = [i for i, r in enumerate(results) if r.mended]
    assert len(told) == 1 and told[0] > VIEWS + TRIALS - 1 and 0.02 < results[told[0]].mended < 0.5
    assert overlap(results[0], frames[0]) < 0.98
    given = results[0].contacts
    assert given is not None
    for result, frame in zip(results[told[0] :], frames[told[0] :], strict=True):
        assert result.status == "tracked" and overlap(result, frame) > 0.985
        assert farthest(result, frame, given) < 0.3


def test_a_contact_on_an_edge_that_was_none_is_told() -> None:
    frames = list(scene())
    true = chosen_grasp(frames[0].outline)
    at, out = true[0], (true[0] - true[1]) / np.hypot(*(true[0] - true[1]))
    first = bridge(frames[0], at, out, 30)
    off = np.array([at + 74.0 * out, true[1]])  # on its round end
    results = track(frames, first, grasp=off)
    told = next(i for i, r in enumerate(results) if r.mended)
    assert all(r.status != "lost" for r in results[:told])
    for result in results[told:]:
        assert (result.status, result.reason_code, result.contacts) == ("lost", "false-edge", None)
        assert "px off" in result.reason and result.confidence == 0.0
    again = track(frames, first, grasp=off, resynthesize=True)
    assert again[told].reason_code == "false-edge"
    found = again[told + 1]
    assert found.status == "tracked" and found.contacts is not None and overlap(found, frames[told + 1]) > 0.985


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", ["twin", "exchange"])
def test_another_object_from_the_second_image_on_is_not_mended(kind: str) -> None:
    made = scene(kind)
    made.guests = tuple(replace(g, start=1, end=COUNT) for g in made.guests)
    frames = list(made)
    results = track(frames, frames[0].image, grasp=chosen_grasp(frames[0].outline))
    assert not any(r.mended or r.located for r in results[1:])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", [1, 2, 5])
def test_what_may_have_been_another_object_at_first_is_refused(seed: int) -> None:
    """The first image shows a part with a notch, and all later ones the part without: nothing says which was wrong."""
    frames = list(scene(seed=seed))
    contacts = chosen_grasp(frames[0].outline)
    results = track(frames, gap(frames[0], away(frames[0], contacts), 22.0), grasp=contacts)
    assert results[0].located and overlap(results[0], frames[0]) < 0.985
    assert not any(r.mended or r.located for r in results[1:])


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("kind", "shape", "seed"), [("hand", "bracket", 2), ("hand", "key", 1), ("bar-parallel", "key", 702)]
)
def test_what_covers_it_from_the_second_image_on_is_not_mended(kind: str, shape: str, seed: int) -> None:
    made = SceneCase(Part(SHAPES[shape]()), kind, frames=30, seed=seed).scene()
    covered = min(range(30), key=lambda i: made[i].outline_visible)
    frames = [made[0], *(made[i] for i in range(max(1, covered - 8), 30))]
    results = track(frames, frames[0].image, grasp=chosen_grasp(frames[0].outline))
    assert not any(r.mended for r in results) and results[-1].located


def test_what_agreed_once_is_not_mended() -> None:
    frame = FIRST
    assert VIEW is not None
    levels, contacts = build_pyramid(frame.image), chosen_grasp(frame.outline)
    target = make_target(levels, VIEW, contacts, NUMBERS)
    at = away(frame, contacts)
    notched = build_pyramid(gap(frame, at, 12.0))
    mender = Mender(target, levels)
    mender._views = [Look(notched, target.A)] * VIEWS
    mender._agreed[:] = True
    assert mender._second_look() is None
    places = (target.points @ target.A[:2, :2].T) + target.A[:2, 2]
    mender._agreed = np.hypot(*(places - at).T) > 16.0
    assert mender._second_look() is not None


def test_an_outline_that_agrees_is_looked_at_no_more() -> None:
    frames = list(scene())
    follower = Follower(frames[0].image, VIEW, chosen_grasp(frames[0].outline), frames[0].time)
    mender, over = Mender(follower.target, build_pyramid(frames[0].image)), []
    for frame in frames[1 : VIEWS + 2]:
        decision = follower.update(frame.image, frame.time)
        if not mender.is_over:
            mender.examine_image(follower.state, build_pyramid(frame.image), decision)
        over.append(mender.is_over)
    assert over == [False] * (VIEWS - 1) + [True] * 2


@given(st.integers(0, 2**32 - 1))
def test_a_target_like_another_keeps_what_poses_mean(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frame = FIRST
    levels = build_pyramid(frame.image)
    view = VIEW
    contacts = chosen_grasp(frame.outline)
    target = make_target(levels, view, contacts, NUMBERS)
    smaller = view.transformed(np.array([[0.9, 0.0, 20.0], [0.0, 0.9, 15.0], [0.0, 0.0, 1.0]]))
    other = make_target(levels, smaller, contacts, NUMBERS, like=target)
    G = target.A @ np.eye(3) + np.diag([0.02, -0.01, 0.0]) * rng.normal()
    d = target.pose_difference(target.A, G)
    assert np.array_equal(d, other.pose_difference(other.A, G)) and target.noise == other.noise
    P = np.diag(rng.uniform(0.1, 1.0, 8))
    for mine, its in zip(target.homography_and_covariance(G, P), other.homography_and_covariance(G, P), strict=True):
        assert np.array_equal(mine, its)
    plane = Plane(target, 640, 480)
    before, size = plane.rectifications, outline_extent(plane.hull)
    plane.replace_outline(other)
    assert plane.rectifications is before
    assert outline_extent(plane.hull) == pytest.approx(0.9 * size, rel=1e-3)  # so that a ruler is laid on it


FIRST = scene()[0]
VIEW = GraspTracker().update(FIRST.image).view
assert VIEW is not None


@given(st.lists(st.floats(-200.0, 200.0), min_size=1, max_size=20), st.floats(3.0, 20.0), st.floats(1.0, 100.0))
def test_grey_levels_farther_off_speak_for_a_cover(off: list[float], spread: float, more: float) -> None:
    values = np.array(off)
    near = _mean_log_ratio(values, spread, NUMBERS)
    farther = _mean_log_ratio(values + np.copysign(more, values), spread, NUMBERS)
    assert farther <= near + 1e-9 and _mean_log_ratio(0.0 * values, spread, NUMBERS) > 0.0 > _mean_log_ratio(
        values * 0 + 200, spread, NUMBERS
    )


def trial(seen: float, looks: float, apart: int, *, lit: bool = False) -> _Trial:
    angle = np.linspace(0.0, 2.0 * math.pi, 90, endpoint=False)
    points = 40.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    stands = type("Points", (), {"points": points})()
    return _Trial(stands, [], np.arange(90) < apart, looks, lit, [seen] * TRIALS)  # type: ignore[arg-type]


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 20.0), st.integers(1, 60))
def test_the_odds_rise_with_all_that_speaks_for_an_outline(a: float, b: float, looks: float, apart: int) -> None:
    less, more = sorted((a, b))
    assert trial(less, looks, apart).odds(NUMBERS) <= trial(more, looks, apart).odds(NUMBERS)
    assert trial(a, looks, apart).odds(NUMBERS) <= trial(a, looks + 1.0, apart).odds(NUMBERS)
    assert trial(1.0, looks, apart).odds(NUMBERS) <= trial(1.0, looks, apart + 1).odds(NUMBERS)
    assert trial(a, looks, apart, lit=True).odds(NUMBERS) >= trial(a, looks, apart).odds(NUMBERS)
    # all edges are seen of what looks like a cover, and half of them by chance of what looks like the object
    assert trial(1.0, 0.0, 90).odds(NUMBERS) < 1.0 / NUMBERS.risk > trial(0.5, 20.0, 90).odds(NUMBERS)


@given(st.integers(0, 99), st.integers(5, 60), st.integers(0, 200))
def test_the_longest_stretch_is_the_same_from_any_first_point(start: int, bare: int, turn: int) -> None:
    angle = np.linspace(0.0, 2.0 * math.pi, 100, endpoint=False)
    outline = 50.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    missing = (np.arange(100) - start) % 100 < bare
    edges = outline[~missing]
    found = _longest_open_stretch(outline, edges)
    assert found == pytest.approx(_longest_open_stretch(np.roll(outline, turn, axis=0), edges), abs=1e-6)
    step = 2.0 * 50.0 * math.sin(math.pi / 100)
    assert abs(found - step * max(0, bare - 2)) < 2.5 * step
