# SPDX-License-Identifier: Apache-2.0
"""Every instance of known parts in one image: where a part may lie, each pose made exact, each place decided by itself.

Outlines of the image say where a part may lie, whole or in pieces; the tracker's estimator makes each pose exact, and its
decision, which asks the edges of the image, says which is believed. A part turned over is one more outline that may explain
a place; where two explain one, the image must have so much more evidence for one of them as the risk asks for.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack import arguments, kernels
from grasptrack.equality import compared_by_value
from grasptrack.errors import ConditioningError, ContourError, GraspTrackError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography, normalize_homography, rotation_at
from grasptrack.grasp.force_closure import GraspAnalysis, analyze
from grasptrack.images import Channel, to_bgr
from grasptrack.matching import Sampled, judge_hypotheses, lay_several, match_several, may_match
from grasptrack.matching.samples import TWIN
from grasptrack.matching.symmetry import TOLERANCE as OWN_TWIN
from grasptrack.presentation import to_dict
from grasptrack.segmentation.candidate import is_same_region
from grasptrack.tracking.common_plane import CommonPlane, PlanePose
from grasptrack.tracking.decision import ANYWHERE_STEPS, Decision, Expected, decide_pose
from grasptrack.tracking.estimator import estimate_pose, first_state
from grasptrack.tracking.evidence import contact_testimony, pose_evidence, texture_evidence
from grasptrack.tracking.messages import StatusReason
from grasptrack.tracking.numbers import DEFAULT_RISK, NUMBERS
from grasptrack.tracking.parts import KnownPart, as_parts, prepare_once
from grasptrack.tracking.places import ImagePyramids, PlaceSearch, Spot, carried_view, overlap_share
from grasptrack.tracking.pose import (
    Hypothesis,
    PoseEstimate,
    contact_tolerance,
    largest_sigma,
    lead_alike,
    max_contact_distance,
)
from grasptrack.tracking.redetection import MAX_UNLIKE
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.single import UNKNOWN_PRESENCE, pose_hypothesis, single_estimate
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import build_pyramid
from grasptrack.typing import Floats

LEAST_OVERLAP = 0.5
"""Share of the lesser of two outlines within the other, from which on they lie in one place."""
LEAST_SHARE, MOST_TOUCHING = 0.5, 4.0
"""Areas of parts within which a piece of an outline of the image is looked for: of a covered one, and of some that touch."""
SMALLEST, LARGEST = 0.4, 2.5
"""Smallest and largest scale at which a part is looked for."""
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""Hypotheses that are made exact at a time."""
TURNED_OVER, WHICH_PART = "turned-over", "which-part"


@compared_by_value
@dataclass(frozen=True, eq=False)
class Instance:
    """A part in an image. Contacts are there where it is believed, turned over or not; `found` says that it can be grasped.

    Attributes:
        part: its name.
        homography: (3, 3) from the part's image to this one; it mirrors where the part is turned over.
        view: its outline in this image, px.
        contacts: (k, 2) px of the part's first grasp; None where it is not believed.
        covariance: (k, 2, 2) px^2 of the contacts; None with them.
        confidence: 0 to 1, the complement of the probability that a contact is off by more than 3 px and 4 % of sqrt(area),
            or on something else.
        mirrored: it is turned over: its lower side is seen.
        seen: (k,) 0 to 1, how much of each contact was observed; None with them.
        edge: 0 to 1, the share of its outline whose own edge was observed.
        room: px behind each finger's pad up to the nearest neighbour, the least of all fingers; infinite where the fingers
            have all the room that they need.
        analysis: of the grasp, in the part's image; None with the contacts.
        turns: degrees of other turns by which its outline fits as well and which its surface does not tell apart: the
            contacts are those of one of them, and equal by the outline alone.
        reason: empty where it is found, else a short sentence.
        reason_code: the reason in one word, see `messages.SENTENCES`.
    """

    part: str
    homography: Floats
    view: View
    contacts: Floats | None
    covariance: Floats | None
    confidence: float
    mirrored: bool
    seen: Floats | None
    edge: float
    room: float
    analysis: GraspAnalysis | None
    turns: tuple[float, ...] = ()
    reason: str = ""
    reason_code: str = ""

    @property
    def found(self) -> bool:
        """Whether it is believed, the right way up."""
        return not self.reason_code

    def __repr__(self) -> str:
        """One line: the part, and where."""
        x, y = self.view.outer.points.mean(axis=0).tolist()
        return f"Instance({self.part} at {x:.0f},{y:.0f}, {self.reason_code or f'confidence {self.confidence:.4f}'})"

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        return to_dict(self)


@arguments.checked(
    image=arguments.array(unbounded=True),
    risk=arguments.number,
    ignore=arguments.optional(arguments.array(unbounded=True)),
)
def find(
    image: NDArray[Any],
    parts: KnownPart | Sequence[KnownPart],
    *,
    risk: float = DEFAULT_RISK,
    ignore: NDArray[Any] | None = None,
) -> list[Instance]:
    """Every instance of known parts in an image: any turn, scales of 0.4 to 2.5, tilts to 45 degrees.

    Args:
        image: 8 or 16 bit, grey, BGR or BGRA.
        parts: what to look for, one part or several of different names; of two that look alike in the image neither is found.
        risk: probability, between 0 and 1, below which an answer may be wrong: less refuses more.
        ignore: (H, W) nonzero where nothing belongs to the scene; None where all does.

    Returns:
        Those that are found first, the easiest to grasp first: with room for the fingers, uncovered, sure. Then those turned
        over, then what looks like a part and is not believed, each with its reason. No two of the first two share a place.

    Raises:
        InputError: no part, two parts of one name, a risk out of range, or a mask of another size.
        SourceError: no image.
    """
    colours = to_bgr(image)
    said = FirstImage.of(ignore=ignore).within(colours.shape)
    numbers = NUMBERS.with_risk(risk)
    scene = ImagePyramids(colours)
    settled: list[_Claim] = []
    doubted: list[_Claim] = []
    beside: list[View] = []
    tried: dict[_Ways, list[View]] = {_ways_onto_whole: [], _ways_onto_part: []}

    def sides_of(part: KnownPart) -> list[_Kind]:
        return prepare_once(part, numbers.risk, partial(_sides_of, part, numbers.risk))

    with ThreadPoolExecutor(CORES) as pool:
        kinds = list(chain.from_iterable(pool.map(sides_of, as_parts(parts))))
        search = PlaceSearch(colours, said, SMALLEST * min(kind.outline.size for kind in kinds))
        while True:
            places = search.find_spots()
            beside = [p.image_view for p in places]
            for ways, before in tried.items():
                fresh = [p for p in places if not any(is_same_region(p.rough.view, view) for view in before)]
                before += [p.rough.view for p in fresh]
                new, refused = _settle_claims(_claims_of(kinds, scene, fresh, ways, pool), settled, numbers.risk)
                settled, doubted = settled + new, doubted + refused
                if new:
                    break
            else:
                _, doubted = _settle_claims(doubted, settled, numbers.risk)
                told = _claims_in_plane(settled, doubted, scene, pool)
                new, doubted = _settle_claims(told, settled, numbers.risk)
                settled = settled + new
                if not new:
                    break
            search.leave_out([claim.view for claim in new])
    outlines = [claim.view for claim in settled]
    outlines += [v for v in beside if not any(overlap_share(v, o) > LEAST_OVERLAP for o in outlines)]
    answers = [claim.as_instance(outlines, numbers.risk) for claim in [*settled, *doubted]]
    return sorted(
        answers, key=lambda a: (not a.found, not a.mirrored, -min(a.room, a.view.outer.area), -a.edge, -a.confidence)
    )


# --- what is looked for ----------------------------------------------------------------------------


class _Kind:
    """A side of a part: as it was taught, or turned over, of which nothing but the outline is known."""

    def __init__(self, part: KnownPart, taught: KnownPart, mirrored: bool, risk: float) -> None:
        self.part, self.taught, self.mirrored = part, taught, mirrored
        self.outline = Sampled(taught.view)
        numbers = NUMBERS.with_risk(risk)
        self._numbers = replace(numbers, texture_contrast=math.inf) if mirrored else numbers
        self._states: dict[Channel, TrackState] = {}

    def state_in(self, channel: Channel) -> TrackState:
        """What the estimator knows of it, as this mixture of colours shows it."""
        if channel not in self._states:
            levels = build_pyramid(channel.to_grey(self.taught.image))
            target = make_target(levels, self.taught.view, self.taught.grasps[0].contacts, self._numbers)
            self._states[channel] = first_state(target, levels)
        return self._states[channel]

    @cached_property
    def grasp_analysis(self) -> GraspAnalysis | None:
        """Of the first grasp, in the part's image."""
        try:
            return analyze(self.part.grasps[0], self.part.view, self.part.friction, judged_in="reference")
        except GraspTrackError:
            return None


def _sides_of(part: KnownPart, risk: float) -> list[_Kind]:
    """The side that was taught, and the other one where its outline is another."""
    own, other = _Kind(part, part, False, risk), _Kind(part, part.turned_over(), True, risk)
    if not may_match([other.outline], own.outline, TWIN):
        return [own, other]
    alike = judge_hypotheses(match_several([other.outline], own.outline)[0]).best
    flat = alike is not None and alike.misfit <= OWN_TWIN * own.outline.size
    return [own] if flat else [own, other]


# --- what may explain a place ------------------------------------------------------------------------


class _Claim:
    """A part that may lie somewhere, as exactly as the image tells, and what is decided of that."""

    def __init__(
        self, kind: _Kind, channel: Channel, decision: Decision, turns: tuple[float, ...], tried: list[PoseEstimate]
    ) -> None:
        assert decision.estimate is not None
        self.kind, self.channel, self.decision, self.turns = kind, channel, decision, turns
        self.estimate: PoseEstimate = decision.estimate
        self.own, self.tried = self.estimate, tried
        self.rival_evidence = -math.inf
        self._state = kind.state_in(channel)
        self.evidence = pose_evidence(self._state, self.estimate)
        self.H = self._state.target.homography(self.estimate.G)
        self.view = carried_view(kind.taught.view, self.H)
        self.code = decision.code

    @property
    def is_vague(self) -> bool:
        """Whether the image alone does not tell its contacts as exactly as is asked for, and nobody has asked the others."""
        return self.own is self.estimate and self.decision.sigma > largest_sigma(self.own.area, self._state.numbers)

    def settled_in_plane(self, alone: _Claim, leaning: float) -> _Claim:
        """The same, where it was another claim as the image alone tells it, and leans with a probability."""
        self.own, self.tried, self.rival_evidence = alone.own, alone.tried, alone.rival_evidence
        self.decision = self.decision.with_alias(leaning, "uncertain")
        self.code = self.decision.code
        return self

    def shares_place(self, other: _Claim) -> bool:
        """Whether both lie in one place."""
        return overlap_share(self.view, other.view) > LEAST_OVERLAP

    def as_instance(self, others: list[View], risk: float) -> Instance:
        """As it is told, beside other outlines of the image."""
        kind, believed = self.kind, self.code in ("", TURNED_OVER)
        H = normalize_homography(self.H @ kind.part.flip) if kind.mirrored else self.H
        beside = [v for v in others if v is not self.view]
        return Instance(
            kind.part.name,
            H,
            self.view,
            self.estimate.contacts if believed else None,
            self.estimate.covariance if believed else None,
            self.decision.confidence,
            kind.mirrored,
            contact_testimony(self._state, self.estimate) if believed else None,
            self.estimate.edge_share,
            _finger_room(kind.taught, self.H, beside),
            kind.grasp_analysis if believed else None,
            self.turns,
            StatusReason(self.code, self.decision.figures).sentence if self.code else "",
            self.code,
        )


def _claims_of(
    kinds: list[_Kind], scene: ImagePyramids, places: list[Spot], ways: _Ways, pool: ThreadPoolExecutor
) -> list[_Claim]:
    """What the kinds may explain of an image: each place once by each, by the estimates that lie there."""
    laid: dict[tuple[_Kind, Channel], list[Floats]] = {}
    for place, found in zip(places, pool.map(partial(ways, kinds), places), strict=True):
        for kind, homographies in zip(kinds, found, strict=True):
            if homographies:
                laid.setdefault((kind, place.best_channel), []).extend(homographies)
                scene.levels_in(place.best_channel)

    def hypotheses_of(asked: tuple[_Kind, Channel]) -> list[Hypothesis]:
        target, distinct = asked[0].state_in(asked[1]).target, list[Hypothesis]()
        for H in laid[asked]:
            hypothesis = pose_hypothesis(target, "match", H)
            if not any(lead_alike(target, hypothesis, other) for other in distinct):
                distinct.append(hypothesis)
        return distinct

    def solve_one(kind: _Kind, channel: Channel, hypothesis: Hypothesis) -> PoseEstimate | None:
        return single_estimate(kind.state_in(channel), scene.levels_in(channel), hypothesis)

    begun = [(*asked, each) for asked, found in zip(laid, pool.map(hypotheses_of, laid), strict=True) for each in found]
    estimates: dict[tuple[_Kind, Channel], list[PoseEstimate]] = {asked: [] for asked in laid}
    for (kind, channel, _), e in zip(begun, pool.map(lambda each: solve_one(*each), begun), strict=True):
        if e is not None and SMALLEST**2 <= e.area / kind.state_in(channel).target.area <= LARGEST**2:
            estimates[kind, channel].append(e)
    return [
        _decided_claim(kind, channel, alike)
        for (kind, channel), found in estimates.items()
        for alike in _by_place(kind.state_in(channel), found)
    ]


_Ways = Callable[[list[_Kind], Spot], list[list[Floats]]]
"""Homographies (3, 3) that may lay the outline of each kind on one of the image."""


def _ways_onto_whole(kinds: list[_Kind], place: Spot) -> list[list[Floats]]:
    """Homographies that lay an outline on the whole of one of the image; none where it looks like another one from anywhere."""
    limit = 1.0 if place.rough.view.is_clipped else MAX_UNLIKE
    outlines = _outlines_within(kinds, place, SMALLEST**2, LARGEST**2)
    if not may_match(list(outlines.values()), place.outline, limit) or place.whole_outline is None:
        return [[] for _ in kinds]
    found = [judge_hypotheses(m) for m in match_several(list(outlines.values()), place.whole_outline, limit)]
    told = dict(zip(outlines, ([m for m in (t.best, *t.others) if m is not None] for t in found), strict=True))
    return [[place.to_image @ m.homography for m in told.get(k, [])] for k in range(len(kinds))]


def _ways_onto_part(kinds: list[_Kind], place: Spot) -> list[list[Floats]]:
    """Homographies that lay most of an outline on a part of one of the image, which is large enough for that and not larger
    than some parts that touch."""
    outlines = _outlines_within(kinds, place, LEAST_SHARE * SMALLEST**2, MOST_TOUCHING * LARGEST**2)
    laid = dict(zip(outlines, lay_several(list(outlines.values()), place.outline, MAX_UNLIKE), strict=True))
    return [[place.to_image @ H for H in laid.get(k, [])] for k in range(len(kinds))]


def _outlines_within(kinds: list[_Kind], place: Spot, least: float, most: float) -> dict[int, Sampled]:
    """By their index the outlines of those kinds of whose area a place has a share between two bounds."""
    return {k: kind.outline for k, kind in enumerate(kinds) if least <= place.image_area / kind.outline.size**2 <= most}


def _by_place(state: TrackState, estimates: list[PoseEstimate]) -> list[list[PoseEstimate]]:
    """Estimates of one place together."""
    places: list[tuple[View, list[PoseEstimate]]] = []
    for e in estimates:
        view = carried_view(state.target.view, state.target.homography(e.G))
        known = next((group for there, group in places if overlap_share(view, there) > LEAST_OVERLAP), None)
        if known is None:
            places.append((view, [e]))
        else:
            known.append(e)
    return [group for _, group in places]


def _decided_claim(kind: _Kind, channel: Channel, estimates: list[PoseEstimate]) -> _Claim:
    """What is decided of the estimates of one place: of turns between which nothing decides one stands for all."""
    state = kind.state_in(channel)
    target, numbers = state.target, state.numbers
    own = max(estimates, key=lambda e: pose_evidence(state, e))
    least = numbers.temper * max(0.0, texture_evidence(state, own)) + math.log(numbers.risk)

    def is_equal(e: PoseEstimate) -> bool:
        allowed = contact_tolerance(e.area, numbers)
        twins = (target.carried_contacts(own.G @ T) for T in target.turns)
        alike = any(max_contact_distance(twin, e.contacts) <= allowed for twin in twins)
        return alike and numbers.temper * max(0.0, texture_evidence(state, e)) > least

    equals = [e for e in estimates if e is not own and is_equal(e)]
    expected = Expected(target.contacts, UNKNOWN_PRESENCE, ANYWHERE_STEPS)
    decision = decide_pose(state, [e for e in estimates if e not in equals], expected)
    back = np.linalg.inv(target.homography(own.G))
    centre = kind.outline.centre.tolist()
    turns = [math.degrees(rotation_at(back @ target.homography(e.G), *centre)) for e in equals]
    return _Claim(kind, channel, decision, tuple(turns), estimates)


def _claims_in_plane(
    settled: list[_Claim], doubted: list[_Claim], scene: ImagePyramids, pool: ThreadPoolExecutor
) -> list[_Claim]:
    """What is doubted, that of it whose outline leaves its pose too open once more: as the plane of the others lets it be."""
    claims = [*settled, *doubted]
    vague = [k for k, c in enumerate(claims) if k >= len(settled) and c.is_vague]
    if not vague or len(claims) < 2:
        return doubted
    kinds, size = list(dict.fromkeys(c.kind for c in claims)), scene.colours.shape

    def pose_of(claim: _Claim, e: PoseEstimate) -> PlanePose:
        return PlanePose(kinds.index(claim.kind), claim.kind.state_in(claim.channel).target, e.G, e.P, size)

    plane = CommonPlane([pose_of(c, c.own) for c in claims])

    def solve_again(k: int) -> _Claim:
        claim = claims[k]
        state, found = claim.kind.state_in(claim.channel), list[PoseEstimate]()
        levels, numbers = scene.levels_in(claim.channel), state.numbers
        for e in claim.tried:
            solved: PoseEstimate | None = e
            for share in (numbers.predicted**2, 1.0):  # texture that images share by chance pulls a loose pose away
                if solved is not None:
                    off, P = plane.prior_of(k, pose_of(claim, solved), state.target.noise_of_guess)
                    G = np.asarray(state.target.handle.moved(solved.G, off))
                    solved = estimate_pose(state, levels, Hypothesis(e.origin, G, share * P), still=True)
            found += [] if solved is None else [solved]
        if not found:
            return claim
        again = _decided_claim(claim.kind, claim.channel, found)
        return again.settled_in_plane(claim, plane.leaning_probability(k))

    again = dict(zip(vague, pool.map(solve_again, vague), strict=True))
    return [again.get(k, claims[k]) for k in range(len(settled), len(claims))]


# --- which of them is believed ---------------------------------------------------------------------


def _settle_claims(claims: list[_Claim], known: list[_Claim], risk: float) -> tuple[list[_Claim], list[_Claim]]:
    """Those claims that are believed, each place once, and for each other place the best of those that are not."""
    settled: list[_Claim] = []
    refused: list[_Claim] = []
    left = [c for c in sorted(claims, key=lambda c: -c.evidence) if not any(c.shares_place(k) for k in known)]
    while left:
        best, left = left[0], left[1:]
        here = [c for c in left if c.shares_place(best)]
        left = [c for c in left if c not in here]
        rival = next((c for c in here if c.kind is not best.kind), None)
        if rival is not None:
            best.rival_evidence = max(best.rival_evidence, rival.evidence)
        if best.code == "" and best.evidence - best.rival_evidence < -math.log(risk):
            best.code = WHICH_PART
        if best.code == "" and best.kind.mirrored:
            best.code = TURNED_OVER
        (settled if best.code in ("", TURNED_OVER) else refused).append(best)
    return settled, [c for c in refused if c.decision.presence > UNKNOWN_PRESENCE]


def _finger_room(part: KnownPart, H: Floats, beside: list[View]) -> float:
    """px of the part's image behind the pads up to the nearest outline of an image, the least of all fingers."""
    back, (width, depth) = np.linalg.inv(H), part.finger
    contacts, ways = part.grasps[0].contacts, part.directions[0]
    across = np.column_stack([-ways[:, 1], ways[:, 0]])
    corners = [contacts - far * ways + aside * across for far in (0.0, depth) for aside in (-width, width)]
    low, high = np.full(2, -math.inf), np.full(2, math.inf)
    with suppress(ConditioningError):
        ends = apply_homography(H, np.concatenate(corners))
        low, high = ends.min(axis=0), ends.max(axis=0)
    least = math.inf
    for view in beside:
        first, last = view.outer.bounds
        if (first > high).any() or (last < low).any():
            continue
        try:
            outer = View(view.outer).transformed(back)
        except (ConditioningError, ContourError):
            continue
        rooms = kernels.finger_clearance(outer.points, outer.offsets, contacts, ways, None, width, depth, width)
        least = min(least, float(rooms[:, 1].min()))
    return least
