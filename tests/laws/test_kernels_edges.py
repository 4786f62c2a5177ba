# SPDX-License-Identifier: Apache-2.0
"""Where edge_search finds a straight blurred step, and when it says that there is none."""

import numpy as np
import pytest
from scipy.special import erf

from grasptrack import kernels

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
    assert np.isnan(
        kernels.search_along_normals(image, p[None] + 3.0 * n, normals, 3.0, 1)[0, 0]
    )  # its peak is at the end
    assert np.isnan(kernels.search_along_normals(image, np.array([[-3.0, 5.0]]), normals, 4.0, 0)[0, 0])  # outside
    np.testing.assert_array_equal(
        kernels.search_along_normals(image, np.array([[-30.0, 5.0]]), normals, 4.0, 0), [[np.nan, 0, np.nan, np.nan]]
    )
