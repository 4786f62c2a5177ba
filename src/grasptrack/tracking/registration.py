# SPDX-License-Identifier: Apache-2.0
"""The grasp in an image, and how the tracker itself carries it: by the first view, laid on that image."""

from __future__ import annotations

from typing import NamedTuple

from grasptrack.geometry.contours import View
from grasptrack.tracking.decision import Decision
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.messages import StatusReason
from grasptrack.tracking.target import Grey
from grasptrack.typing import Floats

REGISTRATION = "registration"
"""Name of what `auto` answers with."""


class Moved(NamedTuple):
    """The grasp in an image.

    Attributes:
        decision: whether it is believed, how surely, and by what estimate.
        contacts: (k, 2) px; None where there are none.
        homography: (3, 3) H_current_reference by which they were carried: the strategy's own.
        view: the outline that was laid on the image, or found in it.
        covariance: (8, 8) of the pose's error, with what the model does not know.
        reason: why it is not believed.
        switch: why another strategy carried them than the last answer's; empty where none did.
    """

    decision: Decision
    contacts: Floats | None = None
    homography: Floats | None = None
    view: View | None = None
    covariance: Floats | None = None
    reason: StatusReason = StatusReason()
    switch: str = ""


class Registration:
    """The first view laid on the image: the estimate's own contacts."""

    name = REGISTRATION

    def __init__(self, follower: Follower) -> None:
        self.follower = follower

    def move(self, grey: Grey, time: float | None) -> Moved:
        """The grasp in the next image (H, W), taken at a time in s."""
        return self.carry_by(self.follower.update(grey, time))

    def carry_by(self, decided: Decision) -> Moved:
        """The grasp by what was decided of an image."""
        decision, target = decided.with_risk(self.follower.risk), self.follower.target
        estimate = decision.estimate
        if estimate is None or not decision.is_accepted:
            return Moved(decision, reason=StatusReason(decision.code, decision.figures))
        H = target.homography(estimate.G)
        view, covariance = target.view.transformed(H), self.follower.pose_covariance(estimate)
        return Moved(decision, estimate.contacts, H, view, covariance)
