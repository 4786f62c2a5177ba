# SPDX-License-Identifier: Apache-2.0
"""The film of an approach: it changes nothing, shows what the tracker sees, in colour, and a lift that can be seen."""

import inspect
import math
from importlib.util import find_spec
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack_bench.approach.case import Row
from grasptrack_bench.approach.pictures import hold_result, side_by_side
from grasptrack_bench.approach.runs import HELD_S, TrialRecord, draw_cases
from grasptrack_bench.approach.trial import Step
from grasptrack_bench.physics import frames
from grasptrack_bench.physics.film import (
    BYSTANDER,
    HAND_HUE,
    LOW,
    PART_HUE,
    TABLE_HUE,
    bystander_pose,
    colour_of_level,
    shadow_on_table,
)
from grasptrack_bench.physics.images import NOISE, SUN, offscreen_error
from grasptrack_bench.scenes import built_in
from grasptrack_bench.simulation import SHAPES
from grasptrack_bench.simulation.render import TO_GREY
from grasptrack_bench.simulation.textures import sample_look
from grasptrack_bench.verbs.servo import servo

if find_spec("mujoco") is None:
    pytest.skip("the physical world needs MuJoCo", allow_module_level=True)

from grasptrack_bench.physics import World
from grasptrack_bench.physics.model import import_mujoco

mj_forward = import_mujoco().mj_forward


def world_of(images: str, name: str = "bracket", seed: int = 3) -> World:
    if images == "mujoco" and (why := offscreen_error()):
        pytest.skip(f"MuJoCo cannot draw here: {why}")
    return World(SHAPES[name](), seed=seed, images=images)  # type: ignore[arg-type]


@given(st.sampled_from([TABLE_HUE, PART_HUE, HAND_HUE]), st.floats(1.0, 255.0))
def test_a_colour_has_the_grey_level_of_what_it_stands_for(hue: np.ndarray, level: float) -> None:
    colour = colour_of_level(hue, level)
    assert float(colour @ TO_GREY) == pytest.approx(level, rel=1e-4)
    assert colour.min() >= 0.0 and colour.max() <= 255.01


@pytest.mark.sampled(1)
@pytest.mark.parametrize("images", ["planar", "mujoco"])
def test_filming_changes_nothing(images: str) -> None:
    plain, filmed = world_of(images), world_of(images)
    for _ in range(6):
        for world in (plain, filmed):
            world.move([0.03, -0.02, 0.05, 0.0, 0.0, 0.2])
        filmed.bystander()
        filmed.hand_in_colour()
        assert np.array_equal(plain.pose(), filmed.pose())
        assert np.array_equal(plain.image(), filmed.image())


@pytest.mark.parametrize("images", ["planar", "mujoco"])
def test_the_hands_view_in_colour_is_the_trackers_image_without_its_noise(images: str) -> None:
    world = world_of(images)
    colour = world.hand_in_colour()
    off = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY).astype(float) - world.image()
    assert abs(np.median(off)) <= 1.0
    assert np.percentile(np.abs(off), 90) < 3.0 * NOISE
    assert np.ptp(colour.astype(int), axis=2).mean() > 30.0  # it is in colour


def test_a_part_that_is_lifted_goes_up_in_the_picture_and_leaves_its_shadow_on_the_table() -> None:
    world = world_of("planar")
    hand, part = (world.model.joint(name).qposadr[0] for name in ("z", "part"))
    world.data.qpos[hand] = 0.0  # down at the table
    mj_forward(world.model, world.data)
    assert world.pose()[2, 3] < LOW
    start, K = world.part_pose(), BYSTANDER.matrix
    at = bystander_pose(world)
    to_camera = frames.inverse_pose(at)
    before = frames.project_points(K, to_camera, start[None, :3, 3])[0]
    world.data.qpos[hand] += 0.12
    world.data.qpos[part + 2] += 0.12
    mj_forward(world.model, world.data)
    assert world.pose()[2, 3] < LOW
    assert bystander_pose(world) == pytest.approx(at)  # who stands beside does not go up with it
    after = frames.project_points(K, to_camera, world.part_pose()[None, :3, 3])[0]
    assert before[1] - after[1] > 480 / 5
    shadow = shadow_on_table(world, K, to_camera)
    falls = world.part_pose()[:3, 3] - 0.12 / SUN[2] * SUN
    x, y = np.rint(frames.project_points(K, to_camera, falls[None])[0]).astype(int)
    assert shadow[y - 2 : y + 3, x - 2 : x + 3].min() > 0.9
    assert math.hypot(*(after - [x, y])) > 480 / 5


def test_the_default_seed_shows_a_part_that_stands_out_from_the_table() -> None:
    seed = inspect.signature(servo).parameters["seed"].default
    shapes = [part.shape for part in built_in([])]
    case = draw_cases(shapes, 1, seed=seed, scenario="static", arm="gantry", law="online")[0]
    look = sample_look(case.shape.name, seed)
    assert abs(look.table_level - look.surface_level) > 80.0


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("outcome", "colour"), [("lifted", (0, 168, 120)), ("failed", (222, 84, 24))])
def test_the_film_ends_with_the_outcome(outcome: str, colour: tuple[int, int, int], tmp_path: Path) -> None:
    world, row = world_of("planar"), Row(3, "bracket", "static", "gantry", "online", outcome)
    step = Step("lift", 1.0)
    picture = side_by_side(world, step)
    held = hold_result(picture, row)
    changed = (held != picture).any(axis=2)
    assert changed.any() and not changed[:, :640].any()  # over the view from beside
    assert (held[430, 660] == colour[::-1]).all()
    record = TrialRecord(tmp_path / "a.mp4", None)
    record(world, step)
    record.end(row)
    record.close()
    with av.open(str(tmp_path / "a.mp4")) as video:
        assert sum(1 for _ in video.decode(video=0)) == 1 + round(HELD_S * 25)
