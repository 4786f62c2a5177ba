# SPDX-License-Identifier: Apache-2.0
"""Two outlines without a prior: laws of the match, of the judgement, and of an object's own symmetries."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack import kernels
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.matching import (
    Sampled,
    find_symmetries,
    judge_hypotheses,
    lay_several,
    match_outlines,
    match_several,
    may_match,
)
from grasptrack.matching.rating import fits_alike
from grasptrack.matching.samples import APART, BENDS, COUNT, pooled_starts
from grasptrack_bench.simulation import SHAPES, Path, Pinhole, Shape
from grasptrack_bench.simulation.lookalikes import mirrored_shape
from outlines import BRACKET, dense, similarities, stars

CAMERA = Pinhole(640, 480, focal=320.0 / math.tan(math.radians(30.0)))
ONE_WAY = "bracket", "spanner", "gasket", "hinge", "hook", "key", "bean", "knife", "fork", "bottle-opener"
CHIRAL = "bracket", "hook", "s-blob", "key"


def posed(shape, tilt, turn, azimuth, share):
    """(3, 3) from the part's plane to the image: tilt in rad, the share of the view that it fills."""
    distance = 2.0 * shape.radius() * CAMERA.matrix[0, 0] / (share * CAMERA.width)
    values = distance, turn, tilt, azimuth
    return Path(np.zeros((1, 2)), *(np.array([v]) for v in values)).table_to_image(CAMERA)[0]


def seen(shape, H, seed=0, noise=0.2):
    rng = np.random.default_rng(seed)
    contours = []
    for i, polygon in enumerate(shape.polygons):
        count = max(16, round(Contour(apply_homography(H, dense(polygon)), hole=i > 0).length))
        points = apply_homography(H, dense(polygon, count))
        points = np.roll(points, int(rng.integers(len(points))), axis=0)
        contours.append(Contour.trusted(points + rng.normal(0, noise, points.shape), hole=i > 0))
    return View(contours)


def apart(H, G, points):
    return float(np.hypot(*(apply_homography(H, points) - apply_homography(G, points)).T).max())


views = st.tuples(
    st.floats(0.0, math.radians(60.0)), st.floats(0, 2 * math.pi), st.floats(0, 2 * math.pi), st.floats(0.2, 0.6)
)


@given(st.sampled_from(ONE_WAY), views, st.floats(0, 2 * math.pi))
def test_any_view_is_matched_to_the_one_from_the_front(name, view, turn):
    shape = SHAPES[name]()
    H1, H2 = posed(shape, 0.0, turn, 0.0, 0.4), posed(shape, *view)
    first, second = seen(shape, H1, 1), seen(shape, H2, 2)
    told = judge_hypotheses(match_outlines(first, second))
    size = math.sqrt(second.outer.area)
    assert told.status == "matched" and told.best is not None
    assert apart(told.best.homography, H2 @ np.linalg.inv(H1), first.outer.points) < max(3.0, 0.04 * size)


@given(st.sampled_from(ONE_WAY), views)
def test_the_way_back_is_the_inverse(name, view):
    shape = SHAPES[name]()
    first, second = seen(shape, posed(shape, 0.0, 0.3, 0.0, 0.4), 1), seen(shape, posed(shape, *view), 2)
    there, back = match_outlines(first, second)[0].homography, match_outlines(second, first)[0].homography
    assert apart(np.linalg.inv(back), there, first.outer.points) < 0.03 * math.sqrt(second.outer.area)


@given(stars(), st.integers(0, 299), similarities())
def test_first_point_and_similarity_of_either_view_change_nothing(points, start, motion):
    first = Contour(points)
    moved = Contour(np.roll(apply_homography(motion, points), -start, axis=0)[::-1])
    size = math.sqrt(moved.area)
    there, back = match_outlines(first, moved), match_outlines(moved, first)
    assert apart(there[0].homography, motion, points) < 0.01 * size
    assert apart(back[0].homography @ motion, np.eye(3), points) < 0.01 * math.sqrt(first.area)


def test_an_outline_matches_itself_by_the_identity():
    first = Contour(dense(BRACKET))
    best = match_outlines(first, first)[0]
    assert apart(best.homography, np.eye(3), first.points) < 1e-3
    assert best.misfit < 1e-3 and best.share == 1.0


@pytest.mark.parametrize("name", CHIRAL)
def test_a_mirror_image_is_never_matched(name):
    shape = SHAPES[name]()
    first = seen(shape, posed(shape, 0.0, 0.2, 0.0, 0.4))
    for k, tilt in enumerate((0.0, 0.7, 1.0)):
        second = seen(mirrored_shape(shape), posed(shape, tilt, 1.0, 0.4, 0.4), k)
        found = match_outlines(first, second)
        assert all(kernels.distortion(m.homography, first.points)[1] > 0 for m in found)
        assert not found or found[0].misfit > 0.03 * found[0].size


def test_what_cannot_be_told_apart_is_ambiguous():
    for name, ways in (("square", 4), ("cross", 4), ("rectangle", 2), ("hex-nut", 6)):
        shape = SHAPES[name]()
        first, second = (seen(shape, posed(shape, tilt, 0.2, 1.0, 0.4)) for tilt in (0.0, 0.2))
        told = judge_hypotheses(match_outlines(first, second, 8))
        assert told.status == "ambiguous" and 1 + len(told.others) >= ways, name
        assert all(fits_alike(m, told.best) or m.misfit < told.best.misfit for m in told.others)


@pytest.mark.parametrize("name", ["disc", "ellipse", "egg"])
def test_what_slides_along_itself_is_never_matched(name):
    shape = SHAPES[name]()
    first, second = (seen(shape, posed(shape, tilt, 0.2, 1.0, 0.4)) for tilt in (0.0, 0.6))
    assert judge_hypotheses(match_outlines(first, second)).status == "ambiguous"


def test_other_objects_do_not_match():
    first, second = (seen(SHAPES[n](), posed(SHAPES[n](), 0.0, 0.0, 0.0, 0.4)) for n in ("fork", "gear"))
    assert judge_hypotheses(match_outlines(first, second)).status == "none"
    assert judge_hypotheses([]).status == "none"


@pytest.mark.parametrize("cut", [0.1, 0.2])
@pytest.mark.parametrize("name", ["bracket", "key", "gasket"])
def test_a_piece_may_be_cut_off(name, cut):
    shape = SHAPES[name]()
    H1, H2 = posed(shape, 0.0, 0.0, 0.0, 0.4), posed(shape, 0.4, 1.0, 0.5, 0.4)
    first, whole = seen(shape, H1), seen(shape, H2, 3)
    points = whole.outer.points
    second = Contour.trusted(points[points[:, 0] <= np.quantile(points[:, 0], 1.0 - cut)])
    told = judge_hypotheses(match_outlines(first, second))
    assert told.best is not None
    assert apart(told.best.homography, H2 @ np.linalg.inv(H1), first.outer.points) < 0.04 * math.sqrt(whole.outer.area)


def test_samples_made_before_serve_as_well():
    first, second = Contour(dense(BRACKET)), Contour(dense(BRACKET)[::-1] * 0.7)
    one, other = match_outlines(first, second), match_outlines(Sampled(first), Sampled(second))
    np.testing.assert_array_equal(one[0].homography, other[0].homography)


@settings(max_examples=8, deadline=None)
@given(st.integers(3, 9), st.floats(0, 6.2), st.integers(0, 99))
def test_a_regular_polygon_has_as_many_symmetries_as_corners(corners, turn, seed):
    angle = turn + 2 * math.pi * np.arange(corners) / corners
    points = dense(np.column_stack([np.cos(angle), np.sin(angle)]) * 90.0 + 200.0, 500)
    found = find_symmetries(Contour.trusted(points + np.random.default_rng(seed).normal(0, 0.2, points.shape)))
    assert 1 + len(found.turns) == corners and not found.continuous
    wanted = np.sort(np.abs([math.remainder(2 * math.pi * k / corners, 2 * math.pi) for k in range(1, corners)]))
    np.testing.assert_allclose(np.sort(np.abs([s.turn for s in found.turns])), wanted, atol=0.02)


def toothed(teeth, missing=0):
    angle = np.linspace(0, 2 * math.pi, 40 * teeth, endpoint=False)
    high = np.mod(angle * teeth / (2 * math.pi), 1.0) < 0.5
    high &= angle >= 2 * math.pi * missing / teeth
    radius = np.where(high, 100.0, 82.0)
    return Contour(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))


@pytest.mark.parametrize("teeth", [5, 8, 12])
def test_a_gear_has_as_many_symmetries_as_teeth_unless_one_is_missing(teeth):
    assert len(find_symmetries(toothed(teeth)).turns) == teeth - 1
    broken = find_symmetries(toothed(teeth, missing=1))
    assert not broken.turns
    assert bool(broken.near) == (teeth > 5)  # one of five is too much to be near


def test_discs_and_rings_fit_in_every_turn():
    angle = np.linspace(0, 2 * math.pi, 400, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    for view in (Contour(80 * circle), View([Contour(80 * circle), Contour(40 * circle, hole=True)])):
        found = find_symmetries(view)
        assert found.continuous and not found.turns
    off = Shape.of("off", circle, [0.3 * circle + [0.5, 0.0]])
    assert not find_symmetries(seen(off, similarity_transform(100.0, 0.0, (0, 0), (300, 200)))).turns


# --- several outlines on one ------------------------------------------------------------------------


@given(st.lists(stars(count=120), min_size=1, max_size=4), stars(count=120), st.floats(0.1, 1.0))
def test_pooled_starts_are_the_best_of_those_of_each_pair(firsts, second, limit):
    """What the harmonics rule out is none of them."""
    first, b = [Sampled(Contour(points)) for points in firsts], Sampled(Contour(second))
    got = pooled_starts([a.whitened_bent for a in first], b.whitened_outline, 12, limit)
    pairs = [kernels.initial_alignments(a.outer, b.outer, BENDS, COUNT, APART, 12) for a in first]
    wanted = np.sort(np.concatenate([rows[:, 0] for rows in pairs]))
    np.testing.assert_allclose(got.left, wanted[wanted <= limit][:12], atol=1e-6)
    for index, left, H in zip(got.owner, got.left, got.homographies, strict=True):
        rows = pairs[index]
        alike = np.abs(rows[:, 0] - left) < 1e-6
        assert np.abs(rows[alike, 2:] - H).max(axis=1).min() < 1e-6 * np.abs(H).max() + 1e-6


@pytest.mark.parametrize("name", ONE_WAY)
def test_of_several_outlines_the_right_one_is_laid_on_the_whole(name):
    kinds = [Sampled(Contour(100.0 * SHAPES[each]().outer)) for each in ONE_WAY]
    view = seen(SHAPES[name](), H := posed(SHAPES[name](), 0.6, 1.0, 0.4, 0.5))
    found = match_several(kinds, Sampled(view), 0.35)
    own = ONE_WAY.index(name)
    assert may_match(kinds, Sampled(view), 0.35) and found[own]
    at = 100.0 * SHAPES[name]().outer
    gaps = apply_homography(found[own][0].homography, at) - apply_homography(H, at / 100.0)
    assert np.hypot(*gaps.T).max() < 0.04 * Sampled(view).size
    assert all(m[0].misfit > found[own][0].misfit for k, m in enumerate(found) if m and k != own)


def test_an_outline_is_laid_on_a_part_of_a_larger_one():
    """A bracket and a square that touch, as one outline."""
    bracket = 100.0 * SHAPES["bracket"]().outer
    (_, top), (right, bottom) = bracket.min(axis=0), bracket.max(axis=0)
    beside = np.array([[right - 4, top], [right + 90, top], [right + 90, bottom], [right - 4, bottom]])
    mask = np.zeros((700, 700), np.uint8)
    for ring in (bracket, beside):
        cv2.fillPoly(mask, [np.rint(ring + 300.0).astype(np.int32)], (255,))
    chain = max(cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0], key=len)[:, 0].astype(float)
    (ways, none) = lay_several(
        [Sampled(Contour(bracket)), Sampled(Contour(100.0 * SHAPES["spanner"]().outer))], Sampled(Contour(chain[::-1]))
    )
    assert min(np.abs(apply_homography(H, bracket) - bracket - 300.0).max() for H in ways) < 6.0
    assert len(ways) <= 3 and len(none) <= 3


@pytest.mark.parametrize("width", [0.1, 0.6, 3.0])
def test_a_thin_strip_whose_samples_cross_is_matched_by_nothing_or_rightly(width):
    x = np.linspace(0.0, 600.0, 1500)
    y = 150.0 * np.sin(x * 2.0 * np.pi * 8 / 600.0)
    strip = View([Contour(np.vstack([np.column_stack([x, y]), np.column_stack([x[::-1], y[::-1] + width])]))])
    for one, other in [
        (strip, View([Contour(dense(BRACKET))])),
        (View([Contour(dense(BRACKET))]), strip),
        (strip, strip),
    ]:
        assert all(np.isfinite(m.homography).all() for m in match_outlines(one, other))
