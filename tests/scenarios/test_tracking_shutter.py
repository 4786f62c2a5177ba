# SPDX-License-Identifier: Apache-2.0
"""A rolling shutter: what is learned of it, and that contacts are where their own rows show them."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import GraspTracker, TrackResult
from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.state import Shutter
from grasptrack.tracking.target import Target
from grasptrack_bench.method import chosen_grasp
from grasptrack_bench.simulation import SHAPES, Scene, SceneFrame
from grasptrack_bench.simulation.disturbances import DISTURBANCES
from test_tracking_blur import target

HEIGHT = 240
READOUTS = st.floats(-1.0, 1.0)


def shutter() -> Shutter:
    return Shutter(np.eye(3), HEIGHT, NUMBERS)


def test_before_any_image_there_is_none() -> None:
    """But there may be one."""
    share, variance = shutter().readout
    assert share == 0.0 and variance == pytest.approx(NUMBERS.rolling * NUMBERS.readout_sd**2)


@given(READOUTS, st.integers(1, 30), st.floats(0.0, 1.0))
def test_images_that_tell_of_a_readout_are_believed(share: float, images: int, new: float) -> None:
    """A clear one as it is, one that is nothing beside its error as none, and nothing beyond what was told."""
    made, sd = shutter(), 0.02
    for _ in range(images):
        made.learn_readout(share, sd**2, new)
    told = made.readout.share
    assert abs(told) <= abs(share) + 1e-9 and told * share >= 0.0
    if abs(share) > 8.0 * sd:
        assert told == pytest.approx(share, rel=0.05)
    error = sd / math.sqrt(1.0 + (images - 1) * new)  # of all images together
    if abs(share) < error:
        assert abs(told) < 0.3 * error


@given(READOUTS, st.integers(2, 10))
def test_what_is_seen_again_makes_it_no_surer(share: float, images: int) -> None:
    once, again, anew = shutter(), shutter(), shutter()
    for _ in range(images):
        again.learn_readout(share, 0.1**2, 0.0)
        anew.learn_readout(share, 0.1**2, 1.0)
    once.learn_readout(share, 0.1**2, 0.0)
    assert again.readout == pytest.approx(once.readout)
    one = shutter()
    one.learn_readout(share, 0.1**2 / images, 1.0)
    assert anew.readout == pytest.approx(one.readout)


def test_images_that_contradict_each_other_are_believed_less() -> None:
    agreeing, other = shutter(), shutter()
    for k in range(10):
        agreeing.learn_readout(0.3, 0.03**2, 0.1)
        other.learn_readout(0.6 * (k % 2), 0.03**2, 0.1)
    assert agreeing.readout.share == pytest.approx(0.3, abs=0.01)
    assert other.readout.share < 0.1 and other.readout.variance > 4.0 * agreeing.readout.variance


@pytest.mark.parametrize("variance", [math.inf, math.nan, 0.0, -1.0])
def test_what_tells_nothing_teaches_nothing(variance: float) -> None:
    made = shutter()
    made.learn_readout(0.7, variance, 1.0)
    assert made.readout == shutter().readout


@cache
def plate() -> Target:
    return target()


def row_of(made: Target, G: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n,) shares of the image's rows below the object's middle at which points (n, 2) are seen through G (3, 3)."""
    return np.asarray((apply_homography(G, points) - apply_homography(G, made.centre[None]))[:, 1] / HEIGHT)


@given(st.lists(st.floats(-4.0, 4.0), min_size=8, max_size=8), st.lists(st.floats(-4.0, 4.0), min_size=8, max_size=8))
def test_the_bend_is_what_moves_while_rows_are_read(first: list[float], now: list[float]) -> None:
    """In this view, less what it was in the first one, less what the pose makes of it; none of it is left at the contacts."""
    made = plate()
    v0, v1 = 0.2 * np.array(first), 0.2 * np.array(now)
    shift = made.handle.moved
    rolling = Shutter(made.A, HEIGHT, NUMBERS)
    second = shift(made.A, v0)
    rolling.follow_pose(made, second, np.zeros((3, 8)), 1.0)
    G = shift(second, v1)
    bend = rolling.bend_about(made, G, 1.0)
    v = made.pose_difference(second, G)
    v = v + 0.5 * (v - made.pose_difference(made.A, second))
    places = np.concatenate([made.points, made.work_contacts])
    uv = (places - made.centre) / (0.5 * made.size)
    J = np.stack([jacobian(*place) for place in uv])
    # speeds times rows, by finite differences
    moving = row_of(made, G, places)[:, None] * (J @ v)
    before = row_of(made, made.A, places)[:, None] * (J @ made.pose_difference(made.A, second))
    left = moving - before + J @ bend[0]
    told = (J @ bend[0]) + uv[:, :1] * (J @ bend[1]) + uv[:, 1:] * (J @ bend[2])
    np.testing.assert_allclose(told, left, atol=0.05 * (1.0 + np.abs(moving).max()))
    np.testing.assert_allclose(told[len(made.points) :], 0.0, atol=1e-4)


def jacobian(u: float, v: float) -> np.ndarray:
    return np.array([[1, 0, u, v, 0, 0, u * u, u * v], [0, 1, 0, 0, u, v, u * v, v * v]], dtype=np.float64)


def test_what_rests_does_not_bend_and_what_was_lost_moves_nobody_knows_how() -> None:
    made = plate()
    rolling = Shutter(made.A, HEIGHT, NUMBERS)
    np.testing.assert_allclose(rolling.bend_about(made, made.A, 1.0), 0.0, atol=1e-12)
    rolling.forget_motion()
    assert not rolling.bend_about(made, made.handle.moved(made.A, np.ones(8)), 1.0).any()


@cache
def followed(part: str, name: str) -> tuple[Scene, list[SceneFrame], np.ndarray, list[TrackResult]]:
    scene = DISTURBANCES[name].scene(SHAPES[part](), 24, 5)
    frames = list(scene)
    contacts = chosen_grasp(frames[0].outline)
    tracker = GraspTracker(grasp=contacts)
    told = [tracker.update(frame.image, time=frame.time) for frame in frames]
    return scene, frames, contacts, told


def readout_share(scene: Scene, frames: list[SceneFrame], contacts: np.ndarray, told: list[TrackResult]) -> float:
    """What the core learns of the readout."""
    assert told[0].view is not None
    follower = Follower(frames[0].image, told[0].view, contacts, frames[0].time)
    for frame in frames[1:]:
        follower.update(frame.image, frame.time)
    return follower.state.shutter.readout.share


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("part", "most"), [("bracket", 0.25), ("bottle", 0.15)])
def test_contacts_are_followed_under_a_rolling_shutter(part: str, most: float) -> None:
    """px, rms: 0.31 and 0.25 where all rows count as exposed at once. The result's own homography has them there."""
    scene, frames, contacts, told = followed(part, "rolling-shutter")
    assert readout_share(scene, frames, contacts, told) == pytest.approx(scene.conditions.readout, rel=0.4)
    first = told[0].contacts  # on the outline as it was found
    assert first is not None
    off = []
    for k, (frame, result) in enumerate(zip(frames, told, strict=True)):
        assert result.contacts is not None and result.homography is not None, k
        np.testing.assert_allclose(apply_homography(result.homography, first), result.contacts, atol=1e-6)
        off.append(result.contacts - frame.carry(contacts))
    assert math.sqrt(2.0 * float(np.mean(np.square(off)))) < most


@pytest.mark.sampled(1)
@pytest.mark.parametrize("part", ["bracket", "bottle"])
def test_where_all_rows_are_exposed_at_once_no_readout_is_believed(part: str) -> None:
    assert abs(readout_share(*followed(part, "clean-6dof"))) < 0.02
