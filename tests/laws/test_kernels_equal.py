# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels equal their NumPy definitions on random outlines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import _grasptrack_native as native
import reference


@st.composite
def outlines(draw):
    """A star-shaped outer contour with a hole: points and offsets, read-only."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))

    def star(n, size):
        angle = 2 * np.pi * (np.arange(n) + rng.uniform(-0.3, 0.3, n)) / n
        radius = size * rng.uniform(0.6, 1.4, n)
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])

    outer, hole = star(draw(st.integers(8, 60)), 80.0), star(draw(st.integers(8, 20)), 15.0)[::-1]
    points = np.ascontiguousarray(np.concatenate([outer, hole]) + rng.uniform(-500, 500, 2))
    offsets = np.array([0, len(outer), len(points)])
    points.flags.writeable = offsets.flags.writeable = False
    return points, offsets, rng


def same(name, *args, atol=1e-9):
    got, wanted = getattr(native, name)(*args), getattr(reference, name)(*args)
    for one, other in zip(got, wanted, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=atol)


@given(outlines())
def test_curve_kernels(outline):
    points, offsets, rng = outline
    contour = points[: offsets[1]]
    length = reference.arc_length(contour)[-1]
    same("arc_length", contour)
    same("blend_normals", contour)
    for clipped in (None, rng.random(len(contour)) < 0.05):
        same("curvature_vector", contour, clipped, float(rng.uniform(0.005, 0.25)), atol=1e-8 * length)
    for smooth in (0.0, float(rng.uniform(0.01, 1.0) * length)):
        same("resample", contour, int(rng.integers(1, 100)), smooth)


@given(outlines())
def test_outline_kernels(outline):
    points, offsets, rng = outline
    middle = points.mean(axis=0)
    same("polygon_moments", points, offsets)
    places = np.array([[c, rng.uniform(0, offsets[c + 1] - offsets[c])] for c in (0, 1, 0)])
    same("point_at", points, offsets, places)
    same("project_to_contour", points, offsets, middle + rng.uniform(-120, 120, (5, 2)))
    same("project_to_contour", points, offsets, points[rng.integers(0, len(points), 3)])
    same("fixed_places", points, offsets, middle + rng.uniform(-120, 120, (2, 2)))
    same("carry_places", places, offsets, points, offsets.copy())
    for width in (3.0, 40.0, 400.0):
        same("contact_frames", points, offsets, places, width)
        at = reference.point_at(points, offsets, places[:, :2]) + rng.uniform(-1.0, 1.0, (3, 2))
        same("judge_contacts", points, offsets, at, width, *middle.tolist(), 50.0, 0.5, atol=1e-6)


@given(outlines(), outlines())
def test_grasp_line_kernels(first, second):
    points, offsets, rng = first
    at = rng.choice(offsets[1] - 1, 2, replace=False)  # on sides: a line through a vertex may touch or cross
    contacts = points[at] + 0.4 * (points[at + 1] - points[at])
    wanted = reference.grasp_line(points, offsets, contacts)
    for found, expected in zip(native.grasp_line(points, offsets, contacts), wanted, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    line, frame = wanted[:4], (wanted.area, *wanted.centroid, wanted.angle)
    for ahead in ((0.0, 0.0), (0.3, -2.0), (-0.3, 2.0)):
        for current in (first, second):
            arguments = current[0], current[1], line, frame, ahead
            for found, expected in zip(
                native.carry_grasp_line(*arguments), reference.carry_grasp_line(*arguments), strict=True
            ):
                np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(2, 5))
def test_grasp_kernels(seed, k):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, k)
    normals = np.column_stack([np.cos(angle), np.sin(angle)])
    contacts = rng.uniform(-1, 1, (k, 2))
    # The bisection's own width is 1e-9 rad.
    same("force_closure", contacts, normals, 0.1, -0.2, 0.7, float(rng.uniform(0, 2)), atol=3e-9)
    maps = np.eye(3) + rng.normal(0.0, 0.1, (int(rng.integers(0, 4)), 3, 3))
    same("carried_angles", maps, contacts, normals, 0.7, atol=3e-9)
    four = list(range(4))
    views = rng.uniform(0, 640, (4, 2)), four, rng.uniform(0, 640, (4, 2)), four
    np.testing.assert_allclose(
        native.fit_homography(*views).H, reference.fit_homography(*views).H, rtol=1e-9, atol=1e-7
    )


@given(st.integers(0, 2**32 - 1), st.sampled_from([np.uint8, np.float32]), st.sampled_from([-1, 0, 1]))
def test_edge_search(seed, kind, polarity):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 255, (30, 40)).astype(kind)
    angle = rng.uniform(0, 2 * np.pi, 12)
    points = np.column_stack([rng.uniform(-3, 42, 12), rng.uniform(-3, 32, 12)])
    same("search_along_normals", image, points, np.column_stack([np.cos(angle), np.sin(angle)]), 4.3, polarity)


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (2, 2)])
def test_edge_search_on_the_smallest_images(shape):
    image = np.arange(shape[0] * shape[1], dtype=np.uint8).reshape(shape)
    points = np.zeros((2, 2))
    same("search_along_normals", image, points, np.array([[1.0, 0.0], [0.0, 1.0]]), 6.0, 0)


def test_both_refuse_the_same():
    points, offsets = np.array([[0.0, 0], [4, 0], [4, 2], [0, 2]]), np.array([0, 4])
    row, square = np.array([[0.0, 0], [1, 0], [2, 0], [0, 1]]), points
    bad = [
        ("curvature_vector", points, None, 0.0),
        ("curvature_vector", points, None, 0.26),
        ("resample", points, 0, 0.0),
        ("resample", points, 4, 12.1),
        ("point_at", points, offsets, np.array([[1.0, 0.0]])),
        ("point_at", points, offsets, np.array([[0.0, 4.1]])),
        ("point_at", points, offsets, np.array([[0.0, -0.1]])),
        ("point_at", points, offsets, np.array([[np.nan, 0.0]])),
        ("carry_places", np.zeros((1, 2)), offsets, points, np.array([0, 5])),
        ("grasp_line", points, offsets, points[:3]),
        ("contact_frames", points, offsets, np.array([[0.0, 0.0]]), 0.0),
        ("fit_homography", row, [0, 1, 2, 3], square, [0, 1, 2, 3]),
        ("fit_homography", square, [0, 1, 2, 3], row, [0, 1, 2, 3]),
        ("fit_homography", np.zeros((4, 2)), [0, 1, 2, 3], square, [0, 1, 2, 3]),
        ("fit_homography", square, [0, 1, 2, 4], square, [0, 1, 2, 3]),
        ("force_closure", points[:1], points[:1], 0.0, 0.0, 1.0, 0.5),
        ("carried_angles", np.eye(3)[None], points[:2], points[:2], 0.0),
        ("force_closure", points[:2], points[:2], 0.0, 0.0, 0.0, 0.5),
        ("force_closure", points[:2], points[:2], 0.0, 0.0, 1.0, -0.5),
        ("search_along_normals", np.zeros((5, 5), np.uint8), points, points, 0.0, 0),
        ("search_along_normals", np.zeros((5, 5), np.uint8), points, points[:2], 4.0, 0),
    ]
    for name, *args in bad:
        for module in (native, reference):
            with pytest.raises(ValueError):
                getattr(module, name)(*args)
    for offsets in ([0, 5], [1, 4], [0, 3, 2, 4], [0]):
        with pytest.raises(ValueError):
            native.polygon_moments(points, np.array(offsets))
