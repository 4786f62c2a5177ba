# SPDX-License-Identifier: Apache-2.0
"""The compiled matching kernels equal their definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack import kernels
from grasptrack.kernels import reference
from grasptrack.projective import apply_homography
from outlines import blobs, frame_motions, stars

pytestmark = pytest.mark.skipif(kernels.BACKEND != "native", reason="no compiled kernels here")
FEW = settings(max_examples=40, deadline=None)


def vectors(points):
    arc = reference.arc_length(points)
    return reference.curvature(points, 0.012 * arc[-1]) * arc[-1], arc


@FEW
@given(st.one_of(stars(), blobs()), st.floats(0.0, 8.0))
def test_peaks(points, prominence):
    v, arc = vectors(points)
    v[5:9] = np.nan
    found = kernels.curvature_peaks(v, arc, 0.03 * arc[-1], prominence)
    assert found.tolist() == reference.curvature_peaks(v, arc, 0.03 * arc[-1], prominence).tolist()
    assert found.dtype == np.int64
    assert not set(found.tolist()) & set(range(4, 10))


@FEW
@given(st.integers(0, 8), st.integers(0, 1000))
def test_quadrilateral(count, seed):
    rng = np.random.default_rng(seed)
    points, weights = rng.uniform(0, 100, (count, 2)), rng.uniform(1, 5, count)
    found, wanted = kernels.best_quadrilateral(points, weights), reference.best_quadrilateral(points, weights)
    assert found[:4] == wanted[:4]
    assert found[4] == pytest.approx(wanted[4])


@FEW
@given(blobs(), stars(count=211))
def test_alignment(first, second):
    arguments = (first, reference.arc_length(first), second, reference.arc_length(second))
    for tie in (0.0, 0.1, 1.0):
        found = kernels.align_outlines(*arguments, 64, tie)
        wanted = reference.align_outlines(*arguments, 64, tie)
        np.testing.assert_allclose(found, wanted, atol=1e-9)


@FEW
@given(st.one_of(stars(), blobs()), frame_motions(), st.integers(0, 299), st.booleans())
def test_eq_3(points, H, start, gap):
    moved = np.roll(apply_homography(H, points), start, axis=0)
    (v1, arc1), (v2, arc2) = vectors(points), vectors(np.ascontiguousarray(moved))
    if gap:
        v2[20:40] = np.nan
    peaks = np.argsort(-np.abs(v1))[:4].astype(np.int64)
    kappa = arc2[-1] / arc1[-1]
    centres = kappa * arc1[peaks] + 3.0
    arguments = (v1, arc1, peaks, v2, arc2, centres, kappa, 0.04 * arc1[-1], 12, 0.0025 * arc1[-1])
    strict, same = kernels.match_curvature(*arguments, 0.2), reference.match_curvature(*arguments, 0.2)
    assert ((strict[:, 0] < 0) == (same[:, 0] < 0)).all()
    found, wanted = kernels.match_curvature(*arguments, 1e9), reference.match_curvature(*arguments, 1e9)
    np.testing.assert_allclose(found[:, 1], wanted[:, 1], rtol=1e-9, atol=1e-9)
    # of samples that fit alike either may be taken; all must be samples
    assert ((found[:, 0] >= -1) & (found[:, 0] < len(points))).all()
    apart = np.abs(np.mod(arc2[found[:, 0].astype(int)] - centres + 0.5 * arc2[-1], arc2[-1]) - 0.5 * arc2[-1])
    assert (apart <= kappa * 0.04 * arc1[-1] + 1e-9).all() or gap


def test_bad_arguments():
    v, arc = np.ones(10), np.arange(10.0)
    with pytest.raises(ValueError, match="arc"):
        kernels.curvature_peaks(v, arc, 1.0, 1.0)
    with pytest.raises(ValueError, match="weight"):
        kernels.best_quadrilateral(np.zeros((4, 2)), np.ones(3))
    with pytest.raises(ValueError, match="count"):
        kernels.align_outlines(np.eye(2), np.zeros(3), np.eye(2), np.zeros(3), 2, 0.1)


@FEW
@given(stars(count=60), frame_motions(), st.integers(0, 1000))
def test_edges_settle_and_normals_are_carried(points, H, seed):
    rng = np.random.default_rng(seed)
    normals = kernels.blend_normals(points)
    edges = np.column_stack([rng.normal(0, 1, len(points)), rng.normal(0, 9, (len(points), 3))])
    edges[rng.random(len(points)) < 0.2] = np.nan
    fixed = rng.random(len(points)) < 0.1
    for found, wanted in zip(
        kernels.settle_edges(points, normals, edges, fixed, 0.5, 1.0),
        reference.settle_edges(points, normals, edges, fixed, 0.5, 1.0),
        strict=True,
    ):
        np.testing.assert_allclose(found, wanted, atol=1e-12)
    found, wanted = kernels.carry_normals(H, points, normals), reference.carry_normals(H, points, normals)
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    # a step along the tangent stays perpendicular to the carried normal
    step = 1e-5 * np.column_stack([-normals[:, 1], normals[:, 0]])
    moved = apply_homography(H, points + step) - apply_homography(H, points - step)
    assert np.abs(np.einsum("ij,ij->i", moved, found[:, 2:4])).max() < 1e-9


@FEW
@given(stars(count=80), frame_motions(), st.integers(0, 1000))
def test_a_projective_step_finds_the_motion_that_is_left(points, H, seed):
    rng = np.random.default_rng(seed)
    small = np.eye(3) + 0.02 * (H / H[2, 2] - np.eye(3))
    normals = kernels.blend_normals(points)
    offsets = np.einsum("ij,ij->i", apply_homography(small, points) - points, normals)
    contacts = points[[3, 40, 60]]
    shift, covariance = kernels.projective_step(points, normals, offsets, contacts, 90.0, 50.0)
    expected = apply_homography(small, contacts) - contacts
    sigma = np.sqrt(np.linalg.eigvalsh(covariance)[:, -1].max())
    assert np.abs(shift - expected).max() < 0.1 + 0.05 * np.abs(expected).max() + sigma
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    noisy = offsets + rng.normal(0, 0.3, len(offsets))
    noisy[:6] += 4.0
    for k in (len(points), 12, 0):
        arguments = (points[:k].copy(), normals[:k].copy(), noisy[:k].copy(), contacts, 90.0, 50.0)
        for found, wanted in zip(
            kernels.projective_step(*arguments), reference.projective_step(*arguments), strict=True
        ):
            np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-6)
    # nothing seen, nothing known
    assert np.sqrt(np.linalg.eigvalsh(found)[:, -1]).max() > 40.0
