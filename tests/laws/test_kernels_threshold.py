# SPDX-License-Identifier: Apache-2.0
"""The threshold that every frame begins with."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import _grasptrack_native as native
import reference
from grasptrack import kernels


@given(st.integers(3, 40), st.integers(3, 40), st.integers(0, 10_000), st.floats(-5, 260), st.sampled_from([1, -1]))
def test_native_equals_reference(height, width, seed, level, polarity):
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
