# SPDX-License-Identifier: Apache-2.0
"""Outlines that a border cuts: what is left is what lies within, and the last frame is what the homography needs there."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasptrack.geometry.contours import Contour
from grasptrack.grasp.contacts import Grasp
from research.paper.clipping import CLIPPED, clip_polygon, clipped_footage
from research.paper.footage import OBJECTS, make_part
from research.paper.transfers import transfer_and_measure


def area(points):
    x, y = points.T
    return 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


@given(st.integers(0, 2**31), st.floats(0.0, 6.28), st.floats(-0.9, 0.9))
@example(236, 0.5, 0.890625)  # all of it lies on one side
def test_both_sides_of_a_border_together_are_the_whole(seed, angle, border):
    rng = np.random.default_rng(seed)
    turns = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    radius = 1.0 + 0.2 * rng.uniform(-1.0, 1.0) * np.cos(2 * turns + rng.uniform(0.0, 6.0))
    points = np.column_stack([radius * np.cos(turns), radius * np.sin(turns)])
    normal = np.array([np.cos(angle), np.sin(angle)])
    kept, on = clip_polygon(points, normal, border)
    rest, _ = clip_polygon(points, -normal, -border)
    left = (area(p) if len(p) > 2 else 0.0 for p in (kept, rest))
    assert sum(left) == pytest.approx(area(points))
    assert on is not None and (kept @ normal <= border + 1e-9).all()
    np.testing.assert_allclose(kept[on] @ normal, border, atol=1e-9)


def test_what_a_border_leaves_in_pieces_is_told():
    u = np.array([(0, 0), (5, 0), (5, 5), (4, 5), (4, 1), (1, 1), (1, 5), (0, 5)], dtype=np.float64)
    assert clip_polygon(u, np.array([0.0, 1.0]), 3.0)[1] is not None  # the legs cut: one piece
    assert clip_polygon(u, np.array([0.0, -1.0]), -3.0)[1] is None  # the legs left alone


@settings(max_examples=2)
@given(st.sampled_from(OBJECTS), st.integers(0, 20))
def test_each_frame_hides_one_per_cent_more_and_leaves_the_contacts(name, seed):
    part = make_part(name, seed)
    seen = clipped_footage(part, seed)
    if seen is None:
        return
    for k, view in enumerate(seen.silhouettes):
        whole = Contour.trusted(part.reference.outer.points).transformed(seen.H[k])
        assert (view.outer.clipped is not None) == (k > 0)
        assert (Grasp(seen.truth("homography", k)).on(view)[:, 2] < 1.0).all()
        if k > 0:
            sides = np.hypot(*(np.roll(view.outer.points, -1, axis=0) - view.outer.points).T)
            cut = view.outer.clipped & np.roll(view.outer.clipped, -1)
            assert sides[~cut].sum() / whole.length == pytest.approx(1.0 - k / 100.0, abs=0.02)


def test_the_last_frame_is_what_makes_the_homography_answer_there():
    asked = alone = following = 0
    for name in OBJECTS:
        for seed in range(1):
            seen = clipped_footage(make_part(name, seed), seed)
            if seen is None:
                continue
            frames = slice(CLIPPED[0], None)
            pairs, tracked = (
                transfer_and_measure(seen, "homography", way).errors[frames]
                for way in ("first view", "last frame as prior")
            )
            asked += len(pairs)
            alone += sum(not isinstance(e, str) for e in pairs)
            following += sum(not isinstance(e, str) for e in tracked)
    assert asked > 25 and alone == 0 and following > 0.3 * asked
