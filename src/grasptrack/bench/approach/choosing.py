# SPDX-License-Identifier: Apache-2.0
"""The first look: which grasp the hand shall go for, or why there is none."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.approach.radial import radial_grasps
from grasptrack.bench.physics.gripper import BESIDE, MAX_OPENING, PAD_THICKNESS, PAD_WIDTH
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.hand import Hand, Length
from grasptrack.grasp.synthesis import synthesize
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats

FRICTION = 0.5
"""Coefficient for which grasps are chosen; that of the pads is higher."""
SIDEWAYS = 0.006
"""m that a finger stands back from its contact before it closes: as far as it may be off, and then some."""
EVEN = 0.001
"""m by which the third of three contacts may be off its place. Fingers that move alike shove a part by two thirds of that until
all touch: no more than the hand may be beside the grasp anyway."""
NEARLY_AS_GOOD = 0.7
"""Share of the best quality that a grasp needs to be preferred for asking less of a turn."""


def hand_for(size: float, unsure: float = 0.0) -> Hand:
    """The hand's limits as shares of an object of sqrt(area) = `size` m, since the scale of the image is not known.

    Args:
        size: m, as it is known beforehand.
        unsure: share by which that may be off. A hand that opens no wider than the part would come down on it, so that however
            large it is the fingers have room beside it.
    """
    opening = min(MAX_OPENING - 2.0 * SIDEWAYS, (MAX_OPENING - 2.0 * BESIDE) * (1.0 - unsure))
    return Hand(
        max_opening=Length(opening / size, "size"),
        finger_width=Length(PAD_WIDTH / size, "size"),
        finger_thickness=Length(PAD_THICKNESS / size, "size"),
        clearance=Length(SIDEWAYS / size, "size"),
    )


def first_look(
    image: NDArray[Any],
    time: float,
    ignore: NDArray[Any],
    hand: Hand,
    tips: Floats,
    strategy: str = "auto",
    risk: float = DEFAULT_RISK,
) -> tuple[GraspTracker, TrackResult]:
    """A tracker that has chosen its grasp, and what it says of the first image; `searching` where it has none.

    Of grasps that squeeze from outside and are nearly as good as the best, the one is taken that asks for the least turn.

    Args:
        image: of the hand's camera.
        time: s.
        ignore: (H, W), where the hand is in the image.
        hand: its limits.
        tips: (k, 2) px of the fingertips.
        strategy, risk: of the tracker.
    """
    fingers, told = len(tips), ""

    def choose(view: View) -> list[Grasp]:
        nonlocal told
        found, told = closing_grasps(view, fingers, hand)
        good = [g for g in found if g.quality >= NEARLY_AS_GOOD * found[0].quality]
        return sorted(good, key=lambda g: turn_between(g.contacts, tips))

    tracker = GraspTracker(
        fingers=fingers, strategy=strategy, ignore=ignore, friction=FRICTION, choose=choose, risk=risk
    )
    result = tracker.update(image, time)
    if result.contacts is None and result.view is not None and told:
        result = replace(result, reason=told)
    return tracker, result


def closing_grasps(view: View, fingers: int, hand: Hand) -> tuple[list[Grasp], str]:
    """Grasps that the hand closes on from outside, best first, and why there is none.

    Args:
        view: the outline.
        fingers: 2, or 3 that are a third of a turn apart on one drive.
        hand: its limits, as `hand_for` tells them.
    """
    if fingers == 2:
        ranked = synthesize(view, fingers, FRICTION, hand=hand)
        squeezing: list[Grasp] = [g for g in ranked if not g.spread]
        only = "no stable grasp: only inside holes, where closing fingers cannot push"
        return squeezing, "" if squeezing else only if ranked else f"no stable grasp: {ranked.reason}"
    found = radial_grasps(view, hand, FRICTION, EVEN / PAD_WIDTH)
    return found.grasps, found.reason


def turn_between(contacts: Floats, tips: Floats) -> float:
    """rad, the least turn from fingertips to contacts, both evenly round their middles, where fingers can change places."""
    (ax, ay), (bx, by) = contacts[-1] - _direction_origin(contacts), tips[-1] - _direction_origin(tips)
    angle, half = math.atan2(ay, ax) - math.atan2(by, bx), math.pi / len(tips)
    return abs((angle + half) % (2.0 * half) - half)


def width_in_m(contacts: Floats, tips: Floats, opening: float) -> float:
    """m that the hand is open where it touches contacts that are seen at the depth of the fingertips.

    Args:
        contacts: (k, 2) px.
        tips: (k, 2) px of the fingertips.
        opening: m of the hand as the tips are seen: their distance, of three twice that from their middle.
    """
    return float(opening * _contact_span(contacts) / _contact_span(tips))


def _direction_origin(points: Floats) -> Floats:
    """Where the direction to the last point counts from: the other one, or the middle of three."""
    return points[0] if len(points) == 2 else np.asarray(points.mean(axis=0))


def _contact_span(points: Floats) -> float:
    """The distance of two points; of three twice the mean one from their middle."""
    if len(points) == 2:
        return float(np.hypot(*(points[1] - points[0])))
    return 2.0 * float(np.hypot(*(points - points.mean(axis=0)).T).mean())
