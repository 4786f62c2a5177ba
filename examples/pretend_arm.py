# SPDX-License-Identifier: Apache-2.0
"""A UR arm, its camera and its gripper that exist in this file alone, for examples/07_ur.py and its test.

The arm answers to the methods of `ur_rtde` that the example calls, in simulated time: a second passes when 50 periods were
waited for. Its camera gives a grey plate on a bright table as it is seen from where the hand is.
"""

import cv2
import numpy as np

from grasptrack.servo.camera import apply_twist, pose_of, rotation_matrix

WIDTH, HEIGHT, FOCAL = 640, 480, 570.0
MOUNTING = pose_of(rotation_matrix((0.0, 0.0, 0.7)) @ rotation_matrix((0.08, -0.05, 0.0)), (0.01, -0.03, -0.25))
START = pose_of(np.diag([1.0, -1.0, -1.0]) @ rotation_matrix((0, 0, 0.4)), (0.46, -0.15, 0.27))
PLATE = np.array([(-50, -19), (-14, -24), (22, -19), (50, -24), (50, 19), (14, 24), (-18, 19), (-50, 26)]) / 1000.0
AT = np.array([0.4, -0.2, 0.0])  # m, of the plate in the base
OPENING = 0.08
TIPS = np.array([(-OPENING / 2, 0, 0), (OPENING / 2, 0, 0)])


class PretendArm:
    """Control and receive interface in one.

    Args:
        stop_at: s at which a protective stop happens.
    """

    def __init__(self, stop_at: float = np.inf) -> None:
        self.clock, self.hand, self._speed, self._stop_at = 0.0, START, np.zeros(6), stop_at
        self.fastest = 0.0

    def getActualTCPPose(self) -> list[float]:  # noqa: N802
        """x, y, z in m and a rotation vector in rad, in the base."""
        turn, _ = cv2.Rodrigues(self.hand[:3, :3])
        return [*self.hand[:3, 3].tolist(), *turn.ravel().tolist()]

    def isProtectiveStopped(self) -> bool:  # noqa: N802
        """Whether the arm has stopped itself."""
        return self.clock >= self._stop_at

    def speedL(self, speed: list[float], acceleration: float, time: float) -> bool:  # noqa: N802
        """Move with a velocity in the base, m/s and rad/s; the hand's own frame is what is turned here."""
        back = self.hand[:3, :3].T
        self._speed = np.concatenate([back @ np.array(speed[:3]), back @ np.array(speed[3:])])
        self.fastest = max(self.fastest, float(np.linalg.norm(speed[:3])))
        return not self.isProtectiveStopped()

    def speedStop(self, deceleration: float = 10.0) -> None:  # noqa: N802
        """Stand."""
        self._speed = np.zeros(6)

    def getTimestamp(self) -> float:  # noqa: N802
        """s since the controller was started."""
        return self.clock

    def initPeriod(self) -> float:  # noqa: N802
        """When a period begins."""
        return self.clock

    def waitPeriod(self, begun: float) -> None:  # noqa: N802
        """Wait for its end; here, that makes time pass."""
        if not self.isProtectiveStopped():
            self.hand = apply_twist(self.hand, self._speed, 0.02)
        self.clock = begun + 0.02

    def setWatchdog(self, min_frequency: float) -> bool:  # noqa: N802
        """Stop by itself when it hears nothing for longer: nothing to do where time stands still meanwhile."""
        return True

    def kickWatchdog(self) -> bool:  # noqa: N802
        """A sign of life."""
        return True

    def stopScript(self) -> None:  # noqa: N802
        """Let go of the arm."""


class PretendCamera:
    """A camera on the hand of a `PretendArm`: 12 images a second."""

    def __init__(self, arm: PretendArm) -> None:
        self._arm, self._last = arm, -1.0

    def newest(self) -> np.ndarray | None:
        """(480, 640) uint8, or None where there is none that was not given before."""
        if self._arm.clock - self._last < 0.079:
            return None
        self._last = self._arm.clock
        camera = np.linalg.inv(self._arm.hand @ MOUNTING)
        corners = (np.column_stack([PLATE, np.zeros(len(PLATE))]) + AT) @ camera[:3, :3].T + camera[:3, 3]
        picture = np.full((4 * HEIGHT, 4 * WIDTH), 210, np.uint8)
        cv2.fillPoly(picture, [np.rint(4.0 * pixels(corners) + 1.5).astype(np.int32)], (70,))
        return cv2.GaussianBlur(cv2.resize(picture, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), (3, 3), 0)


class PretendGripper:
    """Two fingers on the hand of a `PretendArm`, which take a third of a second to close."""

    opening = OPENING

    def __init__(self, arm: PretendArm) -> None:
        self._arm, self._closes = arm, np.inf

    def close(self) -> None:
        """Begin to close."""
        self._closes = self._arm.clock + 0.33

    def open(self) -> None:
        """Begin to open."""
        self._closes = np.inf

    def stopped(self) -> float | None:
        """m between the closed fingertips: the plate's width where it is between them; None while they move."""
        if self._arm.clock < self._closes:
            return None
        tips = TIPS @ self._arm.hand[:3, :3].T + self._arm.hand[:3, 3]
        print("fingertips in mm from the plate's middle:", np.round(1e3 * (tips - AT), 1).tolist())
        if np.abs(tips[:, 2]).max() > 0.005:
            return 0.0
        plate = np.column_stack([PLATE, np.zeros(len(PLATE))]) + AT
        x, y, _ = ((plate - self._arm.hand[:3, 3]) @ self._arm.hand[:3, :3]).T
        x1, y1 = np.roll(x, 1), np.roll(y, 1)
        cut = y * y1 < 0.0  # the edges on the line from one finger to the other
        at = (x + (x1 - x) * y / (y - y1))[cut]
        return float(np.ptp(at)) if cut.any() else 0.0


def fingertips() -> np.ndarray:
    """(2, 2) px, where the images show the fingertips: a person marks them once."""
    back = np.linalg.inv(MOUNTING)
    return pixels(TIPS @ back[:3, :3].T + back[:3, 3])


def pixels(points: np.ndarray) -> np.ndarray:
    """(N, 2) px of points (N, 3) m in the camera's frame."""
    return FOCAL * points[:, :2] / points[:, 2:] + ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
