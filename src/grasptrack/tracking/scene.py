# SPDX-License-Identifier: Apache-2.0
"""Every instance of known parts through images: each followed as one object is, and no two in one place."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack import arguments
from grasptrack.equality import compared_by_value
from grasptrack.errors import ConditioningError, InputError, SourceError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, homography_jacobian
from grasptrack.grasp.contacts import Grasp
from grasptrack.images import PLAIN, Grey, to_bgr
from grasptrack.segmentation.candidate import best_color_projection
from grasptrack.tracking.answer import Moment, Track, first_result, judge_moved, make_closure_check
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.claims import LEAST_OVERLAP
from grasptrack.tracking.decision import SEEN_LIKE, any_of, place_prior
from grasptrack.tracking.evidence import MAX_EXPONENT
from grasptrack.tracking.follower import Follower, Sight
from grasptrack.tracking.instances import Instance, find
from grasptrack.tracking.joint import alias_probabilities
from grasptrack.tracking.numbers import DEFAULT_RISK, NUMBERS, check_risk
from grasptrack.tracking.parts import KnownPart, as_parts
from grasptrack.tracking.places import ImagePyramids, overlap_areas
from grasptrack.tracking.pose import CONTINUOUS, PoseEstimate, mean_point
from grasptrack.tracking.redetection import make_detector
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.state import FRAME_S
from grasptrack.tracking.strategies import Registration
from grasptrack.typing import Floats

ASLANT = 0.25
"""Share of a way by which ways differ that are one, on a plane seen aslant: those to other equals differ by all of it."""
GIVEN_UP_S = 10.0
"""s after which what is lost is not looked for any more: each that is lost takes as long as ten that are not."""
UNCLEAR = 0.3
"""Share of the risk from which on it is asked what the others did."""


@compared_by_value
@dataclass(frozen=True, slots=True)
class SceneResult:
    """What is told of one image of a scene. Two are equal where all but `latency_ms` is.

    Attributes:
        frame: index of the update, from 0.
        time: s, or None where the source has no times.
        results: of each instance that is followed, by its `instance_id`.
        entered: ids that are told for the first time.
        left: ids that went out over the image's border, or were not seen for 10 s, and are told for the last time.
        latency_ms: time that the update took.
    """

    frame: int
    time: float | None
    results: dict[int, TrackResult]
    entered: tuple[int, ...]
    left: tuple[int, ...]
    latency_ms: float = field(default=math.nan, compare=False)

    def __repr__(self) -> str:
        """One line: the frame, and how many instances are where."""
        located = sum(result.located for result in self.results.values())
        return f"SceneResult(frame {self.frame}: {located} of {len(self.results)} located)"

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        from grasptrack.presentation import to_dict

        return to_dict(self)


class SceneTracker:
    """Finds every instance of known parts in the first image, and follows each of them, by its first grasp, through the next.

    Equals that are all followed are no danger to each other: no two are given in one place, and what lies where another one
    surely lies is not looked for there. Where all of them may have gone one way or another, as on a belt that moves by more
    than half of its pitch, they are lost as "lookalike". Of a round part (`Instance.any_turn`) the contacts are those of one
    turn, and may go round with time.
    Covariances count how exactly each was found.

    Args:
        parts: one part or several of different names.
        instances: those of the first image that are to be followed, as `find` gives them; None finds them. Only those that
            are found are followed.
        risk: probability, between 0 and 1, below which an answer may be wrong.
        ignore: (H, W) nonzero where nothing belongs to the scene.
        belt: (x, y) px/s, how a belt that carries the parts moves in the first image, as for `GraspTracker`.
        look_every: s, by the images' times, after which `update` also does what `look` does, which takes seconds; None leaves
            that to the caller.

    Raises:
        InputError: no part, two of one name, an instance of none of them, a risk out of range, or seconds not above 0.
    """

    @arguments.checked(
        instances=arguments.optional(arguments.several),
        risk=arguments.number,
        ignore=arguments.optional(arguments.array(unbounded=True)),
        belt=arguments.optional(arguments.array(2)),
        look_every=arguments.optional(arguments.number),
    )
    def __init__(
        self,
        parts: KnownPart | Sequence[KnownPart],
        *,
        instances: Sequence[Instance] | None = None,
        risk: float = DEFAULT_RISK,
        ignore: NDArray[Any] | None = None,
        belt: ArrayLike | None = None,
        look_every: float | None = None,
    ) -> None:
        if look_every is not None and not 0.0 < look_every < math.inf:
            raise InputError(f"look_every must be a positive number of seconds, not {look_every:g}")
        self._every, self._looked_s, self._now_s = look_every, 0.0, 0.0
        self._parts = {part.name: part for part in as_parts(parts)}
        self.risk = check_risk(risk)
        self._given = None if instances is None else list(instances)
        for one in self._given or ():
            if not isinstance(one, Instance) or one.part not in self._parts:
                raise InputError(f"instances must be some of these parts, not {one!r}")
        self._ignore = ignore
        moved = None if belt is None else np.asarray(belt, dtype=np.float64)
        self._before = replace(Beforehand.of_unknown(NUMBERS), belt=moved)
        self._hidden: Grey | None = None
        self._followed: list[_Followed] = []
        self._image: ImagePyramids | None = None
        self._frame, self._count = -1, 0
        self._time: float | None = None

    @property
    def fingers(self) -> int:
        """Most contacts that a part's first grasp has."""
        return max(len(part.grasps[0]) for part in self._parts.values())

    @arguments.checked(image=arguments.array(unbounded=True), time=arguments.optional(arguments.finite))
    def update(self, image: NDArray[Any], time: float | None = None) -> SceneResult:
        """Look at the next image.

        Args:
            image: 8 or 16 bit, grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4).
            time: s, at which it was taken; None counts frames.

        Raises:
            SourceError: an image of another size than the first, or one that cannot be used.
        """
        started, colours, before = clock.perf_counter(), to_bgr(image), self._image
        if before is not None and before.colours.shape != colours.shape:
            raise SourceError("all images of a scene must have one size and kind", shape=colours.shape)
        self._frame, self._time, self._image = self._frame + 1, time, ImagePyramids(colours)
        self._now_s = self._frame * FRAME_S if time is None else time
        moment = Moment(self._frame, time, started, repeated=False, sure=True, probability=math.nan)
        if before is None:
            self._hidden = FirstImage.of(ignore=self._ignore).within(colours.shape).hidden
            parts, given = list(self._parts.values()), self._given
            self._begin(find(colours, parts, risk=self.risk, ignore=self._ignore) if given is None else given)
            results = [each.first_result(moment) for each in self._followed]
        else:
            results = self._follow(self._image, moment)
        told = {each.number: result for each, result in zip(self._followed, results, strict=True)}
        entered = tuple(each.number for each in self._followed if each.is_new)
        left = tuple(each.number for each in self._followed if each.has_left)
        for each in self._followed:
            each.is_new = False
        if before is None:
            self._looked_s = self._now_s
        if left:
            self._followed = [each for each in self._followed if each.number not in left]
            self._make_acquainted()
        if self._every is not None and self._now_s - self._looked_s >= self._every:
            self.look()
        return SceneResult(self._frame, time, told, entered, left, 1000 * (clock.perf_counter() - started))

    def look(self) -> list[Instance]:
        """Look in the last image for parts that are not followed, as those that have come into view, and follow them too.

        It takes as long as `find`. What was lost and is found so is a new instance: nobody saw which one it is.

        Returns:
            Those that are new; the next update tells of them.

        Raises:
            InputError: before the first update.
        """
        if self._image is None:
            raise InputError("look at an image first: call update")
        colours, self._looked_s = self._image.colours, self._now_s
        hidden = np.zeros(colours.shape[:2], np.uint8) if self._hidden is None else self._hidden.copy()
        for view in [each.view for each in self._followed if not each.follower.state.lost]:
            cv2.fillPoly(hidden, [np.rint(view.outer.points).astype(np.int32)], (255,))
        found = find(colours, list(self._parts.values()), risk=self.risk, ignore=hidden)
        return self._begin(found)

    def _begin(self, found: Sequence[Instance]) -> list[Instance]:
        """Follow what is found in the last image from there on."""
        assert self._image is not None
        taken = [Footprint(each.view) for each in self._followed if not each.follower.state.lost]
        new: list[Instance] = []
        for one in found:
            place = Footprint(one.view)
            if one.found and not any(place.is_shared(other) for other in taken):
                new.append(one)
                taken.append(place)
        for one in new:
            self._count += 1
            part = self._parts[one.part]
            self._followed.append(
                _Followed(self._count, one, part, self._image, (self._time, self.risk, self._hidden, self._before))
            )
        if new:
            self._make_acquainted()
        return new

    def _make_acquainted(self) -> None:
        for each in self._followed:
            others = [other for other in self._followed if other is not each and other.part.name == each.part.name]
            each.follower.follow_beside([other.follower.state for other in others], alone=self._count == 1)

    def _follow(self, image: ImagePyramids, moment: Moment) -> list[TrackResult]:
        """The results of a later image: of what was not lost before, then of what is looked for beside that."""
        told: dict[int, TrackResult] = {}
        lost = {each.number for each in self._followed if each.follower.state.lost}
        for late in (False, True):
            members = [each for each in self._followed if (each.number in lost) is late]
            sure = [Footprint(result.view) for result in told.values() if result.view is not None]
            sights = [each.look_at(image, moment.time, sure) for each in members]
            if not late:
                sights = _each_beside_others(members, sights)
            aliases = _shared_places(members, sights)
            if not late:
                aliases = _with_equals(members, sights, aliases)
                came = _newcomers(members, sights) if self._count > 1 else [0.0] * len(members)
                aliases = [any_of(*each) for each in zip(aliases, came, strict=True)]
            for each, sight, alias in zip(members, sights, aliases, strict=True):
                told[each.number] = each.conclude(moment, sight, alias)
        return [told[each.number] for each in self._followed]


class _Followed:
    """An instance that is followed from the image in which it was found.

    Args:
        number: its id.
        one, part: the instance and its part.
        image: in which it was found.
        asked: time of the image in s, the risk, (H, W) where nothing belongs to the scene, and what is known beforehand.
    """

    def __init__(
        self,
        number: int,
        one: Instance,
        part: KnownPart,
        image: ImagePyramids,
        asked: tuple[float | None, float, Grey | None, Beforehand],
    ) -> None:
        assert one.contacts is not None and one.covariance is not None
        self._found_with = one.covariance
        (time, risk, hidden, before), colours = asked, image.colours
        self.number, self.part, self._probability, self.is_new = number, part, one.confidence, True
        self._channel = PLAIN if colours.ndim == 2 else best_color_projection(colours, one.view.outer)
        grey = image.levels_in(self._channel)[0]
        self._grasp, self.view = Grasp(one.contacts), one.view
        observer, before = make_detector(grey, one.view, hidden), replace(before, any_turn=one.any_turn)
        self.follower = Follower(grey, one.view, one.contacts, time, observer, NUMBERS.with_risk(risk), before)
        self._carrier = Registration(self.follower)
        self._track = Track(1, make_closure_check(self._grasp, one.view, part.friction), self._carrier, self.follower)

    def first_result(self, moment: Moment) -> TrackResult:
        """Of the image in which it was found."""
        return self._named(first_result(self._at(moment), self._track, self._grasp, self.view))

    @property
    def has_left(self) -> bool:
        """Whether it is not followed any more."""
        state = self.follower.state
        return state.has_left or (bool(state.lost) and float(state.sightings.since_s.min()) > GIVEN_UP_S)

    def look_at(self, image: ImagePyramids, time: float | None, sure: Sequence[Footprint]) -> Sight:
        """What the next image shows of it where none of those lies that surely lie there."""
        is_taken = partial(self._lies_on, sure) if sure else None
        return self.follower.look_at(image.levels_in(self._channel), time, is_taken)

    def reconsider(self, sight: Sight, others: Sequence[Footprint], way: Floats | None) -> Sight:
        """What an image shows of it where none of the others lies; `way` as of `Follower.reconsider`."""
        return self.follower.reconsider(sight, partial(self._lies_on, others), way)

    def conclude(self, moment: Moment, sight: Sight, alias: float) -> TrackResult:
        """The result of an image; `alias` as of `Follower.conclude`."""
        moved = self._carrier.carry_by(self.follower.conclude(sight, alias))
        result, _ = judge_moved(self._at(moment), self._track, moved, self.part.friction)
        self.view = self.view if result.view is None else result.view
        return self._named(result)

    def place_at(self, estimate: PoseEstimate) -> Footprint | None:
        """Where an estimate has it; None where that is nowhere."""
        try:
            return Footprint(View(Contour.trusted(apply_homography(estimate.G, self.follower.target.outline))))
        except ConditioningError:
            return None

    def _lies_on(self, places: Sequence[Footprint], estimate: PoseEstimate) -> bool:
        own = self.place_at(estimate)
        return own is not None and any(own.is_shared(place) for place in places)

    def _at(self, moment: Moment) -> Moment:
        return moment._replace(probability=self._probability)

    def _named(self, result: TrackResult) -> TrackResult:
        """A result of this instance: what its first image left open of the part's own grasp is open in each later one."""
        named = replace(result, instance_id=self.number, part_id=self.part.name)
        if result.contacts is None or result.homography is None:
            return named
        H, first = result.homography, self._grasp.contacts
        J = np.array([homography_jacobian(H, x, y) for x, y in first.tolist()]).reshape(-1, 2, 2)
        found = J @ self._found_with @ J.transpose(0, 2, 1)
        covariance = found if result.covariance is None else result.covariance + found
        return replace(named, covariance=covariance, confidence=min(result.confidence, self._probability))


class Footprint:
    """Where an outline lies."""

    def __init__(self, view: View) -> None:
        self.view, points = View(view.outer), view.outer.points
        self._low, self._high = points.min(axis=0).tolist(), points.max(axis=0).tolist()

    def is_shared(self, other: Footprint) -> bool:
        """Whether two have so much in common that no two parts lie so: a small one on a large one may."""
        (x, y), (u, v), (a, b), (c, d) = self._low, self._high, other._low, other._high
        if u < a or c < x or v < b or d < y:
            return False
        both, *areas = overlap_areas(self.view, other.view)
        return both > LEAST_OVERLAP * max(1, *areas)


def _each_beside_others(members: Sequence[_Followed], sights: Sequence[Sight]) -> list[Sight]:
    """What an image shows of each where none of the others is found, and when others went the same way.

    What explains another one speaks for none but that, and two that went one way go with what carries them.
    """
    claims: list[Footprint | None] = []
    for each, sight in zip(members, sights, strict=True):
        e = sight.decision.estimate
        claims.append(None if e is None else each.place_at(e))
    ways = [_way_of(each, sight) for each, sight in zip(members, sights, strict=True)]
    found = []
    for k, (each, sight) in enumerate(zip(members, sights, strict=True)):
        beside = [place for j, place in enumerate(claims) if j != k and place is not None]
        own, way = claims[k], ways[k]
        sure = sight.decision.probability_off < UNCLEAR * sight.decision.risk
        if sure or own is None or way is None or any(own.is_shared(place) for place in beside):
            found.append(sight)
            continue
        near = [other - way for j, other in enumerate(ways) if j != k and other is not None]
        alike = [way + off for off in near if math.hypot(*off.tolist()) < _same_way(sight, way)]
        found.append(each.reconsider(sight, beside, np.mean(alike, axis=0) if alike else None))
    return found


def _newcomers(members: Sequence[_Followed], sights: Sequence[Sight]) -> list[float]:
    """Probability of each that it is another part, which has just come: found by a search, where nothing carries the others."""
    found = [0.0] * len(members)
    ways = [_way_of(each, sight) for each, sight in zip(members, sights, strict=True)]
    for k, (way, sight) in enumerate(zip(ways, sights, strict=True)):
        e = sight.decision.estimate
        if way is None or e is None or e.origin in CONTINUOUS:
            continue
        others = [other for j, other in enumerate(ways) if j != k and other is not None]
        away = math.hypot(*(np.median(others, axis=0) - way).tolist()) if others else math.inf
        found[k] = SEEN_LIKE * (away > _same_way(sight, way))
    return found


def _same_way(sight: Sight, way: Floats) -> float:
    """px by which ways differ that are one, seen aslant."""
    return sight.decision.tolerance + ASLANT * math.hypot(*way.tolist())


def _way_of(each: _Followed, sight: Sight) -> Floats | None:
    """(2,) px from where an object was to where it is found; None where it is not."""
    e, (target, last) = sight.decision.estimate, (each.follower.target, each.follower.state.last)
    return None if e is None else np.subtract(e.middle, mean_point(target.carried_contacts(last.G)))


def _shared_places(members: Sequence[_Followed], sights: Sequence[Sight]) -> list[float]:
    """Probability of each that what it is taken for is another one that is found in its place."""
    places: list[Footprint | None] = []
    worth: list[float] = []
    for each, sight in zip(members, sights, strict=True):
        e = sight.decision.estimate
        places.append(each.place_at(e) if e is not None and sight.decision.is_accepted else None)
        prior = 0.0 if e is None else place_prior(e, sight.solutions.expected, each.follower.target.numbers)
        worth.append(sight.decision.evidence + prior)
    found = []
    for k, own in enumerate(places):
        rivals = [j for j, other in enumerate(places) if j != k and own and other and own.is_shared(other)]
        less = [min(worth[k] - worth[j], MAX_EXPONENT) for j in rivals]
        found.append(any_of(*(1.0 / (1.0 + math.exp(max(each, -MAX_EXPONENT))) for each in less)))
    return found


def _with_equals(members: Sequence[_Followed], sights: Sequence[Sight], aliases: Sequence[float]) -> list[float]:
    """The same, with the probability that all of its equals, and it with them, went another way."""
    found = list(aliases)
    for name in {each.part.name for each in members}:
        group = [k for k, each in enumerate(members) if each.part.name == name]
        told = alias_probabilities([members[k].follower for k in group], [sights[k] for k in group])
        for k, alias in zip(group, told, strict=True):
            found[k] = any_of(found[k], alias)
    return found
