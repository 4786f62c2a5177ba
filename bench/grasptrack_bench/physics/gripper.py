# SPDX-License-Identifier: Apache-2.0
"""The hand: boxes for fingers, palm and wrist, in its own frame, as physics and pictures need them.

The frame of the hand: the origin between the tips of the fingers, z the direction of approach (fingers point along +z), x the
closing direction of two fingers, y to the right of x as seen along z. All lengths in m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grasptrack.errors import InputError
from grasptrack.typing import Floats

MAX_OPENING = 0.088
"""m, between the faces of two fingers that are fully open."""
BESIDE = 0.004
"""m that each finger stands back from its contact when the hand goes down to close."""
PAD_WIDTH, PAD_THICKNESS, PAD_LENGTH = 0.008, 0.005, 0.022
SHAFT_WIDTH, SHAFT_THICKNESS = 0.009, 0.009
REACH = 0.165
"""m from the tips to the palm."""
PALM = (0.058, 0.022, 0.016)
"""Half-lengths along x, y, z. Palm and wrist stand back along y, out of the camera's way."""
WRIST = (0.03, 0.024, 0.07)


@dataclass(frozen=True)
class GripperBox:
    """A box of the hand: centre and half-lengths, and which finger it belongs to (-1: none)."""

    name: str
    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    finger: int = -1

    def corners(self) -> Floats:
        """(8, 3), in the frame of the hand or of its finger."""
        signs = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
        return np.asarray(np.array(self.centre) + signs * np.array(self.half), dtype=np.float64)


@dataclass(frozen=True)
class Gripper:
    """A hand with so many fingers, each on a slide that moves it toward the middle.

    Attributes:
        azimuths: rad, from which direction of the hand's frame each finger comes; (pi, 0) for two.
    """

    azimuths: tuple[float, ...] = (math.pi, 0.0)

    @property
    def fingers(self) -> int:
        """How many."""
        return len(self.azimuths)

    def finger_frame(self, finger: int, travel: float) -> Floats:
        """(4, 4) frame of a finger in the hand, its x pointing outward, its pad's face `travel` m from the middle."""
        a = self.azimuths[finger]
        c, s = math.cos(a), math.sin(a)
        return np.array([[c, -s, 0.0, c * travel], [s, c, 0.0, s * travel], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])

    def finger_boxes(self, finger: int) -> list[GripperBox]:
        """Pad and shaft of a finger in its own frame, the face of the pad at x = 0."""
        t, w, length = PAD_THICKNESS / 2.0, PAD_WIDTH / 2.0, PAD_LENGTH / 2.0
        back = (REACH - PAD_LENGTH) / 2.0
        return [
            GripperBox("pad", (t, 0.0, -length), (t, w, length), finger),
            GripperBox(
                "shaft",
                (SHAFT_THICKNESS / 2.0, 0.0, -PAD_LENGTH - back),
                (SHAFT_THICKNESS / 2.0, SHAFT_WIDTH / 2.0, back),
                finger,
            ),
        ]

    def fixed_boxes(self) -> list[GripperBox]:
        """Palm and wrist in the frame of the hand."""
        return [
            GripperBox("palm", (0.0, PALM[1] - 0.004, -REACH - PALM[2]), PALM),
            GripperBox("wrist", (0.0, PALM[1] + 0.012, -REACH - 2.0 * PALM[2] - WRIST[2]), WRIST),
        ]

    def boxes(self, opening: float) -> list[Floats]:
        """(8, 3) corners of all boxes in the frame of the hand, the fingers so far open."""
        found = [box.corners() for box in self.fixed_boxes()]
        for finger in range(self.fingers):
            frame = self.finger_frame(finger, opening / 2.0)
            found += [b.corners() @ frame[:3, :3].T + frame[:3, 3] for b in self.finger_boxes(finger)]
        return found

    def tips(self, opening: float) -> Floats:
        """(k, 3) where the faces of the pads end, at the tips, in the frame of the hand."""
        return np.array([self.finger_frame(i, opening / 2.0)[:3, 3] for i in range(self.fingers)])


def make_gripper(fingers: int) -> Gripper:
    """A hand of two fingers that close along x, or of three, a third of a turn apart."""
    if fingers == 2:
        return Gripper()
    if fingers == 3:
        return Gripper(tuple(math.pi / 2.0 + k * 2.0 * math.pi / 3.0 for k in range(3)))
    raise InputError(f"the hand has 2 or 3 fingers, not {fingers}", fingers=fingers)
