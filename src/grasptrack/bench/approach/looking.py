# SPDX-License-Identifier: Apache-2.0
"""Following one grasp all the way down, and looking anew where the tracker no longer finds it.

The tracker would rather say nothing than something wrong. From 2.5 times the distance an outline shows less than half of the
detail that it shows in the end, and a thick part shows other sides of itself from elsewhere: what speaks against the reference
then ends in "lost" for good. The hand is nearer by that time, and there is but one part: so a grasp is chosen again in what is
seen now, if that has the outline of the first look.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from grasptrack.bench.approach.choosing import first_look
from grasptrack.geometry.contours import View
from grasptrack.grasp.hand import Hand
from grasptrack.matching import Sampled, match_outlines
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats

WINDOW, LEAST = 8, 0.5
"""Images, and the share of them in which the grasp has to be found, or it is looked for anew."""
OTHERWISE = 2
"""Of so many grasps chosen anew, one is followed by its outline alone: what a faint surface shows may mislead."""
SELDOM = 4
"""Images from one look to the next where nothing was found."""
LIES_ON, MISFIT = 0.6, 0.05
"""What is chosen anew must be the part that was looked at first: so much of both outlines lies on each other, and they differ
by this share of sqrt(area) at most, rms. A grain of the table does not; sides of the part that now show may."""


class Looking:
    """Follows one grasp, image by image, as `GraspTracker` does; a grasp that was chosen anew has a new `grasp_id`.

    Args:
        tracker: that has seen its first image and chosen a grasp.
        view: the outline of the part in that image.
        ignore: (H, W), where the hand is in the image.
        hand: its limits.
        tips: (k, 2) px of the fingertips.
        risk: of a tracker that follows a grasp chosen anew.

    Attributes:
        again: how often a grasp was chosen anew.
        looked: in the last image the part was looked for anew, which takes far longer than following it.
    """

    def __init__(
        self,
        tracker: GraspTracker,
        view: View,
        ignore: NDArray[Any],
        hand: Hand,
        tips: Floats,
        risk: float = DEFAULT_RISK,
    ) -> None:
        self._tracker, self._ignore, self._hand, self._tips, self._risk = tracker, ignore, hand, tips, risk
        self._outline = Sampled(view)
        self._found: deque[bool] = deque([True] * WINDOW, maxlen=WINDOW)
        self._wait = 0
        self.again = 0
        self.looked = False

    def update(self, image: NDArray[Any], time: float, *, look: bool = True) -> TrackResult:
        """What is seen now.

        Args:
            image, time: as for `GraspTracker.update`.
            look: the part may be looked for anew.
        """
        result = self._tracker.update(image, time)
        self._found.append(result.status == "tracked")
        self._wait = max(0, self._wait - 1)
        self.looked = look and result.status != "tracked" and self._wait == 0 and sum(self._found) < LEAST * WINDOW
        if self.looked:
            self._wait = SELDOM
            strategy = "auto" if self.again % OTHERWISE < OTHERWISE - 1 else "homography"
            tracker, anew = first_look(image, time, self._ignore, self._hand, self._tips, strategy, self._risk)
            if anew.status == "tracked" and anew.view is not None and self._is_the_part(anew.view):
                self._tracker, result = tracker, anew
                self._found.extend([True] * WINDOW)
                self.again += 1
        if result.grasp_id is None:
            return result
        return replace(result, grasp_id=result.grasp_id + self.again)

    def _is_the_part(self, view: View) -> bool:
        """Whether an outline is that of the first look, from anywhere."""
        ways = match_outlines(self._outline, Sampled(view), thorough=False)
        return bool(ways) and ways[0].share >= LIES_ON and ways[0].misfit <= MISFIT * ways[0].size
