# SPDX-License-Identifier: Apache-2.0
"""Grasps for three fingers on one drive: equal angles, equal distances, and what is refused cannot be taken."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, rotation_about_z, similarity_transform
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import analyze
from grasptrack.servo import Goal
from grasptrack_bench.approach.choosing import EVEN, FRICTION, closing_grasps, hand_for, turn_between, width_in_m
from grasptrack_bench.approach.truth import triples_that_close
from grasptrack_bench.physics.gripper import MAX_OPENING, make_gripper
from grasptrack_bench.simulation import SHAPES
from grasptrack_bench.simulation.coverage import subdivide_polygon
from grasptrack_bench.simulation.outlines import Shape

SIZE, SCALE = 0.064, 150.0


def view(shape: Shape, turn: float = 0.0) -> View:
    """The outline, sqrt(area) = SCALE px."""
    placed = similarity_transform(SCALE, turn, (0.0, 0.0), (320.0, 240.0))
    return View([
        Contour(apply_homography(placed, subdivide_polygon(r, 0.02)), hole=k > 0) for k, r in enumerate(shape.polygons)
    ])  # fmt: skip


def found(shape: Shape, turn: float = 0.0) -> list[Grasp]:
    return closing_grasps(view(shape, turn), 3, hand_for(SIZE)).grasps


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["disc", "egg", "guitar", "s-blob", "notched-plate", "key", "bracket"])
def test_every_grasp_has_equal_angles_and_distances_and_is_stable(name: str) -> None:
    shape = SHAPES[name]()
    grasps = found(shape)
    assert grasps
    px_to_m = SIZE / SCALE
    for grasp in grasps:
        arms = (grasp.contacts - grasp.contacts.mean(axis=0)) @ [1.0, 1.0j]
        radii = np.abs(arms) * px_to_m
        assert np.ptp(radii) <= EVEN
        assert 2.0 * radii.max() <= MAX_OPENING
        turns = np.sort(np.angle(arms))
        gaps = np.diff(np.append(turns, turns[0] + 2.0 * math.pi))
        assert np.abs(gaps - 2.0 * math.pi / 3.0).max() <= 2.0 * EVEN / radii.min()
        judged = analyze(grasp, view(shape), FRICTION)
        assert judged.stable
        inward = -np.column_stack([arms.real, arms.imag]) / np.abs(arms)[:, None]
        assert ((judged.normals * inward).sum(axis=1) > math.cos(math.atan(FRICTION)) - 0.03).all()
    qualities = [g.quality for g in grasps]
    assert qualities == sorted(qualities, reverse=True)


@settings(max_examples=4)
@given(st.floats(-math.pi, math.pi))
def test_a_turned_part_has_grasps_as_good(turn: float) -> None:
    shape = SHAPES["guitar"]()
    upright, turned = found(shape), found(shape, turn)
    assert turned[0].quality == pytest.approx(upright[0].quality, rel=0.25)


@pytest.mark.slow
def test_a_grasp_of_the_true_outline_is_among_all_triples_of_its_points() -> None:
    for name in ("disc", "notched-plate", "bracket"):
        assert found(SHAPES[name]())
        assert triples_that_close(SHAPES[name](), SIZE) > 0


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["square", "rectangle", "hex-nut", "star"])
def test_what_has_no_three_sides_that_face_three_fingers_is_refused_and_brute_force_agrees(name: str) -> None:
    shape = SHAPES[name]()
    grasps, reason = closing_grasps(view(shape), 3, hand_for(SIZE))
    assert not grasps and "three contacts" in reason
    assert triples_that_close(shape, SIZE) == 0


def test_a_part_that_is_too_wide_is_refused() -> None:
    assert not closing_grasps(view(SHAPES["disc"]()), 3, hand_for(0.2)).grasps
    assert triples_that_close(SHAPES["disc"](), 0.2) == 0


@given(st.sampled_from([2, 3]), st.floats(-3.0, 3.0), st.floats(0.2, 3.0), st.permutations(range(3)))
def test_turn_and_width_do_not_ask_which_finger_is_which(k: int, turn: float, scale: float, order: list[int]) -> None:
    tips = make_gripper(k).tips(0.08)[:, :2] * 2000.0
    placed = apply_homography(similarity_transform(scale, turn, (0.0, 0.0), (50.0, -20.0)), tips)
    least = math.pi / k
    mixed = placed[[i for i in order if i < k]]
    assert turn_between(mixed, tips) == pytest.approx(abs((turn + least) % (2.0 * least) - least), abs=1e-6)
    assert width_in_m(mixed, tips, 0.08) == pytest.approx(0.08 * scale)


def test_the_goal_takes_each_of_three_fingers_for_the_nearest_contact() -> None:
    """Of the orders of the fingers that fit, a third of a turn apart, the first asks for 60 degrees at most."""
    from grasptrack.servo.camera import HandCamera, align_rigid

    camera = HandCamera(600.0, np.array([320.0, 240.0]), np.eye(3), np.array([0.0, -0.07, -0.28]))
    tips = np.column_stack([make_gripper(3).tips(0.088)[:, :2], np.zeros(3)])
    seen = camera.project(tips)
    goal = Goal.fingertips(seen, float(np.linalg.norm(tips[0] - tips[1])))
    for turn in np.radians([0.0, 40.0, 100.0, 170.0, -130.0]):
        contacts = 0.7 * tips @ rotation_about_z(turn).T
        orders = goal.orders(camera, contacts)
        assert len(orders) == 3
        least = (turn + math.pi / 3.0) % (2.0 * math.pi / 3.0) - math.pi / 3.0
        assert abs(align_rigid(contacts[:, :2], tips[list(orders[0]), :2])[1]) == pytest.approx(abs(least), abs=1e-6)
        there = goal.targets(camera, contacts[:, :2], orders[0])
        assert there.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
