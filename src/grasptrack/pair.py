# SPDX-License-Identifier: Apache-2.0
"""The same grasp in two images: outlines matched without a prior, laid on the edges, and carried by every strategy.

Each answer is judged by the edges of the second image.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.analysis import FINGER_WIDTH, GraspAnalysis, analyze
from grasptrack.contour import Contour, View
from grasptrack.errors import AmbiguousError, GraspTrackError, TransferError
from grasptrack.grasp import Grasp
from grasptrack.matching import Judgement, Match, Sampled, judge, match, symmetries
from grasptrack.observation.candidate import Candidate
from grasptrack.observation.images import to_bgr, to_mask
from grasptrack.observation.registration import CLOSE, OutlineRegistration
from grasptrack.observation.segmentation import candidates, grow
from grasptrack.observation.support import OutlineSamples
from grasptrack.projective import apply_homography, check_plausible, jacobian
from grasptrack.reference import Reference
from grasptrack.transfer import STRATEGIES
from grasptrack.verdict import error, refuse

Floats = NDArray[np.float64]

REGISTRATION = "registration"
"""The name of the outcome that needs no strategy of the paper."""
LOOKED_AT = 6
"""Objects of the second image that are matched."""
MARGIN, MARGIN_PX = 0.5, 48.0
"""Share of sqrt(area), and px, that is kept round the object of the first image."""
FIXED = 2.0
"""A match fixes the contacts when the outlines part by more than so many times its misfit as soon as one is 4 % off."""
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
        off: px by which the second image's edges say that the worst contact is off; NaN when refused.
        reason: empty when believed, else why not.
    """

    strategy: str
    contacts: Floats | None
    homography: Floats | None
    analysis: GraspAnalysis | None
    off: float
    reason: str


class Pair(NamedTuple):
    """A grasp in two images.

    Attributes:
        outcomes: the registration, then one for each strategy.
        current: the outline in the second image.
        turns: degrees of the other turns of the object by which the outline would fit as well; empty where none does.
        found: what the match of the outlines amounts to.
    """

    outcomes: list[Outcome]
    current: View
    turns: list[float]
    found: Judgement


def carry_to(
    grasp: Grasp,
    reference: View,
    first: NDArray[Any],
    second: NDArray[Any],
    friction: float,
    object_at: tuple[float, float] | None = None,
    ignore: NDArray[Any] | None = None,
) -> Pair:
    """Carry a grasp to a second image, under any turn, scales of 0.4 to 2.5 and tilts up to 60 degrees.

    One pair of views cannot tell a symmetric object from its turned twin: of hypotheses that fit alike the one that
    asks for the least tilt is taken, of equals the one with the smallest turn, and the others are told.

    Args:
        grasp, reference: in the first image.
        first, second: the images.
        friction: Coulomb coefficient.
        object_at: (x, y) px of the object in the second image.
        ignore: (H, W) nonzero where nothing belongs to either scene.

    Raises:
        ObservationError: no object in the second image.
        TransferError: none there has this outline.
        SourceError, InputError: an image or mask that cannot be used.
        AmbiguousError: the outline fits itself in every turn, as a disc does.
    """
    colours = to_bgr(second)
    hidden = None if ignore is None else grow(to_mask(ignore, colours.shape[:2], "ignore mask"))
    outline = Sampled(reference)
    if symmetries(outline).continuous:
        raise AmbiguousError("the outline fits itself in every turn: nothing tells how far it turned")
    found, ways = _most_alike(candidates(colours, object_at, hidden), outline)
    told = judge(ways)
    if told.best is None:
        raise TransferError(f"no object with this outline was found: {told.reason}")
    chosen = _least_turned(told, outline)
    alike = [told.best, *told.others]
    others = [m for m in alike if m is not chosen]
    worse = [m for m in ways if not any(m is known for known in alike)]
    fixed = told.status == "matched" and chosen.slack >= FIXED * chosen.misfit
    scene = _Scene(grasp, reference, to_bgr(first), colours, found, friction, fixed)
    outcomes = [scene.registered([chosen, *others, *worse])]
    H = outcomes[0].homography if outcomes[0].homography is not None else chosen.homography
    outcomes += [scene.by(name, H) for name in STRATEGIES]
    turns = [math.degrees(_turn(np.linalg.inv(H) @ m.homography, outline.centre)) for m in others]
    return Pair(outcomes, found.view, turns, told)


class _Scene:
    """Both images, the first one cut to the object: with strong perspective its corner may lie beyond the horizon."""

    def __init__(
        self,
        grasp: Grasp,
        reference: View,
        first: NDArray[np.uint8],
        second: NDArray[np.uint8],
        found: Candidate,
        friction: float,
        fixed: bool,
    ) -> None:
        points = reference.outer.points
        margin = max(MARGIN * math.sqrt(reference.outer.area), MARGIN_PX)
        left, top = (max(0, int(v)) for v in (points.min(axis=0) - margin).tolist())
        right, bottom = (int(v) + 1 for v in (points.max(axis=0) + margin).tolist())
        corner = np.array([left, top], dtype=np.float64)
        self._to = np.array([[1.0, 0.0, -corner[0]], [0.0, 1.0, -corner[1]], [0.0, 0.0, 1.0]])
        self._grasp = Grasp(grasp.contacts - corner)
        self._reference = View([_shifted(c, corner) for c in reference.contours])
        self._first = np.ascontiguousarray(found.channel.grey(first)[top:bottom, left:right])
        self._second = found.channel.grey(second)
        self._found, self._friction, self._fixed = found, friction, fixed

    def registered(self, ways: list[Match]) -> Outcome:
        """The first hypothesis that the image bears out once it is laid on the edges; else what was made of the first."""
        refused: list[Outcome] = []
        for way in ways:
            outcome = self._registered(way.homography)
            if not outcome.reason:
                return outcome
            refused.append(outcome)
        return refused[0]

    def _registered(self, H: Floats) -> Outcome:
        polarity, view = self._found.polarity, self._reference
        width = FINGER_WIDTH * math.sqrt(kernels.inertia(view.points, view.offsets)[0])
        try:
            laid = OutlineRegistration(view, self._first, polarity).refine(self._second, self._cut(H), CLOSE)
            check_plausible(laid.homography, view.outer.points)
            contacts = apply_homography(laid.homography, self._grasp.contacts)
            samples = OutlineSamples(view, self._first, self._grasp.contacts, width, polarity)
            support = samples.support(self._second, laid.homography, contacts)
        except GraspTrackError as problem:
            return Outcome(REGISTRATION, None, None, None, math.nan, str(problem))
        if (
            self._fixed
        ):  # a motion that the edges show too little to be measured frame by frame moves the outline, seen whole
            support = support._replace(covariance=np.zeros_like(support.covariance))
        reason, analysis = refuse(support), None
        try:
            analysis = analyze(self._grasp, view, self._friction, width, "reference")
        except GraspTrackError as problem:
            reason = reason or str(problem)
        return Outcome(REGISTRATION, contacts, self._whole(laid.homography), analysis, error(support), reason)

    def by(self, name: str, H: Floats) -> Outcome:
        """What a strategy makes of the pair, told where the object is."""
        try:
            start = Reference(self._grasp, self._reference, self._first, name, self._found.polarity, self._friction)
            moved = start.carriers[0].carry(self._second, self._found.view, self._cut(H)).transfer
            contacts, cut = moved.grasp.contacts, moved.homography
            if cut is None:
                return Outcome(name, contacts, None, None, math.nan, "the transfer has no homography to judge it by")
            support = start.samples.support(self._second, cut, contacts)
        except GraspTrackError as problem:
            return Outcome(name, None, None, None, math.nan, str(problem))
        reason, analysis = refuse(support), None
        try:
            analysis = start.carried_back(contacts, cut)
        except GraspTrackError as problem:
            reason = reason or str(problem)
        return Outcome(name, contacts, self._whole(cut), analysis, error(support), reason)

    def _cut(self, H: Floats) -> Floats:
        """A homography between the images as one from the piece of the first."""
        out = H @ np.linalg.inv(self._to)
        return np.asarray(out / out[2, 2])

    def _whole(self, H: Floats) -> Floats:
        out = H @ self._to
        return np.asarray(out / out[2, 2])


def _shifted(contour: Contour, corner: Floats) -> Contour:
    return Contour(contour.points - corner, hole=contour.hole, strength=contour.strength, clipped=contour.clipped)


def _least_turned(told: Judgement, outline: Sampled) -> Match:
    """Of what fits alike and takes hardly more tilt than the least, the smallest turn."""
    assert told.best is not None
    best = told.best
    alike = [m for m in (best, *told.others) if m.stretch <= HARDLY_MORE * best.stretch]
    return min(alike, key=lambda m: abs(_turn(m.homography, outline.centre)))


def _turn(H: Floats, at: Floats) -> float:
    """rad by which a homography turns what lies at a point (2,)."""
    a, b, c, d = jacobian(H, float(at[0]), float(at[1]))
    return math.atan2(c - b, a + d)


def _most_alike(found: list[Candidate], outline: Sampled) -> tuple[Candidate, list[Match]]:
    """Among what stands out, the object that the reference's outline fits best, and the ways in which it does."""
    ways = [(c, match(outline, c.view, thorough=False)) for c in found[:LOOKED_AT]]
    if all(judge(m).status == "none" for _, m in ways):
        ways = [(c, match(outline, c.view)) for c, _ in ways]
    return min(ways, key=lambda pair: pair[1][0].cost / pair[1][0].size if pair[1] else math.inf)
