# SPDX-License-Identifier: Apache-2.0
"""The same grasp in two images: laid on the second by outline and surface, and carried by every strategy of the paper.

Outlines matched without a prior, keypoints and the strategies' own transfers say where the object may be; the tracker's
estimator makes each exact, and its decision says which is believed.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import AmbiguousError, GraspTrackError, ObservationError, TransferError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, normalize_homography, rotation_at
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import GraspAnalysis, analyze
from grasptrack.images import PLAIN, Grey, to_bgr
from grasptrack.matching import Match, MatchOutcome, Sampled, find_symmetries, judge_hypotheses, match_outlines
from grasptrack.segmentation.candidate import Candidate, contains_pixel
from grasptrack.segmentation.first_look import find_candidates
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.decision import Decision, check_strategy_contacts
from grasptrack.tracking.estimator import first_state
from grasptrack.tracking.evidence import texture_evidence
from grasptrack.tracking.messages import StatusReason
from grasptrack.tracking.numbers import DEFAULT_RISK, NUMBERS
from grasptrack.tracking.pose import Hypothesis, PoseEstimate, max_contact_distance
from grasptrack.tracking.redetection import Keypoints
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.single import (
    decide_single,
    pose_hypothesis,
    same_place,
    single_estimate,
    told_apart,
    turned_hypotheses,
)
from grasptrack.tracking.strategies import REGISTRATION, Carried, make_extractor
from grasptrack.tracking.target import build_pyramid
from grasptrack.transfer import strategy_names
from grasptrack.typing import Floats

LOOKED_AT = 6
"""Objects of the second image that are matched."""
MARGIN, MARGIN_PX = 0.5, 48.0
"""Share of sqrt(area), and px, that is kept round the object of the first image."""
HARDLY_MORE = 1.15
"""Of hypotheses that fit alike, and ask for up to so much more tilt than the one that asks for the least, the one with
the smallest turn is taken."""


class Outcome(NamedTuple):
    """What one strategy makes of a pair of images.

    Attributes:
        strategy: its name, or "registration".
        contacts: (k, 2) px in the second image as transferred, also when they are not believed; None when refused.
        homography: (3, 3) from the first image to the second, or None.
        analysis: of the transferred grasp, in the first view; None when there is none.
        off: px by which the second image says that the worst contact is off; NaN when refused.
        reason: empty when believed, else why not.
        confidence: 0 to 1, the complement of the probability that a contact is off, or on another object; 0 when refused
            without contacts.
        code: the reason in one word, one of `messages.SENTENCES`; empty when believed, or where words alone tell it.
    """

    strategy: str
    contacts: Floats | None
    homography: Floats | None
    analysis: GraspAnalysis | None
    off: float
    reason: str
    confidence: float = 0.0
    code: str = ""


class Place(NamedTuple):
    """Where the contacts may be in the second image.

    Attributes:
        contacts: (k, 2) px.
        share: probability, 0 to 1, that they lie there.
        turn: degrees by which the object lies turned there, against the first of several places.
    """

    contacts: Floats
    share: float
    turn: float


class Pair(NamedTuple):
    """A grasp in two images.

    Attributes:
        outcomes: the registration, then one for each strategy.
        current: the outline in the second image.
        turns: degrees of the other turns of the object by which it would fit as well; empty where none does.
        found: what the match of the outlines amounts to; "matched" also where only the surface tells.
        places: where the contacts may be, the registration's first, where the image does not tell which; else empty.
    """

    outcomes: list[Outcome]
    current: View
    turns: list[float]
    found: MatchOutcome
    places: tuple[Place, ...] = ()


def transfer_between_images(
    grasp: Grasp,
    reference: View,
    first: NDArray[Any],
    second: NDArray[Any],
    friction: float,
    said: FirstImage | None = None,
    risk: float = DEFAULT_RISK,
    focal: Beforehand | None = None,
) -> Pair:
    """Carry a grasp to a second image, under any turn, scales of 0.4 to 2.5 and tilts up to 60 degrees.

    One pair of views cannot tell a symmetric object without a surface of its own from its turned twin: of hypotheses that
    fit alike the one that asks for the least tilt comes first, of equals the one with the smallest turn, then the others.
    Each has its share of the probability, which is then seldom enough for any.

    Args:
        grasp, reference: in the first image.
        first, second: the images.
        friction: Coulomb coefficient.
        said: of the second image: pixels on the object, and what belongs to neither scene.
        risk: probability, between 0 and 1, below which an answer may be wrong.
        focal: what is known of the first image's camera beforehand, as for `Plane`.

    Raises:
        ObservationError: no object in the second image.
        TransferError: none there has this outline.
        SourceError, InputError: an image or mask that cannot be used.
        AmbiguousError: the outline fits itself in every turn, as a disc does, and no surface tells how far it turned.
    """
    colours = to_bgr(second)
    said = (said or FirstImage()).within(colours.shape)
    asked = _Asked(grasp, reference, to_bgr(first), colours, friction, said, risk)
    outline = Sampled(reference)
    try:
        found, ways, told = _by_outline(asked, outline)
    except (ObservationError, TransferError) as problem:
        scene = _Scene(asked, None, focal)
        decision = scene.decide_among(scene.by_keypoints())
        if not decision.is_accepted:
            raise problem from None
        return scene.make_pair(decision, MatchOutcome("matched", None, [], ""), [])
    assert told.best is not None
    alike = [told.best, *told.others]
    worse = [m for m in ways if not any(m is known for known in alike)]
    scene = _Scene(asked, found, focal)
    made = [(m, e) for m in alike if (e := scene.by_match(m)) is not None]
    by_worse = [scene.by_match(m) for m in worse]
    every = [*(e for _, e in made), *by_worse, *scene.by_keypoints()]
    whole = scene.decide_among(every)
    if scene.is_sure(whole) or not made:
        return scene.make_pair(whole, scene.settle_outcome(whole, told), [], told.best.homography)
    # nothing but their turns tells those apart for which there is as much evidence: the least that the surface allows
    made = _by_turn(scene.undecided_matches(made), outline)
    decisions = [scene.decide_among([e, *by_worse]) for _, e in made]
    chosen = next((i for i, each in enumerate(decisions) if scene.is_sure(each)), 0)
    own, decision = made[chosen][1], scene.decide_among([made[chosen][1], *by_worse])
    others = [e for _, e in made if not same_place(e, own, NUMBERS)]
    places = scene.possible_places(own, others)
    if not places:
        decision = scene.decide_among(every)
        return scene.make_pair(decision, scene.settle_outcome(decision, told), [], told.best.homography)
    left, decision = told._replace(status="ambiguous"), decision.among_several(places[0].share)
    turns = [place.turn for place in places[1:]]
    return scene.make_pair(decision, left, turns, scene.target.homography(own.G), places)


class _Asked(NamedTuple):
    """What is asked: as of `transfer_between_images`, both images in BGR."""

    grasp: Grasp
    view: View
    first: NDArray[np.uint8]
    second: NDArray[np.uint8]
    friction: float
    said: FirstImage
    risk: float


def _by_outline(asked: _Asked, outline: Sampled) -> tuple[Candidate, list[Match], MatchOutcome]:
    """The object of the second image that an outline fits best, the ways in which it does, and what they amount to.

    Raises:
        ObservationError: no object.
        TransferError: none has this outline, or it fits itself in every turn.
    """
    if find_symmetries(outline).continuous:
        raise AmbiguousError("the outline fits itself in every turn: nothing tells how far it turned")
    found, ways = _most_alike(find_candidates(asked.second, asked.said), outline)
    told = judge_hypotheses(ways)
    if told.best is None:
        raise TransferError(f"no object with this outline was found: {told.reason}")
    return found, ways, told


class _Scene:
    """Both images, the first with its object as a target, and that object alone as the strategies see it.

    Args:
        asked: the question.
        found: the object in the second image, if its outline was found.
        focal: as of `transfer_between_images`.
    """

    def __init__(self, asked: _Asked, found: Candidate | None, focal: Beforehand | None) -> None:
        self._asked, self._found = asked, found
        self._strict = NUMBERS.for_learning(asked.risk).risk
        channel = PLAIN if found is None else found.channel
        self._first, self._second = channel.to_grey(asked.first), channel.to_grey(asked.second)
        before, self._levels = build_pyramid(self._first), build_pyramid(self._second)
        hidden = asked.said.hidden
        if hidden is not None and hidden.shape != self._first.shape:
            hidden = None
        numbers = NUMBERS.with_risk(asked.risk)
        self.target = make_target(before, asked.view, asked.grasp.contacts, numbers, hidden)
        self._state = first_state(self.target, before, focal)
        self._standing: list[PoseEstimate] = []

    def by_match(self, way: Match) -> PoseEstimate | None:
        """One way in which the outlines lie on each other, made exact."""
        return self._refine_hypothesis(pose_hypothesis(self.target, "match", way.homography))

    def by_keypoints(self) -> list[PoseEstimate | None]:
        """The pose on which keypoints of the surface agree, made exact, and the turns of it in which its outline fits as well;
        nothing without, nor where they agree on another object than was pointed at."""
        G = Keypoints(self.target, build_pyramid(self._first)).find_pose(self._levels, fine=True)
        if G is None:
            return []
        own = self._refine_hypothesis(Hypothesis("keypoints", G, self.target.noise_of_guess))
        if own is None or not self._covers_given_pixel(own):
            return []
        return [own, *(self._refine_hypothesis(way) for way in turned_hypotheses(self.target, own))]

    def _covers_given_pixel(self, estimate: PoseEstimate) -> bool:
        """Whether an estimate covers the pixels of the object that were given, if any were."""
        H = self.target.homography(estimate.G)
        return all(contains_pixel(self._asked.view.transformed(H), *at) for at in self._asked.said.object_at)

    def _refine_hypothesis(self, hypothesis: Hypothesis) -> PoseEstimate | None:
        return single_estimate(self._state, self._levels, hypothesis, one_camera=True)

    def decide_among(self, estimates: list[PoseEstimate | None]) -> Decision:
        """What is decided of some estimates, which stand against those that strategies will ask for."""
        self._standing = [e for e in estimates if e is not None]
        return decide_single(self._state, self._standing)

    def is_sure(self, decision: Decision) -> bool:
        """Whether a decision is accepted also at the default risk: what the user takes at a higher one is no surer for it."""
        return decision.with_risk(self._strict).is_accepted

    def settle_outcome(self, decision: Decision, told: MatchOutcome) -> MatchOutcome:
        """What the outlines amount to once it is decided: where they slide along each other, only the surface tells."""
        assert told.best is not None
        estimate, best = decision.estimate, told.best
        shown = 0.0 if estimate is None else texture_evidence(self._state, estimate)
        if NUMBERS.temper * shown >= -math.log(self._strict) or (told.others and not best.can_slide):
            return MatchOutcome("matched", best, [], "")
        return told

    def undecided_matches(self, made: list[tuple[Match, PoseEstimate]]) -> list[tuple[Match, PoseEstimate]]:
        """Those for which there is as much evidence as for the best, as far as can be told."""
        return [
            (m, e) for m, e in made if not any(told_apart(self._state, other, e, self._strict) for _, other in made)
        ]

    def possible_places(self, own: PoseEstimate, others: list[PoseEstimate]) -> tuple[Place, ...]:
        """Where the contacts may be by estimates that the outline does not tell apart, each place once; () if in one alone.

        By its outline one fits as well as the other, whatever noise says, so that the surface gives each its share.
        """
        distinct = [own]
        for e in others:
            if not any(same_place(e, known, NUMBERS) for known in distinct):
                distinct.append(e)
        if len(distinct) == 1:
            return ()
        seen = [NUMBERS.temper * max(0.0, texture_evidence(self._state, e)) for e in distinct]
        weights = [math.exp(each - max(seen)) for each in seen]
        return tuple(
            Place(e.contacts, weight / sum(weights), self._relative_turn(own, e))
            for e, weight in zip(distinct, weights, strict=True)
        )

    def _relative_turn(self, own: PoseEstimate, other: PoseEstimate) -> float:
        """Degrees by which the object lies turned in one estimate against another."""
        back = np.linalg.inv(self.target.homography(own.G))
        centre = self._asked.view.outer.points.mean(axis=0)
        return math.degrees(rotation_at(back @ self.target.homography(other.G), *centre.tolist()))

    def _rival_places(self, decision: Decision) -> tuple[Place, ...]:
        """Where else a decision that refuses has the contacts, if it knows."""
        own, rival = decision.estimate, decision.rival
        if decision.is_accepted or own is None or rival is None or decision.rival_share <= decision.risk:
            return ()
        return Place(own.contacts, decision.confidence, 0.0), Place(
            rival.contacts, decision.rival_share, self._relative_turn(own, rival)
        )

    def make_pair(
        self,
        decision: Decision,
        told: MatchOutcome,
        turns: list[float],
        H: Floats | None = None,
        places: tuple[Place, ...] = (),
    ) -> Pair:
        """The grasp in both images.

        Args:
            decision: of the registration.
            told: of the outlines.
            turns: degrees.
            H: (3, 3) from the first image to the second, where the strategies look if there is no estimate.
            places: where the contacts may be, the decision's first, where nothing tells which.
        """
        if decision.estimate is not None:
            H = self.target.homography(decision.estimate.G)
        assert H is not None
        current = self._asked.view.transformed(H) if self._found is None else self._found.view
        share = places[0].share if places else 1.0
        outcomes = [
            self._registration_outcome(decision),
            *(self._strategy_outcome(name, H, current, share) for name in strategy_names()),
        ]
        return Pair(outcomes, current, turns, told, places or self._rival_places(decision))

    def _registration_outcome(self, decision: Decision) -> Outcome:
        estimate = decision.estimate
        if estimate is None:
            return Outcome(REGISTRATION, None, None, None, math.nan, _refusal_sentence(decision))
        H = self.target.homography(estimate.G)
        again = self._refine_hypothesis(pose_hypothesis(self.target, REGISTRATION, H))
        off = math.nan if again is None else max_contact_distance(again.contacts, estimate.contacts)
        reason, analysis = _refusal_sentence(decision), None
        try:
            analysis = analyze(self._asked.grasp, self._asked.view, self._asked.friction, judged_in="reference")
        except GraspTrackError as problem:
            reason = reason or str(problem)
        return Outcome(REGISTRATION, estimate.contacts, H, analysis, off, reason, decision.confidence, decision.code)

    def _strategy_outcome(self, name: str, H: Floats, current: View, share: float) -> Outcome:
        """What a strategy makes of the pair, told where the object is with a probability, if it is there in any way."""
        try:
            moved = self._transfer_by_strategy(name, H, current)
        except GraspTrackError as problem:
            return Outcome(name, None, None, None, math.nan, str(problem))
        contacts, carried = moved.contacts, moved.homography
        own = self._refine_hypothesis(pose_hypothesis(self.target, name, carried))
        estimates = [*self._standing, *([] if own is None else [own])]
        decision = check_strategy_contacts(decide_single(self._state, estimates), contacts)
        decision = decision.among_several(share)
        estimate, reason, analysis = decision.estimate, _refusal_sentence(decision), None
        off = math.nan if estimate is None else max_contact_distance(contacts, estimate.contacts)
        try:
            back = Grasp.of(apply_homography(np.linalg.inv(carried), contacts))
            analysis = analyze(back, self._asked.view, self._asked.friction, judged_in="reference")
        except GraspTrackError as problem:
            reason = reason or str(problem)
        return Outcome(name, contacts, carried, analysis, off, reason, decision.confidence, decision.code)

    def _transfer_by_strategy(self, name: str, H: Floats, current: View) -> Carried:
        """A strategy's transfer, with a homography (3, 3) between the images.

        Raises:
            GraspTrackError: it refuses.
        """
        # the first image cut to the object: with strong perspective its corner may lie beyond the horizon
        corner, piece = self._crop_first_image()
        back = np.array([[1.0, 0.0, -corner[0]], [0.0, 1.0, -corner[1]], [0.0, 0.0, 1.0]])
        grasp, view = (
            Grasp(self._asked.grasp.contacts - corner),
            View([_shift_contour(c, corner) for c in self._asked.view.contours]),
        )
        prior = normalize_homography(H @ np.linalg.inv(back))
        carried = make_extractor(name, grasp, view, piece).carry(self._second, current, prior)
        return carried._replace(homography=normalize_homography(carried.homography @ back))

    def _crop_first_image(self) -> tuple[Floats, Grey]:
        """(2,) px of the corner, and the piece of the first image round the object."""
        points = self._asked.view.outer.points
        margin = max(MARGIN * math.sqrt(self._asked.view.outer.area), MARGIN_PX)
        left, top = (max(0, int(v)) for v in (points.min(axis=0) - margin).tolist())
        right, bottom = (int(v) + 1 for v in (points.max(axis=0) + margin).tolist())
        return np.array([left, top], dtype=np.float64), np.ascontiguousarray(self._first[top:bottom, left:right])


def _refusal_sentence(decision: Decision) -> str:
    """Why an answer is not believed; empty when it is."""
    return "" if decision.is_accepted else StatusReason(decision.code, decision.figures).sentence


def _shift_contour(contour: Contour, corner: Floats) -> Contour:
    return Contour.trusted(
        contour.points - corner, hole=contour.hole, strength=contour.strength, clipped=contour.clipped
    )


def _by_turn(made: list[tuple[Match, PoseEstimate]], outline: Sampled) -> list[tuple[Match, PoseEstimate]]:
    """What takes hardly more tilt than the least first, the smallest turn first; then the rest."""
    least = min(m.stretch for m, _ in made)

    def turn_order(each: tuple[Match, PoseEstimate]) -> tuple[bool, float]:
        way = each[0]
        return way.stretch > HARDLY_MORE * least, abs(rotation_at(way.homography, *outline.centre.tolist()))

    return sorted(made, key=turn_order)


def _most_alike(found: list[Candidate], outline: Sampled) -> tuple[Candidate, list[Match]]:
    """Among what stands out, the object that the reference's outline fits best, and the ways in which it does."""
    ways = [(c, match_outlines(outline, c.view, thorough=False)) for c in found[:LOOKED_AT]]
    if all(judge_hypotheses(m).status == "none" for _, m in ways):
        ways = [(c, match_outlines(outline, c.view)) for c, _ in ways]
    return min(ways, key=lambda pair: pair[1][0].cost / pair[1][0].size if pair[1] else math.inf)
