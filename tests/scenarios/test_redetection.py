# SPDX-License-Identifier: Apache-2.0
"""An object that was lost is found again wherever and however it lies, and nothing else is ever taken for it."""

import math

import numpy as np
import pytest

from grasptrack.geometry.homographies import apply_homography
from grasptrack_bench.scenes import built_in, make_scene_cases, run_case
from grasptrack_bench.simulation import SHAPES, Shape
from stages import HEIGHT, WIDTH, Run, mirrored, photo, pose, twin

NAMES = ("bracket", "gasket", "spanner", "hook", "puzzle-piece", "u-clip")
BLACK = np.zeros((HEIGHT, WIDTH), np.uint8)
AWAY = 10
"""Frames without an image."""
BRACKET, HOOK = SHAPES["bracket"](), SHAPES["hook"]()


def anywhere(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """A pose at random: wholly in view, any turn, scales of 0.4 to 1.3 of that before, tilts to 45 degrees."""
    while True:
        scale = 75.0 * math.exp(rng.uniform(math.log(0.4), math.log(1.3)))
        H = pose(*rng.uniform((40, 40), (280, 200)).tolist(), rng.uniform(0, 360), scale, rng.uniform(0, 45))
        at = apply_homography(H, shape.outer)
        if (at > 6).all() and (at < (WIDTH - 7, HEIGHT - 7)).all():
            return H


LAST = pose(164.0, 120.0, -36.0)
"""Where `lost` shows the part last."""


def lost(shape: Shape) -> Run:
    """Seen three times, and then not at all."""
    run = Run()
    for k in range(3):
        H = pose(160.0 + 2 * k, 120.0, -40.0 + 2.0 * k)
        run.see(photo([(shape, H)], seed=k), H)
    assert run.statuses == ["tracked"] * 3
    for _ in range(AWAY):
        run.see(BLACK, None)
    return run


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(3))
def test_it_is_found_within_two_frames_of_its_return_in_any_pose(name: str, seed: int) -> None:
    shape = SHAPES[name]()
    run, H = lost(shape), anywhere(shape, np.random.default_rng((seed, len(name))))
    table = H @ np.linalg.inv(LAST) @ pose(scale=60.0)  # on which it rests: it is the camera that went
    for k in range(2):
        run.see(photo([(shape, H)], seed=20 + k, table=table), H)
    run.check(4)
    assert run.results[-1].located, run.results[-1].reason


@pytest.mark.parametrize(
    "stranger",
    [mirrored(HOOK), twin(HOOK, 0.05, 0.8), twin(HOOK, 0.05, -0.8), BRACKET],
    ids=["mirrored", "tab", "notch", "other"],
)
def test_nothing_else_is_taken_for_it(stranger: Shape) -> None:
    run = lost(HOOK)
    for k in range(4):
        run.see(photo([(stranger, anywhere(stranger, np.random.default_rng((k, 7))))], seed=30 + k), None)
    run.check()
    assert all(r.reason for r in run.results[-4:])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("scale", [1.4, 1 / 1.4])
@pytest.mark.parametrize("together", [True, False], ids=["together", "later"])
def test_a_neighbour_in_another_size_is_not_taken_when_it_is_removed(scale: float, together: bool) -> None:
    run = Run(object_at=(90.0, 120.0))
    beside = BRACKET, pose(230.0, 120.0, 30.0, 45.0 * scale)
    for k in range(12):
        H = pose(90.0 + k, 120.0, 1.0 * k, 45.0)
        there = k < 4
        parts = [(BRACKET, H)] * there + [beside] * (together or not there)
        run.see(photo(parts, seed=k), H if there else None)
    run.check()


def test_a_tangle_beside_the_lost_object_does_not_stop_the_run() -> None:
    # of a comb with fine teeth the few points that are first looked at enclose nothing
    scene = make_scene_cases(built_in(["spoon"]), ["bar"], frames=16)[0]
    frames = run_case((scene, ("auto",)))["auto"]
    assert len(frames) == 16 and not any(f.is_false_accept for f in frames)
