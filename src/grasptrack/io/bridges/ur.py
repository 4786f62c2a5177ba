# SPDX-License-Identifier: Apache-2.0
"""Arms of Universal Robots through ur_rtde: `speedL` in the base's axes, under a watchdog of the controller's. Extra `ur`."""

from __future__ import annotations

import contextlib
import socket
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from grasptrack.errors import InputError, install_hint
from grasptrack.io.arms import RETRY, SILENCE, Order, Report
from grasptrack.io.base import Source
from grasptrack.io.bridges.base import BridgedArm, parse_arm_url
from grasptrack.plugins import import_extra, is_installed
from grasptrack.servo.camera import pose_of, rotation_matrix, twist_in_base
from grasptrack.servo.watchdog import Limits
from grasptrack.typing import Floats

PORT = 30004
"""Of the controller's real-time data exchange."""
RATE = 125.0
"""Hz at which the arm tells its state: what controllers of all series can."""
ACCELERATION = Limits().linear_acceleration
"""m/s^2 of `speedL`; twists come within the servo's own limits."""
NO_PIN = -1
PINS = 8
"""Digital inputs and outputs of the standard's."""
NORMAL_SAFETY, RUNNING = (1, 2), 7
SAFETY = {
    3: "a protective stop: look why, and release it on the pendant", 4: "it is in recovery mode",
    5: "a safeguard stop", 6: "an emergency stop of the system", 7: "an emergency stop of the robot",
    8: "a violation of a safety limit", 9: "a fault of the safety system",
}  # fmt: skip
"""Modes of the safety by their numbers; beside the normal one, a reduced one (2) lets it move."""
ROBOT = {
    -1: "no controller", 0: "disconnected", 1: "the safety settings are to be confirmed", 2: "booting", 3: "power is off",
    4: "power is on, the brakes are not released", 5: "the brakes are not released", 6: "it is moved by hand",
}  # fmt: skip
_FORM = "ur:HOST, as ur:192.0.2.10"


def open_ur(url: str, source: Source) -> BridgedArm:
    """The arm at ur:HOST, whose tool centre point is the hand's frame.

    Settings: `gripper`, the number 0 to 7 of the digital output that closes the fingers while it is on; `held`, that of the
    digital input that is on while something is held.

    Raises:
        InputError: ur_rtde is missing, the URL is none, or no arm answers.
    """
    address = parse_arm_url(url, _FORM, {"gripper": NO_PIN, "held": NO_PIN})
    pins = address.settings
    if not address.host or address.port or address.path or not all(NO_PIN <= pin < PINS for pin in pins.values()):
        raise InputError(
            f'an arm by Universal Robots is {_FORM}, with gripper and held from 0 to 7, not "{url}"', url=url
        )
    if not is_installed("rtde_control"):
        raise InputError(f'"{url}" needs ur_rtde: {install_hint("ur")}', url=url)
    return BridgedArm(url, UrBridge(address.host, **pins))


@dataclass
class UrBridge:
    """The controller of an arm.

    Args:
        host: of the controller.
        gripper: digital output that closes the fingers; `NO_PIN` for none.
        held: digital input that tells that something is held; `NO_PIN` for none.
    """

    host: str
    gripper: int = NO_PIN
    held: int = NO_PIN
    _control: Any = field(default=None, init=False)

    def reach_arm(self) -> None:
        """Read its state and, where nothing keeps it from moving, start ur_rtde's program on it."""
        with contextlib.closing(socket.create_connection((self.host, PORT), RETRY)):
            pass  # ur_rtde would wait for minutes
        self._receive: Any = import_extra("rtde_receive", "ur", "an arm").RTDEReceiveInterface(
            self.host, RATE, ["timestamp", "actual_TCP_pose", "safety_mode", "robot_mode", "actual_digital_input_bits"]
        )
        self._io: Any = None
        if self.gripper != NO_PIN:
            self._io = import_extra("rtde_io", "ur", "an arm").RTDEIOInterface(self.host)
        self._stamp, self._came = 0.0, time.perf_counter()
        while not self._receive.getTimestamp():
            if time.perf_counter() - self._came > RETRY:
                raise OSError("it does not tell its state")
            time.sleep(1.0 / RATE)
        self._moves = self._closing = self._interrupted = False
        if not self._why_not():
            self._start_program()

    def exchange_order(self, order: Order) -> tuple[Floats, Report]:
        """Speed of the tool for an order that is enabled, else a stop; the controller's watchdog is fed."""
        told, stamp = self._receive.getActualTCPPose(), self._receive.getTimestamp()
        now = time.perf_counter()
        if stamp != self._stamp:
            self._stamp, self._came = stamp, now
        elif now - self._came > SILENCE:
            raise OSError("its state does not come any more")
        pose = pose_of(rotation_matrix(told[3:]), np.array(told[:3]))
        if why := self._why_not():
            stopped = why if self._moves else ""
            self._moves, self._interrupted = False, self._control is not None
            if self._control is not None:  # were its program let go on, it would go on with the last speed
                self._control.speedL([0.0] * 6, ACCELERATION, 1.0 / RATE)
            return pose, Report(stopped=stopped, not_ready=why)
        if self._interrupted:
            raise OSError("it had stopped: its program begins anew")
        if self._control is None:
            self._start_program()
        if not self._control.isProgramRunning():
            raise OSError("the program on it has ended, by its watchdog or on the pendant")
        if order.enabled:
            self._moves = True
            if not self._control.speedL(twist_in_base(pose, order.twist).tolist(), ACCELERATION, 1.0 / RATE):
                raise OSError("it takes no command")
        else:
            if self._moves:
                self._moves = False
                self._control.speedStop()
            self._control.kickWatchdog()  # beside a speed, which feeds it too, it might be read in its place
        return pose, self._use_gripper(order)

    def release_arm(self) -> None:
        """Stop, and end the program on it."""
        with contextlib.suppress(Exception):  # not opened, or lost: then its watchdog stops it
            if self._control is not None and self._receive.isConnected():
                self._control.speedStop()
                self._control.stopScript()

    def _start_program(self) -> None:
        self._control = import_extra("rtde_control", "ur", "an arm").RTDEControlInterface(self.host, RATE)
        if not self._control.setWatchdog(1.0 / SILENCE):
            raise OSError("it sets no watchdog")

    def _why_not(self) -> str:
        """Why it cannot be moved, by its own account."""
        safety, mode = self._receive.getSafetyMode(), self._receive.getRobotMode()
        if safety not in NORMAL_SAFETY:
            return SAFETY.get(safety, f"its safety is in mode {safety}")
        return "" if mode == RUNNING else ROBOT.get(mode, f"it is in mode {mode}")

    def _use_gripper(self, order: Order) -> Report:
        if self._io is not None and (order.close or order.open):
            self._io.setStandardDigitalOut(self.gripper, order.close)
            self._closing = order.close
        if self._closing and self.held != NO_PIN and self._receive.getActualDigitalInputBits() >> self.held & 1:
            self._closing = False
            return Report(held=True)
        return Report()
