# SPDX-License-Identifier: Apache-2.0
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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import grasptrack as gt
from grasptrack.servo.camera import pose_of, rotation_matrix

LIMITS = gt.Limits(linear=0.05, angular=0.3, linear_acceleration=0.25, angular_acceleration=1.0)
PERIOD = 0.02  # s of a period of control: 50 Hz


class Camera:
    """The newest image of any source; the one before it is dropped, so that no image waits."""

    def __init__(self, source: str) -> None:
        self._source, self._image, self._lock = gt.open_source(source), None, threading.Lock()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for frame in self._source:
            with self._lock:
                self._image = frame.image

    def newest(self) -> np.ndarray | None:
        """The image, or None where there is none that was not given before."""
        with self._lock:
            image, self._image = self._image, None
        return image


class Gripper:
    """Put your gripper's driver here."""

    opening = 0.085

    def close(self) -> bool:
        """Close, and say whether something is held: grippers tell by their last position or current."""
        raise NotImplementedError("put your gripper's driver into examples/07_ur.py")


def pose_matrix(pose: list[float]) -> np.ndarray:
    """(4, 4) of x, y, z and a rotation vector, as UR arms tell poses."""
    return pose_of(rotation_matrix(pose[3:]), np.array(pose[:3]))


def in_base(hand: np.ndarray, twist: np.ndarray) -> list[float]:
    """A twist of the hand's frame as `speedL` takes it: the same motion of the same point, its axes those of the base."""
    return [*(hand[:3, :3] @ twist[:3]).tolist(), *(hand[:3, :3] @ twist[3:]).tolist()]


def grasp(control: Any, receive: Any, camera: Any, gripper: Any, fingertips_px: ArrayLike) -> gt.GraspServo:
    """Run one approach; whatever ends it, the arm stands afterwards."""
    tracker = gt.GraspTracker(fingers=2)
    servo = gt.GraspServo(gt.Goal.fingertips(fingertips_px, gripper.opening), dof=4, limits=LIMITS, time_limit=90.0)
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
            if receive.isProtectiveStopped():
                print("the arm has stopped itself: look why, release it on the pendant, and begin anew")
                servo.touched()
                break
            if command.close:
                control.speedStop()
                servo.closed(gripper.close())
                break
            control.speedL(in_base(hand, command.twist), LIMITS.linear_acceleration, PERIOD)
            control.kickWatchdog()
            control.waitPeriod(begun)
    finally:
        control.speedStop()
    print(servo.state, "-", servo.reason)
    return servo


def main() -> None:
    """The pretended arm, or the one at the address that is given."""
    if len(sys.argv) == 1:
        from pretend_arm import PretendArm, PretendCamera, PretendGripper, fingertips

        arm = PretendArm()
        grasp(arm, arm, PretendCamera(arm), PretendGripper(arm), fingertips())
        return
    from rtde_control import RTDEControlInterface  # pyright: ignore[reportMissingImports]
    from rtde_receive import RTDEReceiveInterface  # pyright: ignore[reportMissingImports]

    address, source, tips = sys.argv[1:]
    control = RTDEControlInterface(address)
    try:
        grasp(control, RTDEReceiveInterface(address), Camera(source), Gripper(), np.loadtxt(tips, delimiter=","))
    finally:
        control.stopScript()


if __name__ == "__main__":
    main()
