# SPDX-License-Identifier: Apache-2.0
"""Sessions of the live page at full speed for as long as asked: memory, open files and threads have to stay what they are.

    python tests/fuzz/long_live.py --seconds 3600 --seed 1

Browsers' part is played by processes that come and go, in order or killed; recordings are begun and ended; people pause,
restart, choose again and change friction and fingers. Between two such rounds nobody looks on and nothing is recorded: then it
is looked at what the process holds. Half of the time is for recordings as MCAP, half for videos.

Memory that rises in a step once and stays may be glibc's, which keeps an arena for each thread: MALLOC_ARENA_MAX=1 leaves one.
"""

import gc
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))

from grasptrack.demo import demo_scene
from grasptrack.live import commands as told
from grasptrack.live.server import PageServer
from grasptrack.live.session import LiveSession
from grasptrack.live.settings import Settings
from harness import options
from long_run import growth_of
from research.studies.live_page import CLIENT, Played
from research.studies.loop import resident_mb

FRAMES = 60
PATIENCE = 60.0
RECORDED_AS = (".mcap", ".mp4")
ROUND = (1.5, 4.0)
"""s of a round."""
ROUNDS = 4
MOST_CLIENTS = 3
FONT = ".ttf"
"""Matplotlib keeps fonts open for each thread that has drawn, 64 at most."""


class Held(NamedTuple):
    """What the process holds while nobody looks on and nothing is recorded."""

    memory_mb: float
    files: int
    threads: int


class LongLive(NamedTuple):
    """What was measured in one session."""

    counts: Counter[str]  # of images, rounds, clients, recordings and commands
    held: list[Held]  # after each round
    left: tuple[int, int]  # files and threads more than before, once the session has ended

    @property
    def findings(self) -> list[str]:
        """Of what there is always more in the last quarter of the rounds than ever in the second."""
        found, quarter = [], len(self.held) // 4
        if quarter:
            for name in ("files", "threads"):
                before = max(getattr(held, name) for held in self.held[quarter : 2 * quarter])
                after = min(getattr(held, name) for held in self.held[-quarter:])
                if after > before:
                    found.append(f"{name} grow: {before} at most, then {after} at least")
        found += [f"{n} {name} are left over" for n, name in zip(self.left, ("files", "threads"), strict=True) if n > 0]
        return found


def held_now() -> Held:
    """By this process, with the threads of libraries."""
    gc.collect()
    status = Path("/proc/self/status").read_text()
    threads = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("Threads"))
    return Held(resident_mb(), len([path for path in open_files() if not path.endswith(FONT)]), threads)


def open_files() -> list[str]:
    """What the descriptors of this process lead to."""
    found = []
    for path in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # that of the listing itself
            found.append(str(path.readlink()))
    return found


class Run:
    """A session with its page, and who looks on.

    Args:
        folder: empty.
        images: played to and fro.
        suffix: of recordings.
        rng: what happens.
    """

    def __init__(self, folder: Path, images: list[np.ndarray], suffix: str, rng: np.random.Generator) -> None:
        self._folder, self._rng = folder, rng
        self.counts: Counter[str] = Counter()
        self.session = LiveSession(
            Played(images), Settings(), folder, at_once=True, pace=False, record_as=suffix, options={"soak": True}
        )
        self.server = PageServer(self.session)
        self.session.start()
        self.server.start()

    def go_round(self) -> None:
        """Have clients come, images recorded and commands given, until all of it is over again."""
        self._until_tracking()
        recorded = f"recording-{self.counts['recordings'] + 1:03d}"
        records = self._rng.random() < 0.8
        if records:
            self.session.send_command(told.Record(True))
            self.counts["recordings"] += 1
        clients = [self._client() for _ in range(int(self._rng.integers(1, MOST_CLIENTS + 1)))]
        until = time.monotonic() + self._rng.uniform(*ROUND)
        while time.monotonic() < until:
            time.sleep(self._rng.uniform(0.2, 0.8))
            self._command()
        for client in clients:
            (client.kill if self._rng.random() < 0.5 else client.terminate)()
            client.wait(PATIENCE)
        self._until_tracking()
        if records:
            self.session.send_command(told.Record(False))
            if not self.session.wait_for(lambda s: any(recorded in name for name in s.files), PATIENCE):
                raise AssertionError(f"{recorded} is not written: {self.session.shown.notice}")
            for path in self._folder.glob(f"{recorded}.*"):
                path.unlink()
        self.counts["rounds"] += 1

    def rest(self, at_least: Held | None) -> Held:
        """What is held once who went has gone; what is closed late is waited for, for a while."""
        until = time.monotonic() + 10.0
        while True:
            held = held_now()
            quiet = not self.server.hub.clients
            if quiet and (at_least is None or (held.files <= at_least.files and held.threads <= at_least.threads)):
                return held
            if time.monotonic() > until:
                return held
            time.sleep(0.1)

    def close(self) -> None:
        """End all."""
        self.counts["images"] = self.session.shown.image
        self.server.stop()
        summary = self.session.stop()
        assert summary is not None and summary.ended == "interrupted", summary

    def _client(self) -> subprocess.Popen[bytes]:
        self.counts["clients"] += 1
        if self._rng.random() < 0.3:  # a page that is loaded and its files fetched
            for name in ("", "page/app.js", "files/run.json", "files/nothing"):
                url = self.server.url.replace("?", f"{name}?")
                with suppress(urllib.error.HTTPError), urllib.request.urlopen(url) as answer:
                    answer.read()
        return subprocess.Popen(
            [sys.executable, "-c", CLIENT, self.server.url], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def _command(self) -> None:
        shown = self.session.shown
        kind = str(self._rng.choice(["pause", "restart", "choose again", "friction", "fingers", "click", "nothing"]))
        self.counts[kind] += 1
        match kind:
            case "pause":
                self.session.send_command(told.Pause(True))
                time.sleep(0.1)
                self.session.send_command(told.Pause(False))
            case "restart":
                self.session.send_command(told.Restart())
            case "choose again":
                self.session.send_command(told.Rechoose())
            case "friction":
                self.session.send_command(told.Friction(float(self._rng.uniform(0.3, 0.9))))
            case "fingers":
                self.session.send_command(told.Fingers(int(self._rng.integers(2, 4))))
            case "click" if shown.result is not None and shown.result.contacts is not None:
                x, y = shown.result.contacts.mean(axis=0).tolist()
                self.session.send_command(told.Pick(shown.image, x, y))
            case _:
                pass

    def _until_tracking(self) -> None:
        """Until it tracks again, whatever people have done."""
        until = time.monotonic() + PATIENCE
        while not self.session.wait_for(lambda s: s.phase == "tracking" and not s.paused, 0.5):
            self.session.send_command(told.Start() if self.session.shown.phase == "choosing" else told.Pause(False))
            if time.monotonic() > until or not self.session.is_running:
                raise AssertionError(f"{self.session.shown.phase}: {self.session.shown.notice}")


def run(seconds: float, seed: int, suffix: str) -> LongLive:
    """Play a session for so long, and for ROUNDS at least, however slow the machine is.

    Args:
        seconds: s.
        seed: of what happens; images come as fast as the machine tracks them, so that no two runs are alike.
        suffix: of its recordings.
    """
    images = [frame.image for frame in demo_scene(FRAMES, colour=False)]
    before = held_now()
    with tempfile.TemporaryDirectory() as folder:
        live = Run(Path(folder), images, suffix, np.random.default_rng(seed))
        held: list[Held] = []
        until = time.monotonic() + seconds
        while time.monotonic() < until or len(held) < ROUNDS:
            live.go_round()
            held.append(live.rest(held[len(held) // 4] if held else None))
        live.close()
    counts = live.counts
    del live
    after = held_now()
    return LongLive(counts, held, (after.files - before.files, after.threads - before.threads))


def main() -> int:
    """Run, and print what was measured; status 1 where something grows."""
    asked = options(__doc__, 600.0)
    bad = 0
    for suffix in RECORDED_AS:
        found = run(asked.seconds / len(RECORDED_AS), asked.seed, suffix)
        print(f"recordings as {suffix}: " + ", ".join(f"{n} {name}" for name, n in sorted(found.counts.items())))
        memory = np.array([held.memory_mb for held in found.held])
        print("resident MB: " + " ".join(f"{m:.0f}" for m in memory) + f"; growth {growth_of(memory):+.1f}")
        for name in ("files", "threads"):
            values = [getattr(held, name) for held in found.held]
            print(f"{name}: {min(values)} to {max(values)}, at the end {values[-1]}")
        for line in found.findings:
            bad += 1
            print(line)
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
