# SPDX-License-Identifier: Apache-2.0
"""From a silhouette's chain of pixels to sub-pixel points."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import _grasptrack_native as native
import reference
from grasptrack.kernels.results import TraceOptions
from outlines import stars


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
def test_native_equals_reference(points, seed, hole, polarity, cover):
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
        for kernels in (native, reference):
            with pytest.raises(ValueError):
                kernels.trace_edges(image, chain, None, how)
    with pytest.raises((ValueError, IndexError)):
        native.trace_edges(image, chain, image[:20].copy(), HOW)
