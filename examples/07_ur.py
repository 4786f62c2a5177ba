# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: D102, N802
"""A UR arm with a camera on its hand closes its gripper on a part: through ur_rtde, or with an arm that is pretended.

    python examples/07_ur.py                                      the pretended arm of examples/pretend_arm.py
    python examples/07_ur.py 192.0.2.10 camera:0 fingertips.csv   a real one: pip install ur_rtde

fingertips.csv holds a line "x,y" for each fingertip of the open gripper, px in the camera's images.

Before the first run on a real arm:
 1. The tool centre point (TCP) that is set on the teach pendant lies between the fingertips, z along the fingers, x from one
    finger to the other. The servo takes the pose of this frame, and its twists are in it.
 2. `Gripper.opening` is the distance of the open fingertips in m, measured with a caliper.
 3. The arm's own safety limits (speed, planes, force) are set on the pendant, whatever is asked for here.
 4. A hand on the emergency stop, and the first approach with `Limits(linear=0.02)`.
 5. The part lies free, and the camera sees it whole from where the arm starts, at about twice the distance of the grasp.
"""

import sys
import threading
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import grasptrack as gt
from grasptrack.servo.camera import pose_of, rotation_matrix, twist_in_base

LIMITS = gt.Limits(linear=0.05, angular=0.3, linear_acceleration=0.25, angular_acceleration=1.0)
PERIOD = 0.02  # s of a period of control: 50 Hz


Image, Floats = NDArray[np.uint8], NDArray[np.float64]


class Receive(Protocol):
    """What is asked of the arm's state, as of `rtde_receive`."""

    def getTimestamp(self) -> float: ...
    def getActualTCPPose(self) -> list[float]: ...
    def isProtectiveStopped(self) -> bool: ...


class Control(Protocol):
    """What the arm is told, as by `rtde_control`."""

    def setWatchdog(self, min_frequency: float) -> object: ...
    def kickWatchdog(self) -> object: ...
    def initPeriod(self) -> Any: ...
    def waitPeriod(self, begun: Any) -> object: ...
    def speedL(self, speed: list[float], acceleration: float, time: float) -> object: ...
    def speedStop(self) -> object: ...
    def stopScript(self) -> object: ...


class Eye(Protocol):
    """A camera: the newest image, or None where there is none that was not given before."""

    def newest(self) -> Image | None: ...


class Hand(Protocol):
    """A gripper.

    `opening` is the distance of its open fingertips in m. `close` and `open` begin and return at once, so that the loop goes on
    meanwhile. `stopped` is the distance at which the closing fingertips came to rest, m; None before.
    """

    opening: float

    def close(self) -> None: ...
    def open(self) -> None: ...
    def stopped(self) -> float | None: ...


class Camera:
    """The newest image of any source; the one before it is dropped, so that no image waits."""

    def __init__(self, source: str) -> None:
        self._source, self._lock = gt.open_source(source), threading.Lock()
        self._image: Image | None = None
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for frame in self._source:
            with self._lock:
                self._image = frame.image

    def newest(self) -> Image | None:
        """The image, or None where there is none that was not given before."""
        with self._lock:
            image, self._image = self._image, None
        return image


class Gripper:
    """Put your gripper's driver here; `Hand` says what is asked of it."""

    opening = 0.085

    def close(self) -> None:
        raise NotImplementedError("put your gripper's driver into examples/07_ur.py")

    open = stopped = close


def pose_matrix(pose: list[float]) -> Floats:
    """(4, 4) of x, y, z and a rotation vector, as UR arms tell poses."""
    return pose_of(rotation_matrix(pose[3:]), np.array(pose[:3]))


def grasp(control: Control, receive: Receive, camera: Eye, gripper: Hand, fingertips_px: Floats) -> gt.GraspServo:
    """Run one approach; whatever ends it, an error or Ctrl-C included, the arm stands afterwards."""
    tracker = gt.GraspTracker(fingers=2)
    goal = gt.Goal.fingertips(fingertips_px, gripper.opening)
    servo = gt.GraspServo(goal, dof=4, limits=LIMITS, time_limit=90.0, retries=1)
    start, told = receive.getTimestamp(), ""
    control.setWatchdog(5.0)  # looking for a lost object takes the tracker up to a tenth of a second
    try:
        while not servo.over:
            begun, time = control.initPeriod(), receive.getTimestamp() - start
            hand, image = pose_matrix(receive.getActualTCPPose()), camera.newest()
            if image is not None:
                command = servo.update(tracker.update(image, time=time), time=time, pose=hand)
            else:
                command = servo.between(time=time, pose=hand)
            if f"{command.state}: {command.reason}" != told:
                told = f"{command.state}: {command.reason}"
                print(f"{time:6.2f} s  {told}")
            if command.open:
                gripper.open()
            if command.close:
                gripper.close()
            elif servo.state == "closing" and (apart := gripper.stopped()) is not None:
                servo.closed(opening=apart)
            if receive.isProtectiveStopped():
                servo.stop("the arm has stopped itself: look why, release it on the pendant, and begin anew")
            elif not control.speedL(twist_in_base(hand, command.twist).tolist(), LIMITS.linear_acceleration, PERIOD):
                servo.stop("the arm takes no commands: is the program on it still running?")
            control.kickWatchdog()
            control.waitPeriod(begun)
    finally:
        control.speedStop()
    print(servo.state, "-", servo.reason)
    return servo


def connect(address: str) -> tuple[Control, Receive]:
    """The arm at an address."""
    from rtde_control import RTDEControlInterface  # pyright: ignore
    from rtde_receive import RTDEReceiveInterface  # pyright: ignore

    return RTDEControlInterface(address), RTDEReceiveInterface(address)  # pyright: ignore


def main() -> None:
    """The pretended arm, or the one at the address that is given."""
    if len(sys.argv) == 1:
        from pretend_arm import PretendArm, PretendCamera, PretendGripper, fingertips

        arm = PretendArm()
        grasp(arm, arm, PretendCamera(arm), PretendGripper(arm), fingertips())
        return
    address, source, tips = sys.argv[1:]
    control, receive = connect(address)
    try:
        grasp(control, receive, Camera(source), Gripper(), np.loadtxt(tips, delimiter=","))
    finally:
        control.stopScript()


if __name__ == "__main__":
    main()
