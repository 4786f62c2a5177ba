# SPDX-License-Identifier: Apache-2.0
"""Odd messages to the live page's WebSocket and odd requests to its server. Asked is one line for each.

    python tests/fuzz/live_messages.py --seconds 600 --seed 1

The same seed sends the same messages.
"""

import contextlib
import json
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import harness
from grasptrack.io.sources import open_source
from grasptrack.live.commands import COMMANDS
from grasptrack.live.server import PageServer
from grasptrack.live.session import LiveSession
from grasptrack.live.settings import Settings
from harness import Finding

FIELDS = ("image", "x", "y", "on", "width", "height", "points", "number", "paused", "value", "count", "step", "point")
FIELDS += ("opening_m", "beyond_m", "symmetric", "do")
STEPS = ("start", "hover", "add", "close", "move", "clear")
SECRET = "what no page may show"
PATHS = ("/", "/page/", "/files/", "/socket", "/files/grasps.csv", "/page/app.js")
PIECES = (
    "..", "%2e%2e", "/", "%2f", "\\", "%5c", "secret.txt", "%00", "grasps.csv", "?token=", "#", ";", "é", "%ff", "//", "*", ":",
)  # fmt: skip
METHODS = ("GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "TRACE", "G\x00T", "get")
HEADERS = ("Host", "Origin", "Cookie", "Content-Length", "Transfer-Encoding", "Upgrade", "Connection", "Range", "X")
WORDS = (
    "", "a", "-1", "99999999999999999999", "chunked", "websocket", "http://evil.example", "null",
    "127.0.0.1", "\x7f", "[::1", "=;,", "keep-alive",
)  # fmt: skip
ALIVE_SECONDS = 20.0


def odd_value(rng: np.random.Generator, depth: int = 0) -> Any:
    """A JSON value, now and then a good one."""
    kind = int(rng.integers(0, 14))
    if depth < 3 and kind == 0:
        return [odd_value(rng, depth + 1) for _ in range(int(rng.integers(0, 6)))]
    if depth < 3 and kind == 1:
        return {str(rng.choice(FIELDS)): odd_value(rng, depth + 1) for _ in range(int(rng.integers(0, 4)))}
    if kind == 2:
        return [[float(rng.uniform(-50, 400)), float(rng.uniform(-50, 300))] for _ in range(int(rng.integers(0, 12)))]
    if kind == 3:
        return float(rng.choice([0.0, -0.0, 1e-300, 1e300, float("inf"), float("nan"), -1e6, 1e6]))
    if kind == 4:
        return int(rng.choice([0, 1, 2, 3, -1, 2**31, 2**53, 2**62]))
    if kind == 5:
        return bool(rng.integers(0, 2))
    if kind == 6:
        return None
    if kind == 7:
        return str(rng.choice(STEPS))
    if kind == 8:
        return "x" * int(rng.integers(0, 300))
    return float(rng.uniform(0, 320)) if kind % 2 else int(rng.integers(0, 12))


def odd_message(rng: np.random.Generator) -> str | bytes:
    """A message that may be a command, or nothing of the kind."""
    if rng.random() < 0.15:
        return bytes(rng.integers(0, 256, int(rng.integers(0, 200)), dtype=np.uint8))
    name = str(rng.choice([*COMMANDS, "drawn", "no such command"]))
    fields = COMMANDS[name].__dataclass_fields__ if name in COMMANDS else {"number": None}
    content = {"do": name, **{field: odd_value(rng) for field in fields if rng.random() < 0.9}}
    if rng.random() < 0.15:
        content[str(rng.choice(FIELDS))] = odd_value(rng)
    text = json.dumps(content)
    if rng.random() < 0.2:
        at = int(rng.integers(0, len(text)))
        text = text[:at] + str(rng.choice(["{", "[" * 500, '"', "\\", "\x00", "9" * 5000, ","])) + text[at + 1 :]
    return text


def odd_request(rng: np.random.Generator, port: int) -> bytes:
    """An HTTP request, well formed for the most part."""
    path = str(rng.choice(PATHS)) + "".join(str(p) for p in rng.choice(PIECES, int(rng.integers(0, 6))))
    lines = [f"{rng.choice(METHODS)} {path} HTTP/1.{int(rng.integers(0, 3))}"]
    if rng.random() < 0.8:
        lines.append(f"Host: 127.0.0.1:{port}")
    lines += [f"{rng.choice(HEADERS)}: {rng.choice(WORDS)}" for _ in range(int(rng.integers(0, 4)))]
    data = ("\r\n".join(lines) + "\r\n\r\n").encode("utf-8")
    if rng.random() < 0.2:
        at = int(rng.integers(0, len(data)))
        data = data[:at] + bytes(rng.integers(0, 256, 3, dtype=np.uint8)) + data[at:]
    return data


def answer_to(port: int, data: bytes) -> bytes:
    """What a server says to bytes before it closes, or for half a second."""
    answer = b""
    with socket.create_connection(("127.0.0.1", port), 10) as link, contextlib.suppress(OSError):
        link.settimeout(0.5)
        link.sendall(data)
        link.shutdown(socket.SHUT_WR)
        while piece := link.recv(65536):
            answer += piece
    return answer


def why_wrong(answer: bytes) -> str:
    """What is wrong with an answer; empty where nothing is."""
    if SECRET.encode() in answer:
        return "a file that is not the run's was served"
    if b"Traceback" in answer or answer.startswith(b"HTTP/1.1 5"):
        return f"the server failed: {answer[:80]!r}"
    return ""


class Target:
    """A session on a few drawn images and its page, with a file beside them that nobody may see."""

    def __init__(self, folder: Path) -> None:
        frames = folder / "in"
        frames.mkdir(parents=True)
        corners = np.array([[90, 75], [230, 80], [224, 124], [140, 120], [136, 184], [84, 180]], np.int32)
        for k in range(3):
            image = np.full((240, 320), 200, np.uint8)
            cv2.fillPoly(image, [corners + k], 60, cv2.LINE_AA)
            cv2.imwrite(str(frames / f"{k}.png"), cv2.GaussianBlur(image, (0, 0), 0.8))
        (folder / "run").mkdir()
        (folder / "secret.txt").write_text(SECRET)
        (folder / "run" / "secret.txt").write_text(SECRET)
        self.session = LiveSession(open_source(str(frames), fps=25.0), Settings(), folder / "run", pace=False)
        self.server = PageServer(self.session)
        self.session.start()
        self.server.start()

    def send(self, message: str | bytes) -> str:
        """What is wrong after a message; empty where nothing is."""
        with connect(f"ws://127.0.0.1:{self.server.port}/socket", max_size=None) as link:
            with contextlib.suppress(ConnectionClosed):
                link.send(message)
            link.send(json.dumps({"do": "no such command"}))
            while True:  # answers come in order: the last one is to what was sent last
                said = link.recv(timeout=ALIVE_SECONDS)
                if isinstance(said, bytes):
                    continue
                line = json.loads(said).get("error")
                if line is not None and ("\n" in line or len(line) > 500):
                    return f"not one short line: {line[:80]!r}"
                if line is not None and "no such command" in line:
                    return ""

    def check(self) -> str:
        """Why the session is not as it should be; empty where it is."""
        shown = self.session.shown
        if not self.session.is_running or "internal error" in shown.notice[1]:
            return f"the session failed: {shown.notice[1]}"
        return "" if "\n" not in shown.notice[1] else f"not one line: {shown.notice[1]!r}"

    def close(self) -> None:
        """End both."""
        self.server.stop()
        self.session.stop()


def fuzz(target: Target, seed: int) -> Iterator[tuple[str, Finding | None]]:
    """Messages and requests without end, by kind, and what was found with each."""
    case = 0
    while True:
        rng = np.random.default_rng((seed, case))
        if rng.random() < 0.6:
            kind, sent = "message", odd_message(rng)
            try:
                wrong = target.send(sent)
            except (TimeoutError, OSError, ConnectionClosed) as error:
                wrong = f"no answer: {type(error).__name__}: {error}"
        else:
            kind, sent = "request", odd_request(rng, target.server.port)
            wrong = why_wrong(answer_to(target.server.port, sent))
        wrong = wrong or target.check()
        yield kind, None if not wrong else Finding(case, repr(sent)[:300], wrong)
        case += 1


def main() -> int:
    """Fuzz for a while, print counts and findings; status 1 where there is a finding."""
    asked = harness.options(__doc__, count=(10**9, "messages and requests at most"))
    with tempfile.TemporaryDirectory() as folder:
        target = Target(Path(folder))
        status = harness.tell(fuzz(target, asked.seed), asked, "messages and requests to the live page")
        target.close()
    return status


if __name__ == "__main__":
    raise SystemExit(main())
