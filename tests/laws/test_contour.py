# SPDX-License-Identifier: Apache-2.0
"""Contours under homographies, which are worked out late: as they would be at once, refusals included."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.errors import GraspTrackError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from outlines import stars

NUMBERS = st.floats(-1.0, 1.0)


@st.composite
def homographies(draw: st.DrawFn) -> np.ndarray:
    """Any, mirrors and horizons through the object among them."""
    H = np.eye(3) + np.array([[draw(NUMBERS) for _ in range(3)] for _ in range(3)]) * [
        [1, 1, 50],
        [1, 1, 50],
        [0, 0, 0],
    ]
    H[2, :2] = draw(NUMBERS) * 4e-3, draw(NUMBERS) * 4e-3
    return H * draw(st.sampled_from([1.0, 2.5, -1.0]))


@given(stars(), homographies(), st.booleans(), st.booleans(), st.booleans())
def test_what_is_worked_out_late_is_the_same(
    points: np.ndarray, H: np.ndarray, hole: bool, strong: bool, cut: bool
) -> None:
    marks = {
        "strength": np.arange(len(points)) if strong else None,
        "clipped": np.arange(len(points)) < 3 if cut else None,
    }
    contour = Contour(points, hole=hole, **marks)
    try:
        wanted = Contour(
            apply_homography(H, contour.points), hole=hole, strength=contour.strength, clipped=contour.clipped
        )
    except GraspTrackError as error:
        with pytest.raises(type(error)) as raised:
            contour.transformed(H)
        assert str(raised.value) == str(error)
        return
    first = contour.transformed(H)
    for found in (first, pickle.loads(pickle.dumps(contour.transformed(H))), copy.deepcopy(contour.transformed(H))):
        assert found.hole is hole and found.signed_area == wanted.signed_area and found.length == wanted.length
        for name in ("points", "strength", "clipped", "offsets"):
            np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
    assert not hasattr(first, "nonsense")


@given(stars(), st.tuples(NUMBERS, NUMBERS))
def test_what_happens_to_the_matrix_later_changes_nothing(points: np.ndarray, shift: tuple[float, float]) -> None:
    H, contour = np.eye(3), Contour(points)
    H[:2, 2] = shift
    moved = View([contour.transformed(H)])
    H[:] = np.nan
    np.testing.assert_allclose(moved.points, contour.points + shift, atol=1e-9)
    np.testing.assert_array_equal(moved.offsets, contour.offsets)
