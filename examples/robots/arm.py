# SPDX-License-Identifier: Apache-2.0
"""A stand-in for an arm, to try `grasptrack live SOURCE --servo FILE` with: arm = "tcp://127.0.0.1:5556". It is in here alone.

It shows what the program on a robot has to do: answer each line with the pose of the hand and the line's number, and stand
where no line has come for 0.2 s. No robot was moved by it.

python examples/robots/arm.py 5556
"""

import contextlib
import json
import socket
import sys
import threading
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.servo.camera import apply_twist, pose_of

SILENCE_S = 0.2
"""Without a line for so long the arm stands, whoever is to blame."""
STEP_S = 0.005
"""Of the motion."""
START = pose_of(np.diag([1.0, -1.0, -1.0]), (0.4, -0.2, 0.3))


class StandInArm:
    """Listens at a port of this machine, and moves a hand that nobody sees.

    Args:
        port: 0 takes a free one.
        hand: (4, 4), where the hand is at the start, in the base.

    Attributes:
        hand: where it is now.
        lines: when each line came, s of `time.perf_counter`, and what it said.
        answers: whether it answers; one that does not is lost.
    """

    def __init__(self, port: int = 0, hand: NDArray[np.float64] = START) -> None:
        self.hand, self.answers = hand, True
        self.lines: list[tuple[float, dict[str, Any]]] = []
        self._twist, self._came = np.zeros(6), 0.0
        self._lock, self._over = threading.Lock(), False
        self._listener = socket.create_server(("127.0.0.1", port))
        self.url = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._link: socket.socket | None = None
        self._threads = [threading.Thread(target=each, daemon=True) for each in (self._serve_lines, self._move)]
        for thread in self._threads:
            thread.start()

    def hang_up(self) -> None:
        """Lose the connection; another one is taken."""
        with contextlib.suppress(OSError):  # it may have ended
            if self._link is not None:
                self._link.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End."""
        self._over = True
        self.hang_up()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for thread in self._threads:
            thread.join()

    def _serve_lines(self) -> None:
        while not self._over:
            try:
                self._link, _ = self._listener.accept()
                self._link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with self._link, self._link.makefile("rb") as stream:
                    for text in stream:
                        self._obey_line(self._link, json.loads(text))
            except OSError:
                continue

    def _obey_line(self, link: socket.socket, line: dict[str, Any]) -> None:
        now = time.perf_counter()
        self.lines.append((now, line))
        with self._lock:
            self._twist, self._came = np.array(line["twist"]), now
            answer: dict[str, Any] = {"sequence": line["sequence"], "pose": self.hand.tolist()}
        if line["close"]:
            answer["held"] = True  # a real gripper answers later, and may say opening_m instead
        if self.answers:
            link.sendall(json.dumps(answer).encode() + b"\n")

    def _move(self) -> None:
        last = time.perf_counter()
        while not self._over:
            time.sleep(STEP_S)
            now = time.perf_counter()
            with self._lock:
                if now - self._came < SILENCE_S:
                    self.hand = apply_twist(self.hand, self._twist, now - last)
            last = now


if __name__ == "__main__":
    arm = StandInArm(int(sys.argv[1]))
    print(f"a stand-in for an arm, at {arm.url}")
    while True:
        time.sleep(1.0)
        print("hand in mm:", np.round(1e3 * arm.hand[:3, 3]).tolist())
