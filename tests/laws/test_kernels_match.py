# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels of the global match equal their NumPy definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import _grasptrack_native as native
import reference
from grasptrack.geometry.homographies import apply_homography
from grasptrack.kernels.results import AlignmentSteps
from outlines import blobs, dense, stars

BENDS = np.array([[0.0, 0.0], [0.1, 0.0], [-0.05, 0.08], [5.0, 0.0]])


def posed(points, seed):
    """The outline from another first point, under a homography."""
    rng = np.random.default_rng(seed)
    H = np.array([[1.1, 0.2, 10.0], [-0.3, 0.8, 40.0], [2e-4, -1e-4, 1.0]])
    return np.ascontiguousarray(np.roll(apply_homography(H, points), int(rng.integers(len(points))), axis=0)), H


def with_normals(points):
    return points, reference.blend_normals(points), np.array([0, len(points)])


@given(st.one_of(stars(count=120), blobs(count=120)), st.integers(0, 1000))
def test_starts_are_alike(points, seed):
    points = np.ascontiguousarray(points)
    moved, _ = posed(points, seed)
    got = native.initial_alignments(points, moved, BENDS, 64, 0.03, 6)
    wanted = reference.initial_alignments(points, moved, BENDS, 64, 0.03, 6)
    np.testing.assert_allclose(got[:1], wanted[:1], rtol=1e-6, atol=1e-6)  # later ones may tie
    np.testing.assert_allclose(got[:, 0], wanted[:, 0], atol=1e-7)


@given(st.one_of(stars(count=120), blobs(count=120)), st.integers(0, 1000), st.floats(2.0, 400.0))
def test_gaps_are_alike(points, seed, reach):
    rng = np.random.default_rng(seed)
    targets, across, offsets = with_normals(np.ascontiguousarray(points))
    at = np.ascontiguousarray(targets[::3] + rng.uniform(-60, 60, targets[::3].shape))
    normals = np.ascontiguousarray(across[rng.permutation(len(across))[: len(at)]])
    arguments = at, normals, targets, across, offsets, reach
    np.testing.assert_allclose(native.outline_gaps(*arguments), reference.outline_gaps(*arguments), atol=1e-9)


@given(stars(count=120), st.integers(0, 1000))
def test_laying_is_alike(points, seed):
    points = np.ascontiguousarray(points)
    moved, H = posed(points, seed)
    rng = np.random.default_rng(seed)
    starts = np.array([(H @ (np.eye(3) + rng.uniform(-0.02, 0.02, (3, 3)) * [[1, 1, 100], [1, 1, 100], [0, 0, 0]])).ravel()
                       for _ in range(3)])  # fmt: skip
    starts = starts / starts[:, 8:]
    first, second = with_normals(points), with_normals(moved)
    arguments = (
        starts,
        *first[:2],
        *second,
        AlignmentSteps(np.array([40.0, 20.0]), np.array([1e-3, 1e-4]), np.array([2, 1]), 1.0),
    )
    got, wanted = native.align_projective(*arguments), reference.align_projective(*arguments)
    np.testing.assert_allclose(got, wanted, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("kernels", [native, reference])
def test_what_does_not_belong_together_is_refused(kernels):
    points, normals, offsets = with_normals(dense([[0, 0], [50, 0], [50, 30], [0, 30]], 60))
    with pytest.raises(ValueError, match="power of 2"):
        kernels.initial_alignments(points, points, BENDS, 60, 0.03, 6)
    with pytest.raises(ValueError, match="each with its normal"):
        kernels.outline_gaps(points, normals[:-1], points, normals, offsets, 3.0)
    with pytest.raises(ValueError, match="reach must be above 0"):
        kernels.outline_gaps(points, normals, points, normals, offsets, 0.0)
    with pytest.raises(ValueError, match="finite"):
        kernels.outline_gaps(points, normals, points * np.nan, normals, offsets, 3.0)
    with pytest.raises(ValueError, match="stride"):
        kernels.align_projective(
            np.eye(3).reshape(1, 9),
            points,
            normals,
            points,
            normals,
            offsets,
            AlignmentSteps(np.ones(1), np.ones(1), np.zeros(1, int), 1.0),
        )
