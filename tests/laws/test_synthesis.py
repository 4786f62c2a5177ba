# SPDX-License-Identifier: Apache-2.0
"""Synthesis: stable grasps, ranked, the same every time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.errors import InputError, StrategyError
from grasptrack.geometry.contours import Contour
from grasptrack.grasp.force_closure import analyze
from grasptrack.grasp.synthesis import synthesize
from outlines import BRACKET, blobs, dense, stars


@given(st.one_of(stars(), blobs()), st.floats(0.2, 1.0))
def test_every_grasp_is_stable_ranked_and_distinct(points, friction):
    contour = Contour(points)
    grasps = synthesize(contour, friction=friction)
    assert [g.quality for g in grasps] == sorted((g.quality for g in grasps), reverse=True)
    for grasp in grasps:
        assert analyze(grasp, contour, friction).stable
    again = synthesize(Contour(points), friction=friction)
    assert all((a.contacts == b.contacts).all() for a, b in zip(grasps, again, strict=True))
    size = np.sqrt(contour.area)
    for i, a in enumerate(grasps):
        for b in grasps[:i]:
            assert np.abs(a.contacts - b.contacts).max() > 0.03 * size


def test_a_rectangle_is_held_across_its_middle():
    best = synthesize(Contour(dense([[0, 0], [200, 0], [200, 100], [0, 100]], 300)))[0]
    assert np.sort(best.contacts[:, 1]) == pytest.approx([0, 100])
    assert best.contacts[:, 0] == pytest.approx([100, 100], abs=3)


def test_three_fingers_and_no_more():
    contour = Contour(dense(BRACKET))
    grasps = synthesize(contour, fingers=3)
    assert grasps and all(len(g) == 3 and analyze(g, contour).stable for g in grasps)
    for fingers in (1, 4):
        with pytest.raises(StrategyError, match="2 or 3 fingers"):
            synthesize(contour, fingers=fingers)


def test_a_finger_has_a_width():
    for width in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="finger_width"):
            synthesize(Contour(dense(BRACKET)), finger_width=width)


def test_none_where_none_holds():
    wedge = Contour(dense([[0, 0], [300, 100], [0, 200]], 300))
    assert synthesize(wedge, friction=0.02) == []


def test_no_finger_where_the_border_cuts():
    points = dense([[0, 0], [200, 0], [200, 100], [0, 100]], 300)
    cut = points[:, 1] == 0.0
    for grasp in synthesize(Contour(points, clipped=cut)):
        assert grasp.contacts[:, 1].min() > 1.0
