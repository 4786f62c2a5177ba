# SPDX-License-Identifier: Apache-2.0
"""Whether what fits the outline is the object: what may have happened to it since it was last believed.

An outline tells nothing from its equals: an identical part beside the object, or the object itself turned by one of its
own symmetries. Only continuity does, and continuity ends where the object was out of sight.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import ConditioningError
from grasptrack.motion import Motion, wrapped
from grasptrack.observation.images import Grey
from grasptrack.projective import HORIZON, apply_homography, jacobian
from grasptrack.reference import Reference
from grasptrack.transfer.alignment import NEARER

Floats = NDArray[np.float64]

STEP = 0.5
"""The object is within this fraction of sqrt(area) of where it is expected, ..."""
STEP_PX = 60.0
"""... or so many px, or else it has jumped."""
GROWTH = 1.25
"""A step in size that separates the object from an equal of another scale."""
SWELL = 1.05
"""What it may have grown, or shrunk, more in every frame without it, ..."""
KNOWN = 8
"""... of which there are so many at most until its size, and its tilt, are no longer known."""
WANDERED = 0.2
"""Share of sqrt(area) from which on an object that moves may have left its place to an equal while it was not seen, ..."""
SURELY, ON_ITS_WAY = 2, 0.25
"""... but for so many frames in which it went on as before, within this share of the way."""
BEND = 1.12
"""A step in tilt: ratio of the two magnifications relative to what is expected. A cover's edge can stand in for a side."""
EMPTY = 0.5
"""Of the object's place, at least so much shows the ground when it has gone, or its own grey when it is still there."""
REST = 0.1
"""Of its place, at most so much shows its own grey when it has gone."""
IN_VIEW = 0.3
"""Where less of its place than this is in the image, the object may be out of view."""
LEVEL = 0.35
"""A grey level is the ground's or the object's within this share of the contrast between them."""
FAINT = 10.0
"""Grey levels by which what is not the ground differs from it; a place of an object of several colours that does not
tells nothing."""
GRAIN = 4.0
"""The ground itself differs by so many times its own spread at most."""


class Whereabouts:
    """Decides whether a believable pose may be the object's.

    Args:
        reference: the reference view.
        equals: another object with this outline was seen.

    Attributes:
        motion: where it is expected.
        gone: its place was seen without it, or left the image.
        telling: its surface would tell which way round it lies.
    """

    def __init__(self, reference: Reference, equals: bool) -> None:
        self._reference = reference
        self.motion = Motion(reference.centre)
        self.equals = equals
        self.gone = False
        self.telling = False

    @property
    def hopeless(self) -> str:
        """Why nothing found in this image could be believed to be the object; empty as long as something could."""
        if self.gone and math.isfinite(self._reference.symmetry) and not self.telling:
            return "the object was out of sight, and which way round its symmetric outline lies is ambiguous"
        if self.gone and self.equals:
            return "the object was out of sight, and another one with its outline was seen: ambiguous"
        return ""

    @property
    def area(self) -> float:
        """px^2 that the object is expected to fill in the image."""
        return self._reference.size**2 * _growth(self.motion.predict(), self._reference.centre)

    def again(self, H: Floats) -> bool:
        """Whether a pose (3, 3) has to be recognised anew, not just followed."""
        return self.motion.missed > 0 or not self._is_step(H)

    def stayed(self, H: Floats) -> bool:
        """Whether a pose (3, 3) is where the object was last, and nothing says that it has been elsewhere."""
        return self._is_step(H) and not self.gone and self.motion.remembered

    def nearest(self, ways: list[Floats]) -> Floats | None:
        """Of poses (3, 3) that fit alike the one that is meant, because it is a step and clearly the nearest to the expected
        one; None when the object may be elsewhere."""
        if self.gone or not self.motion.remembered:
            return None
        expected = self.motion.predict()
        try:
            there = apply_homography(expected, self._reference.interior.places)
            moved = [np.hypot(*(apply_homography(H, self._reference.interior.places) - there).T).max() for H in ways]
        except ConditioningError:
            return None
        order = sorted(range(len(ways)), key=moved.__getitem__)
        first = ways[order[0]]
        if len(ways) > 1 and moved[order[0]] > NEARER * moved[order[1]]:
            return None
        return first if self._is_step(first) and _bend(first, expected, self._reference.centre) <= BEND else None

    def doubt(self, H: Floats, grey: Grey, levels: tuple[float, float], settled: Callable[[], bool]) -> str:
        """Why a pose (3, 3) that the image bears out may be another object's, or a turned one; empty if it is not.

        Args:
            H: H_current_reference.
            grey: (H, W).
            levels: grey levels of the object and of the ground.
            settled: whether something besides the outline tells which way round the object lies.
        """
        if self.hopeless:
            return self.hopeless
        motion, symmetry = self.motion, self._reference.symmetry
        step, shift = self._is_step(H), self._shift(H)
        expected = motion.predict()
        turn = abs(wrapped(motion.angle(H) - motion.angle(expected)))
        may_turn = motion.turn if not self.gone and (step or shift[1] <= STEP_PX) else math.pi
        if max(may_turn, turn) >= 0.5 * symmetry and not settled():
            return "the outline is symmetric, and the object may have turned round since it was last seen: ambiguous"
        if step:
            forgotten = motion.missed >= KNOWN and self._place(grey, expected, levels, besides=H) == "empty"
            if _bend(H, expected, self._reference.centre) > BEND and not forgotten:
                return "the outline is tilted by more than it can have been since the last image"
            if self.equals and self._wandered(H):  # whatever the ground shows: a row of equals looks alike all round
                return "it moved, and another object with its outline may have come to its place unseen: ambiguous"
            return ""
        if self.equals:
            return "another object with this outline was seen: ambiguous"
        most = GROWTH * SWELL**motion.missed
        if motion.missed < KNOWN and not 1.0 / most < self._grown(H) < most:
            self.equals |= motion.missed <= 1  # both were in view a moment ago
            return "another object has this outline in another size; the one tracked cannot have changed so much"
        if motion.remembered:
            place, far = self._place(grey, expected, levels, besides=H), shift[1] > STEP_PX
            # it cannot leave and be back at once
            if far and (place == "there" or (place == "outside" and motion.missed == 0)):
                self.equals = True
                return "another object has this outline; the one tracked is still where it was, or just out of view"
            if place in ("covered", "there"):
                return (
                    "an object with this outline was found elsewhere, but the one tracked may be covered where it was"
                )
        return ""

    def found(self, H: Floats) -> None:
        """The pose (3, 3) was believed."""
        self.motion.found(H)
        self.gone = False

    def lost(self, grey: Grey, nearby: bool, levels: tuple[float, float]) -> None:
        """Nothing was believed in this image.

        Args:
            grey: (H, W).
            nearby: something of the object's grey and size lies about where it was.
            levels: grey levels of the object and of the ground.
        """
        if not nearby and self._place(grey, self.motion.predict(), levels) in ("empty", "outside"):
            self.gone = True
        self.motion.lost()

    def on_its_way(self, H: Floats) -> list[Floats]:
        """(3, 3) each, where the object may be as well as at a pose, when it was not seen for a while: where it was last, and
        where it would be had it gone on. If something like it stands there, nobody knows which is meant."""
        if self.equals or not self._far():
            return []
        last, way, centre = self.motion.last, self.motion.drift, self._reference.centre
        further = np.array([[1.0, 0.0, way[0]], [0.0, 1.0, way[1]], [0.0, 0.0, 1.0]]) @ last
        return [other for other in (last, further) if _apart(other, H, centre) > 0.5 * math.hypot(*way)]

    def _far(self) -> bool:
        """Whether the object, at the speed at which it was lost, may have left its place since."""
        size = self._reference.size * math.sqrt(_growth(self.motion.last, self._reference.centre))
        return self.motion.missed > 0 and math.hypot(*self.motion.drift) > WANDERED * size

    def _wandered(self, H: Floats) -> bool:
        """Whether the object may have gone so far that a pose (3, 3) may be an equal's."""
        motion, centre = self.motion, self._reference.centre
        way = motion.drift
        far = math.hypot(*way)
        if not self._far():
            return False
        (x, y), (u, v) = _carried(H, centre), _carried(motion.last, centre)
        return motion.missed > SURELY or math.hypot(x - u - way[0], y - v - way[1]) > ON_ITS_WAY * far

    def _shift(self, H: Floats) -> tuple[float, float]:
        """Of the centre relative to the expected one: in sqrt(area), and in px."""
        expected, centre = self.motion.predict(), self._reference.centre
        (x, y), (u, v) = _carried(H, centre), _carried(expected, centre)
        px = math.hypot(x - u, y - v)
        return px / (self._reference.size * math.sqrt(_growth(expected, centre))), px

    def _is_step(self, H: Floats) -> bool:
        """Whether a pose is so near to the expected one that nothing else can be meant."""
        return self._shift(H)[0] <= STEP and 1.0 / GROWTH < self._grown(H) < GROWTH

    def _grown(self, H: Floats) -> float:
        """How much larger the object appears than it was expected to, or than it was: what grew may stop growing."""
        now = _growth(H, self._reference.centre)
        grown = [math.sqrt(now / _growth(H, self._reference.centre)) for H in (self.motion.predict(), self.motion.last)]
        return min(grown, key=lambda ratio: abs(math.log(ratio)))

    def _place(self, grey: Grey, H: Floats, levels: tuple[float, float], besides: Floats | None = None) -> str:
        """What is seen where the object should lie: "there", "empty", "covered" or "outside".

        Args:
            grey: (H, W).
            H: (3, 3) where it should lie.
            levels: grey levels of the object and of the ground.
            besides: (3, 3) where it was found instead; what it covers there says nothing.
        """
        own_levels, told = self._levels(levels)
        try:
            points = apply_homography(H, self._reference.interior.places)
            if besides is not None:
                back = apply_homography(np.linalg.inv(besides), points)
                left = ~self._reference.interior.covers(back)
                points, own_levels, told = points[left], own_levels[left], told[left]
        except ConditioningError:
            return "outside"
        if len(points) < IN_VIEW * len(self._reference.interior.places):
            return "empty"
        points = np.rint(points).astype(np.intp)
        inside = ((points >= 0) & (points < (grey.shape[1], grey.shape[0]))).all(axis=1)
        if inside.mean() < IN_VIEW:
            return "outside"
        inside &= told
        if not inside.any():
            return "covered"  # or not: as grey as the ground, it cannot be told from it
        values = grey[points[inside, 1], points[inside, 0]].astype(np.float64)
        depth = (values - own_levels[inside]) / (levels[1] - own_levels[inside])
        bare = np.abs(depth - 1.0) <= LEVEL
        # a cover may be nearly as grey as the ground, but has not its very level
        bare &= np.abs(values - levels[1]) <= max(FAINT, GRAIN * self._reference.samples.grain)
        own, ground = float((np.abs(depth) <= LEVEL).mean()), float(bare.mean())
        if own >= EMPTY:
            return "there"
        return "empty" if ground >= EMPTY and own <= REST else "covered"

    def _levels(self, levels: tuple[float, float]) -> tuple[Floats, NDArray[np.bool_]]:
        """(m,) grey levels of the object to expect at the places of its interior, and where they differ from the ground.

        An object of several colours has each where the reference showed it, as much lighter as the ground is now.
        """
        samples, interior = self._reference.samples, self._reference.interior
        if samples.polarity:
            return np.full(len(interior.places), levels[0]), np.full(len(interior.places), levels[0] != levels[1])
        own = interior.levels * (levels[1] / max(samples.ground, 1.0))
        return own, np.abs(own - levels[1]) >= FAINT


def _apart(H: Floats, other: Floats, centre: tuple[float, float]) -> float:
    """px between the places of a point under two poses (3, 3)."""
    (x, y), (u, v) = _carried(H, centre), _carried(other, centre)
    return math.hypot(x - u, y - v)


def _growth(H: Floats, centre: tuple[float, float]) -> float:
    """How much a homography enlarges areas at a point."""
    a, b, c, d = jacobian(H, *centre)
    return max(a * d - b * c, 1e-12)


def _bend(H: Floats, expected: Floats, centre: tuple[float, float]) -> float:
    """Ratio of the two magnifications, at the centre, of what takes the expected view to the found one."""
    a, b, c, d = jacobian(expected, *centre)
    e, f, g, h = jacobian(H, *centre)
    determinant = a * d - b * c
    if determinant == 0.0:
        return math.inf
    # of the found one after the inverse of the expected one
    p, q, r, s = e * d - f * c, f * a - e * b, g * d - h * c, h * a - g * b
    mean, half = math.hypot(p + s, r - q), math.hypot(p - s, q + r)
    return (mean + half) / max(abs(mean - half), 2e-12 * abs(determinant))


def _carried(H: Floats, point: tuple[float, float]) -> tuple[float, float]:
    """Where a homography takes one point.

    Raises:
        ConditioningError: to infinity.
    """
    (a, b, c), (d, e, f), (g, h, i) = H.tolist()
    x, y = point
    w = g * x + h * y + i
    if not abs(w) > HORIZON:
        raise ConditioningError("the homography sends part of the object to infinity", homography=H.tolist())
    return (a * x + b * y + c) / w, (d * x + e * y + f) / w
