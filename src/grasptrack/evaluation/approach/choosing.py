# SPDX-License-Identifier: Apache-2.0
"""The first look: which grasp the hand shall go for, or why there is none."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.hand import Hand, Length
from grasptrack.result import TrackResult
from grasptrack.simulation.physical.gripper import MAX_OPENING, PAD_THICKNESS, PAD_WIDTH
from grasptrack.synthesis import synthesize
from grasptrack.tracker import GraspTracker

Floats = NDArray[np.float64]

FRICTION = 0.5
"""Coefficient for which grasps are chosen; that of the pads is higher."""
SIDEWAYS = 0.006
"""m that a finger stands back from its contact before it closes: as far as it may be off, and then some."""
NEARLY_AS_GOOD = 0.7
"""Share of the best quality that a grasp needs to be preferred for asking less of a turn."""


def hand_for(size: float) -> Hand:
    """The hand's limits as shares of an object of sqrt(area) = `size` m, since the scale of the image is not known."""
    return Hand(
        max_opening=Length((MAX_OPENING - 2.0 * SIDEWAYS) / size, "size"),
        finger_width=Length(PAD_WIDTH / size, "size"),
        finger_thickness=Length(PAD_THICKNESS / size, "size"),
        clearance=Length(SIDEWAYS / size, "size"),
    )


def first_look(
    image: NDArray[Any], time: float, ignore: NDArray[Any], hand: Hand, tips: Floats, strategy: str = "auto"
) -> tuple[GraspTracker, TrackResult]:
    """A tracker that has chosen its grasp, and what it says of the first image; `searching` where it has none.

    Of grasps that squeeze from outside and are nearly as good as the best, the one is taken that asks for the least turn.

    Args:
        image: of the hand's camera.
        time: s.
        ignore: (H, W), where the hand is in the image.
        hand: its limits.
        tips: (k, 2) px of the fingertips.
        strategy: of the tracker.
    """
    fingers = len(tips)
    looking = GraspTracker(fingers=fingers, ignore=ignore, hand=hand, friction=FRICTION)
    seen = looking.update(image, time)
    if seen.view is None:
        return looking, seen
    found = [g for g in synthesize(seen.view, fingers, FRICTION, hand=hand) if not g.spread]
    if not found:
        reason = seen.reason or "no stable grasp: only inside holes, where closing fingers cannot push"
        return looking, TrackResult(frame=0, time=time, status="searching", reason=reason, view=seen.view)
    good = [g for g in found if g.quality >= NEARLY_AS_GOOD * found[0].quality]
    chosen = min(good, key=lambda g: turn_between(g.contacts, tips)) if fingers == 2 else good[0]
    tracker = GraspTracker(grasp=chosen.contacts, strategy=strategy, ignore=ignore, friction=FRICTION)
    return tracker, tracker.update(image, time)


def turn_between(contacts: Floats, tips: Floats) -> float:
    """rad, 0 to pi/2, between two contacts' line and that of two fingertips that can change places."""
    (ax, ay), (bx, by) = contacts[1] - contacts[0], tips[1] - tips[0]
    angle = math.atan2(ay, ax) - math.atan2(by, bx)
    return abs((angle + math.pi / 2.0) % math.pi - math.pi / 2.0)


def width_in_m(contacts: Floats, tips: Floats, opening: float) -> float:
    """m between contacts that are seen at the depth of the fingertips, by their distance and the fingertips' in the image."""
    return float(opening * np.hypot(*(contacts[1] - contacts[0])) / np.hypot(*(tips[1] - tips[0])))
