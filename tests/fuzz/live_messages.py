# SPDX-License-Identifier: Apache-2.0
"""Odd messages to the live page's WebSocket and odd requests to its server. Asked is one line for each.

    python tests/fuzz/live_messages.py --seconds 600 --seed 1 --connections 10000

The same seed sends the same messages. First so many connections come that do not know the token, say nothing, their headers
a byte at a time, nonsense, or whole requests; how long the owner waits meanwhile is printed.
"""

import contextlib
import json
import resource
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from http.client import HTTPException
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from websockets.exceptions import ConnectionClosed, InvalidMessage
from websockets.sync.client import connect

import harness
from grasptrack.io.sources import open_source
from grasptrack.live.commands import COMMANDS, LARGEST, MOST_POINTS
from grasptrack.live.server import PageServer
from grasptrack.live.session import LiveSession
from grasptrack.live.settings import Settings
from harness import Finding

FIELDS = ("image", "x", "y", "on", "width", "height", "points", "number", "paused", "value", "count", "step", "point")
FIELDS += ("opening_m", "beyond_m", "symmetric", "do")
STEPS = ("add", "hover", "close", "move", "back", "clear")
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
FLOODS = {
    "silent": b"",
    "slow headers": b"GET / HTTP/1.1\r\nHost: x\r\nX: ",
    "nonsense": bytes(range(256)),
    "requests": b"GET /?token=wrong HTTP/1.1\r\nHost: x\r\n\r\n",
}
DESCRIPTORS = 1024
"""That the process with the page may have while it is flooded, as is usual."""
FLOOD = """
import resource, socket, sys, time
from contextlib import suppress

most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
said, links = bytes.fromhex(sys.argv[3]), []
for _ in range(int(sys.argv[2])):
    link = socket.socket()
    link.setblocking(False)
    with suppress(BlockingIOError):
        link.connect(("127.0.0.1", int(sys.argv[1])))
    links.append(link)
for piece in (said, *[b"x"] * 4):
    for link in links:
        with suppress(OSError):
            link.send(piece)
    time.sleep(0.5)
"""


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


def large_message(rng: np.random.Generator) -> str:
    """A message about as large as they may be, or an outline of about as many points."""
    if rng.random() < 0.5:
        return "x" * int(rng.choice([LARGEST - 1, LARGEST, LARGEST + 1, 2 * LARGEST, 40 * LARGEST]))
    count = MOST_POINTS + int(rng.integers(-1, 2))
    points = [[int(v) for v in rng.integers(0, 320, 2)] for _ in range(count)]
    return json.dumps({"do": str(rng.choice(["outline", "contacts"])), "image": 1, "points": points})


def odd_request(rng: np.random.Generator, url: str) -> bytes:
    """An HTTP request, well formed for the most part, with the token of the page's address as often as not."""
    _, _, host, token = url.split("/")
    path = str(rng.choice(PATHS)) + "".join(str(p) for p in rng.choice(PIECES, int(rng.integers(0, 6))))
    if rng.random() < 0.5:
        path += token
    lines = [f"{rng.choice(METHODS)} {path} HTTP/1.{int(rng.integers(0, 3))}"]
    if rng.random() < 0.8:
        lines.append(f"Host: {host}")
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

    def link(self) -> Any:
        """A WebSocket to the page, with the token."""
        return connect(self.server.url.replace("http", "ws", 1).replace("/?", "/socket?"), max_size=None)

    def send(self, message: str | bytes) -> str:
        """What is wrong after a message; empty where nothing is."""
        with self.link() as link:
            try:
                link.send(message)
                return self._answer(link)
            except ConnectionClosed:
                if len(message) <= LARGEST:
                    raise
        return ""  # who sends too much is sent away

    def contradict(self, rng: np.random.Generator) -> str:
        """What is wrong after two pages have told it different things at once."""
        kinds: tuple[dict[str, Any], ...] = ({"do": "pause", "paused": True}, {"do": "pause", "paused": False})
        kinds += ({"do": "start"}, {"do": "restart"}, {"do": "rechoose"}, {"do": "choose", "number": 2})
        kinds += ({"do": "fingers", "count": 2}, {"do": "fingers", "count": 3}, {"do": "record", "on": True})
        kinds += ({"do": "record", "on": False}, {"do": "friction", "value": 0.3}, {"do": "friction", "value": 0.8})
        with self.link() as one, self.link() as other:
            for k in rng.integers(len(kinds), size=20):
                (one, other)[int(k) % 2].send(json.dumps(kinds[k]))
            return self._answer(one) or self._answer(other)

    def flood(self, kind: str, count: int) -> tuple[str, float]:
        """What is wrong while so many connections come without the token; and s for which the owner waited at most."""
        command = [sys.executable, "-c", FLOOD, str(self.server.port), str(count), FLOODS[kind].hex()]
        longest, limits = 0.0, resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(DESCRIPTORS, limits[0]), limits[1]))
        try:
            with subprocess.Popen(command) as flooding:
                while flooding.poll() is None:
                    began, wrong = time.monotonic(), "never"
                    while wrong and time.monotonic() < began + ALIVE_SECONDS:  # as who reloads a page
                        with contextlib.suppress(OSError, HTTPException, ConnectionClosed, InvalidMessage):
                            with urllib.request.urlopen(self.server.url, timeout=ALIVE_SECONDS) as page:
                                page.read()
                            with self.link() as link:
                                wrong = self._answer(link)
                    longest = max(longest, time.monotonic() - began)
                    if wrong:
                        return f"the owner was not served while {count} came: {wrong}", longest
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, limits)
        return self.check(), longest

    @staticmethod
    def _answer(link: Any) -> str:
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


KINDS = {"message": 0.58, "request": 0.38, "large message": 0.02, "contradiction": 0.018, "flood": 0.002}
"""How often each is drawn."""
FEW = 300
"""Connections of a flood among others."""


def fuzz(target: Target, seed: int) -> Iterator[tuple[str, Finding | None]]:
    """Messages and requests without end, by kind, and what was found with each."""
    case = 0
    while True:
        rng = np.random.default_rng((seed, case))
        kind, sent, wrong = str(rng.choice(list(KINDS), p=list(KINDS.values()))), b"", ""
        try:
            if kind == "message":
                wrong = target.send(sent := odd_message(rng))
            elif kind == "large message":
                wrong = target.send(sent := large_message(rng))
            elif kind == "contradiction":
                wrong = target.contradict(rng)
            elif kind == "flood":
                wrong = target.flood(name := str(rng.choice(list(FLOODS))), FEW)[0]
                sent = name
            else:
                wrong = why_wrong(answer_to(target.server.port, sent := odd_request(rng, target.server.url)))
        except (TimeoutError, OSError, ConnectionClosed) as error:
            wrong = f"no answer: {type(error).__name__}: {error}"
        wrong = wrong or target.check()
        yield kind, None if not wrong else Finding(case, repr(sent)[:300], wrong)
        case += 1


def main() -> int:
    """Fuzz for a while, print counts and findings; status 1 where there is a finding."""
    asked = harness.options(
        __doc__, count=(10**9, "messages and requests at most"), connections=(0, "of a flood of each kind, first")
    )
    with tempfile.TemporaryDirectory() as folder, contextlib.closing(Target(Path(folder))) as target:
        wrongs = []
        for kind in FLOODS if asked.connections else ():
            wrong, longest = target.flood(kind, asked.connections)
            wrongs += [wrong] if wrong else []
            print(
                f"{asked.connections} connections, {kind}: the owner waited {longest:.2f} s at most {wrong}",
                flush=True,
            )
        status = harness.tell(fuzz(target, asked.seed), asked, "messages and requests to the live page")
    return 1 if wrongs else status


if __name__ == "__main__":
    raise SystemExit(main())
