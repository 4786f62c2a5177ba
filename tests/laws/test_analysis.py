# SPDX-License-Identifier: Apache-2.0
"""Grasp analysis against a linear programme, and its invariances."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from closure import programme
from grasptrack.errors import GraspError, InputError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import analyze
from outlines import BRACKET, blobs, dense, similarities, stars, turned


@given(st.one_of(stars(), blobs()), st.lists(st.floats(0, 0.999), min_size=2, max_size=4), st.floats(0.1, 1.2))
def test_stable_is_what_a_linear_programme_says(points, where, friction):
    contour = Contour(points)
    contacts = np.array([points[int(w * len(points))] for w in where])
    found = analyze(Grasp(contacts), contour, friction)
    weight = programme(contacts, found.normals, points.mean(axis=0), found.rho, friction)
    expected = weight > 1e-9
    if abs(weight) > 1e-7 or not expected:
        assert found.stable == expected or abs(found.margin) < 1e-6
    assert (found.margin > 0) == found.stable or abs(found.margin) < 1e-6
    assert (found.reason == "") == found.stable


@given(stars(), st.floats(0, 0.999), st.floats(0, 0.999), st.floats(0.001, 0.004))
def test_a_refusal_asks_for_more_friction_than_there_is(points, a, b, gap):
    """However near they come: it once read "needs friction 0.05, there is 0.05"."""
    contour, grasp = Contour(points), Grasp([points[int(w * len(points))] for w in (a, b)])
    without = analyze(grasp, contour, 1e-6).reason
    if "needs friction" in without:
        just_less = max(float(without.split("friction ")[2].split(",")[0]) - gap, 1e-6)
        found = analyze(grasp, contour, just_less)
        needed, there = found.reason.split("needs friction ")[1].split(", there is ")
        assert float(needed) > float(there)


@given(stars(), st.floats(0, 0.999), st.floats(0, 0.999), similarities(), st.integers(0, 299), st.booleans())
def test_unchanged_by_similarity_first_point_and_direction(points, a, b, S, start, reverse):
    contour = Contour(points)
    contacts = points[[int(a * len(points)), int(b * len(points))]] + 0.25 * (points[1] - points[0])
    before = analyze(Grasp(contacts).snapped(contour), contour)
    snapped = Grasp(contacts).snapped(contour).contacts
    moved = Contour(apply_homography(S, points))
    after = analyze(Grasp(apply_homography(S, snapped)), turned(moved, start, reverse))
    scale = math.sqrt(moved.area / contour.area)
    assert after.stable == before.stable or abs(before.margin) < 1e-6
    assert after.margin == pytest.approx(before.margin, abs=1e-6)
    assert math.radians(after.margin_deg) == pytest.approx(after.margin, abs=1e-12)
    assert after.epsilon == pytest.approx(before.epsilon, abs=1e-6)
    assert after.centroid_distance == pytest.approx(scale * before.centroid_distance, abs=1e-6 * moved.length)
    np.testing.assert_allclose(after.flatness, before.flatness, atol=1e-6)


@given(stars(), st.lists(st.floats(0, 0.999), min_size=2, max_size=3), st.floats(0.05, 1.0), st.floats(0.01, 1.0))
def test_more_friction_never_makes_a_grasp_worse(points, where, friction, more):
    contour = Contour(points)
    grasp = Grasp([points[int(w * len(points))] for w in where])
    less, much = analyze(grasp, contour, friction), analyze(grasp, contour, friction + more)
    assert much.margin >= less.margin - 1e-9
    assert much.epsilon >= less.epsilon - 1e-9 or not less.stable
    assert much.stable or not less.stable


def test_signs_of_normals_count():
    slot = Contour(dense([[0, 0], [300, 0], [300, 200], [200, 200], [200, 100], [100, 100], [100, 200], [0, 200]], 400))
    squeeze = analyze(Grasp([[0, 150], [300, 150]]), slot)
    spread = analyze(Grasp([[100, 150], [200, 150]]), slot)
    one_each = analyze(Grasp([[0, 150], [100, 150]]), slot)
    wrong = analyze(Grasp([[0, 150], [200, 150]]), slot)
    assert squeeze.stable and spread.stable and one_each.stable
    assert not wrong.stable and "oppose" in wrong.reason
    assert squeeze.margin == pytest.approx(math.atan(0.5))
    np.testing.assert_allclose(squeeze.normals, [[1, 0], [-1, 0]], atol=1e-12)


def test_a_corner_is_not_flat_and_a_refusal_names_the_friction():
    plate = Contour(dense(BRACKET, 600))
    assert analyze(Grasp(BRACKET[[0, 2]]), plate).flatness.min() > 0.05
    leaning = analyze(Grasp([[100, 160], [300, 105]]), plate, friction=0.2)
    assert not leaning.stable
    assert "friction" in leaning.reason


def test_holes_are_part_of_the_outline():
    t = np.linspace(0, 2 * np.pi, 80, endpoint=False)
    ring = View(
        [
            Contour(100 * np.column_stack([np.cos(t), np.sin(t)])),
            Contour(40 * np.column_stack([np.cos(t), np.sin(t)]), hole=True),
        ]
    )
    inside = analyze(Grasp([[40, 0], [-40, 0]]), ring)
    assert inside.stable  # the fingers spread
    np.testing.assert_allclose(inside.normals, [[1, 0], [-1, 0]], atol=1e-9)


def test_bad_input():
    plate = Contour(dense(BRACKET))
    with pytest.raises(GraspError, match="contact 2 is"):
        analyze(Grasp([[100, 160], [500, 500]]), plate)
    for friction in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match="friction"):
            analyze(Grasp([[100, 160], [140, 105]]), plate, friction)
    with pytest.raises(InputError, match="finger_width"):
        analyze(Grasp([[100, 160], [140, 105]]), plate, finger_width=0.0)
    with pytest.raises(GraspError, match="shape"):
        Grasp([[1, 2]])
