# SPDX-License-Identifier: Apache-2.0
"""Runs of the command line, interrupted at random moments by Ctrl-C, SIGTERM, SIGHUP and kill -9, on a disk that gets full, and
two in one folder.

    python tests/fuzz/interruptions.py --count 500 --seed 1

Whatever strikes, every file that is there can be read, all but the last end in one line and status 130 (`live`, which Ctrl-C
ends in good order, in none and 0), and no process is left over. Evaluations and trials are interrupted in one folder until
they are finished; they must then hold what a run without interruption holds. The same seed interrupts alike, but for what
the machine does meanwhile.
"""

import csv
import itertools
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from grasptrack import open_source
from grasptrack.errors import SourceError
from grasptrack.io.limits import HELD
from harness import Finding, options, tell

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL)
FRAMES = 60
PATIENCE = 30.0
"""Seconds within which a run ends that was told to, and its workers after it."""
INTERRUPTED = 130
CROWDED, FULL = 0.08, 0.08
"""Shares of the cases that are two runs in one folder, and a full disk."""


class Verb(NamedTuple):
    """A command that is interrupted.

    Attributes:
        arguments: without --output; "{images}" stands for a folder of images.
        check: what is wrong with its folder, "" for nothing.
        results: what must be the same however often it was interrupted; None where it begins anew.
    """

    arguments: tuple[str, ...]
    check: Callable[[Path], str]
    results: Callable[[Path], object] | None = None
    says: str = ""  # in the line of an interruption that came when something was done


def table(path: Path) -> list[dict[str, str]]:
    """A table, each of whose rows is whole."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert not any(None in row or None in row.values() for row in rows), f"{path.name} ends within a row"
    return rows


def without_times(path: Path) -> list[dict[str, str]]:
    """A table without what the clock says."""
    return [{k: v for k, v in row.items() if "_ms" not in k} for row in table(path)]


def readable(*names: str) -> Callable[[Path], str]:
    """See that files, where they are there, can be read: tables, JSON and pictures."""

    def check(folder: Path) -> str:
        try:
            for path in (found for name in names for found in folder.glob(name)):
                if path.suffix == ".csv":
                    table(path)
                elif path.suffix == ".json":
                    json.loads(path.read_text(encoding="utf-8"))
                elif cv2.imread(str(path)) is None:
                    return f"{path.name} is no picture"
        except (ValueError, AssertionError) as error:
            return f"{path.name}: {error}"
        return ""

    return check


def scored(folder: Path) -> object:
    """What an evaluation found."""
    return {path.name: without_times(path) for path in sorted((folder / "cases").glob("*.csv"))}


def recorded(folder: Path) -> str:
    """See that a run's files and its recording can be read: where the run ended, an image of the recording for each row."""
    path = folder.parent / "images.mcap"
    wrong = readable("grasps.csv", "run.json", "summary.png")(folder)
    if wrong or not (folder / "run.json").exists():
        return wrong
    log = json.loads((folder / "run.json").read_text())
    ended, count, rows = log["ended"], images_in(path), len(table(folder / "grasps.csv"))
    shown = images_in(folder / "overlay.mp4")
    if ended != "running" and not rows == shown == log["frames"]:
        return f"{rows} rows of {log['frames']} frames, {shown} of them in the video"
    whole = count == rows or (ended == "running" and count >= rows - HELD - 2)
    return "" if whole else f"the recording of a run that is {ended} has {count} images for {rows} rows"


def ended(folder: Path) -> str:
    """How a run ended, as it tells itself."""
    path = folder / "run.json"
    return str(json.loads(path.read_text()).get("ended", "")) if path.exists() else ""


def images_in(path: Path) -> int:
    """Images of a recording, as far as it can be read; none where it was killed before its first."""
    try:
        with open_source(path) as source:
            return sum(1 for _ in source)
    except SourceError:
        return 0


LIVE = ("live", "{images}", "--start", "--until-end", "--port", "0")
EVALUATE = "evaluate scenes --methods auto --shapes bracket --frames 8 --seed 3 --workers 1 --disturbances"
VERBS = {
    "track": Verb(("track", "{images}", "--record", "{images}.mcap"), recorded, says="frames; what was computed is in"),
    "live": Verb(LIVE, readable("grasps.csv", "run.json", "summary.png")),
    "inspect": Verb(("inspect", "{images}/000.png", "--runs", "2"), readable("inspect.*", "candidates.png")),
    "servo": Verb(
        ("servo", "--shape", "rectangle", "--seed", "1", "--images", "planar", "--no-video"),
        readable("approach.json", "*.png"),
    ),
    "servo --trials": Verb(
        ("servo", "--trials", "2", "--seed", "3", "--shape", "rectangle", "--workers", "1"),
        readable("trials.*", "failures/*.png"),
        lambda folder: without_times(folder / "trials.csv"),
    ),
    "evaluate": Verb(
        (*EVALUATE.split(), "clean-4dof,noise,bar"),
        readable("evaluation.json", "cases/*.csv", "summary.csv", "summary.json"),
        scored,
        "the same command goes on with it",
    ),
}


def write_images(folder: Path) -> Path:
    """A plate that moves."""
    folder.mkdir(parents=True)
    corners = np.array([[-70, -45], [70, -45], [70, 5], [-20, 5], [-20, 45], [-70, 45]])
    for k in range(FRAMES):
        turn = 0.2 + 0.005 * k
        c, s = np.cos(turn), np.sin(turn)
        at = corners @ np.array([[c, s], [-s, c]]) + [150 + 0.5 * k, 118 + 0.2 * k]
        image = np.full((240, 320), 200, np.uint8)
        cv2.fillPoly(image, [np.rint(at * 16).astype(np.int32)], 60, cv2.LINE_AA, 4)
        cv2.imwrite(str(folder / f"{k:03d}.png"), cv2.GaussianBlur(image, (0, 0), 0.8))
    return folder


class Harness:
    """Interrupts runs, in a folder of its own.

    Args:
        folder: empty.
        verbs: names of those that are interrupted.
    """

    def __init__(self, folder: Path, verbs: tuple[str, ...] = tuple(VERBS)) -> None:
        self._folder, self.verbs = folder, verbs
        self._images = write_images(folder / "images")
        self._whole: dict[str, object] = {}
        self._seconds: dict[str, float] = {}
        self.told: set[str] = set()  # verbs that were interrupted and said of it what they should
        for name in verbs:
            out, began = folder / "whole" / name, time.monotonic()
            subprocess.run(self._command(name, out), check=True, capture_output=True)
            self._seconds[name] = time.monotonic() - began
            results = VERBS[name].results
            self._whole[name] = results(out) if results else None

    def _command(self, name: str, out: Path) -> list[str]:
        arguments = [word.format(images=self._images) for word in VERBS[name].arguments]
        return [sys.executable, "-m", "grasptrack.cli.main", *arguments, "--output", str(out)]

    def interrupt(self, name: str, how: signal.Signals, share: float) -> str:
        """Begin a run, or go on with it, and strike after a share of the time that it takes; how that ended.

        Returns:
            "interrupted", "killed", "finished", "before it began", or "bad: " and what is wrong.
        """
        out, verb = self._folder / name, VERBS[name]
        if verb.results is None:
            shutil.rmtree(out, ignore_errors=True)
        with subprocess.Popen(
            self._command(name, out),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        ) as process:
            with suppress(subprocess.TimeoutExpired):
                process.wait(share * self._seconds[name])
            if process.poll() is None:
                # a terminal sends Ctrl-C to all processes of a group
                (os.killpg if how == signal.SIGINT else os.kill)(process.pid, how)
            try:
                said = process.communicate(timeout=PATIENCE)[1]
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                return "bad: hang"
        status = process.returncode
        if status == -signal.SIGINT and said.startswith("grasptrack: "):
            # Python ends so, which a shell tells as 130, where the signal struck while it ran a string, as for named tuples
            status = INTERRUPTED
        if status == INTERRUPTED and verb.says in said:
            self.told.add(name)
        wrong = self._complaint(name, out, status, how, said) or self._left_over(process.pid)
        if wrong:
            return f"bad: {wrong}"
        if status == 0 and ended(out) == "interrupted":
            self.told.add(name)
            return "interrupted"
        if status == 0:
            if verb.results is not None and verb.results(out) != self._whole[name]:
                return "bad: other results than without interruption"
            shutil.rmtree(out, ignore_errors=True)
            return "finished"
        if status == -signal.SIGKILL:
            return "killed"
        return "interrupted" if status == INTERRUPTED else "before it began"

    def fill(self, name: str, most: int) -> str:
        """A run that can write so many bytes into each of its files; how that ended."""
        out, verb = self._folder / name, VERBS[name]
        shutil.rmtree(out, ignore_errors=True)
        done = subprocess.run(
            self._command(name, out),
            capture_output=True,
            text=True,
            timeout=PATIENCE + 10 * self._seconds[name],
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
        )
        told = done.stderr.count("\n") == 1 and "cannot be written" in done.stderr
        wrong = verb.check(out)
        shutil.rmtree(out, ignore_errors=True)
        if wrong or not (told if done.returncode == 2 else done.returncode == 0 and not done.stderr):
            return f"bad: status {done.returncode} with {most} bytes a file: {wrong or done.stderr[:300]!r}"
        return "no room" if done.returncode else "finished"

    def crowd(self, name: str, share: float) -> str:
        """A run into whose folder another one comes after a share of its time; how the other one ended."""
        out, verb = self._folder / name, VERBS[name]
        shutil.rmtree(out, ignore_errors=True)
        command: Any = {"args": self._command(name, out), "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
        with subprocess.Popen(**command, text=True) as first:
            time.sleep(share * self._seconds[name])
            other = subprocess.run(**command, text=True, timeout=PATIENCE + 10 * self._seconds[name])
            said = first.communicate(timeout=PATIENCE + 10 * self._seconds[name])[1]
        refused = [text.count("\n") == 1 and "another run writes to" in text for text in (said, other.stderr)]
        wrong = verb.check(out)
        if wrong or [2 * told for told in refused] != [first.returncode, other.returncode] or all(refused):
            return f"bad: {first.returncode} {said[:200]!r}, {other.returncode} {other.stderr[:200]!r} {wrong}"
        if verb.results is not None and verb.results(out) != self._whole[name]:
            return "bad: other results than of one run alone"
        return "kept out" if any(refused) else "finished"

    def _complaint(self, name: str, out: Path, status: int, how: signal.Signals, said: str) -> str:
        if status not in (0, INTERRUPTED, -how):
            return f"status {status}: {said[:300]!r}"
        if status == INTERRUPTED and not (said.count("\n") == 1 and said.startswith("grasptrack: interrupted")):
            return f"it said {said[:300]!r}"
        if status == 0 and said:
            return f"finished, and said {said[:300]!r}"
        if status == -how and how != signal.SIGKILL and not self._began_nothing(name, out):
            return f"ended by {how.name}: {said[:300]!r}"
        if status != -signal.SIGKILL and (parts := [p.name for p in out.rglob("*.part")]):
            return f"left {parts}"
        return VERBS[name].check(out)

    @staticmethod
    def _began_nothing(name: str, out: Path) -> bool:
        """Whether the program was still being loaded: Python's own answer to a signal is another."""
        return VERBS[name].results is not None or not out.exists()

    @staticmethod
    def _left_over(group: int) -> str:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            try:
                os.killpg(group, 0)
            except ProcessLookupError:
                return ""
            time.sleep(0.02)
        os.killpg(group, signal.SIGKILL)
        return "a process lives on"


def cases(harness: Harness, seed: int) -> Iterator[tuple[str, Finding | None]]:
    """Interruptions without end: the command and how each ended, and what was wrong."""
    for case in itertools.count():
        draw = random.Random(f"{seed} {case}")
        name, how = harness.verbs[case % len(harness.verbs)], draw.choice(SIGNALS)
        what, share, way = how.name, draw.uniform(0.0, 1.1), draw.random()
        if way < CROWDED:
            what, outcome = "two in one folder", harness.crowd(name, share)
        elif way < CROWDED + FULL:
            what, outcome = "full disk", harness.fill(name, int(10.0 ** draw.uniform(1.0, 5.0)))
        else:
            outcome = harness.interrupt(name, how, share)
        kind = outcome.partition(":")[0]
        yield f"{kind} {name}", Finding(case, f"{name}, {what}", outcome) if kind == "bad" else None


def main() -> int:
    """Interrupt for a while, print counts and findings; status 1 where there is a finding."""
    asked = options(__doc__, 1e9, count=(10**9, "interruptions at most"))
    with tempfile.TemporaryDirectory() as folder:
        return tell(cases(Harness(Path(folder)), asked.seed), asked, "interruptions")


if __name__ == "__main__":
    raise SystemExit(main())
