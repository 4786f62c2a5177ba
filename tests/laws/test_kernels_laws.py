# SPDX-License-Identifier: Apache-2.0
"""What the kernels must obey whatever computes them: known shapes, similarities, the choice of the first point."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import _grasptrack_native as native
from closure import programme
from grasptrack import kernels
from outlines import blobs, similarities, stars
from reference.geometry import crossings, nearest_crossings
from synthesis_shapes import circle

RECTANGLE = np.array([[0.0, 0], [4, 0], [4, 2], [0, 2]])


def whole(points):
    return np.array([0, len(points)])


def mapped(H, points):
    return np.ascontiguousarray(points @ H[:2, :2].T + H[:2, 2])


def test_known_shapes():
    area, cx, cy, theta, major, minor, *third = kernels.polygon_moments(np.array([10, 5]) + RECTANGLE, whole(RECTANGLE))
    np.testing.assert_allclose([area, cx, cy, theta, major, minor], [8, 12, 6, 0, 16 / 12, 4 / 12], atol=1e-12)
    np.testing.assert_allclose(third, 0, atol=1e-12)
    upright = np.ascontiguousarray(RECTANGLE[:, ::-1][::-1])
    assert kernels.polygon_moments(upright, whole(upright))[3] == pytest.approx(math.pi / 2)
    hole = 1 + 0.5 * RECTANGLE[::-1]
    plate = np.concatenate([RECTANGLE * 2, hole])
    area, cx, *_ = kernels.polygon_moments(plate, np.array([0, 4, 8]))
    assert area == pytest.approx(32 - 2) and cx == pytest.approx((32 * 4 - 2 * 2) / 30)
    ring = circle(100.0, 80.0, 50.0, 300)
    np.testing.assert_allclose(kernels.curvature_vector(ring, None, 0.025).curvature, 2 * math.pi, rtol=0.01)
    np.testing.assert_allclose(kernels.arc_length(RECTANGLE), [0, 4, 6, 10, 12])
    np.testing.assert_allclose(kernels.blend_normals(ring), (ring - [100, 80]) / 50, atol=1e-9)


def test_lines_touch_and_cross():
    def on(points, x, y, ux, uy):
        return crossings(points, whole(points), x, y, ux, uy)[:, 2].tolist()

    diamond = np.array([[0.0, -1], [1, 0], [0, 1], [-1, 0]])
    assert on(diamond, 0, 0, 1, 0) == [-1, 1]
    assert on(diamond, 0, -1, 1, 0) == []  # a corner touches
    assert on(RECTANGLE, 0, 0, 1, 0) == []  # a side lies along the line and does not cross
    step = np.array([[0.0, 0], [1, 0], [1, 1], [2, 1], [2, 2], [0, 2]])
    assert on(step, 0, 1, 1, 0) == [0, 1]  # a step does; the nearer end counts
    assert on(step, 0, 1, -1, 0) == [-2, 0]
    assert all(math.isnan(v) for v in nearest_crossings(step, whole(step), 9, 9, 1, 0, 0, 1))


@given(stars(), similarities(), st.integers(1, 200))
def test_similarity_and_first_point(points, H, start):
    scale, turn = math.hypot(H[0, 0], H[1, 0]), math.atan2(H[1, 0], H[0, 0])
    moved = np.roll(mapped(H, points), -start, axis=0)
    n = len(points)
    start %= n
    before, after = kernels.polygon_moments(points, whole(points)), kernels.polygon_moments(moved, whole(moved))
    assert after[0] == pytest.approx(scale**2 * before[0])
    np.testing.assert_allclose(after[1:3], mapped(H, np.array([before[1:3]]))[0], rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(after[4:6], np.multiply(before[4:6], scale**2), rtol=1e-8)
    if before[5] < 0.9 * before[4] and abs(before[6] + before[8]) > 1e-6:
        assert math.remainder(after[3] - before[3] - turn, 2 * math.pi) == pytest.approx(0, abs=1e-7)
        np.testing.assert_allclose(after[6:], before[6:], atol=1e-9)
    bend = np.roll(kernels.curvature_vector(points, None, 0.02).curvature, -start)
    np.testing.assert_allclose(kernels.curvature_vector(moved, None, 0.02).curvature, bend, rtol=1e-6, atol=1e-4)
    place = np.array([[0.0, 7.3], [0.0, 0.6 * n]])
    shifted = np.column_stack([place[:, 0], (place[:, 1] - start) % n])
    where = kernels.point_at(moved, whole(moved), shifted)
    np.testing.assert_allclose(where, mapped(H, kernels.point_at(points, whole(points), place)), rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(kernels.project_to_contour(moved, whole(moved), where)[:, 2], 0, atol=1e-6)
    frame = kernels.contact_frames(points, whole(points), place, 12.0)
    other = kernels.contact_frames(moved, whole(moved), shifted, 12.0 * scale)
    c, s = math.cos(turn), math.sin(turn)
    np.testing.assert_allclose(other[:, :2], frame[:, :2] @ [[c, s], [-s, c]], atol=1e-6)
    np.testing.assert_allclose(other[:, 2:], frame[:, 2:], atol=1e-6)


@given(blobs(), st.floats(5.0, 40.0))
def test_frames_depend_on_the_curve_not_on_its_sampling(points, width):
    finer = np.concatenate(
        [np.linspace(a, b, 3, endpoint=False) for a, b in zip(points, np.roll(points, -1, 0), strict=True)]
    )
    place = np.array([[0.0, 20.5]])
    a = kernels.contact_frames(points, whole(points), place, width)
    b = kernels.contact_frames(finer, whole(finer), place * [1, 3], width)
    np.testing.assert_allclose(a, b, atol=1e-9)
    inward = kernels.point_at(points, whole(points), place) + 2.0 * a[:, :2]
    centre = np.array(kernels.polygon_moments(points, whole(points))[1:3])
    assert np.hypot(*(inward[0] - centre)) < np.hypot(*(inward[0] - 4.0 * a[0, :2] - centre))


@given(blobs(), st.integers(3, 400), st.floats(0.0, 30.0))
def test_resample_stays_near_the_curve(points, count, smooth):
    out = kernels.resample(points, count, smooth)
    assert out.shape == (count, 2)
    if smooth == 0:
        np.testing.assert_allclose(out[0], points[0], atol=1e-9)
    assert kernels.project_to_contour(points, whole(points), out)[:, 2].max() <= smooth / 4 + 1e-9


@given(st.integers(0, 2**32 - 1))
def test_homography_of_four_points_is_exact(seed):
    rng = np.random.default_rng(seed)
    source = np.array([[100.0, 90], [520, 110], [490, 400], [130, 380]]) + rng.uniform(-60, 60, (4, 2))
    target = np.array([[100.0, 90], [520, 110], [490, 400], [130, 380]]) + rng.uniform(-60, 60, (4, 2))
    every = list(range(4))
    H = kernels.fit_homography(source, every, target, every).H
    q = np.column_stack([source, np.ones(4)]) @ H.T
    assert H[2, 2] == 1
    np.testing.assert_allclose(q[:, :2] / q[:, 2:], target, atol=1e-8)


def test_the_compiled_functions_are_called_without_wrappers():
    assert kernels.project_to_contour is native.project_to_contour


@st.composite
def grasps(draw, fingers=(2, 5)):
    """Contacts around an object, their normals inward within some 40 degrees, and a friction."""
    k = draw(st.integers(*fingers))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    around = 2 * np.pi * (np.arange(k) + rng.uniform(-0.3, 0.3, k)) / k
    contacts = np.column_stack([np.cos(around), np.sin(around)]) * rng.uniform(0.5, 1.5, (k, 1))
    lean = around + math.pi + rng.uniform(-0.7, 0.7, k)
    return contacts, np.column_stack([np.cos(lean), np.sin(lean)]), float(rng.uniform(0.0, 1.2))


@given(grasps())
def test_closure_agrees_with_a_linear_programme(grasp):
    contacts, normals, friction = grasp
    epsilon, angle = kernels.force_closure(contacts, normals, 0.05, -0.1, 0.8, friction)
    weight = programme(contacts, normals, np.array([0.05, -0.1]), 0.8, friction)
    assume(abs(weight) > 1e-7)
    assert (epsilon > 1e-9) == (weight > 0)
    assert (epsilon > 1e-9) == (math.atan(friction) > angle + 1e-8)


def test_two_fingers_exactly():
    contacts = np.array([[-1.0, 0.0], [1.0, 0.3]])
    squeeze, spread = np.array([[1.0, 0], [-1, 0]]), np.array([[-1.0, 0], [1, 0]])
    for normals in (squeeze, spread):
        assert kernels.force_closure(contacts, normals, 0, 0, 1, 0.5).friction_angle == pytest.approx(
            math.atan2(0.3, 2.0)
        )
    same_way = np.array([[1.0, 0], [1.0, 0]])
    epsilon, angle = kernels.force_closure(contacts, same_way, 0, 0, 1, 0.5)
    assert angle == math.pi / 2 and epsilon <= 0
    assert kernels.force_closure(contacts, squeeze, 0, 0, 1, 0.0).epsilon == 0.0
