# SPDX-License-Identifier: Apache-2.0
"""Bring a hand to a grasp with a camera that nobody calibrated. Below `Robot` is all that a driver needs: ten lines.

`Robot` stands for yours: a hand above a table, a camera on it, images rendered. The servo is not told where the camera is.
"""

import cv2
import numpy as np

import grasptrack as gt
from grasptrack.servo.camera import apply_twist, pose_of, rotation_matrix

WIDTH, HEIGHT, PERIOD, FOCAL = 640, 480, 0.04, 570.0
MOUNTING = pose_of(
    rotation_matrix((0.0, 0.0, 0.7)) @ rotation_matrix((0.08, -0.05, 0.0)), (0.01, -0.03, -0.25)
)  # in the hand
PLATE = np.array([(-50, -19), (-14, -24), (22, -19), (50, -24), (50, 19), (14, 24), (-18, 19), (-50, 26)]) / 1000.0  # m


class Robot:
    """Yours: what it sees, what time it is, where its hand is, and how it moves."""

    def __init__(self) -> None:
        self.clock, self.hand = (
            0.0,
            pose_of(np.diag([1.0, -1.0, -1.0]) @ rotation_matrix((0, 0, 0.4)), (0.06, 0.05, 0.27)),
        )

    def image(self) -> np.ndarray:
        """(480, 640) uint8: a grey plate on the bright table, and the fingertips."""
        camera = np.linalg.inv(self.hand @ MOUNTING)
        corners = np.column_stack([PLATE, np.zeros(len(PLATE))]) @ camera[:3, :3].T + camera[:3, 3]
        picture = np.full((4 * HEIGHT, 4 * WIDTH), 210, np.uint8)
        cv2.fillPoly(picture, [np.rint(4.0 * self.pixels(corners) + 1.5).astype(np.int32)], 70)
        return cv2.GaussianBlur(cv2.resize(picture, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), (3, 3), 0)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) px of points (N, 3) m of the camera's frame."""
        return FOCAL * points[:, :2] / points[:, 2:] + ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)

    def fingertips(self) -> np.ndarray:
        """(2, 2) px, as marked once by a person: they are where they are in every image."""
        back = np.linalg.inv(MOUNTING)
        return self.pixels(np.array([(-0.04, 0, 0.0), (0.04, 0, 0.0)]) @ back[:3, :3].T + back[:3, 3])

    def move(self, twist: np.ndarray) -> None:
        """One control period."""
        self.hand, self.clock = apply_twist(self.hand, twist, PERIOD), self.clock + PERIOD

    def close(self) -> bool:
        """Whether the plate's narrow part is between the fingertips."""
        tips = (self.hand @ np.array([(-0.04, 0, 0, 1), (0.04, 0, 0, 1)]).T)[:3].T
        print("fingertips in mm:", np.round(1e3 * tips, 1).tolist())
        return bool(np.abs(tips[:, 2]).max() < 0.005)


robot = Robot()
tracker = gt.GraspTracker(fingers=2)
servo = gt.GraspServo(gt.Goal.fingertips(robot.fingertips(), 0.08), dof=4)
while not servo.over:
    result = tracker.update(robot.image(), time=robot.clock)
    command = servo.update(result, time=robot.clock, pose=robot.hand)
    print(
        f"{robot.clock:5.2f} s  {result.status:8s}  {command.state:11s}  {command.error_px:6.1f} px  {command.reason}"
    )
    robot.move(command.twist)
    if command.close:
        servo.closed(robot.close())
print(servo.state, "-", servo.reason)
