# SPDX-License-Identifier: Apache-2.0
"""The check of a carried outline against an image."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack import kernels
from grasptrack.kernels import reference
from outlines import frame_motions, stars
from test_kernels_outline import picture

RULES = (1, 20_000.0, 0.02, 3.0, 12.0, 2.0, 0.3, 0.35, 0.25)


@settings(max_examples=25, deadline=None)
@given(stars(), frame_motions(), st.integers(0, 1000))
def test_native_equals_reference(points, H, seed):
    image, _ = picture(points, seed)
    outline = np.ascontiguousarray(points[::4] * 0.5)
    strength = np.random.default_rng(seed).uniform(5, 80, len(outline))
    strength[::9] = np.inf
    small = np.eye(3) + 0.2 * (H / H[2, 2] - np.eye(3))
    arguments = (image, small, outline, kernels.blend_normals(outline), strength, outline[[3, 30]], *RULES)
    found, wanted = kernels.outline_support(*arguments), reference.outline_support(*arguments)
    for a, b in zip(found[:4], wanted[:4], strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9)
    np.testing.assert_array_equal(found[5], wanted[5])
    # of two slopes of 8 bit images that are equal, rounding decides which is the stronger
    same = np.isclose(found[4], wanted[4], atol=1e-6, equal_nan=True).all(axis=1) & (found[6] == wanted[6])
    assert same.mean() > 0.96
    if same.all():
        np.testing.assert_allclose(found[7], wanted[7], atol=1e-6)
        np.testing.assert_allclose(found[8], wanted[8], rtol=1e-6, atol=1e-6)


def test_an_outline_beyond_infinity_has_no_size():
    outline = np.array([[10.0, 10], [40, 10], [40, 40], [10, 40]])
    H = np.array([[1.0, 0, 0], [0, 1, 0], [-0.05, 0, 1]])
    image = np.zeros((50, 50), np.uint8)
    for backend in (kernels, reference):
        found = backend.outline_support(image, H, outline, -outline / 57.0, np.ones(4), outline[:2].copy(), *RULES)
        assert found[0] == 0.0 and not found[6].any()
    with pytest.raises((ValueError, IndexError, ZeroDivisionError)):
        kernels.outline_support(image, H, outline[:0], outline[:0], np.ones(0), outline[:2].copy(), *RULES)
