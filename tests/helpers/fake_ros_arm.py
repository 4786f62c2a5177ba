# SPDX-License-Identifier: Apache-2.0
"""An arm in the stand-in for ROS 2: it goes by the newest twist as MoveIt Servo does, and tells tf where its hand is."""

from __future__ import annotations

import socket
import threading
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.io.bridges.base import Bridge, BridgedArm, run_bridge
from grasptrack.servo.camera import apply_twist, pose_of, quaternion_of
from stub_ros import Clock, World

TIMEOUT_S = 0.1
"""MoveIt Servo's `incoming_command_timeout`."""
STEP_S = 0.005
TOPIC, FRAME = "/servo_node/delta_twist_cmds", "tool0"
START = pose_of(np.diag([1.0, -1.0, -1.0]), (0.4, -0.2, 0.3))


class RunningClock(Clock):
    """That of this machine."""

    nanoseconds = property(lambda self: time.time_ns(), lambda self, _: None)  # type: ignore[assignment]


class FakeRosArm:
    """Moves the hand of a world; another process cannot see that, so its bridge runs in a thread.

    Attributes:
        hand: (4, 4), where the hand is now.
        twist: what moves it now, (6,).
        orders: when each twist came, s of `time.perf_counter`, and what it says.
        tells: whether tf goes on.
    """

    def __init__(self, monkeypatch: Any) -> None:
        self.world = World()
        self.world.clock = RunningClock(self.world.messages)
        self.world.install(monkeypatch)
        self.world.spin = lambda: time.sleep(STEP_S)
        self.hand, self.twist, self.tells, self._over = START.copy(), np.zeros(6), True, False
        self.orders: list[tuple[float, Any]] = []
        self._tell()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End."""
        self._over = True
        self._thread.join()

    def _run(self) -> None:
        last = time.perf_counter()
        while not self._over:
            time.sleep(STEP_S)
            now = time.perf_counter()
            for node in self.world.nodes:
                if TOPIC in node.publishers:
                    self.orders += [(now, message) for message in node.publishers[TOPIC].sent[len(self.orders) :]]
            if not self.orders or now - self.orders[-1][0] > TIMEOUT_S:
                self.twist = np.zeros(6)
            else:
                self.twist = twist_in(self.orders[-1][1])
            self.hand = apply_twist(self.hand, self.twist, now - last)
            if self.tells:
                self._tell()
            last = now

    def _tell(self) -> None:
        place, turn = (SimpleNamespace(**dict(zip("xyzw", v.tolist(), strict=False))) for v in (
            self.hand[:3, 3], quaternion_of(self.hand[:3, :3])
        ))  # fmt: skip
        self.world.transform_ns = time.time_ns()
        self.world.transform = SimpleNamespace(translation=place, rotation=turn)


def twist_in(message: Any) -> NDArray[np.float64]:
    """(6,) m/s and rad/s of a TwistStamped."""
    told = message.twist
    return np.array([getattr(part, axis) for part in (told.linear, told.angular) for axis in "xyz"])


class ThreadedArm(BridgedArm):
    """An arm whose bridge runs in a thread of this process."""

    def __init__(self, bridge: Bridge) -> None:
        super().__init__("ros2:", bridge)

    def open_link(self) -> socket.socket:
        mine, other = socket.socketpair()
        threading.Thread(target=run_bridge, args=(self._bridge, other), daemon=True).start()
        if why := self._read_greeting(mine):
            mine.close()
            raise OSError(why)
        return mine
