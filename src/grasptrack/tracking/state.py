# SPDX-License-Identifier: Apache-2.0
"""All that changes from frame to frame, and nothing else does: what an image teaches, and what remains known without."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grasptrack.tracking.decision import Decision, is_near, mean_point, outline_surprisal
from grasptrack.tracking.estimator import CONTINUOUS, PoseEstimate
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.plane import Beforehand, Plane
from grasptrack.tracking.shutter import Shutter
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Floats

if TYPE_CHECKING:
    from grasptrack.tracking.hypotheses import Predictions


MOST_SEEN = 0.7
"""Share of the outline that shows from which on what shows another shape lies in the place of the object."""
BLUR_KEPT = 0.2
"""Share of a new measurement of the blur: shutters keep their time, hands do not keep their speed."""
MEMORY = 10
"""Images over which it is remembered what is usual, ..."""
FIRST = 2
"""... and images for which the likeness that noise allows counts before the first."""
UNSURE = 0.5
"""Most that an image in which nothing was accepted tells of the object's presence."""
FOLLOWED = 0.999
"""Presence from which on what shows another shape or surface is followed all the same, whatever risk is taken."""
STILL = 0.05
"""Least wandering: what rests may be pushed."""
UNKNOWN: Floats = np.empty(0)
"""Nothing is known of what is visible."""
CALM = 0.01
"""Share of the process noise that always remains."""


@dataclass(frozen=True)
class Look:
    """An image in which the object was located, or looked for.

    Attributes:
        levels: the image and its halves.
        G: (3, 3) work px -> px.
    """

    levels: list[Grey]
    G: Floats


@dataclass
class TrackState:
    """Where the object is, what is known of camera and part, and how sure that is.

    Attributes:
        last: the last image, with the best pose found in it.
        visible: (N,) probability of each sample of the outline to be visible in it; empty where that is not known.
        velocity: (8,) the pose's change in a usual interval, work px at the half size; None where it is not known.
        velocity_P: (8, 8) covariance of its error.
        P: (8, 8) covariance of the pose's error, work px^2 at the half size.
        moved: work px that a contact moved in a usual interval, root mean square, in the last image and in the one before: a
            jump is no speed; 0 where that is not known.
        presence: probability that the object is there.
        steps: time from the last image but one to the last, or to the one that is looked at, in usual intervals.
        shutter: what is known of the readout.
        nuisance, nuisance_covariance: (4,), (4, 4) what is not known of part and camera: the part's thickness in work px, log
            of the focal length over the image's width, slopes of the first view's normal; these three as `plane` has them.
        plane: the object's own, as the views so far let it be known.
        sides: probability that a thick part's sides are seen as the object, so that its outline is the lower face's.
        inner_spread: grey levels, see `Numbers.other_spread`.
        edge_width: work px, standard deviation of an edge at rest: how far the image is out of focus.
        blur_share: half of an edge's blur, of what moved across it since the last image: how long the shutter is open.
        blur: work px, half of what blurred most edges of late.
        located: the last image in which the object was located.
        light: gain and bias of the surface there, from the first view on.
        lost: images since.
        time, interval: s, of the last image; a usual time between images.
        usual: of each patch of the three finest levels: its correlation of late.
        accepted: images in which the object was located.
        strange: usual strangeness of the outline: edges that no light shows, or not where the first view had them.
        elsewhere: share of the outline whose edge lies elsewhere although a second solution was tried.
        confirmed: strangeness of the last image, if other hypotheses led to the same answer there.
        agility: mean square by which even motion was off of late, in process noise; moves: how often that was measured.
        expected: (3, 3) where it was located, carried by the ground since then.
        anchored: the ground carried it ever since, so that the last look is where it is expected.
        wander: how far it left its place on the ground of late, a frame, in `Numbers.travel`; wanders: how often that was
            measured.
        unseen: how far it may have gone since it was located, likewise.
        slope: sd of the change of depth over half the object, as a share, when it was located.
        adrift: frames since the ground last told how far the camera is, or the object itself.
        gone: since it was located its place was seen without it.
        exchanged: the last image showed something else in its place.
        lookalike: something just like it was seen elsewhere.
        beside: the same, while the object itself was seen in its place.
        sighted: (3, 3) where something like it was seen in the last image, but not believed to be it; None where nothing was.
    """

    last: Look
    visible: Floats
    velocity: Floats | None
    velocity_P: Floats
    P: Floats
    moved: tuple[float, float]
    presence: float
    steps: float
    shutter: Shutter
    nuisance: Floats
    nuisance_covariance: Floats
    plane: Plane
    sides: float
    inner_spread: float
    edge_width: float
    blur_share: float
    located: Look
    blur: float
    light: tuple[float, float]
    lost: int
    time: float | None
    interval: float | None
    usual: list[Floats]
    accepted: int
    strange: float
    elsewhere: float
    confirmed: float
    agility: float
    moves: int
    expected: Floats
    anchored: bool
    wander: float
    wanders: int
    unseen: float
    slope: float
    adrift: float
    gone: bool
    exchanged: bool
    lookalike: bool
    beside: bool
    sighted: Floats | None

    def learn(
        self,
        target: Target,
        levels: list[Grey],
        decision: Decision,
        estimate: PoseEstimate,
        predictions: Predictions,
        steps: float,
    ) -> None:
        """What an image teaches in which the object was located; all of it only if it was accepted.

        Args:
            target: the object.
            levels: the image's pyramid.
            decision, estimate: what was found in it.
            predictions: where it was expected.
            steps: time since the last image in usual intervals.
        """
        numbers, e = target.numbers, estimate
        way = float(np.linalg.norm(target.handle.difference(self.last.G, e.G)))
        new = min(1.0, way / (numbers.new_view * target.size)) if math.isfinite(way) else 1.0
        self._learn_motion(target, e, predictions, steps)
        rigid = self.shutter.follow(target, e.G, e.bend, steps)
        before = target.carried(self.last.G)
        px = math.sqrt(2.0 * float(((e.contacts - before) ** 2).mean()))
        moved = 0.0 if self.lost else px * target.size / math.sqrt(e.area) / max(steps, 1e-3)
        self.moved = moved, self.moved[0]
        self.last, self.visible = Look(levels, e.G), e.visible
        self.P = e.P
        self.presence = _clamp_value(decision.presence, numbers.redetected, 1.0 - numbers.hazard)
        self.expected, self.anchored, self.unseen, self.adrift, self.lost = e.G, True, 0.0, 0.0, 0
        if not decision.accepted:  # where it is, is known only roughly
            return
        self.exchanged, self.sighted, self.gone = False, None, False
        self.slope = math.sqrt(e.P[6, 6] + e.P[7, 7]) / (0.5 * target.size)
        self.located, self.light = self.last, e.light
        if self.plane.learn(rigid, e.P):
            self.nuisance[1:], self.nuisance_covariance[1:, 1:] = self.plane.theta_and_covariance()
        self._learn_thickness(e, new)
        self.shutter.learn(e.readout, e.readout_variance, new)
        self._remember_looks(target, e)
        if math.isfinite(e.edge_width):
            self.edge_width = e.edge_width
        if math.isfinite(e.blur):
            self.blur = e.blur
        if math.isfinite(e.blur_share):
            self.blur_share += BLUR_KEPT * (e.blur_share - self.blur_share)
        if e.look > 0.0:
            self.inner_spread = _clamp_value(0.9 * self.inner_spread + 0.1 * 1.3 * e.look, 6.0, 30.0)

    def lose(
        self,
        target: Target,
        levels: list[Grey],
        decision: Decision,
        predictions: Predictions,
        steps: float,
    ) -> None:
        """What remains known of an object that was not located; arguments as for `learn`."""
        numbers, e, ground = target.numbers, decision.estimate, predictions.ground
        self.lost += 1
        seen = e is not None and bool(len(e.visible)) and float(np.mean(e.visible)) > MOST_SEEN
        self.exchanged = self.exchanged or (seen and decision.exchanged > 0.5 < decision.presence)
        self.velocity, self.elsewhere, self.confirmed = None, 0.0, 0.0
        self.shutter.lose()
        # while something is followed that is more probably the object than another shape or surface, its place is known
        followed = decision.presence > FOLLOWED and decision.probability_off < 0.5
        if e is not None and e.origin in CONTINUOUS and followed and decision.code in ("other-shape", "other-surface"):
            self.expected, self.anchored, self.unseen, self.adrift = e.G, True, 0.0, 0.0
            self.last, self.P, self.presence = Look(levels, e.G), e.P, UNSURE
            self.visible = e.visible
            return
        self.visible = UNKNOWN
        # what shows its outline in its place has not left it, whatever else is wrong
        at_place = e is not None and decision.presence > FOLLOWED and is_near(e, target.carried(self.expected))
        self.anchored = self.anchored and ground is not None
        if ground is not None and self.anchored:
            self.expected = ground
            self.last = Look(levels, ground)
            self.unseen += 0.0 if at_place else self.wander
            self.adrift = 0.0
        else:
            passed = 0.0 if at_place else max(1.0, steps)
            self.adrift += passed
            self.unseen += passed
            self.last = Look(levels, self.last.G if e is None else e.G)
        # what looks like it elsewhere looks like it again and again: that makes it no surer
        self.presence = _clamp_value(decision.presence, numbers.redetected, UNSURE)
        if e is not None:
            self.P = e.P

    def forget_outline(self, usual: list[Floats]) -> None:
        """What was strange of an outline that was mended is so no more; `usual` is of the patches within it."""
        self.usual, self.exchanged, self.visible = usual, False, UNKNOWN
        self.strange = self.elsewhere = self.confirmed = 0.0

    def _learn_motion(self, target: Target, estimate: PoseEstimate, predictions: Predictions, steps: float) -> None:
        """How it moves; how far even motion and rest on the ground are off."""
        numbers, ground = target.numbers, predictions.ground
        if predictions.even is not None:
            off = target.handle.difference(predictions.even, estimate.G)
            share = float(off**2 @ target.precision_of_motion) / len(off)
            if math.isfinite(share):
                self.moves += 1
                rate = 1.0 / min(self.moves, MEMORY)
                self.agility = _clamp_value(self.agility + (share - self.agility) * rate, CALM, 1.0)
        if ground is not None and not self.lost:
            away = math.dist(estimate.middle, mean_point(target.carried(ground)))
            share = away / math.sqrt(estimate.area) / numbers.travel
            self.wanders += 1
            rate = 1.0 / min(self.wanders, MEMORY)
            self.wander = _clamp_value(self.wander + (share - self.wander) * rate, STILL, 1.0)
        velocity = target.handle.difference(self.last.G, estimate.G) / max(steps, 1e-3)
        self.velocity_P = self.P + estimate.P
        self.velocity = velocity if not self.lost and math.isfinite(float(velocity @ velocity)) else None

    def _learn_thickness(self, estimate: PoseEstimate, new: float) -> None:
        """How thick the part is, by an accepted image of which the share `new` (0 to 1) is new.

        Information is averaged rather than added up: much the same view errs as the last one did.
        """
        before, after = float(self.nuisance_covariance[0, 0]), float(estimate.nuisance_covariance[0, 0])
        both = (1.0 - new) * after + new * before
        thickness = ((1.0 - new) * after * self.nuisance[0] + new * before * estimate.nuisance[0]) / both
        if not both > 0.0 or not math.isfinite(both) or not math.isfinite(thickness):
            return
        self.nuisance[0], self.nuisance_covariance[0, 0] = thickness, after * before / both
        if math.isfinite(estimate.sides) and thickness**2 > self.nuisance_covariance[0, 0]:  # there are sides
            self.sides += new * (estimate.sides - self.sides)

    def _remember_looks(self, target: Target, estimate: PoseEstimate) -> None:
        """How much of outline and patches usually looks as it did first: noise, reflections and blur make it less."""
        self.accepted += 1
        share = 1.0 / (min(self.accepted, MEMORY) + FIRST)
        self.elsewhere = estimate.elsewhere if estimate.confirmed else min(self.elsewhere, estimate.elsewhere)
        strange = outline_surprisal(estimate, target.numbers)
        self.strange += (strange - self.strange) * share
        self.confirmed = min(self.confirmed, strange)
        for usual, r in zip(self.usual, estimate.correlation, strict=True):
            if self.accepted == 1:
                # what passed for texture in the first image, as JPEG's noise, shows itself in the second
                np.minimum(usual, r, out=usual, where=np.isfinite(r))
            np.add(usual, (r - usual) * share, out=usual, where=np.isfinite(r))


def _clamp_value(value: float, low: float, high: float) -> float:
    """A value within bounds; of one number NumPy's takes longer than all that it is the bound of."""
    return min(max(value, low), high)


FIRST_SPREAD = 12.0
"""Grey levels; measured from the first image on."""


def initial_state(target: Target, levels: list[Grey], numbers: Numbers, before: Beforehand | None = None) -> TrackState:
    """The state in the first image, where the pose is known by definition; `before` as for `Plane`."""
    nuisance_covariance = np.diag([(numbers.thickness_sd * target.size) ** 2, 0.0, 0.0, 0.0])
    look, before = Look(levels, target.A), before or Beforehand.usual(numbers)
    nuisance_covariance[1:, 1:] = before.scale
    return TrackState(
        last=look,
        visible=UNKNOWN,
        velocity=None,
        velocity_P=np.zeros((8, 8)),
        P=np.eye(8) * 0.05**2,
        moved=(0.0, 0.0),
        presence=1.0 - 1e-6,
        steps=1.0,
        shutter=Shutter(target.A, levels[0].shape[0], numbers),
        nuisance=np.array([0.0, *before.theta]),
        nuisance_covariance=nuisance_covariance,
        plane=Plane(target, levels[0].shape[1], levels[0].shape[0], before),
        sides=numbers.sides,
        inner_spread=FIRST_SPREAD,
        edge_width=target.edge_width,
        blur_share=numbers.blur_share,
        located=look,
        blur=0.0,
        light=(1.0, 0.0),
        lost=0,
        time=None,
        interval=None,
        accepted=0,
        strange=0.0,
        elsewhere=0.0,
        confirmed=0.0,
        agility=1.0,
        moves=0,
        anchored=True,
        wander=1.0,
        wanders=0,
        unseen=0.0,
        slope=0.0,
        adrift=0.0,
        gone=False,
        exchanged=False,
        lookalike=False,
        beside=False,
        sighted=None,
        expected=target.A,
        usual=[np.zeros(n) for n in target.counts],
    )
