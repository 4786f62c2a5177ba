# SPDX-License-Identifier: Apache-2.0
"""Links between the ends of broken edges."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import _grasptrack_native as native
import reference
from grasptrack import kernels

RULES = (60.0, np.radians(25.0), np.radians(70.0))


@given(st.integers(8, 70), st.integers(8, 70), st.integers(0, 10_000), st.floats(0.02, 0.3))
def test_native_equals_reference(height, width, seed, share):
    rng = np.random.default_rng(seed)
    edges = (rng.random((height, width)) < share * 0.3).astype(np.uint8)
    for _ in range(6):  # strokes, so that some edges have ends
        x, y = rng.integers(0, width), rng.integers(0, height)
        dx, dy = rng.integers(-1, 2, 2)
        for k in range(rng.integers(5, 40)):
            if 0 <= x + k * dx < width and 0 <= y + k * dy < height:
                edges[y + k * dy, x + k * dx] = 255
    np.testing.assert_array_equal(native.edge_links(edges, *RULES), reference.edge_links(edges, *RULES))


@pytest.mark.parametrize("gap", [3, 12, 40])
def test_a_straight_edge_is_mended(gap):
    edges = np.zeros((40, 200), np.uint8)
    edges[20, 10:90] = edges[20, 90 + gap : 190] = 255
    assert kernels.edge_links(edges, *RULES).tolist() == [[89, 20, 90 + gap, 20]]


def test_ends_that_do_not_point_at_each_other_stay_apart():
    edges = np.zeros((120, 200), np.uint8)
    edges[20, 10:90] = 255
    edges[60:110, 100] = 255  # goes up, across the first one's way
    assert len(kernels.edge_links(edges, *RULES)) == 0
    edges[:] = 0
    edges[20, 10:90] = edges[20, 160:190] = 255  # farther than the shorter one's length allows
    assert len(kernels.edge_links(edges, *RULES)) == 0


def test_an_edge_that_the_border_cuts_has_no_end_there():
    edges = np.zeros((40, 100), np.uint8)
    edges[20, :40] = edges[20, 50:] = 255
    assert kernels.edge_links(edges, *RULES).tolist() == [[39, 20, 50, 20]]
