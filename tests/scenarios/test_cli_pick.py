# SPDX-License-Identifier: Apache-2.0
"""`grasptrack pick`: how a tray lies, what the truth says of a closing, and what is written of what became of it."""

import csv
import json
import math
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack.cli.main import main
from grasptrack.errors import InputError
from grasptrack.geometry.homographies import apply_homography, rotation_about_z
from grasptrack_bench.approach.case import Row
from grasptrack_bench.approach.picking import TrayRobot
from grasptrack_bench.approach.tray_runs import Trays, draw_tray_cases
from grasptrack_bench.approach.trays import Emptied, PickRow, TrayCase
from grasptrack_bench.approach.truth import record_closing_errors
from grasptrack_bench.physics import frames
from grasptrack_bench.physics.tray import GAP, TRAY, fingers_in_view, looks_over, sample_tray, seen_from_above, travel
from grasptrack_bench.physics.world import World
from grasptrack_bench.simulation import SHAPES
from test_cli_bad_input import refused

needs_mujoco = pytest.mark.skipif(find_spec("mujoco") is None, reason="the physical world needs MuJoCo")


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (["--parts", "0"], "--parts"),
        (["--trays", "0"], "--trays"),
        (["--shape", "disc", "--silhouettes", "x"], "give one of them"),
        (["--shape", "nothing"], "unknown shape"),
    ],
)
def test_bad_input_is_one_line_and_status_2(asked: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    if "unknown" in told and find_spec("mujoco") is None:
        pytest.skip("the physical world needs MuJoCo")
    assert told in refused(["pick", *asked], capsys)


@needs_mujoco
@settings(max_examples=15, deadline=None)
@given(st.sampled_from(sorted(SHAPES)), st.integers(1, 12), st.integers(0, 10**6))
def test_parts_lie_apart_in_the_tray_and_each_is_seen_whole_and_not_far_aside(name: str, count: int, seed: int) -> None:
    try:
        setting = sample_tray(SHAPES[name](), count, seed=seed)
    except InputError:
        assert count > 1
        return
    places, outer = (setting.place, *setting.beside), setting.part.shape.outer
    assert len(places) == count
    lying = [(outer * [1.0, -1.0]) @ place[:2, :2].T + place[:2, 3] for place in places]
    for k, ring in enumerate(lying):
        assert (np.abs(ring) <= 0.5 * np.array(TRAY) + 1e-3).all()
        for other in lying[k + 1 :]:
            near = [cv2.pointPolygonTest(other.astype(np.float32), p, True) for p in ring.astype(np.float32).tolist()]
            assert max(near) < -0.5 * GAP
    hidden, (aim, aside) = fingers_in_view(setting), seen_from_above(setting)
    for place in places:
        seen = []
        for look in looks_over(setting):
            H = frames.plane_to_image(setting.camera.matrix, look @ setting.mount, place, setting.part.thickness)
            drawn, ring = np.zeros_like(hidden), apply_homography(H, outer)
            cv2.fillPoly(drawn, [np.rint(ring).astype(np.int32)], (255,))
            inside = (ring > 0.0).all() and (ring < [hidden.shape[1] - 1.0, hidden.shape[0] - 1.0]).all()
            near = np.hypot(*(ring.mean(axis=0) - aim)) < aside
            seen.append(bool(inside and near and not (drawn & hidden).any()))
        assert any(seen)


def test_so_many_parts_do_not_fit() -> None:
    with pytest.raises(InputError, match="do not fit"):
        sample_tray(SHAPES["square"](), 90, seed=1)


@needs_mujoco
@settings(max_examples=6, deadline=None)
@given(st.sampled_from(["bracket", "rectangle", "gasket"]), st.integers(0, 99), st.floats(0.0, 2.0), st.integers(0, 3))
def test_the_truth_knows_which_part_is_meant_and_calls_contacts_on_another_one_wrong(
    name: str, seed: int, off_px: float, number: int
) -> None:
    robot = TrayRobot(TrayCase(SHAPES[name](), seed, 4))
    world, grasp = robot.world, len(robot.taught.grasps) - 1
    travel(world, robot.looks[0])
    rows = []
    for other in (number, (number + 1) % 4):
        world.chosen = number
        seen = apply_homography(world.outline_to_image(), robot.taught.grasps[grasp]) + off_px / math.sqrt(2.0)
        found, chosen = robot._truth_of(seen, grasp)
        assert found == number
        turned = [apply_homography(rotation_about_z(turn), robot.taught.grasps[grasp]) for turn in robot.taught.turns]
        assert min(float(np.abs(chosen - places).max()) for places in turned) < 1e-9
        world.chosen = other
        held = apply_homography(world.outline_to_image(), chosen)
        world.chosen = number
        rows.append(Row(seed, name, "static", "gantry", "online"))
        record_closing_errors(rows[-1], world, chosen, held)
    assert [row.right for row in rows] == [True, False]


@needs_mujoco
@pytest.mark.slow
def test_open_fingers_come_down_on_no_neighbour() -> None:
    """A narrow part tells its distance to a centimetre: a finger came down on another one, and turned it over."""
    robot = TrayRobot(TrayCase(SHAPES["strip"](), 1100008))
    before = robot.world.part_poses()
    found = robot._look(0)
    assert found is not None
    robot._take(0, *found)
    after = robot.world.part_poses()
    assert robot.told.picks[0].outcome == "lifted"
    for number, pose in after.items():
        np.testing.assert_allclose(pose[:3, 3], before[number][:3, 3], atol=1e-3)


@needs_mujoco
def test_a_part_that_lies_turned_over_rests_on_the_table_too() -> None:
    setting = sample_tray(SHAPES["bracket"](), 1, seed=1)
    over = setting.place.copy()
    over[:3, :3] = over[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    over[2, 3] = setting.part.thickness
    world = World(SHAPES["bracket"](), seed=1, images="planar", setting=replace(setting, place=over))
    for _ in range(20):
        world.move(np.zeros(6))
    assert abs(world.part_pose()[2, 3] - setting.part.thickness) < 2e-4


@needs_mujoco
def test_what_was_taken_away_is_seen_and_touched_no_more() -> None:
    robot = TrayRobot(TrayCase(SHAPES["bracket"](), 3, 2))
    world = robot.world
    before, at = world.image(), world.part_pose()
    world.chosen = 0
    H = world.outline_to_image()
    world.take_away(0)
    for _ in range(5):
        world.move(np.zeros(6))
    assert list(world.part_poses()) == [1]
    np.testing.assert_allclose(world._pose_of_part(0), at, atol=1e-3)
    drawn = np.zeros_like(before)
    cv2.fillPoly(drawn, [np.rint(apply_homography(H, world.setting.part.shape.outer)).astype(np.int32)], (255,))
    inside = cv2.erode(drawn, np.ones((9, 9), np.uint8)) > 0
    assert inside.any() and np.abs(world.image().astype(float) - before)[inside].mean() > 10.0


@needs_mujoco
@pytest.mark.parametrize(("apart", "touching"), [(0.02, True), (0.08, False)])
def test_a_part_that_lies_against_another_one_is_told(apart: float, touching: bool) -> None:
    shape = SHAPES["square"]()
    beside = frames.pose_of(np.eye(3), np.array([apart, 0.0, 0.0]))
    setting = replace(sample_tray(shape, 1, seed=2), place=np.eye(4), beside=(beside,))
    world = World(shape, seed=2, images="planar", setting=setting)
    told = set[bool]()
    for _ in range(10):
        world.move(np.zeros(6))
        told.add(world.touches_another(0) and world.touches_another(1))
    assert (True in told) is touching


def test_figures_count_every_part_and_every_closing() -> None:
    def pick(**told: object) -> PickRow:
        return PickRow(1, "key", "static", "gantry", "online", **told)  # type: ignore[arg-type]

    first = Emptied(
        "a", 3, [pick(tries=2, empty=1, outcome="lifted"), pick(tries=2, wrong=2)], {2: "no room 3 px"}, 30.0
    )
    other = Emptied("b", 1, [pick(tries=1, others=1, outcome="lifted")], {}, 30.0)
    none = Emptied("c", 0, refused="no part was seen")
    figures = Trays([first, other, none], {"d": "ValueError"}, 4).index_figures()
    assert (figures["trays"], figures["emptied"], figures["parts"], figures["lifted"]) == (4, 1, 8, 3)
    assert (figures["closed"], figures["closed_wrong"], figures["empty"]) == (5, 3, 1)
    assert figures["picks_an_hour"] == pytest.approx(180.0)
    assert figures["left"] == {"no room # px": 1} and figures["refused"] == {"c": "no part was seen"}


def test_shapes_of_trays_are_drawn_evenly() -> None:
    shapes = [make() for make in list(SHAPES.values())[:5]]
    cases = draw_tray_cases(shapes, 12, seed=4, count=3, snatched=False, risk=1e-3)
    counts = [sum(c.shape.name == s.name for c in cases) for s in shapes]
    assert max(counts) - min(counts) <= 1 and len({c.name for c in cases}) == 12


@needs_mujoco
@pytest.mark.slow
def test_a_tray_from_which_the_first_part_is_snatched_is_emptied_all_the_same(tmp_path: Path) -> None:
    asked = ["--shape", "bracket", "--parts", "2", "--seed", "1", "--snatch", "--workers", "1", "-q"]
    assert main(["pick", *asked, "--output", str(tmp_path)]) == 0
    told = json.loads((tmp_path / "run.json").read_text())
    figures = told["figures"]
    assert told["ended"] == "finished" and figures["broken"] == {}
    assert (figures["lifted"], figures["emptied"], figures["closed_wrong"]) == (2, 1, 0)
    assert figures["empty"] >= 1
    with (tmp_path / "picks.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert sum(row["outcome"] == "lifted" for row in rows) == 2
    assert [int(row["number"]) for row in rows] == list(range(1, 1 + len(rows)))
    picture = cv2.imread(str(tmp_path / "tray-bracket-100000.png"))
    assert picture.shape[1] == 640 and picture.shape[0] > 480
