# SPDX-License-Identifier: Apache-2.0
"""A rolling shutter: what is learned of it, and that contacts are where their own rows show them."""

import math
from functools import cache

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import GraspTracker, TrackResult
from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking import hypotheses
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.pose import Look
from grasptrack.tracking.state import Shutter
from grasptrack.tracking.target import Target, build_pyramid
from grasptrack_bench.method import chosen_grasp
from grasptrack_bench.simulation import SHAPES, Scene, SceneFrame, Shape, TextureMap
from grasptrack_bench.simulation.disturbances import DISTURBANCES
from stages import Run, photo, pose
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


# --- jerks ----------------------------------------------------------------------------------------


BRACKET, FORK, NUT, SPANNER = (SHAPES[name]() for name in ("bracket", "fork", "hex-nut", "spanner"))
PITCH = 48
"""px of an image between the pegs of a board."""


def peg_board(seed: int) -> TextureMap:
    """Dark pegs on a grained board of 8 table units each way, drawn at 60 px a unit."""
    side = 960
    board = 150.0 + 3.0 * np.random.default_rng(seed).standard_normal((side, side), dtype=np.float32)
    for x in range(PITCH // 2, side, PITCH):
        for y in range(PITCH // 2, side, PITCH):
            cv2.circle(board, (x, y), PITCH // 5, (70.0,), -1, cv2.LINE_AA)
    return TextureMap(np.clip(board, 0, 255).astype(np.uint8), 8.0)


def jerk(k: int, far: float, seed: int) -> np.ndarray:
    """(3, 3) by which the hand has carried the whole image at image k: at rest in the first two, then by `far` px an image."""
    way = np.cumsum(np.random.default_rng(seed).choice([-1.0, 1.0], (20, 2)), axis=0) % 3 - 1.0
    x, y = far / np.sqrt(2.0) * (way[k] if k > 1 else np.zeros(2))
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("far", [15.0, 30.0, 60.0])
def test_a_part_at_rest_is_followed_however_the_hand_jerks(far: float, seed: int) -> None:
    """Found in each image, and the ground with it: 15 px had been too far for the ground's own motion."""
    run = Run(object_at=(160.0, 120.0))
    for k in range(14):
        H = jerk(k, far, seed)
        part = H @ pose(scale=40.0, degrees=20.0)
        run.see(photo([(BRACKET, part)], table=H @ pose(scale=60.0), seed=k), part)
    run.check()
    assert run.tracker._track is not None
    assert run.tracker._track.follower.state.wander < 0.5


@pytest.mark.parametrize("far", [0.0, 3.0, 20.0, 70.0])
def test_the_shift_of_an_image_is_that_of_its_ground(far: float) -> None:
    H = jerk(5, far, 3)
    looks = [photo([(SPANNER, G @ pose())], table=G @ pose(scale=60.0), seed=k) for k, G in enumerate((np.eye(3), H))]
    before, now = (build_pyramid(image) for image in looks)
    shifted, apart = hypotheses.shifted_with_image(Look(before, pose()), now)
    assert np.abs((shifted @ np.linalg.inv(pose()) - H)[:2, 2]).max() < apart


@pytest.mark.parametrize("seed", [19, 23])
def test_a_slender_part_does_not_slide_along_itself(seed: int) -> None:
    """The hand jerks along it, turns and leans: half of the outline that was seen is not, all at once, for three images."""
    rng, run = np.random.default_rng((seed, 4)), Run(object_at=(160.0, 120.0))
    x, y, turn, tilt = 0.0, 0.0, rng.uniform(0.0, 360.0), 0.0
    for k in range(14):
        if k > 1:
            way = rng.uniform(-30.0, 30.0)
            x = float(np.clip(x + way * np.cos(np.radians(turn)) + 4.0 * rng.normal(), -70.0, 70.0))
            y = float(np.clip(y + way * np.sin(np.radians(turn)) + 4.0 * rng.normal(), -50.0, 50.0))
            turn, tilt = turn + rng.uniform(-6.0, 6.0), float(np.clip(tilt + rng.uniform(-8.0, 8.0), 0.0, 40.0))
        G = pose(160.0 + x, 120.0 + y, turn, 40.0, tilt)
        run.see(photo([(FORK, G)], table=G @ np.linalg.inv(pose(scale=40.0)) @ pose(scale=60.0), seed=k), G)
    run.check(13)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("shape", [BRACKET, NUT, SPANNER], ids=lambda shape: str(shape.name))
def test_among_equals_on_a_board_of_pegs_a_jerk_is_not_known_to_a_pitch(shape: Shape, seed: int) -> None:
    """Nothing but the ends of the row tells by how many pitches it went: lost is right, the neighbour is not."""
    rng, run, board = np.random.default_rng((seed, PITCH)), Run(object_at=(160.0, 120.0)), peg_board(seed)
    for k in range(10):
        x, y = rng.uniform(-PITCH, PITCH, 2) if k > 1 else (0.0, 0.0)
        H = np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
        beside = ((0, 0), (2, 0), (-2, 0), (0, 2))
        parts = [(shape, H @ pose(160.0 + PITCH * i, 120.0 + PITCH * j, 17.0 * seed, 34.0)) for i, j in beside]
        run.see(photo(parts, ground=board, table=H @ pose(scale=60.0), seed=k), parts[0][1])
    run.check(2)
