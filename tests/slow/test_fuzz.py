# SPDX-License-Identifier: Apache-2.0
"""Each fuzzer for some seconds: nothing dies, hangs, comes out raw, answers wrongly or grows; what ends badly is counted."""

import ctypes
import random
import signal
import subprocess
import sys
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import damaged_files
import grasptrack as gt
import leaks
import servo_calls
import servo_images
from interruptions import SIGNALS, VERBS, Harness
from long_run import run
from servo_bench import Bench
from servo_judge import Judge
from servo_trial import Answers, Trial

RUN = Path(__file__).parents[1] / "fuzz" / "run.py"
NONE = "0 crash, 0 hang, 0 internal, 0 bad stability, 0 bad contact"


def test_a_seeded_run_finds_nothing(tmp_path: Path) -> None:
    command = [sys.executable, "-W", "ignore", str(RUN), "--seed", "11", "--calls", "10000", "--contours", "2500"]
    ran = subprocess.run([*command, "--keep", str(tmp_path)], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    told = ran.stdout.splitlines()
    assert [line.partition(";")[0] for line in told] == [f"kernel calls: 10000: {NONE}", f"contours: 2500: {NONE}"]


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="this C library does not count what it allocates"
)
def test_kernels_keep_no_memory() -> None:
    command = [sys.executable, "-W", "ignore", leaks.__file__, "--calls", "400"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0 and "1200 calls of each: 0 leaks" in done.stdout, done.stdout + done.stderr


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="this C library does not count what it allocates"
)
def test_a_few_bytes_that_are_kept_now_and_then_are_seen() -> None:
    """In a process of its own: what other tests leave behind goes while it counts."""
    code = f"""
import ctypes
import sys
sys.path[:0] = {sys.path!r}
import leaks

allocate = ctypes.CDLL(None).malloc
allocate.argtypes = [ctypes.c_size_t]
print(leaks.growth(lambda k: allocate(8) if k == 3 else None, 400))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(leaks.__file__).parent, check=True
    )
    assert float(done.stdout) > 0.1


@pytest.mark.filterwarnings("ignore")
def test_a_damaged_file_is_told_in_a_line(tmp_path: Path) -> None:
    found = [finding for _, finding in islice(damaged_files.fuzz(tmp_path, 1), 150)]
    assert [f for f in found if f is not None] == []


def test_the_same_seed_damages_alike() -> None:
    data = [bytes(range(200)), b"x" * 90]
    one, other, third = (damaged_files.damaged(data[0], np.random.default_rng(s), data) for s in (5, 5, 6))
    assert one == other != third


def test_files_that_end_badly_are_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(damaged_files, "command_line", lambda arguments: 1)
    monkeypatch.setattr(sys, "argv", ["damaged_files", "--count", "7"])
    assert damaged_files.main() == 1
    assert "7 damaged files" in capsys.readouterr().out


@pytest.mark.parametrize("verb", VERBS)
def test_whatever_strikes_files_can_be_read_and_what_goes_on_ends_alike(tmp_path: Path, verb: str) -> None:
    if verb.startswith("servo"):
        pytest.importorskip("mujoco", reason="the physical world needs MuJoCo")
    harness, draw = Harness(tmp_path, (verb,)), random.Random(verb)
    seen: list[str] = []
    while not ({"interrupted", "killed"} <= set(seen) and harness.told) and len(seen) < 30:
        # on a busy machine moments are hard to hit
        seen += [harness.interrupt(verb, how, draw.uniform(0.2, 0.9)) for how in SIGNALS]
    seen.append(harness.interrupt(verb, signal.SIGKILL, 60.0))  # it ends before that
    assert not [outcome for outcome in seen if outcome.startswith("bad")], seen
    assert {"interrupted", "killed"} <= set(seen) and seen[-1] == "finished" and harness.told, seen


LARGEST = 0.03
"""Share of the memory by which two halves of a run may differ: what an allocator keeps."""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is looked up in /proc")
@pytest.mark.filterwarnings("ignore")
def test_memory_does_not_grow_with_updates() -> None:
    found = run(1250, 3)
    assert found.counts["tracked"] > 500
    assert all(found.counts[name] for name in ("lost", "refused", "copied", "pickled", "new")), found.counts
    assert found.growth < LARGEST * found.memory[0], found.memory


@pytest.mark.parametrize("approach", range(3))
def test_call_sequences_do_no_harm(approach: int) -> None:
    assert servo_calls.run_approach(7, approach).findings == []


@pytest.mark.parametrize("number", range(len(servo_images.FAULTS)))
def test_a_camera_an_arm_or_a_clock_that_fails_does_no_harm(number: int) -> None:
    assert servo_calls.run_real(7, number).findings == []


def judged(command: Any, faults: tuple[str, ...] = (), calls: int = 60, **attributes: Any) -> set[str]:
    """The kinds of what is found of a servo that answers every call alike."""
    bench = Bench(seed=2)
    servo: Any = SimpleNamespace(state="approaching", reason="", closed=lambda *a, **k: None)
    servo.update = servo.between = lambda *a, **k: command(bench)
    trial = Trial(bench, servo, Answers(), Judge(gt.Limits(), bench.period, bench.period, **attributes))
    rng = np.random.default_rng(0)
    for _ in range(calls):
        trial.call(faults, rng)
    return {f.kind for f in trial.judge.findings}


def says(*twist: float, state: str = "approaching", reason: str = "goes on", **more: Any) -> Any:
    return lambda bench: gt.Command(np.array(twist), state, reason, **more)  # type: ignore[arg-type]


def test_the_judge_finds_what_is_wrong() -> None:
    still, down, up = (0.0,) * 6, (0.0, 0.0, 0.2, 0.0, 0.0, 0.0), (0.0, 0.0, -0.2, 0.0, 0.0, 0.0)
    assert judged(says(*still)) == set()
    assert judged(says(*still), ("none",)) == set()
    assert judged(says(*down), calls=3) == {"beyond the limits"}  # at once
    assert judged(says(*down)) == {"beyond the limits", "below the table"}
    assert judged(says(*up)) == {"beyond the limits", "above the start"}
    assert "moved without a new image" in judged(says(*down), ("none",))
    assert "moved without a new image" in judged(says(*down), ("repeated",))
    assert "moved without a new image" in judged(says(*down), ("time stands", "none"))
    assert "moved by images that do not follow the hand" in judged(says(*down), ("frozen",))
    assert "moved though the arm does not follow" in judged(says(*down), ("arm stands",))
    assert judged(says(*still, reason="")) == judged(says(*still, reason="a\nb")) == {"no reason in one line"}
    assert judged(says(np.nan, *still[1:])) == {"not finite"}
    assert judged(says(*still, state="closing", close=True)) == {
        "closed beside the grasp",
        "closed twice, or opened unasked",
    }
    assert "closed on what is not new, seen and right" in judged(says(*still, state="closing", close=True), ("jump",))
    assert "closed on what is not new, seen and right" in judged(says(*still, state="closing", close=True), ("lost",))
    assert judged(says(*still, state="retreating", open=True), retries=1) == {"closed twice, or opened unasked"}
    assert "not over for ever, or not at rest" in judged(says(*down, state="failed"))
    assert judged(says(*still), ("pose nan",)) == {"malformed, yet taken"}


def test_the_judge_finds_what_is_raised_and_what_begins_anew() -> None:
    def raising(bench: Bench) -> gt.Command:
        raise ZeroDivisionError

    def refusing(bench: Bench) -> gt.Command:
        raise gt.InputError("times go on")

    def reviving(bench: Bench) -> gt.Command:
        return gt.Command(np.zeros(6), "failed" if bench.time < 1.0 else "approaching", "goes on")

    assert judged(raising) == judged(refusing) == {"undocumented exception"}
    assert judged(refusing, ("pose nan",)) == set()
    assert judged(reviving) == {"not over for ever, or not at rest"}


def test_the_same_seed_plays_the_same() -> None:
    whole, again = (servo_calls.run_approach(3, 2) for _ in range(2))
    one = servo_calls.run_approach(3, 2, 2 * servo_calls.CASES + 4)
    assert whole == again
    assert one.counts["sequences"] == 1


def test_approaches_that_end_badly_are_counted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = servo_calls.Finding("below the table", "--only 3", "1 mm")
    ran = servo_calls.Ran(servo_calls.Counter({"sequences": 1}), [found])
    monkeypatch.setattr(servo_calls, "every", lambda *a: iter([ran]))
    monkeypatch.setattr("sys.argv", ["servo_calls"])
    assert servo_calls.main() == 1
    told = capsys.readouterr().out
    assert "--seed 1 --only 3: below the table" in told and "1 findings" in told
