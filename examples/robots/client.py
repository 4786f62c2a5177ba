# SPDX-License-Identifier: Apache-2.0
"""Reads results as a robot's program should: one line after another, and stop where none comes in time.

grasptrack track camera:0 --publish 5555
python examples/robots/client.py 127.0.0.1 5555
"""

import json
import socket
import sys

SILENCE_S = 0.2
"""Without a line for so long, or with an image that is older, the robot stands."""


def follow_grasp(host: str, port: int) -> int:
    """Print what a robot would do, until the tracker ends; the number of lines that were read."""
    count = 0
    with socket.create_connection((host, port), timeout=SILENCE_S) as link:
        rest = b""
        while True:
            try:
                piece = link.recv(4096)
            except TimeoutError:
                print("STOP: no line")
                continue
            if not piece:
                print("STOP: the tracker has ended")
                return count
            *lines, rest = (rest + piece).split(b"\n")
            for text in lines[-1:]:  # the newest; older ones are out of date
                line = json.loads(text)
                fresh = line["age_ms"] is not None and line["age_ms"] < 1e3 * SILENCE_S
                if line["may_close"] and fresh:
                    print("may close at", line["contacts"])
                elif line["status"] in ("tracked", "unstable") and fresh:
                    print("approach", line["contacts"], line["notice"] or line["reason_code"])
                else:
                    print("STOP:", line["status"], line["reason"] or "")
            count += len(lines)


if __name__ == "__main__":
    follow_grasp(sys.argv[1], int(sys.argv[2]))
