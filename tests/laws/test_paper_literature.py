# SPDX-License-Identifier: Apache-2.0
"""Other methods that match outlines: each is exact for its own group of motions, wherever a contour begins."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.errors import TransferError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.synthesis import synthesize
from research.paper.footage import FilmedPart, make_part, moved_curves, sample_view
from research.paper.literature import LITERATURE, PlannedAgain, match_contours, nearest_on_outline

CENTRE = (320.0, 240.0)
LEAST_PX = {"Fourier phase": 0.5, "affine arc length": 1.5, "contour matching [21]": 0.2}
"""px of a contact: what equal steps along a polygon of some 130 px leave, and corners that were made smooth."""

shapes = st.sampled_from(["bracket", "spanner", "hook", "key"])
shares = st.floats(0.0, 1.0, exclude_max=True)
turns = st.floats(-math.pi, math.pi)


@cache
def part(name: str) -> FilmedPart:
    return make_part(name, 0)


def worst_px(method: str, name: str, H: np.ndarray, share: float) -> float:
    """Of a grasp in a view that H leads to, whose contours begin anywhere."""
    there = part(name)
    starts = np.array([share * len(c) for c in there.reference.contours])
    second = sample_view(moved_curves(there, H), starts)
    chosen = LITERATURE[method]
    found = chosen.apply(chosen.describe(Grasp(there.contacts), there.reference), second).grasp.contacts
    return float(np.hypot(*(found - apply_homography(H, there.contacts)).T).max())


@given(st.sampled_from(sorted(LITERATURE)), shapes, turns, st.floats(0.6, 1.6), shares)
def test_similarities_are_found_from_any_start(method, name, turn, scale, share):
    H = similarity_transform(scale, turn, CENTRE, (350.0, 210.0))
    assert worst_px(method, name, H, share) < LEAST_PX[method] * max(1.0, scale)


@given(shapes, turns, st.floats(0.7, 1.0), turns, shares)
def test_affine_motions_are_found_by_contour_matching(name, turn, flat, way, share):
    """By far more than the few degrees of tilt that squeeze an outline so much."""
    about, squeezed = similarity_transform(1.0, way, CENTRE, CENTRE), np.diag([1.0, flat, 1.0])
    to_centre = np.array([[1.0, 0.0, -CENTRE[0]], [0.0, 1.0, -CENTRE[1]], [0.0, 0.0, 1.0]])
    squeeze = np.linalg.inv(to_centre) @ squeezed @ to_centre @ about
    H = similarity_transform(1.0, turn, CENTRE, CENTRE) @ squeeze
    assert worst_px("contour matching [21]", name, H, share) < LEAST_PX["contour matching [21]"]


@given(shapes, st.floats(-6e-4, 6e-4), st.floats(-6e-4, 6e-4), shares)
def test_collineations_are_found_by_contour_matching(name, p, q, share):
    to_centre = np.array([[1.0, 0.0, -CENTRE[0]], [0.0, 1.0, -CENTRE[1]], [0.0, 0.0, 1.0]])
    H = np.linalg.inv(to_centre) @ np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [p, q, 1.0]]) @ to_centre
    assert worst_px("contour matching [21]", name, H, share) < LEAST_PX["contour matching [21]"]


@given(shapes, st.integers(0, 299))
def test_a_doubled_point_changes_nothing(name, where):
    """Chains of fewer pixels than points have some twice."""
    first = part(name).reference.outer.points
    second = apply_homography(similarity_transform(1.2, 0.4, CENTRE, CENTRE), first)
    once = match_contours(first, second)
    twice = match_contours(first, np.insert(second, where, second[where], axis=0))
    assert np.allclose(apply_homography(twice, first), apply_homography(once, first), atol=1e-4)


@given(shapes, st.integers(0, 9))
def test_a_planned_grasp_stays_where_nothing_moves(name, rank):
    view = part(name).reference
    grasp = synthesize(view, top=10)[rank % len(synthesize(view, top=10))]
    again = PlannedAgain().apply(PlannedAgain().describe(grasp, view), view)
    assert again.residual == pytest.approx(0.0, abs=1e-9)
    assert np.allclose(again.grasp.contacts, grasp.contacts)


def test_nothing_is_planned_where_nothing_is_stable(monkeypatch):
    monkeypatch.setattr("research.paper.literature.synthesize", lambda *_, **__: [])
    with pytest.raises(TransferError, match="no stable grasp"):
        PlannedAgain().apply(np.zeros((2, 2)), part("bracket").reference)


@given(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))
def test_the_nearest_point_is_on_the_outline_and_no_other_is_nearer(x, y):
    corners = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0], [0.0, 20.0]])
    square = np.stack([corners, 0.5 * (corners + np.roll(corners, -1, 0))], axis=1).reshape(-1, 2)
    hole = 5.0 + 0.5 * square
    view = View([Contour(square), Contour(hole, hole=True)])
    (found,) = nearest_on_outline(np.array([[x, y]]), view)
    along = np.linspace(0.0, 1.0, 201)[:, None]
    every = np.concatenate(
        [a + along * (b - a) for ring in (square, hole) for a, b in zip(ring, np.roll(ring, -1, 0), strict=True)]
    )
    assert np.hypot(*(every - found).T).min() < 0.1
    assert math.dist(found, (x, y)) <= np.hypot(*(every - (x, y)).T).min() + 1e-9
