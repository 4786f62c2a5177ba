# SPDX-License-Identifier: Apache-2.0
"""From tracked contacts to a twist of the hand: grasp-based visual servoing with a camera that nobody calibrated (Fig. 1)."""

from grasptrack.servo.camera import NominalCamera
from grasptrack.servo.closing import Closing
from grasptrack.servo.command import Command
from grasptrack.servo.controller import LAWS, GraspServo
from grasptrack.servo.goal import Goal
from grasptrack.servo.grasp_pose import GraspPose
from grasptrack.servo.hand_eye import HandEye
from grasptrack.servo.law import Gain
from grasptrack.servo.loss import LossPolicy
from grasptrack.servo.self_calibration import Exploration
from grasptrack.servo.watchdog import Bounds, Limits

__all__ = [
    "LAWS", "Bounds", "Closing", "Command", "Exploration", "Gain", "Goal", "GraspPose", "GraspServo", "HandEye",
    "Limits", "LossPolicy", "NominalCamera",
]  # fmt: skip
