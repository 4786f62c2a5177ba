# SPDX-License-Identifier: Apache-2.0
"""A hand that jerks carries everything along, farther from image to image than surfaces tell their motion."""

import cv2
import numpy as np
import pytest

from grasptrack.tracking import hypotheses
from grasptrack.tracking.pose import Look
from grasptrack.tracking.target import build_pyramid
from grasptrack_bench.simulation import SHAPES, Shape, TextureMap
from stages import Run, photo, pose

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
