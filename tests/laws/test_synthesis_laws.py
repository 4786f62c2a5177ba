# SPDX-License-Identifier: Apache-2.0
"""Laws of synthesis: what is returned closes, has room for its fingers, may slip, and is found again from elsewhere."""

import itertools
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from closure import programme
from grasptrack import Hand, Length, kernels
from grasptrack.errors import InputError, StrategyError
from grasptrack.geometry.contours import Contour, View, as_view
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import analyze
from grasptrack.grasp.synthesis import synthesize
from outlines import BRACKET, blobs, dense, similarities, stars
from synthesis_shapes import BAR, FRAME, NOTCHED, RING, SHAPES, circle, material, near

OUTLINES = st.one_of(
    stars().map(Contour), blobs().map(Contour), st.sampled_from(sorted(SHAPES)).map(lambda name: SHAPES[name])
)


@given(OUTLINES, st.sampled_from([2, 3]), st.floats(0.2, 1.0))
def test_each_closes_by_a_linear_programme(outline, fingers, friction):
    area, cx, cy, *_ = kernels.polygon_moments(outline.points, outline.offsets)
    for grasp in synthesize(outline, fingers, friction, top=12):
        found = analyze(grasp, outline, friction)
        assert found.stable and found.margin == pytest.approx(grasp.margin, abs=1e-6)
        weight = programme(grasp.contacts, found.normals, np.array([cx, cy]), 0.5 * math.sqrt(area), friction)
        assert weight > 0 or grasp.margin < 1e-4
        assert math.prod(grasp.terms) == pytest.approx(grasp.quality)
        assert all(0 <= term <= 1 for term in grasp.terms)


@given(OUTLINES, st.sampled_from([2, 3]), st.integers(0, 2**32 - 1))
def test_no_finger_stands_in_material_or_in_another(outline, fingers, seed):
    rng = np.random.default_rng(seed)
    view = as_view(outline)
    size = math.sqrt(kernels.polygon_moments(view.points, view.offsets).area)
    width, depth = 0.1 * size, 0.13 * size
    for grasp in synthesize(outline, fingers, top=10):
        for contact, direction, corners in zip(grasp.contacts, grasp.directions, grasp.swept, strict=True):
            x, y = rng.uniform(-0.5, 0.5, 60) * width, rng.uniform(0, depth, 60)
            across = np.array([-direction[1], direction[0]])
            inside = contact + x[:, None] * across - y[:, None] * direction
            depths = material(view, inside)
            # under the pad the outline may protrude by a quarter of the width
            assert depths[y > 0.25 * width].max() < 1e-3 * size
            assert depths.max() < 0.25 * width
            assert np.hypot(*(corners[0] - corners[1])) == pytest.approx(width)
            assert np.hypot(*(corners[1] - corners[2])) == pytest.approx(depth)
        for one, other in itertools.combinations(grasp.swept, 2):
            assert not overlap(one, other)


def overlap(one, other):
    """Whether two convex polygons share more than a border, by separating axes."""
    for polygon in (one, other):
        for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            axis = np.array([a[1] - b[1], b[0] - a[0]]) / np.hypot(*(a - b))
            p, q = one @ axis, other @ axis
            if p.max() <= q.min() + 1e-6 or q.max() <= p.min() + 1e-6:
                return False
    return True


@given(OUTLINES, st.sampled_from([2, 3]), st.floats(0.2, 1.0), st.integers(0, 2**32 - 1))
def test_whatever_the_contacts_do_in_their_regions_the_grasp_closes(outline, fingers, friction, seed):
    rng = np.random.default_rng(seed)
    view = as_view(outline)
    for grasp in synthesize(outline, fingers, friction, top=8):
        assert (grasp.regions > 0).all()
        places = grasp.on(view)
        for _ in range(25):
            slips = rng.uniform(-1, 1, fingers) if rng.uniform() < 0.5 else rng.choice([-1.0, 1.0], fingers)
            moved = []
            for (c, position, _), slip in zip(places, slips * grasp.regions, strict=True):
                contour = view.contours[int(c)]
                index = np.arange(len(contour) + 1)
                s = (np.interp(position, index, contour.arc_length) + slip) % contour.length
                moved.append([c, np.interp(s, contour.arc_length, index) % len(contour)])
            contacts = kernels.point_at(view.points, view.offsets, np.array(moved))
            assert analyze(Grasp(contacts), view, friction).stable


@given(st.one_of(stars().map(Contour), blobs().map(Contour)), similarities(), st.sampled_from([2, 3]))
def test_a_moved_outline_has_the_moved_grasps(outline, S, fingers):
    here, there = synthesize(outline, fingers, top=6), synthesize(outline.transformed(S), fingers, top=6)
    assert len(here) == len(there)
    if here:
        scale = math.sqrt(abs(np.linalg.det(S[:2, :2])))
        np.testing.assert_allclose([g.quality for g in here], [g.quality for g in there], rtol=1e-6)
        gap = np.diff([g.quality for g in here], append=0.0)
        for one, other, before, after in zip(here, there, np.r_[-1, gap], gap, strict=False):
            if min(-before, -after) > 1e-6:
                far = np.abs(apply_homography(S, one.contacts) - other.contacts).max()
                assert far < 1e-6 * scale * math.sqrt(outline.area)


@settings(max_examples=4)
@given(OUTLINES, st.sampled_from([2, 3]), st.integers(0, 2**32 - 1))
def test_neighbours_only_remove(outline, fingers, seed):
    rng = np.random.default_rng(seed)
    points = outline.points
    size = math.sqrt(kernels.polygon_moments(points, outline.offsets).area)
    beside = points[rng.integers(len(points))] + rng.normal(0, 0.2 * size, 2)
    neighbours = [Contour(circle(*beside, 0.15 * size, 12)), Contour(circle(*(points[0] + 9 * size), size, 8))]
    free = synthesize(outline, fingers, top=100_000)
    crowded = synthesize(outline, fingers, top=100_000, neighbours=neighbours)
    alone = View(neighbours[0])
    for grasp in crowded:
        for finger in grasp.swept:
            middle = finger.mean(axis=0, keepdims=True)
            assert material(alone, np.concatenate([finger, middle])).max() < 1e-3 * size
    assert not crowded or crowded[0].quality <= free[0].quality
    gap = 0.12 * size
    for grasp in (free[k] for k in rng.permutation(len(free))[:100]):
        # where no finger is in the way, the grasp or a better one like it is still there
        if all(cv2_apart(neighbours[0].points, finger) for finger in grasp.swept):
            better = [g for g in crowded if g.quality >= grasp.quality]
            assert any(near(g.contacts, grasp.contacts, gap) for g in better)


def cv2_apart(polygon, rectangle):
    """Whether a convex polygon and a rectangle share no area."""
    import cv2

    area, _ = cv2.intersectConvexConvex(polygon.astype(np.float32), rectangle.astype(np.float32))
    return area == 0.0


def test_rings_and_notches_are_held_in_every_way():
    for outline in (RING, FRAME, NOTCHED):
        grasps = synthesize(outline, top=500)
        assert any(g.spread for g in grasps) and not all(g.spread for g in grasps)
    walls = [g for g in synthesize(RING, top=500) if not g.spread and g.opening < 60]
    assert walls and {int(c) for g in walls for c in g.on(RING)[:, 0]} == {0, 1}
    wide = View([Contour(circle(300, 300, 200, 200)), Contour(circle(300, 300, 150, 150), hole=True)])
    assert any(g.spread for g in synthesize(wide, 3, top=500))


@given(st.sampled_from([RING, FRAME, NOTCHED]), st.sampled_from([2, 3]))
def test_spread_pushes_outward(outline, fingers):
    for grasp in synthesize(outline, fingers, top=200):
        normals = analyze(grasp, outline).normals
        assert (np.einsum("ij,ij->i", normals, grasp.directions) > 0).all()  # each pushes into the material
        apart = grasp.contacts - grasp.contacts.mean(axis=0)
        assert ((np.einsum("ij,ij->i", apart, grasp.directions) > 0) == grasp.spread).all()


def test_ten_grasps_on_a_bar_are_ten_different_ones():
    first = synthesize(BAR, top=10)
    size = math.sqrt(600 * 40)
    for one, other in itertools.combinations(first, 2):
        apart = min(np.hypot(*(one.contacts - o).T).max() for o in (other.contacts, other.contacts[::-1]))
        assert apart >= 0.12 * size


def test_openings():
    free = synthesize(NOTCHED, top=1000)
    openings = [g.opening for g in free]
    limit = float(np.median(openings))
    narrow = synthesize(NOTCHED, top=1000, hand=Hand(max_opening=limit))
    assert narrow and max(g.opening for g in narrow) <= limit
    assert f"too wide for the opening of {limit:.0f} px" in narrow.refused
    wide = synthesize(NOTCHED, top=1000, hand=Hand(min_opening=limit))
    assert wide and min(g.opening for g in wide) >= limit
    assert f"narrower than the least opening of {limit:.0f} px" in wide.refused
    three = synthesize(NOTCHED, 3, top=1000, hand=Hand(max_opening=Length(1.2, "size")))
    size = math.sqrt(kernels.polygon_moments(NOTCHED.points, NOTCHED.offsets).area)
    for grasp in three:
        assert np.hypot(*(grasp.contacts - grasp.contacts.mean(axis=0)).T).max() <= 0.6 * size + 1e-9


SQUARE = Contour([[0, 0], [50, 0], [100, 0], [100, 50], [100, 100], [50, 100], [0, 100], [0, 50]])


@pytest.mark.parametrize(
    ("hand", "friction", "neighbours", "reason"),
    [
        (Hand(max_opening=50), 0.5, (), "too wide for the opening of 50 px: the narrowest stable grasp needs 100 px"),
        (Hand(min_opening=250), 0.5, (), "narrower than the least opening of 250 px: the widest stable grasp has"),
        (Hand(finger_width=150.0), 0.5, (), "the outline under a finger is not flat"),
        (Hand(), 0.5, [Contour(circle(50, 50, 400, 8))], "no room for a finger: a neighbour is in the way"),
    ],
)
def test_reasons(hand, friction, neighbours, reason):
    found = synthesize(SQUARE, friction=friction, hand=hand, neighbours=neighbours)
    assert found == [] and found.reason.startswith(reason)
    assert sum(found.refused.values()) > 0 and list(found.refused.values()) == sorted(found.refused.values())[::-1]


@pytest.mark.parametrize("fingers", [2, 3])
@pytest.mark.parametrize("outline", [NOTCHED, RING, BAR])
def test_what_a_reason_asks_for_is_enough(outline, fingers):
    for key, limit, words in (("max_opening", 6.0, "needs"), ("min_opening", 2000.0, "has")):
        reason = synthesize(outline, fingers, hand=Hand(**{key: limit})).reason
        asked = float(reason.split(f"grasp {words} ")[1].removesuffix(" px"))
        assert synthesize(outline, fingers, hand=Hand(**{key: asked}))


@pytest.mark.parametrize("fingers", [2, 3])
@pytest.mark.parametrize("outline", [NOTCHED, RING])
def test_fingers_of_the_size_that_a_reason_names_find_a_place(outline, fingers):
    width = next(
        w
        for w in 60.0 * 1.4 ** np.arange(9)
        if not synthesize(outline, fingers, hand=Hand(finger_width=w, finger_thickness=9.0))
    )
    large = Hand(finger_width=width, finger_thickness=9.0, px_per_mm=2.0)
    reason = synthesize(outline, fingers, hand=large).reason
    wide, thick = (float(v) for v in re.findall(r"([\d.]+) px", reason))
    assert " mm)" in reason
    assert synthesize(outline, fingers, hand=Hand(finger_width=wide, finger_thickness=thick))


def test_a_long_part_is_taken_across():
    for size in (1.0, 40.0):
        blade = Contour(
            size
            * np.array([[0, 0], [2, -0.3], [4, 0.0], [6, -0.3], [8, 0], [8, 1], [6, 1.3], [4, 1], [2, 1.3], [0, 1]])
        )
        blade = Contour(kernels.resample(blade.points, 300, 0.0))
        assert synthesize(blade)[0].opening < 2.0 * size


def test_reasons_before_any_hand():
    wedge = Contour(np.array([[0, 0], [100, 33], [200, 67], [300, 100], [200, 133], [100, 167], [0, 200], [0, 100]]))
    assert synthesize(wedge, friction=0.001).reason == "no pair of contacts closes with friction 0.001"
    assert synthesize(wedge, 3, friction=0.001).reason == "no three contacts close with friction 0.001"
    cut = Contour(SQUARE.points, clipped=np.ones(8, dtype=bool))
    assert "cut by the border" in synthesize(cut).reason
    small = View([SQUARE, Contour(circle(50, 50, 6, 16), hole=True)])
    assert not any(g.spread for g in synthesize(small))
    assert synthesize(SQUARE).reason == ""


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


def test_no_finger_where_the_border_cuts():
    points = dense([[0, 0], [200, 0], [200, 100], [0, 100]], 300)
    cut = points[:, 1] == 0.0
    for grasp in synthesize(Contour(points, clipped=cut)):
        assert grasp.contacts[:, 1].min() > 1.0
