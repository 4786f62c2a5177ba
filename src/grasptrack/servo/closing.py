# SPDX-License-Identifier: Apache-2.0
"""When the hand may close: at the goal, for some images in a row, on a grasp that is believed and seen. Never otherwise.

And what came of it, by the opening at which the fingers stopped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.servo.features import rms_diameter
from grasptrack.servo.law import Aim
from grasptrack.tracking.messages import SENTENCES
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats

TOUCHING_OPENING = 0.001
"""m at which fingers touch each other, where nobody knows how wide the part is."""
HIDING_DISTANCE = 0.5
"""Contacts so near to their goal, in lengths of the goal, may be hidden by the fingers."""


@arguments.checked(
    arguments.number,
    tolerance=arguments.finite,
    images=arguments.whole,
    loosest=arguments.finite,
    tips=arguments.finite,
)
@dataclass(frozen=True)
class Closing:
    """What it takes.

    Args:
        tolerance: px, the farthest contact from its goal.
        images: so many believed images in a row within the tolerance.
        confidence: the least of a result.
        seen: the least share of the outline at each contact.
        memory: s for which a contact may have been out of sight that the fingers now hide.
        patience: s near the goal after which the tolerance grows.
        loosest: px to which it grows, in as long again.
        timeout: s after the command to close by which `closed` has to be called.
        tips: m along the approach direction by which a fingertip may be off: a hand of 4 DoF refuses a part that is tilted so
            much that it will be.

    Raises:
        InputError: a value outside its range.
    """

    tolerance: float = 1.0
    images: int = 3
    confidence: float = 0.5
    seen: float = 0.3
    memory: float = 3.0
    patience: float = 3.0
    loosest: float = 2.5
    timeout: float = 5.0
    tips: float = 0.002

    def __post_init__(self) -> None:
        if not (
            0.0 < self.tolerance <= self.loosest
            and self.images >= 1
            and self.memory >= 0.0
            and min(self.patience, self.timeout, self.tips) > 0.0
        ):
            raise InputError("tolerances are positive, images 1 or more, times not below 0", closing=repr(self))
        if not (0.0 <= self.confidence <= 1.0 and 0.0 <= self.seen <= 1.0):
            raise InputError("confidence and seen are shares of 0 to 1", closing=repr(self))


class CloseGate:
    """Says why the hand may not close yet."""

    def __init__(self, closing: Closing) -> None:
        self._asked = closing
        self._row = 0
        self._grasp: int | None = None
        self._near: float | None = None
        self._seen_at: list[float] | None = None

    def reset_count(self) -> None:
        """Something was not believed: images in a row count anew."""
        self._row = 0

    def position_tolerance(self, time: float) -> float:
        """px; more than at first once the hand has been near the goal for long."""
        late = 0.0 if self._near is None else (time - self._near) / self._asked.patience - 1.0
        return self._asked.tolerance + min(max(late, 0.0), 1.0) * (self._asked.loosest - self._asked.tolerance)

    def why_not(self, result: TrackResult, found: Aim, time: float) -> str:
        """Why not to close on this image; empty when everything speaks for it. Call it once for every new image."""
        error_px = found.error_px
        if result.grasp_id != self._grasp:
            self._grasp, self._row, self._seen_at = result.grasp_id, 0, None
        if error_px > 2.0 * self._asked.loosest:
            self._near = None
        elif self._near is None:
            self._near = time
        why, tolerance = self._rejection_reason(result, found.final, time), self.position_tolerance(time)
        if not why and not error_px <= tolerance:
            why = f"{error_px:.1f} px from the goal"
        if not why and not found.moved_px <= tolerance:  # it shows a place where the hand is no more
            why = f"at the goal, {found.moved_px:.1f} px after the image was taken"
        if not why and result.repeated:
            return "at the goal, in the same image again"
        self._row = 0 if why else self._row + 1
        if not why and self._row < self._asked.images:
            why = f"at the goal in {self._row} of {self._asked.images} images"
        return why

    def _rejection_reason(self, result: TrackResult, goal: Floats, time: float) -> str:
        if result.contacts is None or result.seen is None or result.status != "tracked" or result.notice:
            why = result.reason or (SENTENCES[result.notice] if result.notice else "")
            return f"at the goal, but {result.status}: {why}"
        if self._seen_at is None:
            self._seen_at = [-math.inf] * len(result.seen)
        seen = [share >= self._asked.seen for share in result.seen.tolist()]
        self._seen_at = [time if now else then for now, then in zip(seen, self._seen_at, strict=True)]
        if not result.confidence >= self._asked.confidence:
            return f"confidence {result.confidence:.2f}, below {self._asked.confidence:g}"
        near = HIDING_DISTANCE * rms_diameter(goal)
        for i, (contact, aim) in enumerate(zip(result.contacts.tolist(), goal.tolist(), strict=True)):
            hidden = math.dist(contact, aim) <= near and time - self._seen_at[i] <= self._asked.memory
            if not (seen[i] or hidden):
                return f"contact {i + 1} is not seen"
        return ""


def judge_opening(opening: float, width: float, widest: float) -> str:
    """Why nothing is held as it should be; empty where the part is.

    The fingers stopped at the part, at each other, or where they were: whichever is nearest. All in m; the width of the part
    and the widest opening are NaN where they are not known.
    """
    if not opening > (0.5 * width if width > 0.0 else TOUCHING_OPENING):
        return f"closed to {1000.0 * opening:.1f} mm: nothing is in it"
    if opening > 0.5 * (width + widest):
        return f"the fingers stopped at {1000.0 * opening:.1f} mm, the grasp is {1000.0 * width:.1f} mm wide"
    return ""
