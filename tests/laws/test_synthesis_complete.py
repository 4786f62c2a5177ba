# SPDX-License-Identifier: Apache-2.0
"""Nothing that a search by brute force finds is missing, but for what the hand refuses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from closure import every_stable_pair, firm
from datasets import SILHOUETTES
from grasptrack import Hand, kernels
from grasptrack.geometry.contours import Contour, as_view
from grasptrack.grasp.synthesis import synthesize
from grasptrack.grasp.synthesis.candidates import GROUP, GROUPS, sample_candidates, stable_pairs
from grasptrack.grasp.synthesis.limits import UnevennessLimits, reject_infeasible
from grasptrack.grasp.synthesis.search import AskedGrasps, duplicate_radius, find_grasps
from outlines import blobs, stars
from synthesis_shapes import SHAPES, traced

ALL = 1_000_000
THIN = Hand(finger_thickness=0.0, clearance=0.0)
NO_LIMITS = UnevennessLimits(math.inf, math.inf)
FRICTIONS = (0.1, 0.2, 0.5, 1.0)


def missing(view, friction, *, narrow=True):
    """Of the pairs that brute force finds, those with no returned grasp near; and how many there are.

    Near means within the thinning distance and one stretch of candidates at both contacts, in any order. Without `narrow`
    such pairs are not asked for as are stable only in a place narrower than a step of candidates: at a corner the normal
    may turn by 20 degrees in one step, a twentieth of a finger's width.
    """
    area, *_ = kernels.polygon_moments(view.points, view.offsets)
    size = math.sqrt(area)
    _, contacts, pairs, _ = every_stable_pair(view, 200, 0.1 * size, friction)
    stretch = sum(c.length for c in view.contours) / GROUPS
    if not narrow:
        pairs = pairs[firm(view, 200, 0.1 * size, friction, pairs, stretch / GROUP)]
    found = find_grasps(view, AskedGrasps(2, friction, ALL), THIN, (), NO_LIMITS)
    held = np.array([g.contacts for g in found]).reshape(-1, 2, 2)
    far = 0
    for pair in contacts[pairs]:
        apart = [np.hypot(*(held - p).T).max(axis=0, initial=0.0) for p in (pair, pair[::-1])]
        far += not len(held) or np.minimum(*apart).min() > duplicate_radius(size, 0.1 * size) + stretch
    return far, len(pairs)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("friction", FRICTIONS[::2])
@pytest.mark.parametrize("name", sorted(SHAPES))
def test_no_stable_pair_is_missing(name, friction):
    assert missing(as_view(SHAPES[name]), friction)[0] == 0


@given(st.one_of(stars(), blobs()), st.floats(0.1, 1.0))
def test_no_stable_pair_is_missing_on_any_outline(points, friction):
    assert missing(as_view(Contour(points)), friction, narrow=False)[0] == 0


@pytest.mark.slow
@pytest.mark.skipif(
    not SILHOUETTES.is_dir(), reason=f"no silhouettes in {SILHOUETTES}; set GRASPTRACK_DATA to the folder that has them"
)
@pytest.mark.parametrize("friction", [0.5])
def test_no_stable_pair_is_missing_on_silhouettes(friction):
    for path in sorted(SILHOUETTES.glob("*.png"))[::12]:
        assert missing(traced(path), friction)[0] == 0, path.name


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", sorted(SHAPES))
@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_what_the_hand_can_do_with_something_to_spare_is_not_refused(name, friction):
    """Fingers a little larger all round that fit, on an outline that is well within the limits: not lost."""
    view = as_view(SHAPES[name])
    area, cx, cy, *_ = kernels.polygon_moments(view.points, view.offsets)
    size = math.sqrt(area)
    places, contacts, pairs, sense = every_stable_pair(view, 200, 0.1 * size, friction)
    stretch = sum(c.length for c in view.contours) / GROUPS
    hand, limits = Hand().in_px(size), UnevennessLimits()
    at = sample_candidates(view, area, np.array([cx, cy]), hand.finger_width)
    found = stable_pairs(at, friction)
    left, _ = reject_infeasible(found, at, view, hand, (), limits)
    rough = [kernels.contact_frames(view.points, view.offsets, places, f * hand.finger_width)[:, 2] for f in (1, 2)]
    flat = np.maximum(rough[0], 0.5 * rough[1])
    checked = 0
    for (i, j), way in zip(pairs, sense, strict=True):
        line = contacts[j] - contacts[i]
        opening = float(np.hypot(*line))
        # a pair that is far apart: its line hardly turns when the contacts move by a stretch
        if opening < 8 * stretch or max(flat[i], flat[j]) > 0.3 * limits.roughness:
            continue
        push = way * np.array([line, -line]) / opening
        rooms = kernels.finger_clearance(
            view.points,
            view.offsets,
            contacts[[i, j]],
            push,
            places[[i, j]],
            hand.finger_width + 3 * stretch,
            hand.finger_thickness + hand.clearance + 2 * stretch,
            hand.finger_width + 3 * stretch,
        )
        lean = rooms[:, 0].max() > 0.5 * limits.protrusion * hand.finger_width
        close = way < 0 and opening < 2 * (hand.finger_thickness + hand.clearance) + 3 * stretch
        if lean or np.isfinite(rooms[:, 1]).any() or close:
            continue
        checked += 1
        pair = contacts[[i, j]]
        apart = [np.hypot(*(found.contacts[left] - p).T).max(axis=0) for p in (pair, pair[::-1])]
        assert np.minimum(*apart).min() <= 1.5 * stretch
    assert checked


def test_more_friction_and_more_opening_lose_nothing():
    view = as_view(SHAPES["notched"])
    area, cx, cy, *_ = kernels.polygon_moments(view.points, view.offsets)
    at = sample_candidates(view, area, np.array([cx, cy]), 0.1 * math.sqrt(area))
    before: set[tuple[int, int]] = set()
    for friction in FRICTIONS:
        now = {tuple(pair) for pair in (stable_pairs(at, friction).index // GROUP).tolist()}
        assert before <= now
        before = now
    few, many = (synthesize(view, top=ALL, hand=Hand(max_opening=o)) for o in (150.0, 250.0))
    assert sum(few.refused.values()) >= sum(many.refused.values())
    assert len(few) <= len(many)
