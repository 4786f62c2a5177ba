# SPDX-License-Identifier: Apache-2.0
"""Some of the random call sequences and of the approaches in which something fails; and a judge that finds what is wrong."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import grasptrack as gt
import servo_calls
import servo_images
from servo_bench import Bench
from servo_judge import Judge
from servo_trial import Answers, Trial


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


def test_what_is_found_is_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    found = servo_calls.Finding("below the table", "--only 3", "1 mm")
    ran = servo_calls.Ran(servo_calls.Counter({"sequences": 1}), [found])
    monkeypatch.setattr(servo_calls, "every", lambda *a: iter([ran]))
    monkeypatch.setattr("sys.argv", ["servo_calls"])
    assert servo_calls.main() == 1
    told = capsys.readouterr().out
    assert "--seed 1 --only 3: below the table" in told and "1 findings" in told
