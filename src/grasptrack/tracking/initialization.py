# SPDX-License-Identifier: Apache-2.0
"""The first view: which of its objects is meant, and which grasp on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import (
    ConditioningError,
    ContourError,
    GraspError,
    InputError,
    ObservationError,
    StrategyError,
    TransferError,
)
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import DEFAULT_FRICTION
from grasptrack.grasp.hand import Hand, Length
from grasptrack.grasp.synthesis import synthesize
from grasptrack.images import Grey, as_scene, to_bgr, to_mask
from grasptrack.segmentation.candidate import Candidate, distance_of_contacts, numbered_candidate, remove_nested
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.segmentation.segmenters import Segmenter
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.follower import AUTO
from grasptrack.tracking.messages import StatusReason
from grasptrack.tracking.numbers import DEFAULT_RISK, NUMBERS, Numbers
from grasptrack.tracking.pose import contact_tolerance
from grasptrack.tracking.state import SEEN
from grasptrack.tracking.strategies import PAPER, Carrier, carrier_for
from grasptrack.transfer import strategy_named
from grasptrack.typing import Floats

NEARLY_AS_GOOD = 0.7
"""Share of the best quality that a grasp needs to be preferred for being easier to carry."""
TRIED_GRASPS = 50
"""Synthesised grasps of which one is wanted that the strategy can carry and whose contacts the image shows."""
APART = 0.3
"""Outlines whose mean points lie within this fraction of sqrt(area) belong to one object."""


@dataclass(frozen=True)
class Wish:
    """What is asked of the first view.

    Attributes:
        said: what a person says of it.
        fingers: number of contacts.
        strategy: that will carry the grasp.
        friction: Coulomb coefficient.
        hand: that a synthesised grasp must suit.
        choose: the user's choice in the place of synthesis.
        segmenter: proposes regions beside the own search.
        risk: probability below which an answer may be wrong.
        tolerance: by which a contact may be off, px or a share, as this image shows the object; None has the core's own.
        waits: only an object that lies whole in view, and whose choice is sure, will do.
        before: the outline that the object had in the image before, where it needs another grasp.
        plane: tells of an outline the homography (3, 3) from px to its own plane, in which a grasp is to be chosen; None where
            nothing is known but that the view may be frontal.
    """

    said: FirstImage
    fingers: int = 2
    strategy: str = AUTO
    friction: float = DEFAULT_FRICTION
    hand: Hand | None = None
    choose: Callable[[View], Sequence[Grasp]] | None = None
    segmenter: Segmenter | None = None
    risk: float = DEFAULT_RISK
    tolerance: Length | None = None
    waits: bool = False
    before: View | None = None
    plane: Callable[[View], Floats] | None = None

    def for_another(self, view: View, plane: Callable[[View], Floats]) -> Wish:
        """Another grasp on the object that has this outline, chosen in its plane."""
        said = replace(self.said.of_no_object(), background=None)
        return replace(self, said=said, before=view, plane=plane)

    def is_sure_of(self, candidate: Candidate) -> bool:
        """Whether a person said which outline is meant, or its choice is sure."""
        drawn = self.said.outline is not None and not self.waits  # an outline may be of a place that is empty
        return drawn or self.said.number is not None or candidate.probability >= self.said.sure

    def for_next(self) -> Wish:
        """A grasp on whatever object comes next, once it lies whole in view."""
        return replace(self, said=self.said.of_no_object(), before=None, plane=None, waits=True)

    def numbers_for(self, view: View) -> Numbers:
        """The core's for an object of this outline, with the risk and the tolerance that are asked for."""
        numbers = NUMBERS.with_risk(self.risk)
        if self.tolerance is None:
            return numbers
        size = math.sqrt(view.outer.area)
        return numbers.with_tolerance(self.tolerance.in_px(size, None) / size)


class FirstView(NamedTuple):
    """What was made out in a first view.

    Attributes:
        candidate: the object that is meant; None where there is none.
        grasps: on it, in the order in which they are to be tried.
        reason: why there is no object or no grasp.
        found: all objects that were looked at, the most outstanding first.
        doubt: probability that the outline is none of the object's; 0 where a person gave contacts or a mask.
    """

    candidate: Candidate | None
    grasps: list[Grasp]
    reason: StatusReason
    found: list[Candidate]
    doubt: float = 0.0


def first_view(observer: OutlineDetector, wish: Wish, masked: bool) -> FirstView:
    """Object and grasps in the image that an observer has looked at.

    Args:
        observer: of the image.
        wish: what is asked of it; what is said fits the image.
        masked: the image is a softened mask.

    Raises:
        GraspError: given contacts that are not on an object, or a choice with another number of fingers.
    """
    try:
        found = observer.find_objects(replace(wish.said, masked=masked), None if masked else wish.segmenter)
    except ObservationError as error:
        return FirstView(None, [], StatusReason("no-object", detail=str(error)), [])
    waits = wish.waits and wish.before is None
    try:
        candidate = _choose_candidate(found, wish)
    except (GraspError, InputError) as error:
        if not waits:
            raise
        return FirstView(None, [], StatusReason("waiting", detail=str(error)), found)
    if candidate is None:
        return FirstView(None, [], StatusReason("object-gone"), found)
    if waits and candidate.view.is_clipped:
        return FirstView(None, [], StatusReason("waiting", detail="the likeliest is cut off"), found)
    if waits and not (masked or wish.is_sure_of(candidate)):
        return FirstView(None, [], StatusReason("waiting", {"choice": candidate.probability}), found)
    chosen, why = _choose_grasps(candidate, found, wish)
    reason = StatusReason() if chosen else StatusReason("no-grasp", detail=why)
    doubt = 0.0
    if not masked and wish.said.grasp is None:
        doubt = NUMBERS.misled if wish.said.is_settled else max(1.0 - candidate.probability, NUMBERS.misled)
    return FirstView(candidate, chosen, reason, found, doubt)


class FirstScene(NamedTuple):
    """What a tracker chose in an image, and all that the choice rests on: for looking again without another search.

    Attributes:
        colours: (H, W) or BGR (H, W, 3) the image without the lens's distortion, or the softened mask in its place.
        masked: it is a mask.
        chosen: the object and the grasps on it.
        wish: what was asked.
        before: what was known of camera and tilt, or None.
    """

    colours: NDArray[np.uint8]
    masked: bool
    chosen: FirstView
    wish: Wish
    before: Beforehand | None


class TrackingStart(NamedTuple):
    """How a grasp is begun to be followed.

    Attributes:
        grasp: the first that the strategy can carry; None where there is none.
        carrier: takes it to later images.
        refusal: why the strategy cannot carry the first one of all; empty where it can.
    """

    grasp: Grasp | None
    carrier: Carrier | None
    refusal: str


def start_tracking(
    first: FirstView,
    wish: Wish,
    grey: Grey,
    observer: OutlineDetector,
    time: float | None = None,
    before: Beforehand | None = None,
) -> TrackingStart:
    """The first grasp of a first view that the strategy can carry, and what carries it; arguments as for `carrier_for`.

    A synthesised one whose contacts nothing in the image shows, as on an edge in a glare, gives way to the first that it does:
    no later image could testify for it.
    """
    if first.candidate is None:
        return TrackingStart(None, None, "")
    view, numbers = first.candidate.view, wish.numbers_for(first.candidate.view)
    synthesised = wish.said.grasp is None and wish.choose is None
    refusal, start = "", TrackingStart(None, None, "")
    for grasp in first.grasps:
        if start.carrier is not None and not _shows_contacts(start.carrier, grasp):
            continue
        try:
            carrier = carrier_for(wish.strategy, grasp, view, grey, time, observer, numbers, before)
        except TransferError as error:
            refusal = refusal or str(error)
            continue
        carrier.follower.state.sightings.doubt = first.doubt
        found = TrackingStart(grasp, carrier, refusal)
        if not synthesised or _shows_contacts(carrier, grasp):
            return found
        start = found if start.carrier is None else start
    return start._replace(refusal=refusal)


def _shows_contacts(carrier: Carrier, grasp: Grasp) -> bool:
    """Whether the first view shows enough of each contact for later images to see it again."""
    state = carrier.follower.state
    return state.target.shown_share(grasp.contacts, state.usual) >= SEEN


def image_size(image: NDArray[Any]) -> tuple[int, int]:
    """Height and width of an image, once it is one.

    Raises:
        SourceError: it is none.
    """
    height, width = to_bgr(image).shape[:2]
    return height, width


def mask_as_scene(mask: NDArray[Any], shape: tuple[int, int]) -> Grey:
    """(H, W) the user's segmentation of an image, softened: it takes the image's place.

    Raises:
        InputError: a mask of another size.
    """
    return as_scene(to_mask(mask, shape, "mask"))


def _choose_candidate(found: list[Candidate], wish: Wish) -> Candidate | None:
    """The given contacts' object, the one whose grasp was refused, or the most outstanding."""
    if wish.said.grasp is not None:
        return object_at_contacts(found, wish.said.grasp, wish.said.number)
    if wish.before is not None:
        return object_at_outline(found, wish.before)
    return numbered_candidate(found, wish.said.number)


def _choose_grasps(candidate: Candidate, found: list[Candidate], wish: Wish) -> tuple[list[Grasp], str]:
    """Grasps on an object, and why there is none."""
    if wish.said.grasp is not None:
        return [_placed_grasp(wish.said.grasp, candidate.view, wish)], ""
    if wish.choose is not None:
        given: Any = wish.choose(candidate.view)
        chosen = list(given) if isinstance(given, Iterable) else [given]
        if not all(isinstance(grasp, Grasp) for grasp in chosen):
            raise GraspError("choose must return grasps, a sequence of Grasp, [] where there is none")
        if any(len(grasp) != wish.fingers for grasp in chosen):
            raise GraspError(f"a grasp of {wish.fingers} contacts is to be chosen", fingers=wish.fingers)
        return chosen, "the choice that was given made none"
    beside = [c.view for c in remove_nested([candidate, *found])[1:]]
    return synthesize_grasps(candidate.view, wish.strategy, wish.fingers, wish.friction, wish.hand, beside, wish.plane)


def _placed_grasp(given: Grasp, view: View, wish: Wish) -> Grasp:
    """Given contacts on an outline, those of them that are only a little beside it.

    Who gives a contact means a point of the object. A little beside the outline that is taken for the edge under the finger;
    farther away the outline may be wrong there, as by a shadow, and the point stays. Strategies that tell contacts by the
    outline alone cannot carry such a one.
    """
    snapped = given.snapped(view)
    if wish.strategy != AUTO:
        return snapped
    allowed = contact_tolerance(view.outer.area, wish.numbers_for(view))
    far = np.hypot(*(snapped.contacts - given.contacts).T) > 0.5 * allowed
    return Grasp.of(np.where(far[:, None], given.contacts, snapped.contacts), given.quality)


def object_at_contacts(found: list[Candidate], grasp: Grasp, number: int | None = None) -> Candidate:
    """The object that given contacts were found on, or that of these with a number, 1 being the likeliest.

    Raises:
        GraspError: a contact is too far from it.
        InputError: there are fewer.
    """
    candidate = numbered_candidate(found, number)
    distance, limit = distance_of_contacts(candidate.view, grasp)
    if distance > limit:
        raise GraspError(
            f"a contact is {distance:.1f} px from the nearest object's outline; at most {limit:.1f} px are allowed",
            distance=distance,
        )
    return candidate


def object_at_outline(found: list[Candidate], view: View) -> Candidate | None:
    """The object where an outline was in the image before, or None when none is near."""
    return min(
        (c for c in found if _relative_distance(c.view, view) <= 1.0),
        key=lambda c: _relative_distance(c.view, view),
        default=None,
    )


def other_objects(found: list[Candidate], chosen: Candidate) -> list[Candidate]:
    """What else lies in the view."""
    return [c for c in found if _relative_distance(c.view, chosen.view) > APART]


def synthesize_grasps(
    view: View,
    strategy: str,
    fingers: int,
    friction: float,
    hand: Hand | None,
    beside: list[View],
    plane: Callable[[View], Floats] | None = None,
) -> tuple[list[Grasp], str]:
    """Synthesised grasps in the order in which they are to be tried, and why there is none.

    Args:
        view: the object.
        strategy: that will carry the grasp.
        fingers, friction, hand: as in synthesis.
        beside: outlines of what lies beside the object.
        plane: as of `Wish`.
    """
    H = np.eye(3) if plane is None else plane(view)
    own = [view] if plane is None else _in_plane([view], H)
    if not own:
        return [], "the object's plane is not seen from its front"
    neighbours = beside if plane is None else _in_plane(beside, H)
    found = synthesize(own[0], fingers, friction, top=TRIED_GRASPS, hand=hand, neighbours=neighbours)
    back = np.linalg.inv(H)
    ranked: list[Grasp] = [g if plane is None else Grasp(apply_homography(back, g.contacts), g.quality) for g in found]
    if strategy in (AUTO, PAPER) and ranked:
        # among grasps that are nearly as good, the first that most descriptions can carry
        count = sum(g.quality >= NEARLY_AS_GOOD * ranked[0].quality for g in ranked)
        ranked[:count] = sorted(ranked[:count], key=lambda g: -count_describing_strategies(g, view))
    return ranked, found.reason


def _in_plane(views: list[View], H: Floats) -> list[View]:
    """Outlines under a homography; those that it takes to infinity lie nowhere near."""
    carried = []
    for view in views:
        try:
            carried.append(view.transformed(H))
        except (ConditioningError, ContourError):
            continue
    return carried


def count_describing_strategies(grasp: Grasp, view: View) -> int:
    """How many of the strategies that work on silhouettes can describe a grasp."""
    count = 0
    for name in ("homography", "grasp-line"):
        try:
            strategy_named(name).describe(grasp, view)
            count += 1
        except (TransferError, StrategyError):
            continue
    return count


def _relative_distance(one: View, other: View) -> float:
    """Distance of two outlines' mean points in sqrt(area) of the second."""
    away = np.subtract(one.outer.points.mean(axis=0), other.outer.points.mean(axis=0))
    return math.hypot(*away.tolist()) / math.sqrt(other.outer.area)
