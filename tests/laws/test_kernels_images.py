# SPDX-License-Identifier: Apache-2.0
"""Kernels on images: where an edge is found and where none, mended edges, the threshold, sub-pixel points of a chain."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import erf

import _grasptrack_native as native
import reference
from grasptrack import kernels
from grasptrack.kernels.results import TraceOptions
from outlines import stars

SHIFTS = np.array([-2.1, -1.3, 0.0, 0.4, 1.7])


def step(angle, offset, sigma, contrast):
    """Dark half-plane of 64x64, grey rising along the normal: image, a point of the edge, the normal."""
    n = np.array([np.cos(angle), np.sin(angle)])
    p = np.array([32 + 0.83 * offset, 32 + 0.37 * offset])
    y, x = np.mgrid[0:64, 0:64]
    d = (x - p[0]) * n[0] + (y - p[1]) * n[1]
    return np.round(60 + contrast * 0.5 * (1 + erf(d / sigma / np.sqrt(2)))).astype(np.uint8), p, n


@pytest.mark.parametrize(("sigma", "contrast"), [(0.7, 100.0), (1.0, 100.0), (1.5, 190.0)])
def test_no_bias(sigma, contrast):
    errors = []
    for angle in np.radians([0, 7.5, 26.565, 33, 45, 61, 90, 118, 135, 180, 222, 270, 315]):
        for offset in np.arange(8) / 8:
            image, p, n = step(angle, offset, sigma, contrast)
            found = kernels.search_along_normals(image, p + SHIFTS[:, None] * n, np.tile(n, (len(SHIFTS), 1)), 4.0, 1)
            errors.append(found[:, 0] + SHIFTS)
    # Rounding to 8 bit alone accounts for most of the largest error; the mean is the bias.
    assert np.abs(errors).max() < 0.025
    assert abs(np.mean(errors)) < 0.001
    assert np.std(errors) < 0.01


def test_polarity_strength_and_levels():
    image, p, n = step(0.6, 0.3, 1.0, 120.0)
    points, normals = p[None], n[None]
    offset, strength, inside, outside = kernels.search_along_normals(image, points, normals, 6.0, 1)[0]
    assert abs(offset) < 0.02 and abs(inside - 60) < 8 and abs(outside - 180) < 8
    assert strength == pytest.approx(120 / np.sqrt(2 * np.pi), rel=0.15)
    mirrored = kernels.search_along_normals(image, points, -normals, 6.0, -1)[0]
    np.testing.assert_allclose(mirrored, [-offset, -strength, outside, inside], atol=1e-9)
    either = kernels.search_along_normals(image.astype(np.float32), points, normals, 6.0, 0)[0]
    np.testing.assert_allclose(either, [offset, strength, inside, outside], atol=1e-9)
    assert np.isnan(kernels.search_along_normals(image, points, normals, 6.0, -1)[0, 0])


def test_what_is_no_edge():
    image, p, n = step(0.0, 0.0, 1.0, 120.0)
    normals = n[None]
    assert np.isnan(kernels.search_along_normals(np.full_like(image, 9), p[None], normals, 6.0, 0)[0, 0])
    # its peak is at the end
    assert np.isnan(kernels.search_along_normals(image, p[None] + 3.0 * n, normals, 3.0, 1)[0, 0])
    assert np.isnan(kernels.search_along_normals(image, np.array([[-3.0, 5.0]]), normals, 4.0, 0)[0, 0])  # outside
    np.testing.assert_array_equal(
        kernels.search_along_normals(image, np.array([[-30.0, 5.0]]), normals, 4.0, 0), [[np.nan, 0, np.nan, np.nan]]
    )


@given(st.integers(3, 40), st.integers(3, 40), st.integers(0, 10_000), st.floats(-5, 260), st.sampled_from([1, -1]))
def test_the_threshold_equals_its_definition(height, width, seed, level, polarity):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (height, width), dtype=np.uint8)
    left, right = np.sort(rng.choice(width + 1, 2, replace=False)).tolist()
    top, bottom = np.sort(rng.choice(height + 1, 2, replace=False)).tolist()
    window = (left, top, right, bottom, level, polarity)
    np.testing.assert_array_equal(native.blur_threshold(image, *window), reference.blur_threshold(image, *window))
    other = kernels.blur_threshold(image, left, top, right, bottom, level, -polarity)
    np.testing.assert_array_equal(kernels.blur_threshold(image, *window), 255 - other)


def test_a_window_outside_the_image_is_refused():
    with pytest.raises((ValueError, IndexError)):
        kernels.blur_threshold(np.zeros((8, 8), np.uint8), 0, 0, 9, 4, 100.0, 1)


def picture(points, seed):
    """A dark object on a light ground, four times over-sampled; its chain of pixels."""
    rng = np.random.default_rng(seed)
    large = np.full((1200, 1200), 200, np.uint8)
    cv2.fillPoly(large, [np.rint(points * 4 * 0.5 + 1.5).astype(np.int32)], 60)
    image = cv2.GaussianBlur(cv2.resize(large, (300, 300), interpolation=cv2.INTER_AREA), (0, 0), 0.8)
    image = np.clip(image + rng.normal(0, 3, image.shape), 0, 255).astype(np.uint8)
    chains, _ = cv2.findContours((image < 130).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return image, max(chains, key=cv2.contourArea).reshape(-1, 2)


@given(stars(), st.integers(0, 1000), st.booleans(), st.sampled_from([1, -1, 0]), st.booleans())
def test_traced_edges_equal_their_definition(points, seed, hole, polarity, cover):
    image, chain = picture(points, seed)
    hidden = None
    if cover:
        hidden = np.zeros_like(image)
        hidden[:150] = 255
    arguments = image, chain, hidden, TraceOptions(hole, polarity, 1.0, 700, 4.0, 4.0, 1.5, 1.0)
    found, wanted = native.trace_edges(*arguments), reference.trace_edges(*arguments)
    # of two slopes of 8 bit images that are equal, rounding decides which is the stronger
    apart = np.abs(found[0] - wanted[0]).max(axis=1) + np.abs(found[1] - wanted[1])
    assert (apart > 1e-6).mean() < 0.03
    np.testing.assert_array_equal(found[2], wanted[2])
    # one such point may lie anywhere beside a median of few or of two kinds of ground
    np.testing.assert_allclose(found[3:], wanted[3:], atol=1e-6 if apart.max() < 1e-6 else 10.0)
    assert found[2].dtype == np.bool_
    area = cv2.contourArea(found[0].astype(np.float32), oriented=True)
    assert (area < 0) is hole


HOW = TraceOptions(False, 1, 1.0, 100, 4.0, 4.0, 1.5, 1.0)


def test_bad_arguments():
    image = np.zeros((50, 50), np.uint8)
    chain = np.array([[1, 1], [20, 1], [20, 20], [1, 20]], np.int32)
    with pytest.raises((ValueError, IndexError)):
        native.trace_edges(image, chain[:2], None, HOW)
    for how in (HOW._replace(spacing=0.0), HOW._replace(most=10**9), HOW._replace(reach=np.nan)):
        for module in (native, reference):
            with pytest.raises(ValueError):
                module.trace_edges(image, chain, None, how)
    with pytest.raises((ValueError, IndexError)):
        native.trace_edges(image, chain, image[:20].copy(), HOW)
