# SPDX-License-Identifier: Apache-2.0
"""Bring a hand to a grasp with an uncalibrated camera. `Robot` shows what your driver has to offer.

Here it simulates a hand above a table and renders what the camera on the hand sees. The servo is told neither where the
camera sits nor its focal length.
"""

import cv2
import numpy as np

import grasptrack as gt
from grasptrack.servo.camera import apply_twist, pose_of, rotation_matrix

WIDTH, HEIGHT, PERIOD, FOCAL = 640, 480, 0.04, 570.0
OPENING = 0.08  # m, between the fingertips of the open hand
TILT = rotation_matrix((0.0, 0.0, 0.7)) @ rotation_matrix((0.08, -0.05, 0.0))
MOUNTING = pose_of(TILT, (0.01, -0.03, -0.25))  # of the camera on the hand
START = pose_of(np.diag([1.0, -1.0, -1.0]) @ rotation_matrix((0, 0, 0.4)), (0.06, 0.05, 0.27))
PLATE = np.array([(-50, -19), (-14, -24), (22, -19), (50, -24), (50, 19), (14, 24), (-18, 19), (-50, 26)]) / 1000.0  # m
TIPS = np.array([(-OPENING / 2, 0, 0), (OPENING / 2, 0, 0)])  # m, in the frame of the hand


class Robot:
    """Replace it with yours: what the camera sees, the time, the pose of the hand, and how the hand moves."""

    def __init__(self) -> None:
        self.clock, self.hand = 0.0, START

    def image(self) -> np.ndarray:
        """(480, 640) uint8: a grey plate on a bright table."""
        camera = np.linalg.inv(self.hand @ MOUNTING)
        corners = np.column_stack([PLATE, np.zeros(len(PLATE))]) @ camera[:3, :3].T + camera[:3, 3]
        picture = np.full((4 * HEIGHT, 4 * WIDTH), 210, np.uint8)
        cv2.fillPoly(picture, [np.rint(4.0 * self.pixels(corners) + 1.5).astype(np.int32)], (70,))
        return cv2.GaussianBlur(cv2.resize(picture, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), (3, 3), 0)

    def time(self) -> float:
        """Seconds, on the same clock for images and poses."""
        return self.clock

    def pose(self) -> np.ndarray:
        """(4, 4) pose of the hand in a fixed base frame, from the robot's encoders."""
        return self.hand

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) px of points (N, 3) m in the camera's frame."""
        return FOCAL * points[:, :2] / points[:, 2:] + ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)

    def fingertips(self) -> np.ndarray:
        """(2, 2) px. A person marks them once: they are at the same place in every image."""
        back = np.linalg.inv(MOUNTING)
        return self.pixels(TIPS @ back[:3, :3].T + back[:3, 3])

    def move(self, twist: np.ndarray) -> None:
        """Move for one control period."""
        self.hand, self.clock = apply_twist(self.hand, twist, PERIOD), self.clock + PERIOD

    def stop(self) -> None:
        """Stand, whatever it was told before. This one stands by itself after each period; most arms do not."""

    def open(self) -> None:
        """Open the fingers for another try."""

    def close(self) -> bool:
        """Close the fingers; whether they are at the height of the plate."""
        tips = TIPS @ self.hand[:3, :3].T + self.hand[:3, 3]
        print("fingertips in mm:", np.round(1e3 * tips, 1).tolist())
        return bool(np.abs(tips[:, 2]).max() < 0.005)


def approach(robot: Robot) -> gt.GraspServo:
    """Run the loop of an approach; whatever ends it, an error or Ctrl-C included, the hand stands afterwards."""
    tracker = gt.GraspTracker(fingers=2)
    servo = gt.GraspServo(gt.Goal.fingertips(robot.fingertips(), OPENING), dof=4, retries=1)
    try:
        while not servo.over:
            result = tracker.update(robot.image(), time=robot.time())
            command = servo.update(result, time=robot.time(), pose=robot.pose())
            errors = f"{command.error_px:6.1f} px"
            print(f"{robot.time():5.2f} s  {result.status:8s}  {command.state:11s}  {errors}  {command.reason}")
            robot.move(command.twist)
            if command.close:
                servo.closed(robot.close())
            if command.open:
                robot.open()
    finally:
        robot.stop()
    print(servo.state, "-", servo.reason)
    return servo


if __name__ == "__main__":
    approach(Robot())
