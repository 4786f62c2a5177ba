# SPDX-License-Identifier: Apache-2.0
"""All that changes from frame to frame, and nothing else does: what an image teaches, and what remains known without."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.decision import Decision, is_near, mean_point, outline_surprisal
from grasptrack.tracking.estimator import CONTINUOUS, NO_BEND, Hypothesis, PoseEstimate, estimate_pose
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.plane import Plane
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Floats

if TYPE_CHECKING:
    from grasptrack.tracking.hypotheses import Predictions


FAR = 500.0
"""Log of odds beyond which nothing changes."""


class Readout(NamedTuple):
    """Share of a usual interval between two images in which rows are read out, first to last, and the variance of that."""

    share: float
    variance: float


class Shutter:
    """How the object moves and moved when it was seen first, and what is known of the readout.

    Rows are exposed one after another, so that each place is seen at the time of its own row. To first order it lies beside
    where all would be seen at once by its speed times the time between its row and that of the object's middle, in the first
    view as in this one. Most of this a pose's error makes as well; the rest is what tells of the readout.

    Args:
        A: (3, 3) the pose in the first view.
        height: px of the image.
        numbers: the core's.

    Attributes:
        readout: as it is believed. Either all rows are exposed at once, or of a readout that there is the images told.
        shown: (3, 8) the bend of the last image in which the object was found.
    """

    def __init__(self, A: Floats, height: int, numbers: Numbers) -> None:
        self._height, self._numbers = height, numbers
        self._rigid, self.shown = A, NO_BEND
        self._velocity: Floats | None = None
        self._first: Floats | None = None
        self._information, self._views, self._sums = 0.0, 0, (0.0, 0.0, 0.0)
        self.readout = self._believed()

    def bend(self, target: Target, G: Floats, steps: float) -> Floats:
        """(3, 8) where places are seen beside the pose, for a readout of 1, as `kernels.PoseTarget.solve` takes it.

        The pose is the homography that carries the contacts exactly, up to four of them, and the outline as well as it can.

        Args:
            target: the object.
            G: (3, 3) the pose through which it is seen, roughly.
            steps: time since the last image in usual intervals.
        """
        velocity = self._speed(target, target.handle.moved(G, self.readout.share * self.shown[0]), steps)
        if velocity is None:
            return NO_BEND
        first = velocity if self._first is None else self._first
        if self._velocity is not None:  # between two images it is that in the middle of them, and goes on changing
            velocity = velocity + (velocity - self._velocity) * (steps / (steps + 1.0))
        bend = np.outer(self._rows(target, G), velocity) - np.outer(self._rows(target, target.A), first)
        bend[0] = -(target.error_of_bend @ bend[1:].ravel())
        return bend

    def follow(self, target: Target, G: Floats, bend: Floats, steps: float) -> Floats:
        """Where the object was found: its pose (3, 3), and the bend (3, 8) of that.

        Returns:
            (3, 3) the pose in which it would be seen if all rows were exposed at once.
        """
        rigid = np.asarray(target.handle.moved(G, self.readout.share * bend[0]), dtype=np.float64)
        self._velocity = self._speed(target, rigid, steps)
        self._rigid, self.shown = rigid, bend
        if self._first is None:
            self._first = self._velocity
        return rigid

    def lose(self) -> None:
        """It was not found: how it moves is not known."""
        self._rigid, self._velocity, self.shown = np.full((3, 3), math.nan), None, NO_BEND
        if self._first is None:
            self._first = np.zeros(8)

    def learn(self, share: float, variance: float, new: float) -> None:
        """What an image tells of the readout, of which the share `new` (0 to 1) is new: near views err alike.

        The mean is that of all images. What is known of it is the better of what was known and what is told, and of the other
        one that which is new; and all the less, the more the images contradict each other.
        """
        if not (variance > 0.0 and math.isfinite(variance) and math.isfinite(share)):
            return
        known, told = self._information, 1.0 / variance
        self._information = known + told - (1.0 - new) * min(known, told)
        self._views += 1
        weight, first, second = self._sums
        self._sums = weight + told, first + told * share, second + told * share**2
        self.readout = self._believed()

    def _believed(self) -> Readout:
        prior, rolling = self._numbers.readout_sd**2, self._numbers.rolling
        if not self._views:
            return Readout(0.0, rolling * prior)
        weight, first, second = self._sums
        told = first / weight
        uneven = max(1.0, (second - weight * told**2) / self._views)
        information = self._information / uneven
        variance = 1.0 / (information + 1.0 / prior)
        mean = variance * information * told
        odds = 0.5 * (mean**2 / variance + math.log(variance / prior)) + math.log(rolling / (1.0 - rolling))
        some = 1.0 / (1.0 + math.exp(min(-odds, FAR)))
        return Readout(some * mean, some * (variance + mean**2) - (some * mean) ** 2)

    def _speed(self, target: Target, rigid: Floats, steps: float) -> Floats | None:
        """(8,) the pose's change in a usual interval; None where it is not known."""
        velocity: Floats = target.handle.difference(self._rigid, rigid) / max(steps, 1e-3)
        return velocity if math.isfinite(float(velocity @ velocity)) else None

    def _rows(self, target: Target, G: Floats) -> tuple[float, float, float]:
        """0, and the share of the image's rows by which places lie lower, at the middle, half a size to the right, and down."""
        _, (a, b, c), (d, e, f) = G.tolist()
        x, y = target.centre.tolist()
        w = d * x + e * y + f
        row, unit = (a * x + b * y + c) / w, 0.5 * target.size / self._height / w
        return 0.0, (a - row * d) * unit, (b - row * e) * unit


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

    def advance(self, time: float | None) -> float:
        """The next image was taken at a time in s: usual intervals since the last one, 1 where times are not told."""
        self.steps = 1.0
        if time is not None and self.time is not None and time > self.time:
            passed = time - self.time
            self.interval = passed if self.interval is None else min(self.interval, passed)
            self.time = time
            self.steps = passed / self.interval
        return self.steps

    def bend(self, target: Target, levels: list[Grey], G: Floats) -> Floats:
        """(3, 8) how a rolling shutter bends the object in the image of this pyramid, seen about a pose (3, 3)."""
        if levels is self.last.levels:  # it was found there
            return self.shutter.shown
        return self.shutter.bend(target, G, self.steps)

    def confirm(self, estimate: PoseEstimate, numbers: Numbers) -> None:
        """Other hypotheses led to the same answer."""
        self.confirmed = outline_surprisal(estimate, numbers)

    def sight(self, G: Floats | None) -> None:
        """What may be the object, but is not believed to be it, was seen at a pose (3, 3), or nowhere."""
        self.sighted = G

    def note_gone(self, *, gone: bool) -> None:
        """Whether its place is seen without it."""
        self.gone = gone

    def note_lookalike(self, *, anywhere: bool = False) -> None:
        """An image shows the object where it was, and something just like it elsewhere, or anywhere in the first image."""
        if self.lost or anywhere:  # which of them came to its place, nobody saw
            self.lookalike = True
        else:
            self.beside = True

    def learn(
        self,
        target: Target,
        levels: list[Grey],
        decision: Decision,
        estimate: PoseEstimate,
        predictions: Predictions,
    ) -> None:
        """What an image teaches in which the object was located; all of it only if it was accepted.

        Args:
            target: the object.
            levels: the image's pyramid.
            decision, estimate: what was found in it.
            predictions: where it was expected.
        """
        numbers, e, steps = target.numbers, estimate, self.steps
        way = float(np.linalg.norm(target.handle.difference(self.last.G, e.G)))
        new = min(1.0, way / (numbers.new_view * target.size)) if math.isfinite(way) else 1.0
        self._learn_motion(target, e, predictions)
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
        self, target: Target, levels: list[Grey], decision: Decision, predictions: Predictions, *, lookalike: bool
    ) -> None:
        """What remains known of an object that was not located.

        Args:
            target, levels, decision, predictions: as for `learn`.
            lookalike: the last look at it shows something just like it elsewhere.
        """
        self.lookalike = self.lookalike or lookalike
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
            passed = 0.0 if at_place else max(1.0, self.steps)
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

    def _learn_motion(self, target: Target, estimate: PoseEstimate, predictions: Predictions) -> None:
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
        velocity = target.handle.difference(self.last.G, estimate.G) / max(self.steps, 1e-3)
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


def first_state(
    target: Target, levels: list[Grey], numbers: Numbers, before: Beforehand | None = None, time: float | None = None
) -> TrackState:
    """The state in the first image, where the pose is known by definition.

    Each patch of the surface is expected to look alike as far as noise allows.

    Args:
        target: the object.
        levels: pyramid of the first image.
        numbers: the core's.
        before: what is known of camera and tilt, as for `Plane`.
        time: s, of the image.
    """
    nuisance_covariance = np.diag([(numbers.thickness_sd * target.size) ** 2, 0.0, 0.0, 0.0])
    look, before = Look(levels, target.A), before or Beforehand.usual(numbers)
    nuisance_covariance[1:, 1:] = before.scale
    state = TrackState(
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
        time=time,
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
    own = estimate_pose(target, state, levels, Hypothesis("first", target.A, state.P))
    if own is not None:
        # V / (V + grain) is what a patch of variance V has with itself, (V - grain) / (V + grain) with another look
        state.usual = [np.clip(2.0 * np.nan_to_num(r) - 1.0, 0.0, 1.0) for r in own.correlation]
    return state
