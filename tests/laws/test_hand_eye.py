# SPDX-License-Identifier: Apache-2.0
"""Files of calibrations and goals give back what was saved, other programs read theirs, and the alarm rings when it should."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import Goal, InputError
from grasptrack.files import read_yaml
from grasptrack.servo.camera import HandCamera, apply_twist, pose_of, rotation_matrix
from grasptrack.servo.estimate import Estimate, Origin, Prior, refine_estimate
from grasptrack.servo.hand_eye import HandEye
from grasptrack.servo.model import Placed, pack_state
from grasptrack.servo.observation import Observation
from grasptrack.servo.trust import MIN_SIGHTINGS, DriftAlarm, Trust

SEEDS = st.integers(0, 10_000)


def calibration(seed: int) -> HandEye:
    rng = np.random.default_rng(seed)
    sd = np.array([0.02, 0.01, 0.01, 0.02, 0.003, 0.003, 0.3]) * rng.uniform(0.5, 2.0, 7)
    root = np.eye(7) + 0.3 * rng.normal(size=(7, 7))
    mounting = pose_of(rotation_matrix(rng.normal(0.0, 1.5, 3)), rng.normal(0.0, 0.2, 3))
    return HandEye(
        rng.uniform(300.0, 2000.0), np.array([319.5, 239.5]), (640, 480), mounting, np.outer(sd, sd) * (root @ root.T)
    )


def alike(a: HandEye, b: HandEye) -> bool:
    return (
        a.size == b.size
        and a.focal == b.focal
        and np.array_equal(a.centre, b.centre)
        and np.allclose(a.mounting, b.mounting, atol=1e-12)
        and np.allclose(a.covariance, b.covariance, rtol=1e-12)
    )


@given(seed=SEEDS)
def test_a_calibration_comes_back_as_it_was_saved(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    known = calibration(seed)
    file = tmp_path_factory.mktemp("eye") / "hand eye: 1.yaml"
    known.save(file, hand="left: tool", camera="it's #1")
    assert alike(HandEye.load(file), known)
    assert [p.name for p in file.parent.iterdir()] == [file.name]
    told = read_yaml(file.read_text())
    assert told["parameters"]["robot_effector_frame"] == "left: tool"
    assert told["parameters"]["tracking_base_frame"] == "it's #1"


def test_easy_handeye_reads_it(tmp_path: Path) -> None:
    """The keys of its own loader: all parameters are arguments by name, and no others."""
    known = calibration(1)
    known.save(tmp_path / "eye.yaml")
    told = read_yaml((tmp_path / "eye.yaml").read_text())
    assert set(told["parameters"]) == {
        "namespace", "move_group_namespace", "move_group", "eye_on_hand", "robot_base_frame", "robot_effector_frame",
        "tracking_base_frame", "tracking_marker_frame",
    }  # fmt: skip
    assert told["parameters"]["namespace"] == "eye" and told["parameters"]["eye_on_hand"] is True
    t = told["transformation"]
    assert set(t) == {"x", "y", "z", "qx", "qy", "qz", "qw"}
    assert np.allclose([t["x"], t["y"], t["z"]], known.mounting[:3, 3])
    x, y, z, w = (t[name] for name in ("qx", "qy", "qz", "qw"))
    v = np.array([0.3, -0.2, 0.9])
    turned = v + 2.0 * np.cross([x, y, z], np.cross([x, y, z], v) + w * v)
    assert np.allclose(turned, known.mounting[:3, :3] @ v)


def test_easy_handeye2_reads_its_own(tmp_path: Path) -> None:
    """It takes no key that is not a field of its message."""
    known = calibration(2)
    known.export(tmp_path / "eye.calib", "easy_handeye2", hand="flange")
    told = read_yaml((tmp_path / "eye.calib").read_text())
    assert set(told) == {"parameters", "transform"}
    assert set(told["parameters"]) <= {
        "name", "calibration_type", "robot_base_frame", "robot_effector_frame", "tracking_base_frame",
        "tracking_marker_frame", "freehand_robot_movement", "move_group_namespace", "move_group",
    }  # fmt: skip
    assert told["parameters"]["name"] == "eye" and told["parameters"]["calibration_type"] == "eye_in_hand"
    assert told["parameters"]["robot_effector_frame"] == "flange"
    assert np.allclose([told["transform"]["translation"][a] for a in "xyz"], known.mounting[:3, 3])
    assert sum(told["transform"]["rotation"][a] ** 2 for a in "xyzw") == pytest.approx(1.0)


def test_a_launch_file_publishes_it(tmp_path: Path) -> None:
    known = calibration(3)
    known.export(tmp_path / "eye.launch.py", "launch", camera='the "eye"')
    text = (tmp_path / "eye.launch.py").read_text()
    compile(text, "eye.launch.py", "exec")
    told = known.static_transform(camera='the "eye"')
    assert all(json.dumps(argument) in text for argument in told)
    assert (
        told[:2] == ["--x", repr(float(known.mounting[0, 3]))]
        and told[-1] == 'the "eye"'
        and told[-4:-2] == ["--frame-id", "tool0"]
    )
    assert "'the \"eye\"'" in known.static_transform_command(camera='the "eye"')
    with pytest.raises(InputError, match="easy_handeye2 or launch"):
        known.export(tmp_path / "x", "moveit")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("format: 1", "format: 2", "format 2, not 1"),
        ("eye_on_hand: true", "eye_on_hand: false", "not on the hand"),
        ("grasptrack:", "graptrack:", "grasptrack and transformation"),
        ("  qw: ", "  qw: 2", "quaternion"),
        ("  x: ", "  x: here #", "transformation, with x, y"),
        ("  x: ", "  x: .nan #", "transformation, with x, y"),
        ("size_px: [640, 480]", "size_px: [640.5, 480]", "size_px"),
        ("size_px: [640, 480]", "size_px: [true, 480]", "size_px"),
        ("focal_px: ", "focal_px: -", "positive"),
        ("focal_px: ", "focal_px: .inf #", "focal_px"),
        ("centre_px: [", "centre_px: [1.0, ", "centre_px"),
        ("    - [", "    - [1.0, ", "7 rows of 7"),
        ("    - [", "    - [-", "symmetric"),
    ],
)
def test_what_is_no_calibration_is_told(tmp_path: Path, old: str, new: str, told: str) -> None:
    file = tmp_path / "eye.yaml"
    calibration(4).save(file)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=told) as error:
        HandEye.load(file)
    assert str(file) in str(error.value) and "\n" not in str(error.value)


DAMAGED = [b"", b"[]", b"\xff\xfe", b"[" * 300, b"[" * 50_000, b" " * 100_000, b"a: &x [*x]", b"{}", b"a: 1e999"]


@pytest.mark.parametrize("load", [HandEye.load, Goal.load], ids=["calibration", "goal"])
@pytest.mark.parametrize("content", [*DAMAGED, b'{"format": 1e999}'])
def test_files_that_hold_nothing_of_the_kind(tmp_path: Path, load: Callable[[Path], object], content: bytes) -> None:
    (tmp_path / "held.any").write_bytes(content)
    with pytest.raises(InputError, match=r"held\.any"):
        load(tmp_path / "held.any")
    with pytest.raises(InputError, match="No such file"):
        load(tmp_path / "none.any")


def test_a_file_that_cannot_be_written(tmp_path: Path) -> None:
    eye, goal = calibration(0), Goal.taught([[0, 0], [9, 9]])
    for write in (eye.save, partial(eye.export, kind="launch"), goal.save):
        with pytest.raises(InputError, match="cannot be written"):
            write(tmp_path / "no folder" / "eye.yaml")


def test_a_servo_can_begin_with_it() -> None:
    known = calibration(5)
    nominal = known.nominal(0.3)
    assert nominal.focal == known.focal and np.array_equal(nominal.pose(), known.mounting) and nominal.distance == 0.3


def test_it_shows_itself_and_is_compared_by_value() -> None:
    one, other = calibration(6), calibration(6)
    assert one == other and hash(one) == hash(other) and one != calibration(7)
    assert "px within" in repr(one) and "degrees" in repr(one)
    assert len(one.to_dict()["covariance"]) == 7


@given(seed=SEEDS)
def test_the_difference_of_two_calibrations_is_a_chi_square(seed: int) -> None:
    one = calibration(seed)
    assert one.contradicted_by(one) == 0.0
    off = np.linalg.cholesky(2.0 * one.covariance)[:, 0]
    mounting = one.mounting.copy()
    mounting[:3, :3] = mounting[:3, :3] @ rotation_matrix(off[1:4])
    mounting[:3, 3] += off[4:]
    other = HandEye(one.focal * float(np.exp(off[0])), one.centre, one.size, mounting, one.covariance)
    assert np.allclose(one.difference(other), off, atol=1e-9)
    assert one.contradicted_by(other) == pytest.approx(1.0, rel=1e-5)
    assert other.contradicted_by(one) == pytest.approx(one.contradicted_by(other), rel=0.1)


def moves(knocked: float, noise: float = 0.1, images: int = 60) -> tuple[list[Observation], list[Estimate]]:
    """Sightings while a hand goes about, and what is estimated of them; half-way the camera is turned, rad."""
    rng = np.random.default_rng(0)
    camera = HandCamera(
        600.0, np.array([319.5, 239.5]), rotation_matrix((0.05, -0.1, 0.4)), np.array([0.05, 0.02, -0.1])
    )
    points = np.array([[-0.03, 0.0], [0.03, 0.0], [-0.04, -0.04], [0.04, -0.04], [0.04, 0.04], [-0.04, 0.04]])
    facing = np.diag([1.0, -1.0, -1.0])
    lies = Placed(points, facing, np.zeros(3), np.zeros(3), facing * (1.0, 1.0, 0.01))
    hand, seen, told, trust, search = pose_of(facing, (0.0, 0.0, 0.3)), [], [], Trust(), None
    origin = None
    for i in range(images):
        twist = np.array([0.3, 0.25, 0.2, 0.0, 0.0, 1.5]) * np.sin(i * np.array([0.3, 0.5, 0.2, 1.0, 1.0, 0.25]) + 0.4)
        hand = apply_twist(hand, twist, 0.04)
        if i == images // 2:
            camera = HandCamera(600.0, camera.centre, camera.turn @ rotation_matrix((0.0, 0.0, knocked)), camera.offset)
        pixels = camera.project((lies.in_base() - hand[:3, 3]) @ hand[:3, :3]) + rng.normal(0.0, noise, (6, 2))
        seen.append(Observation(0.04 * i, hand, pixels, np.broadcast_to(0.2**2 * np.eye(2), (6, 2, 2)).copy(), 2))
        if origin is None:
            origin = Origin(camera, lies, Prior().prior_covariance(camera, lies, hand), 0.0)
        if i >= 8:
            known, search = refine_estimate(origin, seen[: images // 2], search, 3)
            told.append(trust.with_true_covariance(known, origin, seen[: images // 2], search))
    return seen[8:], told


@pytest.mark.parametrize(("knocked", "rings"), [(0.0, False), (0.06, True)])
def test_the_alarm_rings_where_the_camera_was_turned(knocked: float, rings: bool) -> None:
    alarm, rang = DriftAlarm(), []
    seen, told = moves(knocked)
    for i, (one, known) in enumerate(zip(seen, told, strict=True)):
        rang.append(alarm.take_sighting(one, known, 1.2 if knocked and i >= 22 else -np.inf))
    assert alarm.rings == rings and rang[-1] == rings, alarm.contradiction
    assert not any(rang[: 22 + MIN_SIGHTINGS - 1])


def test_the_alarm_rings_for_a_calibration_from_before_that_is_another(tmp_path: Path) -> None:
    seen, told = moves(0.0)
    own = HandEye.from_estimate(told[-1])
    for moved, rings in ((0.0, False), (0.03, True)):
        mounting = own.mounting.copy()
        mounting[0, 3] += moved
        HandEye(own.focal, own.centre, own.size, mounting, own.covariance).save(tmp_path / "eye.yaml")
        alarm = DriftAlarm(HandEye.load(tmp_path / "eye.yaml"))
        for one, known in zip(seen, told, strict=True):
            alarm.take_sighting(one, known, -np.inf)
        assert alarm.rings == rings, alarm.contradiction


def test_sightings_of_another_grasp_are_not_mixed() -> None:
    seen, told = moves(0.0)
    alarm = DriftAlarm()
    for i, (one, known) in enumerate(zip(seen, told, strict=True)):
        if i == 20:
            alarm.change_grasp()
        if i >= 20:
            o = known.object
            other = Placed(o.points[::-1], o.turn, o.place, o.speed, o.axes)
            known = Estimate(pack_state(known.camera, other), known.covariance, known.time)
            one = replace(one, points=one.points[::-1])
        alarm.take_sighting(one, known, -np.inf)
    assert not alarm.rings


COORDINATES = st.floats(-5000.0, 5000.0, allow_nan=False)
GOOD: dict[str, Any] = {
    "format": 1,
    "kind": "fingertips",
    "points_px": [[100.25, 200.5], [300.0, 210.0]],
    "opening_m": 0.08,
    "beyond_m": 0.01,
    "symmetric": True,
}


@given(
    points=st.lists(st.tuples(COORDINATES, COORDINATES), min_size=2, max_size=4, unique=True).filter(
        lambda p: np.hypot(p[0][0] - p[1][0], p[0][1] - p[1][1]) > 1.0
    ),
    opening=st.one_of(st.none(), st.floats(0.001, 1.0)),
    beyond=st.floats(-0.05, 0.05),
    symmetric=st.booleans(),
)
def test_a_goal_comes_back_as_it_was_saved(
    tmp_path_factory: pytest.TempPathFactory,
    points: list[tuple[float, float]],
    opening: float | None,
    beyond: float,
    symmetric: bool,
) -> None:
    goal = (
        Goal.taught(points, symmetric=symmetric)
        if opening is None
        else Goal.fingertips(points, opening, beyond_m=beyond, symmetric=symmetric)
    )
    file = tmp_path_factory.mktemp("goal") / "goal.json"
    goal.save(file)
    assert Goal.load(file) == goal
    assert [p.name for p in file.parent.iterdir()] == ["goal.json"]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"format": 2}, "format 2, not 1"),
        ({"kind": "grip"}, '"fingertips" or "taught"'),
        ({"points_px": "here"}, "points_px"),
        ({"points_px": [[1.0, 2.0]]}, "two or more"),
        ({"points_px": [[1.0, 2.0], [1.0, 2.0]]}, "lie apart"),
        ({"opening_m": None}, "opening_m"),
        ({"opening_m": True}, "opening_m"),
        ({"opening_m": -0.1}, "positive"),
        ({"beyond_m": "1 cm"}, "beyond_m"),
        ({"symmetric": 1}, "symmetric"),
        ({"opening_mm": 80}, "opening_mm"),
    ],
)
def test_what_is_no_goal_is_told(tmp_path: Path, change: dict[str, Any], told: str) -> None:
    file = tmp_path / "goal.json"
    file.write_text(json.dumps(GOOD))
    assert Goal.load(file).opening == 0.08
    file.write_text(json.dumps({**GOOD, **change}))
    with pytest.raises(InputError, match=told) as error:
        Goal.load(file)
    assert str(file) in str(error.value)
