# SPDX-License-Identifier: Apache-2.0
"""Contours: what is refused at the edge, and under homographies what is worked out late, as it would be at once."""

import copy
import pickle
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import _grasptrack_native as native
import grasptrack as gt
import reference
from grasptrack.errors import ContourError, GraspTrackError, InputError
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
        wanted = Contour.trusted(
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


@given(stars(), st.integers(1, 3), st.integers(0, 5))
def test_points_that_repeat_the_one_before_are_merged(points: np.ndarray, times: int, closing: int) -> None:
    closed = np.concatenate([np.repeat(points, times, axis=0), np.repeat(points[:1], closing, axis=0)])
    marks = np.arange(len(closed), dtype=np.float64)
    cut = np.zeros(len(closed), dtype=np.bool_)
    cut[-1] = True
    plain, contour = Contour(points), Contour(closed, strength=marks, clipped=cut)
    np.testing.assert_array_equal(contour.points, plain.points)
    assert contour.strength is not None and contour.strength[0] == 0.0
    # a clipped point stays clipped, whatever it is merged with
    assert contour.clipped is not None and contour.clipped.sum() == 1


@given(st.integers(0, 2**32 - 1), st.integers(4, 30), st.sampled_from([3, 6, 1000]))
def test_crossings_are_those_of_every_two_sides(seed: int, n: int, grid: int) -> None:
    """On coarse grids sides touch, overlap and pass through points; the definition says the same."""
    points = np.random.default_rng(seed).integers(0, grid, (n, 2)).astype(np.float64)
    points = points[(points != np.roll(points, 1, axis=0)).any(axis=1)]
    if len(points) < 4:
        return
    found = native.first_crossing(points)
    assert found == reference.first_crossing(points)
    ends = np.roll(points, -1, axis=0)

    def area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
        return float(np.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])))

    proper = [
        (i, j)
        for i in range(len(points))
        for j in range(i + 1, len(points))
        if area(points[i], ends[i], points[j]) * area(points[i], ends[i], ends[j]) < 0
        and area(points[j], ends[j], points[i]) * area(points[j], ends[j], ends[i]) < 0
    ]
    assert found[0] >= 0 if proper else True
    if found[0] >= 0:  # the same however the curve is written
        for other in (points[::-1], np.roll(points, 2, axis=0), points @ [[0.0, 1.0], [-1.0, 0.0]], points * 0.5 + 7.0):
            assert native.first_crossing(np.ascontiguousarray(other))[0] >= 0


@given(st.floats(1e-3, 1e6), st.integers(1, 40))
def test_no_rounding_error_decides_whether_curves_cross(size: float, steps: int) -> None:
    """A tooth that ends one unit in the last place before the side opposite, on it, or behind it."""
    side = 1.0 / 3.0 * size
    below = above = size
    for _ in range(steps):
        below, above = np.nextafter(below, 0.0), np.nextafter(above, np.inf)
    for tip, crosses in ((below, False), (size, False), (above, True)):
        points = np.array([[0, 0], [side, tip], [size, 0], [2 * size, 0], [2 * size, size], [-size, size], [-size, 0]])
        for module in (native, reference):
            assert (module.first_crossing(points)[0] >= 0) is crosses


def test_what_touches_itself_is_a_contour() -> None:
    """A way out and back of no width, and two parts that meet in a point."""
    spiked = [[0, 0], [5, 0], [9, 0], [5, 0], [5, 2], [5, 5], [2, 5], [0, 5], [0, 3]]
    meeting = [[0, 0], [4, 0], [4, 4], [8, 4], [8, 8], [4, 8], [4, 4], [0, 4], [0, 2]]
    for points in (spiked, meeting):
        assert Contour(points).area > 20.0


ANGLE = 2.0 * np.pi * np.arange(20) / 20
CIRCLE = 100.0 + 50.0 * np.column_stack([np.cos(ANGLE), np.sin(ANGLE)])


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (CIRCLE[:7], "at least 8 points, not 7"),
        (np.repeat(CIRCLE[:6], 4, axis=0), "at least 8 points, not 6"),
        ([["a", "b"]] * 9, "array of numbers"),
        ([[1.0, 2.0], [3.0]], "array of numbers"),
        (CIRCLE.astype(complex), "array of numbers"),
        (CIRCLE.astype(str), "array of numbers"),
        (CIRCLE[:, :1], r"shape \(N, 2\)"),
        (np.where(np.eye(20)[:, :2] > 0, np.nan, CIRCLE), "finite"),
        (np.where(np.eye(20)[:, :2] > 0, -np.inf, CIRCLE), "finite"),
        (CIRCLE * 1e8, "at most 1e\\+09 px"),
        (CIRCLE * 1e-6, "0.001 px wide and high"),
        (CIRCLE * [1.0, 1e-7], "one line"),
        (CIRCLE * [1.0, 0.0], "one line"),
        (np.zeros((100_001, 2)), "at most 100000 points"),
        (100.0 + 50.0 * np.column_stack([np.sin(ANGLE), np.sin(2 * ANGLE) - np.cos(ANGLE)]), "must not cross itself"),
    ],
)
def test_what_is_no_contour_is_refused_with_its_reason(points: object, message: str) -> None:
    with pytest.raises(ContourError, match=message):
        Contour(points)  # type: ignore[arg-type]


def test_marks_of_another_length_and_holes_as_large_as_the_object_are_refused() -> None:
    for marks in ({"strength": [1.0]}, {"clipped": [[True]]}, {"strength": ["x"] * 20}):
        with pytest.raises(ContourError, match="one value for each of the 20 points"):
            Contour(CIRCLE, **marks)  # type: ignore[arg-type]
    with pytest.raises(ContourError, match="leave some of the area"):
        View([Contour(CIRCLE), Contour(CIRCLE, hole=True)])


@pytest.mark.parametrize("H", [None, "x", np.eye(2), [1.0, 2.0], object()])
def test_what_is_no_homography_is_told(H: Any) -> None:
    curve = Contour(CIRCLE)
    for each in (curve, View([curve])):
        with pytest.raises(InputError, match=r"\(3, 3\)"):
            each.transformed(H)


@pytest.mark.parametrize("contours", [None, 3, "x", [3], [np.zeros((9, 2))]])
def test_what_is_no_contour_makes_no_view(contours: Any) -> None:
    with pytest.raises(InputError, match="made of a Contour"):
        View(contours)


RING = 50.0 * np.array([[-2, -1], [0, -1], [2, -1], [2, 0], [2, 1], [0, 1], [-1, 1], [-2, 0]], dtype=np.float64)
TAKERS: dict[str, Callable[[Any], object]] = {
    "synthesize": lambda points: [g.contacts.tolist() for g in gt.synthesize(points, top=3)],
    "neighbours": lambda points: gt.synthesize(RING + 300.0, top=3, neighbours=[points]).refused,
    "transfer from": lambda points: gt.transfer(
        gt.Grasp([[0, -50], [0, 50]]), points, RING + 3.0, "rrp"
    ).grasp.contacts.tolist(),
    "transfer to": lambda points: gt.transfer(
        gt.Grasp([[3, -47], [3, 53]]), RING + 3.0, points, "rrp"
    ).grasp.contacts.tolist(),
    "analyze": lambda points: gt.analyze(gt.Grasp([[0, -50], [0, 50]]), points).margin,
    "on": lambda points: gt.Grasp([[0, -50], [0, 50]]).on(points).tolist(),
    "snapped": lambda points: gt.Grasp([[0, -50], [0, 50]]).snapped(points).contacts.tolist(),
}


@pytest.mark.parametrize("taker", TAKERS)
def test_points_are_taken_as_the_contour_that_they_make(taker: str) -> None:
    take = TAKERS[taker]
    told = take(Contour(RING))
    assert take(RING) == told and take(RING.tolist()) == told and take(RING.astype(np.float32)) == told
    assert take(View(Contour(RING))) == told


@pytest.mark.parametrize("taker", TAKERS)
@given(
    points=st.one_of(
        st.integers(0, 12).map(lambda n: RING[:n] if n < 8 else np.zeros((n, 2))),
        st.sampled_from(
            [np.zeros((9, 3)), np.zeros(9), np.zeros((3, 3, 2)), RING * np.nan, RING * 1e9, RING[[0, 4] * 4]]
        ),
        st.permutations(range(8)).map(lambda order: RING[list(order)]),
    )
)
def test_points_that_are_no_contour_are_refused_as_by_it(taker: str, points: np.ndarray) -> None:
    try:
        contour = Contour(points)
    except ContourError as error:
        with pytest.raises(ContourError, match=f"^{re.escape(str(error))}$"):
            TAKERS[taker](points)
    else:
        assert len(contour) == 8


@pytest.mark.parametrize("taker", TAKERS)
@pytest.mark.parametrize("value", [None, "ring", {}, object()])
def test_what_is_neither_is_named(taker: str, value: object) -> None:
    with pytest.raises(
        InputError, match=r"must be a (list, each a )?Contour or a View, or an array of numbers of shape \(N, 2\)"
    ):
        TAKERS[taker](value)
