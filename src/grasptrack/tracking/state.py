# SPDX-License-Identifier: Apache-2.0
"""All that changes from frame to frame: where the object is, and what is known of its camera and surface."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.plane import Plane
from grasptrack.tracking.pose import FixedMarks, Look, sane_area
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Bools, Floats, Ints

NO_BEND: Floats = np.zeros((3, 8))
"""The bend of what does not move, or of what moves in an unknown way."""
MAX_LOG_ODDS = 500.0
"""Log of odds beyond which nothing changes."""
LEFT_IMAGES = 3
"""Images after which what went out of view is not on its way back, as what a hand shakes is."""
SHORTEST_STEP = 1e-3
"""Usual intervals between two images, at least, where something is divided by them."""


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
        self.readout = self._believed_readout()

    def bend_about(self, target: Target, G: Floats, steps: float) -> Floats:
        """(3, 8) where places are seen beside the pose, for a readout of 1, as `kernels.PoseTarget.solve` takes it.

        The pose is the homography that carries the contacts exactly, up to four of them, and the outline as well as it can.

        Args:
            target: the object.
            G: (3, 3) the pose through which it is seen, roughly.
            steps: time since the last image in usual intervals.
        """
        velocity = self._pose_change(target, target.handle.moved(G, self.readout.share * self.shown[0]), steps)
        if velocity is None:
            return NO_BEND
        first = velocity if self._first is None else self._first
        if self._velocity is not None:  # between two images it is that in the middle of them, and goes on changing
            velocity = velocity + (velocity - self._velocity) * (steps / (steps + 1.0))
        bend = np.outer(self._row_shares(target, G), velocity) - np.outer(self._row_shares(target, target.A), first)
        bend[0] = -(target.error_of_bend @ bend[1:].ravel())
        return bend

    def follow_pose(self, target: Target, G: Floats, bend: Floats, steps: float) -> Floats:
        """Where the object was found: its pose (3, 3), and the bend (3, 8) of that.

        Returns:
            (3, 3) the pose in which it would be seen if all rows were exposed at once.
        """
        rigid = np.asarray(target.handle.moved(G, self.readout.share * bend[0]), dtype=np.float64)
        self._velocity = self._pose_change(target, rigid, steps)
        self._rigid, self.shown = rigid, bend
        if self._first is None:
            self._first = self._velocity
        return rigid

    def forget_motion(self) -> None:
        """It was not found: how it moves is not known."""
        self._rigid, self._velocity, self.shown = np.full((3, 3), math.nan), None, NO_BEND
        if self._first is None:
            self._first = np.zeros(8)

    def learn_readout(self, share: float, variance: float, new: float) -> None:
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
        self.readout = self._believed_readout()

    def _believed_readout(self) -> Readout:
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
        some = 1.0 / (1.0 + math.exp(min(-odds, MAX_LOG_ODDS)))
        return Readout(some * mean, some * (variance + mean**2) - (some * mean) ** 2)

    def _pose_change(self, target: Target, rigid: Floats, steps: float) -> Floats | None:
        """(8,) the pose's change in a usual interval; None where it is not known."""
        velocity: Floats = target.handle.difference(self._rigid, rigid) / max(steps, SHORTEST_STEP)
        return velocity if math.isfinite(float(velocity @ velocity)) else None

    def _row_shares(self, target: Target, G: Floats) -> tuple[float, float, float]:
        """0, and the share of the image's rows by which places lie lower, at the middle, half a size to the right, and down."""
        _, (a, b, c), (d, e, f) = G.tolist()
        x, y = target.centre.tolist()
        w = d * x + e * y + f
        row, unit = (a * x + b * y + c) / w, 0.5 * target.size / self._height / w
        return 0.0, (a - row * d) * unit, (b - row * e) * unit


STALE_PRIOR, FLOW_PRIOR = 10.0, 2.0
"""Grey levels^2 that count for new before the first image, and freedoms that count for as far off as is told."""
WAYS_PRIOR = 2.0
"""Images that count for as far as an unseen object goes, before the first that show how far it goes."""
MEMORY_SHARE = 0.9
"""Share of a sum over images that is left an image later."""
FRAME_S = 1.0 / 30.0
"""s between images whose times are not told."""


@dataclass
class ContactSightings:
    """When each contact was last seen itself, by the outline under the finger or the surface beside it.

    Attributes:
        places: (k, 2) px where it was then.
        since_s: (k,) s that have passed since.
        images: (k,) images that have come since.
        first: (k, 2) px where it was in the first view.
        open: (k,) no view in which it had moved has shown it yet.
        doubt: probability that the first outline is another object's; 0 where a person gave the contacts.
        look: the last one that showed all of them; shown: (n,) how much of each sample of the outline, empty before any did.
        bare: log-odds that since then an image showed bare ground where a contact's part was, against a cover.
    """

    places: Floats
    since_s: Floats
    images: Ints
    first: Floats
    open: Bools
    look: Look
    shown: Floats
    doubt: float = 0.0
    bare: float = -math.inf

    def add(
        self, contacts: Floats, testified: Floats, look: Look, visible: Floats, seconds: float, numbers: Numbers
    ) -> None:
        """An answer, `seconds` after the last image, in which each contact (k, 2) px was seen by a share (k,)."""
        self.pass_image(seconds)
        own = testified >= SEEN
        if own.all():
            self.look, self.shown, self.bare = look, visible, -math.inf
        self.places[own], self.since_s[own], self.images[own] = contacts[own], 0.0, 0
        self.open &= ~(own & self.have_moved(contacts, numbers))

    def pass_image(self, seconds: float) -> None:
        """An image, `seconds` after the last one, that shows none of them for certain."""
        self.since_s += seconds
        self.images += 1

    def have_moved(self, contacts: Floats, numbers: Numbers) -> Bools:
        """(k,) which contacts (k, 2) px have left their places of the first view: what stands there has not."""
        return np.asarray(np.hypot(*(contacts - self.first).T) >= numbers.unseen_px, dtype=np.bool_)

    def are_stale(self, contacts: Floats, numbers: Numbers) -> bool:
        """Whether a contact has moved unseen for long: that it still moves with the rest is a guess."""
        moved = np.hypot(*(contacts - self.places).T) >= numbers.unseen_px
        return bool((moved & (self.since_s >= numbers.unseen_s)).any())


@dataclass
class FadingRatio:
    """One sum over images by another, in which late images count most.

    Attributes:
        above, below: the sums, of which the first view's part does not fade.
    """

    above: float
    below: float

    def __post_init__(self) -> None:
        self._first = self.above, self.below

    def add(self, above: float, below: float) -> None:
        """What the last image adds to both."""
        if math.isfinite(above) and below >= 0.0:
            (a, b), kept = self._first, MEMORY_SHARE
            self.above, self.below = a + kept * (self.above - a) + above, b + kept * (self.below - b) + below

    @property
    def value(self) -> float:
        """Of late."""
        return self.above / self.below


SURE_SD = 2.0
"""Standard deviations by which an object is thinner than it seems, at most."""
SEEN = 0.5
"""Share of the outline under a finger, or of the surface beside it, from which on a contact is seen."""
FIRST_SPREAD = 12.0
"""Grey levels, the inner spread before an image has told it."""


def nothing_visible() -> Floats:
    """What is known of the samples' visibility where nothing is."""
    return np.empty(0)


class Coasting(NamedTuple):
    """Where a lost object was when it was seen last, and how it moved.

    Attributes:
        G: (3, 3) its pose then.
        velocity: (8,) the pose's change in a usual interval.
        steps: usual intervals from then to the last image.
    """

    G: Floats
    velocity: Floats
    steps: float = 0.0


@dataclass
class TrackState:
    """Where the object is, what is known of camera and part, and how sure that is.

    `hypotheses.predict_hypotheses` looks ahead with it; `learning` changes it by what an image taught.

    Attributes:
        target: the object.
        last: the last image, with the best pose found in it; located: the last one in which the object was located.
        expected: (3, 3) where it was located, carried by the background since then.
        P: (8, 8) covariance of the pose's error, work px^2 at the half size.
        shutter: what is known of the readout.
        nuisance, nuisance_covariance: (4,), (4, 4) what is not known of part and camera: the part's thickness in work px, log
            of the focal length over the image's width, slopes of the first view's normal; these three as `plane` has them.
        plane: the object's own, as the views so far let it be known.
        sides: probability that a thick part's sides are seen as the object, so that its outline is the lower face's.
        edge_width: work px, standard deviation of an edge at rest: how far the image is out of focus.
        blur_share: half of an edge's blur, of what moved across it since the last image: how long the shutter is open.
        sharp: log-odds that it is open but for a moment instead.
        usual: of each patch of the three finest levels: its correlation of late.
        unasked: of each of them whether it may be no patch of the object but fixed in the image: see `fixed_patches`.
        time, interval: s, of the last image; a usual time between images.
        visible: (N,) probability of each sample of the outline to be visible in the last image; empty where that is not known.
        belt: (2,) px/s, how the belt on which it lies moves in the first view, where that is told; None otherwise.
        velocity: (8,) the pose's change in a usual interval, work px at the half size; None where it is not known.
        velocity_P: (8, 8) covariance of its error.
        moved: work px that a contact moved in a usual interval, root mean square, in the last image and in the one before: a
            jump is no speed; 0 where that is not known.
        presence: probability that the object is there.
        sightings: of the contacts.
        stale: work px^2, how far patches lag that lag together, as far as a video's encoder leaves them as they were.
        flow_misfit: squared distances of the surface's motion from what outline and first view then say, by their expectation.
        resting: (3, 3) where the first image's ground has what lay on it there, as it was found last; None where it was not.
        shown: (N,) 0 to 1: how much of each sample of the outline accepted images showed on average, once it had moved there.
        shown_in: (N,) so many of them.
        steps: time from the last image but one to the last, or to the one that is looked at, in usual intervals.
        passed_s, usual_s: the same in s, and what was usual of late; None before the object moved.
        inner_spread: grey levels, see `Numbers.other_spread`.
        blur: work px, half of what blurred most edges of late.
        light: gain and bias of the surface there, from the first view on.
        lost: images since it was located; accepted: images in which it was.
        strange: usual strangeness of the outline: edges that no light shows, or not where the first view had them.
        surfaces: log odds of its surface in the last two accepted images, the latest first.
        agreeing: share of the surface's patches that agreed, on average of all accepted images.
        elsewhere: share of the outline whose edge lies elsewhere although a second solution was tried.
        confirmed: strangeness of the last image, if other hypotheses led to the same answer there.
        agility: mean square by which even motion was off of late, in process noise; moves: how often that was measured.
        anchored: the background carried it ever since, so that the last look is where it is expected.
        ways: squares of how far it went in the image, a frame, as `decision.squared_way` measures them.
        strays: the same of how far it was from where even motion had it.
        coasting: how it would go on moving, once it is lost; None where its motion was not known.
        marks: what is fixed in the image and was taken for its surface, until it is seen elsewhere; None otherwise.
        wander: how far it left its place on the background of late, a frame, in `Numbers.travel`; wanders: how often that was
            measured.
        unseen: how far it may have gone since it was located, likewise.
        slope: sd of the change of depth over half the object, as a share, when it was located.
        adrift: frames since the background last told how far the camera is, or the object itself.
        gone: since it was located its place was seen without it.
        leaving: the border cut its place when it was lost; left: images in a row since that lies out of view.
        exchanged: probability that something else lies in its place, by the last image of a loss that showed what does.
        lookalike: something just like it was seen elsewhere; beside: the same, while it was seen in its place itself.
        equals: (n, 2) work px from the object's middle to those of what is just like it in the first view.
        alias: probability that one of them has been followed since.
        slip: log-odds that its surface moves by itself, as a reflection does.
        fast: (k, 2) px, the contacts when it was last seen that it does not.
        sighted: (3, 3) where something like it was seen in the last image, but not believed to be it; None where nothing was.
    """

    target: Target
    last: Look
    located: Look
    expected: Floats
    P: Floats
    shutter: Shutter
    nuisance: Floats
    nuisance_covariance: Floats
    plane: Plane
    sightings: ContactSightings
    sides: float
    slip: float
    fast: Floats
    edge_width: float
    blur_share: float
    usual: list[Floats]
    unasked: list[Bools]
    time: float | None
    sharp: float = 0.0
    belt: Floats | None = None
    interval: float | None = None
    stale: FadingRatio = field(default_factory=lambda: FadingRatio(0.0, STALE_PRIOR))
    flow_misfit: FadingRatio = field(default_factory=lambda: FadingRatio(FLOW_PRIOR, FLOW_PRIOR))
    shown: Floats = field(default_factory=nothing_visible)
    shown_in: Floats = field(default_factory=nothing_visible)
    visible: Floats = field(default_factory=nothing_visible)
    velocity: Floats | None = None
    velocity_P: Floats = field(default_factory=lambda: np.zeros((8, 8)))
    moved: tuple[float, float] = (0.0, 0.0)
    presence: float = 1.0 - 1e-6
    steps: float = 1.0
    passed_s: float = FRAME_S
    usual_s: float | None = None
    inner_spread: float = FIRST_SPREAD
    blur: float = 0.0
    light: tuple[float, float] = (1.0, 0.0)
    lost: int = 0
    accepted: int = 0
    strange: float = 0.0
    surfaces: tuple[float, float] = (0.0, 0.0)
    agreeing: float = 1.0
    elsewhere: float = 0.0
    confirmed: float = 0.0
    agility: float = 1.0
    moves: int = 0
    strays: FadingRatio = field(default_factory=lambda: FadingRatio(WAYS_PRIOR, WAYS_PRIOR))
    coasting: Coasting | None = None
    marks: FixedMarks | None = None
    resting: Floats | None = None
    anchored: bool = True
    ways: FadingRatio = field(default_factory=lambda: FadingRatio(WAYS_PRIOR, WAYS_PRIOR))
    wander: float = 1.0
    wanders: int = 0
    unseen: float = 0.0
    slope: float = 0.0
    adrift: float = 0.0
    gone: bool = False
    leaving: bool = False
    left: int = 0
    exchanged: float = 0.0
    lookalike: bool = False
    beside: bool = False
    equals: Floats = field(default_factory=lambda: np.empty((0, 2)))
    alias: float = 0.0
    sighted: Floats | None = None

    @property
    def numbers(self) -> Numbers:
        """The core's."""
        return self.target.numbers

    @property
    def delay(self) -> float:
        """How much longer than usual nothing was seen, 1 at least: jitter of the time stamps is no delay."""
        return 1.0 if self.usual_s is None else max(1.0, self.passed_s / self.usual_s)

    @property
    def pace(self) -> float:
        """How far it goes in the image in a usual interval, in what an unseen object goes in a frame, which is the least."""
        return math.sqrt(max(1.0, self.ways.value))

    def coasted(self) -> Floats | None:
        """(3, 3) where a lost object would be in the next image, had it moved on evenly; None where that is not known.

        None beyond the border too: what left the image comes back otherwise.
        """
        return None if self.left else self.moved_on()

    def moved_on(self) -> Floats | None:
        """(3, 3) the same, beyond the border too."""
        if self.coasting is None:
            return None
        G, velocity, steps = self.coasting
        moved = np.asarray(self.target.handle.moved(G, velocity * (steps + self.steps)), dtype=np.float64)
        return moved if sane_area(self.target, moved) else None

    def carried_by_belt(self) -> Floats | None:
        """(3, 3) the same where a person has told how its belt moves, so that it did."""
        return None if self.belt is None or not self.lost else self.coasted()

    @property
    def strayed(self) -> float:
        """How far it may have left that in the next image, in what an unseen object goes in a frame."""
        since = 0.0 if self.coasting is None else self.coasting.steps
        return (since + max(1.0, self.steps)) * math.sqrt(self.strays.value)

    @property
    def has_left(self) -> bool:
        """Whether it went out over the border of the image, and did not come back at once."""
        return self.leaving and self.left >= LEFT_IMAGES

    @property
    def is_outside(self) -> bool:
        """Whether it has left, and motion or ground say that it is still beyond the border."""
        return self.has_left and (self.anchored or self.coasting is not None)

    @property
    def drifted(self) -> float:
        """Variance by which motion that changes as `Numbers.drift` is off since the last image, as a share of the area."""
        n = self.delay
        return self.numbers.drift**2 * n * (n + 1) * (2 * n + 1) / 6

    @property
    def surface_lag(self) -> Floats:
        """(8,) variances of the pose's error that the surface's patches share."""
        share = self.stale.value / (self.numbers.drift * self.target.size) ** 2
        return np.asarray(np.diagonal(self.target.noise_of_motion) * share, dtype=np.float64)

    @property
    def thickness(self) -> float:
        """Of the object, as a share of sqrt(area)."""
        return float(self.nuisance[0]) / self.target.size

    def shows_sides(self, tilt: float) -> bool:
        """Whether a lower edge is surely off by more than a contact may be, in a view that is tilted by so many rad."""
        sd = math.sqrt(self.nuisance_covariance[0, 0]) / self.target.size
        return (self.thickness - SURE_SD * sd) * math.sin(tilt) > self.numbers.tolerance

    def advance(self, time: float | None) -> None:
        """The next image was taken at a time in s: `steps` usual intervals after the last one, 1 where times are not told."""
        self.steps, self.passed_s = 1.0, FRAME_S
        if time is not None and self.time is not None and time > self.time:
            passed = time - self.time
            self.interval = passed if self.interval is None else min(self.interval, passed)
            self.time = time
            self.steps, self.passed_s = passed / self.interval, passed
        if self.belt is not None and not self.lost:
            self.velocity = self._velocity_of_belt(self.belt)

    def _velocity_of_belt(self, belt: Floats) -> Floats | None:
        """(8,) the velocity of what goes with a belt (2,) px/s, in the plane in which that moves."""
        moved = np.eye(3)
        moved[:2, 2] = belt * self.passed_s
        moved = self.target.pose(self.target.homography(self.last.G) @ moved)
        velocity: Floats = self.target.pose_difference(self.last.G, moved) / max(self.steps, SHORTEST_STEP)
        return velocity if math.isfinite(float(velocity @ velocity)) else None

    def shutter_bend(self, levels: list[Grey], G: Floats) -> Floats:
        """(3, 8) how a rolling shutter bends the object in the image of this pyramid, seen about a pose (3, 3)."""
        if levels is self.last.levels:  # it was found there
            return self.shutter.shown
        return self.shutter.bend_about(self.target, G, self.steps)

    def learn_shutter(self, gain: float) -> None:
        """Log-odds of images that the shutter is open but for a moment add up, as far as it may change between two of them."""
        most = -math.log(self.numbers.hazard)
        self.sharp = min(max(self.sharp + gain, -most), most)

    def note_lookalike(self) -> None:
        """An image shows the object where it was, and something just like it elsewhere."""
        if self.lost:  # which of them came to its place, nobody saw
            self.lookalike = True
        else:
            self.beside = True
