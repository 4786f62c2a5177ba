# SPDX-License-Identifier: Apache-2.0
"""The compiled kernels of matching, of curves and of whole outlines, equal their definitions."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import _grasptrack_native as kernels
import _grasptrack_native as native
import reference
from grasptrack.geometry.homographies import apply_homography
from grasptrack.kernels.results import AlignmentSteps, CurvatureVector, MatchWindow
from outlines import blobs, dense, frame_motions, stars
from reference.transfer import curvature_peaks


def vectors(points):
    arc = reference.arc_length(points)
    return reference.curvature_vector(points, None, 0.012).curvature, arc


@given(st.one_of(stars(), blobs()), st.floats(0.0, 8.0))
def test_peaks(points, prominence):
    v, arc = vectors(points)
    v[5:9] = np.nan
    found = kernels.select_points(points, arc, v, 0.03 * arc[-1], prominence)
    assert found.peaks == reference.select_points(points, arc, v, 0.03 * arc[-1], prominence).peaks
    assert not set(found.peaks) & set(range(4, 10))


@given(blobs(count=400), st.integers(0, 1000), st.floats(0.5, 4.0))
def test_peaks_among_very_many_crests(points, seed, prominence):
    v, arc = vectors(points)
    v += np.random.default_rng(seed).normal(0.0, 0.5 * prominence, len(v))
    v[50] = np.nan
    found = kernels.select_points(points, arc, v, 0.03 * arc[-1], prominence)
    assert found.peaks == reference.select_points(points, arc, v, 0.03 * arc[-1], prominence).peaks


@given(blobs(count=400), st.integers(0, 1000), st.floats(0.0, 4.0))
def test_equal_peaks_are_not_told_apart_by_rounding(points, seed, prominence):
    rng = np.random.default_rng(seed)
    v, arc = vectors(points)
    v = np.round(2.0 * (v + rng.normal(0.0, 1.0, len(v)))) / 2.0
    rounded = v * (1.0 + 1e-13 * rng.uniform(-1.0, 1.0, len(v)))
    found = [kernels.select_points(points, arc, w, 0.03 * arc[-1], prominence + 0.1).peaks for w in (v, rounded)]
    assert found[0] == found[1] == reference.select_points(points, arc, v, 0.03 * arc[-1], prominence + 0.1).peaks


@given(st.one_of(stars(), blobs()), st.integers(0, 299), st.booleans())
def test_curvature_vectors_and_the_points_selected_by_them(points, cut, clip):
    n = len(points)
    clipped = (np.arange(n) - cut) % n < 5 if clip else None
    found, wanted = kernels.curvature_vector(points, clipped, 0.012), reference.curvature_vector(points, clipped, 0.012)
    for a, b in zip(found, wanted, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-6)
    assert np.isnan(found[1]).sum() == (5 + 2 * int(np.ceil(1.5 * 0.012 * n)) if clip else 0)
    arc, v = wanted
    for prominence in (1.0, 4.0):
        arguments = points, arc, v, 0.03 * arc[-1], prominence
        (peaks, triangle), (same, wanted_triangle) = (
            kernels.select_points(*arguments),
            reference.select_points(*arguments),
        )
        assert peaks == same
        assert sorted(peaks) == sorted(curvature_peaks(v, arc, 0.03 * arc[-1], prominence).tolist())
        assert triangle == pytest.approx(wanted_triangle)


@given(stars(), frame_motions(), st.lists(st.integers(0, 290), min_size=4, max_size=4, unique=True))
def test_homographies_of_samples_and_contacts_carried_by_them(points, H, samples):
    current, offsets = apply_homography(H, points), np.array([0, len(points)])
    arguments = points, samples, current, samples
    assume(reference.best_quadrilateral(points[samples], np.ones(4)).triangle > 100.0)
    wanted = reference.fit_homography(*arguments)
    assert wanted[1:] == pytest.approx(reference.distortion(wanted[0], points[samples]))
    assume(wanted[1] > 1e-3)
    for a, b in zip(kernels.fit_homography(*arguments), wanted, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6)
    three = points[[20, 130, 240]]
    normals = kernels.blend_normals(points)[[20, 130, 240]]
    for contacts, along in ((three[:2], None), (three, normals)):
        carried = H, contacts, along, current, offsets
        for a, b in zip(kernels.refine_contacts(*carried), reference.refine_contacts(*carried), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-6)


def test_contacts_without_a_crossing_of_their_own_are_told():
    square = np.array([[0.0, 0], [100, 0], [100, 100], [0, 100]])
    offsets = np.array([0, 4])
    for module in (kernels, reference):
        off = module.refine_contacts(np.eye(3), np.array([[10.0, 300], [90, 300]]), None, square, offsets)
        assert np.isnan(off[1])
        same = module.refine_contacts(np.eye(3), np.array([[-20.0, 50], [-10, 50]]), None, square, offsets)
        assert same[1] == np.inf
        behind = np.array([[1.0, 0, 0], [0, 1, 0], [-0.02, 0, 1]])
        assert module.refine_contacts(behind, np.array([[0.0, 50], [100, 50]]), None, square, offsets)[3] < 0
        assert module.distortion(behind, square)[0] < 0
        assert np.isnan(module.distortion(np.full((3, 3), np.nan), square)[0])
        assert module.distortion(np.diag([-1.0, 1, 1]), square)[1] < 0
        assert module.distortion(np.diag([20.0, 1, 1]), square)[2] == pytest.approx(20)


@given(st.integers(0, 8), st.integers(0, 1000))
def test_quadrilateral(count, seed):
    rng = np.random.default_rng(seed)
    points, weights = rng.uniform(0, 100, (count, 2)), rng.uniform(1, 5, count)
    found, wanted = kernels.best_quadrilateral(points, weights), reference.best_quadrilateral(points, weights)
    assert found.corners == wanted.corners
    assert found.triangle == pytest.approx(wanted.triangle)


@given(blobs(), stars(count=211))
def test_alignment(first, second):
    arguments = (first, reference.arc_length(first), second, reference.arc_length(second))
    for tie in (0.0, 0.1, 1.0):
        found = kernels.align_outlines(*arguments, 64, tie)
        wanted = reference.align_outlines(*arguments, 64, tie)
        np.testing.assert_allclose(found, wanted, atol=1e-9)


@given(st.one_of(stars(), blobs()), frame_motions(), st.integers(0, 299), st.booleans())
def test_eq_3(points, H, start, gap):
    moved = np.roll(apply_homography(H, points), start, axis=0)
    (v1, arc1), (v2, arc2) = vectors(points), vectors(np.ascontiguousarray(moved))
    if gap:
        v2[20:40] = np.nan
    peaks = np.argsort(-np.abs(v1))[:4].astype(np.int64)
    kappa = arc2[-1] / arc1[-1]
    centres = kappa * arc1[peaks] + 3.0
    arguments = CurvatureVector(arc1, v1), peaks.tolist(), CurvatureVector(arc2, v2), centres.tolist()
    window = MatchWindow(kappa, 0.04 * arc1[-1], 12, 0.0025 * arc1[-1], 0.2)
    strict, same = kernels.match_curvature(*arguments, window), reference.match_curvature(*arguments, window)
    assert [j < 0 for j in strict[0]] == [j < 0 for j in same[0]]
    window = window._replace(tolerance=1e9)
    found, wanted = kernels.match_curvature(*arguments, window), reference.match_curvature(*arguments, window)
    np.testing.assert_allclose(found[1], wanted[1], rtol=1e-9, atol=1e-9)
    places = np.array(found.places)[~np.isnan(found.places)]
    assert ((places >= 0.0) & (places < len(points))).all()
    if found.samples == wanted.samples:
        np.testing.assert_allclose(found.places, wanted.places, rtol=0.0, atol=1e-6)
    # of samples that fit alike either may be taken; all must be samples
    samples = np.array(found[0])
    assert ((samples >= -1) & (samples < len(points))).all()
    apart = np.abs(np.mod(arc2[samples] - centres + 0.5 * arc2[-1], arc2[-1]) - 0.5 * arc2[-1])
    assert (apart <= kappa * 0.04 * arc1[-1] + 1e-9).all() or gap


@pytest.mark.parametrize("spoil", ["no reach", "only NaN", "an infinite peak"])
def test_where_nothing_is_near_there_is_no_match_however_much_may_differ(spoil):
    """An error that is not finite passed an infinite tolerance, and sample -1 was read."""
    arc, v = np.arange(11.0), np.arange(10.0)
    first, second, reach = CurvatureVector(arc, v.copy()), CurvatureVector(arc, v.copy()), 3.0
    if spoil == "no reach":
        reach = -1.0
    elif spoil == "only NaN":
        second.curvature[:] = np.nan
    else:
        first.curvature[2] = np.inf
    window = MatchWindow(1.0, reach, 2, 0.5, math.inf)
    for backend in (kernels, reference):
        with np.errstate(all="ignore"):
            found = backend.match_curvature(first, [2], second, [2.0], window)
        assert found.samples == [-1] and math.isnan(found.places[0])


def test_a_place_rounded_to_the_end_is_the_first():
    """The match is sample 0, and rounding may put it 1e-17 before; that was place N, which is none."""
    points = 50.0 * np.array(
        [[math.cos(t), 0.6 * math.sin(t)] for t in np.linspace(0, 2 * math.pi, 60, endpoint=False)]
    )
    v, arc = vectors(points)
    for shift in np.linspace(-3e-15, 3e-15, 61):
        moved = v + shift * np.gradient(v, arc[:-1])
        arguments = CurvatureVector(arc, moved), [0], CurvatureVector(arc, v), [0.0], MatchWindow(1.0, 8.0, 4, 2.0, 1e9)
        for backend in (kernels, reference):
            assert 0.0 <= backend.match_curvature(*arguments).places[0] < len(points)


@given(stars(count=80), frame_motions(), st.lists(st.floats(0.0, 79.99), min_size=4, max_size=4))
def test_homography_of_places_between_samples(points, H, places):
    moved, indices = apply_homography(H, points), [int(place) for place in places]
    try:
        wanted = reference.fit_homography(points, indices, moved, places)
    except ValueError:  # three in a row, or nearly
        assume(False)
    found = kernels.fit_homography(points, indices, moved, places)
    assume(np.abs(wanted.H).max() < 1e6)
    np.testing.assert_allclose(found.H, wanted.H, rtol=1e-6, atol=1e-6 * np.abs(wanted.H).max())


@given(stars(), st.floats(0.5, 4.0))
def test_curvature_may_refer_to_another_length(points, share):
    """Twice the length is twice the smoothing and twice the number."""
    whole = share * reference.arc_length(points)[-1]
    found = kernels.curvature_vector(points, None, 0.012, whole)
    wanted = reference.curvature_vector(points, None, 0.012, whole)
    np.testing.assert_allclose(found.curvature, wanted.curvature, rtol=1e-9, atol=1e-7)
    same = kernels.curvature_vector(points, None, 0.012 * share).curvature * share
    np.testing.assert_allclose(found.curvature, same, rtol=1e-9, atol=1e-7)


def test_bad_arguments():
    v, arc = np.ones(10), np.arange(10.0)
    with pytest.raises(ValueError, match="arc"):
        kernels.select_points(np.zeros((10, 2)), arc, v, 1.0, 1.0)
    with pytest.raises(ValueError, match="weight"):
        kernels.best_quadrilateral(np.zeros((4, 2)), np.ones(3))
    with pytest.raises(ValueError, match="flag"):
        kernels.curvature_vector(np.eye(9, 2), np.zeros(3, dtype=bool), 0.01)
    with pytest.raises(ValueError, match="four points"):
        kernels.fit_homography(np.eye(4, 2), [0, 1, 2], np.eye(4, 2), [0, 1, 2])
    with pytest.raises(ValueError, match="place"):
        kernels.fit_homography(np.eye(4, 2), [0, 1, 2, 3], np.eye(4, 2), [0, 1, 2, math.nan])
    with pytest.raises(ValueError, match="two"):
        kernels.refine_contacts(np.eye(3), np.ones((3, 2)), None, np.ones((4, 2)), np.array([0, 4]))
    with pytest.raises(ValueError, match="count"):
        kernels.align_outlines(np.eye(2), np.zeros(3), np.eye(2), np.zeros(3), 2, 0.1)


@given(stars(count=60), frame_motions(), st.integers(0, 1000))
def test_normals_are_carried(points, H, seed):
    rng = np.random.default_rng(seed)
    normals = kernels.blend_normals(points)
    found, wanted = kernels.carry_normals(H, points, normals), reference.carry_normals(H, points, normals)
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    (moved, in_front), (at, least) = kernels.carry_points(H, points), reference.carry_points(H, points)
    np.testing.assert_array_equal(moved, at)
    np.testing.assert_allclose(moved, found[:, :2], atol=1e-9)
    assert in_front == least == kernels.carry_points(-H, points)[1]
    # of no account: the sign of H, its scale, and where the images' origins lie
    np.testing.assert_array_equal(kernels.carry_normals(-H, points, normals), found)
    away = np.eye(3)
    away[:2, 2] = rng.normal(0, 1e4, 2)
    for side in (kernels, reference):
        elsewhere = side.carry_normals(H @ np.linalg.inv(away), points + away[:2, 2], normals)
        np.testing.assert_allclose(elsewhere, found, atol=1e-6)
    # a step along the tangent stays perpendicular to the carried normal
    step = 1e-5 * np.column_stack([-normals[:, 1], normals[:, 0]])
    moved = apply_homography(H, points + step) - apply_homography(H, points - step)
    assert np.abs(np.einsum("ij,ij->i", moved, found[:, 2:4])).max() < 1e-9


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
