# SPDX-License-Identifier: Apache-2.0
"""The kernels of synthesis: compiled and NumPy alike, and what each of them promises."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import _grasptrack_native as native
import reference
from grasptrack import kernels
from grasptrack.kernels.results import RankedCandidates, RankingLimits, WrenchSpace
from reference.grasp import LEAST_EPSILON
from synthesis_shapes import near


@st.composite
def wavy(draw):
    """Candidates on a smooth outline with a round hole: contacts, normals, flags, starts, steps, generator."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    outer, hole = 64, 32
    t = 2 * np.pi * np.arange(outer) / outer
    radius = 80 * (1 + sum(rng.uniform(-0.1, 0.1) * np.cos(k * t + rng.uniform(0, 6)) for k in (1, 2, 3)))
    u = -2 * np.pi * np.arange(hole) / hole
    points = np.concatenate(
        [np.column_stack([1.4 * radius * np.cos(t), radius * np.sin(t)]), 20 * np.column_stack([np.cos(u), np.sin(u)])]
    )
    offsets = np.array([0, outer, outer + hole])
    places = np.array([[c, i] for c, n in ((0, outer), (1, hole)) for i in range(n)], dtype=float)
    normals = np.ascontiguousarray(reference.contact_frames(points, offsets, places, 14.0)[:, :2])
    steps = np.array([reference.arc_length(points[a:b])[-1] / (b - a) for a, b in ((0, 64), (64, 96))])
    return points, normals, rng.uniform(size=96) < 0.95, offsets, steps, places, rng


def both(name, *args):
    got, wanted = getattr(native, name)(*args), getattr(reference, name)(*args)
    for one, other in zip(got, wanted, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    return got


@given(wavy(), st.floats(0.1, 1.0), st.sampled_from([1, 4, 8]))
def test_opposed_pairs_are_the_best_of_every_two_groups(outline, friction, group):
    points, normals, usable, _, _, _, rng = outline
    worth = np.where(usable, rng.uniform(0.1, 1.0, len(points)), -1.0)
    pairs, sense, need = both("opposed_pairs", points, normals, worth, group, friction)
    assert (need < friction).all() and set(sense) <= {-1.0, 1.0}
    found = {tuple(p // group) for p in pairs}
    assert len(found) == len(pairs)
    every, _, _ = native.opposed_pairs(points, normals, worth, 1, friction)
    assert {tuple(p // group) for p in every} == found
    for pair, least in zip(pairs, need, strict=True):
        _, angle = kernels.force_closure(points[pair], normals[pair], 0.0, 0.0, 50.0, friction)
        assert math.tan(angle) == pytest.approx(least, abs=1e-9)


@given(wavy(), st.floats(0.2, 1.0))
def test_closing_triples_close(outline, friction):
    points, normals, _, _, _, _, rng = outline
    some = np.sort(rng.choice(len(points), 18, replace=False))
    triples, sense, epsilon = both("closing_triples", points[some], normals[some], 1.0, 2.0, 50.0, friction)
    for row, way, depth in zip(triples, sense, epsilon, strict=True):
        at, n = points[some][row], normals[some][row]
        expected, _ = kernels.force_closure(at, n, 1.0, 2.0, 50.0, friction)
        assert depth == pytest.approx(expected, abs=1e-9) and depth > LEAST_EPSILON
        assert (way * (n * (at.mean(axis=0) - at)).sum(axis=1) > 0).all()


@given(wavy(), st.floats(2.0, 40.0), st.floats(0.0, 60.0))
def test_finger_rooms(outline, width, depth):
    points, _, _, offsets, _, places, rng = outline
    lean = rng.uniform(0, 2 * np.pi, len(points))
    directions = np.column_stack([np.cos(lean), np.sin(lean)])
    for where, deep in itertools.product((places, None), (depth, 1e-15)):  # no deeper than rounding
        got = native.finger_clearance(points, offsets, points, directions, where, width, deep, width)
        wanted = reference.finger_clearance(points, offsets, points, directions, where, width, deep, width)
        np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9)


SQUARE = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]])
DOWN = np.array([[0.0, 1.0]])


@pytest.mark.parametrize(
    ("contact", "place", "room"),
    [
        ([50.0, 0.0], [0.0, 0.5], (0.0, math.inf)),  # on an edge: free
        ([50.0, -30.0], None, (0.0, math.inf)),  # above it all
        ([50.0, 60.0], None, (0.0, 0.0)),  # inside, far from every side
        ([50.0, 130.0], None, (0.0, 30.0)),  # the far side is in the way, though no point of it is near
        ([104.0, 20.0], None, (0.0, 0.0)),  # a side goes along within it
    ],
)
def test_long_sides_and_what_lies_inside_are_noticed(contact, place, room):
    at = np.array([contact])
    where = None if place is None else np.array([place])
    for backend in (native, reference):
        found = backend.finger_clearance(SQUARE, np.array([0, 4]), at, DOWN, where, 10.0, 40.0, 10.0)
        assert tuple(found[0]) == pytest.approx(room, abs=1e-9)


def test_a_tilted_edge_protrudes():
    tilt = math.radians(20)
    direction = np.array([[math.sin(tilt), math.cos(tilt)]])
    for backend in (native, reference):
        (found,) = backend.finger_clearance(
            SQUARE, np.array([0, 4]), np.array([[50.0, 0.0]]), direction, np.array([[0.0, 0.5]]), 10.0, 40.0, 10.0
        )
        assert found[0] == pytest.approx(5 * math.tan(tilt), rel=1e-6) and found[1] == math.inf


@given(wavy(), st.floats(0.3, 1.0), st.sampled_from([2, 3]), st.floats(0.0, 60.0), st.integers(0, 30))
def test_ranking_is_exact_and_distinct(outline, friction, fingers, gap, top):
    points, normals, usable, starts, steps, _, rng = outline
    if fingers == 2:
        grasps, _, strength = native.opposed_pairs(points, normals, np.where(usable, 1.0, -1.0), 4, friction)
    else:
        some = np.flatnonzero(usable)[::5]
        grasps, _, strength = native.closing_triples(points[some], normals[some], 0.0, 0.0, 50.0, friction)
        grasps = some[grasps]
    bound = rng.uniform(0, 1, len(grasps))
    given_ = RankedCandidates(points, normals, usable, starts, steps), grasps, strength, bound
    given_ += (WrenchSpace(friction, 0.0, 0.0, 50.0),)
    chosen, quality, regions = both("rank_grasps", *given_, RankingLimits(20.0, gap, top))
    assert (np.diff(quality) <= 0).all() and len(chosen) <= top
    assert (regions > 0).all() and (regions <= 20.0).all()
    everything, exact, _ = native.rank_grasps(*given_, RankingLimits(20.0, 0.0, len(grasps)))
    assert sorted(everything) == list(range(len(grasps)))
    np.testing.assert_allclose(
        quality, [dict(zip(everything.tolist(), exact, strict=True))[i] for i in chosen.tolist()]
    )
    # what is left out is like a better one, or came too late
    order = {g: n for n, g in enumerate(everything.tolist())}
    for g in set(order) - set(chosen.tolist()):
        better = [c for c in chosen.tolist() if order[c] < order[g]]
        assert len(chosen) == top or any(near(points[grasps[g]], points[grasps[c]], gap) for c in better)


def test_both_refuse_the_same():
    points, normals, flags = SQUARE, np.tile([0.0, 1.0], (4, 1)), np.ones(4, dtype=bool)
    starts, steps, pair = np.array([0, 4]), np.array([100.0]), np.array([[0, 2]])
    one = np.array([0.1])
    places = RankedCandidates(points, normals, flags, starts, steps)
    rest = pair, one, one, WrenchSpace(0.5, 0.0, 0.0, 50.0), RankingLimits(10.0, 5.0, 5)
    wrong = [
        ("opposed_pairs", (points, normals[:3], one, 1, 0.5)),
        ("opposed_pairs", (points, normals, np.ones(4), 3, 0.5)),
        ("opposed_pairs", (points, normals, np.ones(4), 1, 0.0)),
        ("closing_triples", (points, normals[:3], 0.0, 0.0, 1.0, 0.5)),
        ("closing_triples", (points, normals, 0.0, 0.0, 0.0, 0.5)),
        ("finger_clearance", (points, starts, points, normals[:3], None, 1.0, 1.0, 1.0)),
        ("finger_clearance", (points, starts, points, normals, None, 0.0, 1.0, 1.0)),
        ("finger_clearance", (points, starts, points, normals, np.full((4, 2), 7.0), 1.0, 1.0, 1.0)),
        ("rank_grasps", (places._replace(usable=flags[:2]), *rest)),
        ("rank_grasps", (places._replace(starts=np.array([0, 3])), *rest)),
        ("rank_grasps", (places._replace(steps=np.ones(2)), *rest)),
        ("rank_grasps", (places, np.array([[0, 9]]), *rest[1:])),
        ("rank_grasps", (places, np.array([[0, 1, 2, 3]]), *rest[1:])),
        ("rank_grasps", (places, *rest[:4], RankingLimits(0.0, 5.0, 5))),
    ]
    for name, args in wrong:
        for backend in (native, reference):
            with pytest.raises(ValueError):
                getattr(backend, name)(*args)
