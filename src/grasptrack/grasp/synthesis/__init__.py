# SPDX-License-Identifier: Apache-2.0
"""Choose grasps on an outline: all good ones that a hand can do, ranked (Fig. 3; references [10], [12], [13])."""

from __future__ import annotations

from collections.abc import Sequence

from grasptrack import arguments
from grasptrack.errors import InputError, StrategyError
from grasptrack.geometry.contours import OutlineLike, as_outline, as_view, outline_like
from grasptrack.grasp.contacts import GraspList, RankedGrasp, Terms
from grasptrack.grasp.force_closure import DEFAULT_FRICTION, check_friction, check_width
from grasptrack.grasp.hand import Hand
from grasptrack.grasp.synthesis.limits import UnevennessLimits
from grasptrack.grasp.synthesis.search import AskedGrasps, find_grasps

__all__ = ["GraspList", "RankedGrasp", "Terms", "synthesize"]


@arguments.checked(
    outline=outline_like,
    fingers=arguments.whole,
    friction=arguments.number,
    finger_width=arguments.optional(arguments.number),
    top=arguments.whole,
    hand=arguments.optional(arguments.instance(Hand)),
    neighbours=arguments.each(outline_like),
)
def synthesize(
    outline: OutlineLike,
    fingers: int = 2,
    friction: float = DEFAULT_FRICTION,
    finger_width: float | None = None,
    top: int = 50,
    *,
    hand: Hand | None = None,
    neighbours: Sequence[OutlineLike] = (),
) -> GraspList:
    """Ranked stable grasps that a hand can do, best first. The same outline gives the same list.

    Fingers squeeze from outside, on both sides of a wall too, or spread inside a hole or a notch. Two move along the
    line between their contacts, three toward the contacts' mean or away from it. Each is a rectangle, in which on its
    way in there may be nothing of the object, of its neighbours and of the other fingers; the outline under the pad
    may reach into it by a quarter of the pad's width.

    The quality is the product of five terms, each from 0 to 1:

    - closure: sqrt(1 - needed / friction), needed being the least friction with which two fingers close;
      1 - exp(-epsilon / 0.15) for three.
    - centre: exp(-(a / 0.3)^2 - b^2), a the distance of the grasp line from the centroid and b that of the contacts'
      middle; exp(-(b / 0.3)^2) for three. In units of sqrt(area).
    - flatness: 1 / (1 + (f / 0.01)^2), f the rms distance of the outline from a straight line under the worst
      finger, or half of that over twice a finger's width, in finger widths.
    - room: 0.2 + 0.8 sqrt(r / most), r the least half-length of the independent regions of contact; `most`, beyond
      which nothing is looked at, is a finger's width, or 12 % of sqrt(area) where that is less.
    - span: 1 / (1 + (o / 2.5)^6), o the opening in units of sqrt(area). A long part is taken across and not from tip
      to tip, unless there it is much flatter.

    Of grasps that are alike the best stays: those whose contacts, in any order, all lie within 12 % of sqrt(area) or
    a finger's width of its contacts.

    Args:
        outline: a Contour or View, or points (N, 2) px of a contour; contacts are not put where the image border cuts the
            object.
        fingers: 2 or 3.
        friction: Coulomb coefficient; less friction leaves fewer grasps.
        finger_width: px, in short for ``Hand(finger_width=...)``: wider fingers see less noise and find fewer places.
        top: at most so many grasps.
        hand: opening and fingers; by default they grow with the object, and no opening is too wide.
        neighbours: outlines of what else lies there, likewise, taken as solid. They only ever remove grasps, though one that
            was like a removed one may show in its place.

    Returns:
        The grasps. Where there is none, `reason` says why in one sentence. `refused` counts what each reason removed
        of all stable candidates before those that are alike are thinned: of two fingers the best pair for every two
        of some 120 stretches of outline, of three all triples of some 48 places
        or, where those are few and leave nothing, of some 144.

    Raises:
        ContourError: points that are no contour.
        StrategyError: a number of fingers that has no synthesis.
        InputError: friction or finger_width not positive, both finger_width and hand given, a hand in mm without
            scale, or openings that contradict each other on this object.
    """
    check_friction(friction)
    check_width(finger_width)
    if fingers not in (2, 3):
        raise StrategyError(
            f"grasps are synthesised for 2 or 3 fingers, not {fingers}; give the contacts instead", fingers=fingers
        )
    if hand is not None and finger_width is not None:
        raise InputError("give the finger's width with the hand, not beside it", finger_width=finger_width)
    if hand is None:
        hand = Hand() if finger_width is None else Hand(finger_width=finger_width)
    beside = [as_outline(neighbour) for neighbour in neighbours]
    return find_grasps(as_view(outline), AskedGrasps(fingers, friction, top), hand, beside, UnevennessLimits())
