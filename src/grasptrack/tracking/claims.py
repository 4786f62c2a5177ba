# SPDX-License-Identifier: Apache-2.0
"""What known parts may explain of one image: poses made exact, and what is decided of each by itself.

A pose comes from an outline of the image, whole or in part, from what parts that lie in one plane leave open, or from the edges
that vote for an outline of that size. Where other parts lie, an image shows nothing of this one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property, partial
from itertools import chain
from typing import NamedTuple

import numpy as np

from grasptrack.errors import GraspTrackError
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import rotation_at
from grasptrack.grasp.force_closure import GraspAnalysis, analyze
from grasptrack.images import Channel
from grasptrack.matching import Sampled, find_symmetries, judge_hypotheses, lay_several, match_several, may_match
from grasptrack.matching.samples import TWIN
from grasptrack.matching.symmetry import TOLERANCE as OWN_TWIN
from grasptrack.tracking.common_plane import CommonPlane, PlanePose
from grasptrack.tracking.decision import ANYWHERE_STEPS, Decision, Expected, decide_pose
from grasptrack.tracking.estimator import estimate_pose, first_state
from grasptrack.tracking.evidence import pose_evidence, texture_evidence
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.parts import KnownPart
from grasptrack.tracking.placements import (
    MOST_PLACEMENTS,
    SCORE_SAMPLES,
    OutlineSamples,
    edges_in_plane,
    find_placements,
)
from grasptrack.tracking.places import ImagePyramids, Spot, carried_view, material_mask, overlap_areas, overlap_share
from grasptrack.tracking.pose import (
    Hypothesis,
    PoseEstimate,
    carried_in_front,
    contact_tolerance,
    distinct_hypotheses,
    image_information,
    known_by_image,
    largest_sigma,
    lead_alike,
    max_contact_distance,
    mixed_estimate,
)
from grasptrack.tracking.redetection import MAX_UNLIKE
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.single import (
    THICK_ODDS,
    UNKNOWN_PRESENCE,
    pose_hypothesis,
    single_estimate,
    surely_shown,
    thick_part,
)
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Target, build_pyramid, hidden_levels
from grasptrack.typing import Floats

LEAST_OVERLAP = 0.5
"""Share of the lesser of two outlines within the other, from which on they lie in one place."""
LEAST_SHARE, MOST_TOUCHING = 0.5, 4.0
"""Areas of parts within which a piece of an outline of the image is looked for: of a covered one, and of some that touch."""
SMALLEST, LARGEST = 0.4, 2.5
"""Smallest and largest scale at which a part is looked for."""
SCALE_STEP = 0.1
"""Steps of the log of the scale in which an outline of unknown size is voted for."""
BESIDE = 0.25
"""Share of sqrt(area) within which an estimate of a place is the same lying otherwise, and none that is turned."""
FAR = 10.0
"""Times what is not known of any view: what the image does not tell, all parts together do not tell either."""


class PartSide:
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
            contacts, origin = self.taught.grasps[0].contacts, self.taught.seen_from
            target = make_target(levels, self.taught.view, contacts, self._numbers, origin=origin)
            self._states[channel] = first_state(replace(target, any_turn=self.is_round), levels)
        return self._states[channel]

    def map_to_first_image(self, target: Target) -> Floats:
        """(3, 3) from work px of a target made of it to the image that taught the part, half its width about its middle."""
        width, x, y = self.part.seen_from
        unit = np.array([[2.0, 0.0, -2.0 * x], [0.0, 2.0, -2.0 * y], [0.0, 0.0, width]])
        back = self.part.flip if self.mirrored else np.eye(3)
        return np.asarray(unit @ back @ np.linalg.inv(target.homography(np.eye(3))))

    @cached_property
    def is_round(self) -> bool:
        """Whether its outline fits itself in every turn, as a disc's and a ring's does: any is as good as another."""
        return find_symmetries(self.outline).continuous

    @cached_property
    def grasp_analysis(self) -> GraspAnalysis | None:
        """Of the first grasp, in the part's image."""
        try:
            return analyze(self.part.grasps[0], self.part.view, self.part.friction, judged_in="reference")
        except GraspTrackError:
            return None


def sides_of(part: KnownPart, risk: float) -> list[PartSide]:
    """The side that was taught, and the other one where its outline is another, and may be seen."""
    if part.face_up:
        return [PartSide(part, part, False, risk)]
    own, other = PartSide(part, part, False, risk), PartSide(part, part.turned_over(), True, risk)
    if not may_match([other.outline], own.outline, TWIN):
        return [own, other]
    alike = judge_hypotheses(match_several([other.outline], own.outline)[0]).best
    flat = alike is not None and alike.misfit <= OWN_TWIN * own.outline.size
    return [own] if flat else [own, other]


class PartSearch(NamedTuple):
    """Where parts are looked for.

    Attributes:
        kinds: sides of the parts.
        scene: the image.
        places: its regions that nothing explains yet.
        voted: the sides of parts whose outline all edges have been asked for.
        pool: hypotheses are made exact in.
    """

    kinds: list[PartSide]
    scene: ImagePyramids
    places: list[Spot]
    voted: set[PartSide]
    pool: ThreadPoolExecutor

    def common_plane(self, claims: list[PartClaim]) -> CommonPlane:
        """The plane that most of some parts lie in."""
        poses = list[PlanePose]()
        for claim in claims:
            target, near = claim.state.target, BESIDE * math.sqrt(claim.own.area)
            # what else explains the place lies on the way along which the outline slides, perhaps
            alike = [e for e in claim.tried if max_contact_distance(e.contacts, claim.own.contacts) < near]
            own = mixed_estimate(target, alike, [pose_evidence(claim.state, e) for e in alike])
            told = image_information(own) + np.linalg.inv(FAR**2 * target.noise_of_view)
            poses.append(self.plane_pose(claim, own.G, claims, np.linalg.inv(told)))
        return CommonPlane.of(poses)

    def plane_pose(self, claim: PartClaim, G: Floats, claims: list[PartClaim], P: Floats | None = None) -> PlanePose:
        """A pose of one of some claims for that plane, with its covariance where it counts."""
        kinds, size = list(dict.fromkeys(c.kind for c in claims)), self.scene.colours.shape
        kind, target = claim.kind, claim.state.target
        taught = kind.map_to_first_image(target) if kind.part.same_tilt else None
        return PlanePose(kinds.index(kind), target, G, np.eye(8) if P is None else P, size, taught)


# --- what may explain a place ------------------------------------------------------------------------


class PartClaim:
    """A part that may lie somewhere, as exactly as the image tells, and what is decided of that."""

    def __init__(self, kind: PartSide, channel: Channel, state: TrackState, tried: list[PoseEstimate]) -> None:
        self.kind, self.channel, self.state, self.tried = kind, channel, state, tried
        self.decision, self.turns = _decide_among(kind, state, tried)
        self.any_turn = kind.is_round and not any(surely_shown(state, e) for e in tried)
        self.turns = () if self.any_turn else self.turns
        assert self.decision.estimate is not None
        self.estimate: PoseEstimate = self.decision.estimate
        self.own = self.estimate
        self.rival_evidence = -math.inf
        self.evidence = pose_evidence(state, self.estimate)
        self.H = state.target.homography(self.estimate.G)
        self.view = carried_view(kind.taught.view, self.H)
        self.code = self.decision.code

    @property
    def is_vague(self) -> bool:
        """Whether the image alone does not tell its contacts as exactly as is asked for, and nobody has asked the others."""
        return self.own is self.estimate and self.decision.sigma > largest_sigma(self.own.area, self.state.numbers)

    def settled_in_plane(self, alone: PartClaim, leaning: float) -> PartClaim:
        """The same, where it was another claim as the image alone tells it, and leans with a probability."""
        self.own, self.tried, self.rival_evidence = alone.own, alone.tried, alone.rival_evidence
        self.decision = self.decision.with_alias(leaning, "uncertain")
        self.code = self.decision.code
        return self

    def settled_beside(self, alone: PartClaim) -> PartClaim:
        """The same, where it was another claim as long as nothing was hidden: its rival had as much less evidence as it had."""
        self.rival_evidence = self.evidence - (alone.evidence - alone.rival_evidence)
        return self

    def shares_place(self, other: PartClaim) -> bool:
        """Whether both lie in one place."""
        return overlap_share(self.view, other.view) > LEAST_OVERLAP


def claims_of(places: list[Spot], ways: Ways, search: PartSearch) -> list[PartClaim]:
    """What parts may explain of regions of the image: each place once by each, by the estimates that lie there."""
    laid: dict[tuple[PartSide, Channel], list[Floats]] = {}
    for place, found in zip(places, search.pool.map(partial(ways, search.kinds), places), strict=True):
        for kind, homographies in zip(search.kinds, found, strict=True):
            if homographies:
                laid.setdefault((kind, place.best_channel), []).extend(homographies)
                search.scene.levels_in(place.best_channel)

    def hypotheses_of(asked: tuple[PartSide, Channel]) -> list[Hypothesis]:
        target = asked[0].state_in(asked[1]).target
        return distinct_hypotheses(target, [pose_hypothesis(target, "match", H) for H in laid[asked]])

    told = zip(laid, search.pool.map(hypotheses_of, laid), strict=True)
    return _claims_at([(*asked, each) for asked, found in told for each in found], search)


def _claims_at(begun: list[tuple[PartSide, Channel, Hypothesis]], search: PartSearch) -> list[PartClaim]:
    """What hypotheses become that are made exact, those of one side in one place together."""

    def solve_one(kind: PartSide, channel: Channel, hypothesis: Hypothesis) -> PoseEstimate | None:
        return single_estimate(kind.state_in(channel), search.scene.levels_in(channel), hypothesis)

    estimates: dict[tuple[PartSide, Channel], list[PoseEstimate]] = {(kind, channel): [] for kind, channel, _ in begun}
    for (kind, channel, _), e in zip(begun, search.pool.map(lambda each: solve_one(*each), begun), strict=True):
        if e is not None and SMALLEST**2 <= e.area / kind.state_in(channel).target.area <= LARGEST**2:
            estimates[kind, channel].append(e)
    return [
        PartClaim(kind, channel, kind.state_in(channel), alike)
        for (kind, channel), found in estimates.items()
        for alike in _by_place(kind.state_in(channel), found)
    ]


Ways = Callable[[list[PartSide], Spot], list[list[Floats]]]
"""Homographies (3, 3) that may lay the outline of each kind on one of the image."""


def ways_onto_whole(kinds: list[PartSide], place: Spot) -> list[list[Floats]]:
    """Homographies that lay an outline on the whole of one of the image; none where it looks like another one from anywhere."""
    limit = 1.0 if place.rough.view.is_clipped else MAX_UNLIKE
    outlines = _outlines_within(kinds, place, SMALLEST**2, LARGEST**2)
    if not may_match(list(outlines.values()), place.outline, limit) or place.whole_outline is None:
        return [[] for _ in kinds]
    found = [judge_hypotheses(m) for m in match_several(list(outlines.values()), place.whole_outline, limit)]
    told = dict(zip(outlines, ([m for m in (t.best, *t.others) if m is not None] for t in found), strict=True))
    return [[place.to_image @ m.homography for m in told.get(k, [])] for k in range(len(kinds))]


def ways_onto_part(kinds: list[PartSide], place: Spot) -> list[list[Floats]]:
    """Homographies that lay most of an outline on a part of one of the image, which is large enough for that and not larger
    than some parts that touch."""
    outlines = _outlines_within(kinds, place, LEAST_SHARE * SMALLEST**2, MOST_TOUCHING * LARGEST**2)
    laid = dict(zip(outlines, lay_several(list(outlines.values()), place.outline, MAX_UNLIKE), strict=True))
    return [[place.to_image @ H for H in laid.get(k, [])] for k in range(len(kinds))]


def _outlines_within(kinds: list[PartSide], place: Spot, least: float, most: float) -> dict[int, Sampled]:
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


def _decide_among(
    kind: PartSide, state: TrackState, estimates: list[PoseEstimate]
) -> tuple[Decision, tuple[float, ...]]:
    """What is decided of the estimates of one place: of turns between which nothing decides, in degrees, one stands for all."""
    target, numbers = state.target, state.numbers
    own = max(estimates, key=lambda e: pose_evidence(state, e))
    least = numbers.temper * max(0.0, texture_evidence(state, own)) + math.log(numbers.risk)
    outline = np.concatenate([r.points for r in carried_view(kind.taught.view, target.homography(own.G)).contours])

    def is_equal(e: PoseEstimate) -> bool:
        allowed = contact_tolerance(e.area, numbers)
        if max_contact_distance(e.contacts, own.contacts) <= allowed or lead_alike(target, e, own):
            return False  # the same answer, as far as that is known
        laid = carried_in_front(e.G, target.points[:: max(1, len(target.points) // SCORE_SAMPLES)])
        away = ((laid[:, None] - outline) ** 2).sum(axis=2).min(axis=1)
        twin = float(away.mean()) <= OWN_TWIN**2 * e.area
        return twin and numbers.temper * max(0.0, texture_evidence(state, e)) > least

    equals = [e for e in estimates if is_equal(e)]
    expected = Expected(target.contacts, UNKNOWN_PRESENCE, ANYWHERE_STEPS)
    decision = decide_pose(state, [e for e in estimates if e not in equals], expected)
    back = np.linalg.inv(target.homography(own.G))
    centre = kind.outline.centre.tolist()
    turns = [math.degrees(rotation_at(back @ target.homography(e.G), *centre)) for e in equals]
    return decision, tuple(turns)


def claims_in_plane(settled: list[PartClaim], doubted: list[PartClaim], search: PartSearch) -> list[PartClaim]:
    """What is doubted, that of it whose outline leaves its pose too open once more: as the plane of the others lets it be."""
    claims = [*settled, *doubted]
    vague = [k for k, c in enumerate(claims) if k >= len(settled) and c.is_vague]
    if not vague or (len(claims) < 2 and not claims[0].kind.part.same_tilt):
        return doubted
    plane = search.common_plane(claims)

    def solve_in_plane(k: int, e: PoseEstimate, state: TrackState, shown: bool) -> PoseEstimate | None:
        solved, target = e, state.target
        # texture that images share by chance pulls a loose pose away; of edges alone a tight one is sure which is its own
        shares = (state.numbers.predicted**2, 1.0)
        for share in shares if shown else shares[::-1]:
            pose = search.plane_pose(claims[k], solved.G, claims)
            off, P = plane.prior_of(k, pose, target.noise_of_guess)
            begun = Hypothesis(e.origin, np.asarray(target.handle.moved(solved.G, off)), share * P)
            found = estimate_pose(state, search.scene.levels_in(claims[k].channel), begun, still=True, surface=shown)
            if found is None:
                return None
            solved = known_by_image(target, found, plane.prior_of(k, pose, target.noise_of_view)[1])
        return solved

    def solve_both(k: int) -> list[tuple[PoseEstimate, PoseEstimate]]:
        """As a part that may be thin, and as a thick one."""
        claim, found = claims[k], list[tuple[PoseEstimate, PoseEstimate]]()
        shown = surely_shown(claim.state, claim.estimate)
        for e in claim.tried if k in vague else [claim.estimate]:
            thin = solve_in_plane(k, e, claim.state, shown)
            thick = None if shown else solve_in_plane(k, e, thick_part(claim.state), shown)
            found += [] if thin is None else [(thin, thick or thin)]
        return found

    kinds = {claims[k].kind for k in vague}
    asked = [k for k, c in enumerate(claims) if c.kind in kinds]
    told = dict(zip(asked, search.pool.map(solve_both, asked), strict=True))
    odds = dict.fromkeys(kinds, THICK_ODDS)  # log-odds of a kind to be thick: all of it are, or none
    for k, ways in told.items():
        if ways:
            thin, thick = (max(pose_evidence(claims[k].state, e) for e in each) for each in zip(*ways, strict=True))
            odds[claims[k].kind] += thick - thin
    again = {
        k: PartClaim(
            claims[k].kind,
            claims[k].channel,
            claims[k].state,
            [mixed_estimate(claims[k].state.target, both, [0.0, odds[claims[k].kind]]) for both in told[k]],
        ).settled_in_plane(claims[k], plane.leaning_probability(k))
        for k in vague
        if told[k]
    }
    return [again.get(k, claims[k]) for k in range(len(settled), len(claims))]


def claims_by_votes(settled: list[PartClaim], doubted: list[PartClaim], search: PartSearch) -> list[PartClaim]:
    """What is doubted, and what else may lie in the plane of all that, by the edges that vote for an outline.

    Each side of a part votes once, where a region is left that may be most of one: for outlines of the size that one of it has
    in the plane, or of any size where nothing of it is known.
    """
    claims = [*settled, *doubted]
    if not claims:
        return doubted
    first, largest = claims[0], max((p.image_area for p in search.places), default=0.0) / LEAST_SHARE
    known = {c.kind: c for c in sorted(claims, key=lambda c: (c in settled, c.evidence))}
    asked = [
        kind
        for kind in search.kinds
        if kind not in search.voted
        and largest >= (known[kind].estimate.area if kind in known else SMALLEST**2 * kind.outline.size**2)
    ]
    if not asked:
        return doubted
    search.voted.update(asked)
    size = search.scene.colours.shape
    R = search.common_plane(claims).rectification(size)
    channel, levels = first.channel, search.scene.levels_in(first.channel)
    own = carried_in_front(first.estimate.G, first.state.target.points)
    edges = edges_in_plane(levels, np.asarray(np.linalg.inv(R)), own[np.isfinite(own).all(axis=1)])
    middles = np.array([c.view.outer.points.mean(axis=0) for c in settled]).reshape(-1, 2)

    def vote(kind: PartSide) -> list[tuple[PartSide, Channel, Hypothesis]]:
        state, like = kind.state_in(channel), known.get(kind)
        target, look = state.target, state.last
        samples = OutlineSamples(target, look.levels[0], look.G)
        if like is not None:
            poses = find_placements(edges, R @ like.estimate.G, samples, middles)
        else:
            unit = kind.outline.size / (0.5 * max(size[:2]) * target.size)
            plane = np.array([[unit, 0.0, 0.0], [0.0, unit, 0.0], [0.0, 0.0, 1.0]])
            scales = np.exp(np.arange(math.log(SMALLEST), math.log(LARGEST), SCALE_STEP))
            scales = scales[scales * kind.outline.size <= math.sqrt(largest)]
            poses = find_placements(edges, plane, samples, middles, scales=scales)
        found = [Hypothesis("placed", G, target.noise_of_guess) for G in poses]
        alike = [c.estimate for c in claims if c.kind is kind]
        return [(kind, channel, h) for h in samples.promising(levels[0], found, MOST_PLACEMENTS, alike)]

    told = search.pool.map(vote, asked)
    return [*doubted, *_claims_at(list(chain.from_iterable(told)), search)]


def claims_beside(settled: list[PartClaim], doubted: list[PartClaim], search: PartSearch) -> list[PartClaim]:
    """What is doubted, once more: where others lie, the image shows nothing of it."""

    def judge_again(claim: PartClaim) -> PartClaim:
        others = [c for c in [*settled, *doubted] if c is not claim and not c.shares_place(claim)]
        others = [c for c in others if overlap_areas(c.view, claim.view)[0]]
        if not others:
            return claim
        hidden = np.maximum.reduce([material_mask(c.view, search.scene.colours.shape) for c in others])
        target = claim.state.target
        handle = target.recipe.build_target()
        handle.hide(hidden_levels(hidden))
        state = replace(claim.state, target=replace(target, handle=handle))
        begun = [Hypothesis(e.origin, e.G, target.noise_of_guess) for e in claim.tried]
        found = [single_estimate(state, search.scene.levels_in(claim.channel), each) for each in begun]
        seen = [e for e in found if e is not None]
        return PartClaim(claim.kind, claim.channel, state, seen).settled_beside(claim) if seen else claim

    return list(search.pool.map(judge_again, doubted))
