# SPDX-License-Identifier: Apache-2.0
"""A servo under every order of events: what it was told, and what it did, judged by where its arm is in truth."""

import copy
import math
import pickle
from functools import cache

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

import grasptrack as gt
from servo_bench import Bench
from servo_judge import OVER, Judge
from servo_trial import FALSE, Answers, Trial
from test_servo_loop import nominal_for

LOOSE = ("unsure", "approaching", "converged", "holding", "searching")
NEXT = {
    **dict.fromkeys(LOOSE, (*LOOSE, "failed")),
    "approaching": (*LOOSE, "closing", "failed"),
    "converged": (*LOOSE, "closing", "failed"),
    "closing": ("closing", "retreating", "done", "empty", "failed"),
    "retreating": ("retreating", "searching", "holding", "approaching", "unsure", "failed"),
    **{state: (state,) for state in OVER},
}
"""The states that may follow each."""
INFERRED = ("below the table", "above the start", "closed beside the grasp", "moved by images", "moved though")
"""What `make fuzz` judges: it takes more than a few calls, and whole arms that fail."""
OLD = ("repeated", "flagged", "stale", "reordered", "late")
UNBELIEVED = ("doubtful", "unstable", "unsure", "open_tilt", "lost", "searching")
MOMENTS = ("start", "exploring", "aligning", "converged", "closing")


@cache
def _approach(law: str, retries: int, dof: int) -> dict[str, bytes]:
    """An approach that nothing disturbs, at some moments."""
    bench = Bench(seed=5, dof=dof, noise=0.02, latency=0.03)
    camera = None if law == "online" else nominal_for(bench)
    servo = gt.GraspServo(bench.goal(), dof, latency=0.03, retries=retries, law=law, camera=camera)  # type: ignore[arg-type]
    trial = Trial(bench, servo, Answers(), Judge(servo.limits, 0.04, 0.04, retries))
    kept = {"start": pickle.dumps(trial)}
    rng = np.random.default_rng(0)
    for k in range(400):
        command = trial.call((), rng)
        assert command is not None and not trial.judge.findings, trial.judge.findings
        here = {"exploring": k == 9, "aligning": "aligns" in command.reason, "converged": command.state == "converged"}
        here["closing"] = command.close
        trial.waits = None
        for moment, now in here.items():
            if now and moment not in kept:
                kept[moment] = pickle.dumps(trial)
        if command.close:
            break
    assert set(kept) == set(MOMENTS)
    return kept


class ServoMachine(RuleBasedStateMachine):
    """A servo in the middle of something."""

    @initialize(
        moment=st.sampled_from((*MOMENTS, "converged", "converged")),
        law=st.sampled_from(["online", "online", "nominal"]),
        retries=st.sampled_from([0, 1, 2]),
        dof=st.sampled_from([4, 4, 6]),
    )
    def begin(self, moment: str, law: str, retries: int, dof: int) -> None:
        self.trial: Trial = pickle.loads(_approach(law, retries, dof)[moment])
        self.rng = np.random.default_rng(0)
        self.state = self.trial.servo.state

    # --- what happens -----------------------------------------------------------------------------

    def call(self, *faults: str) -> gt.Command | None:
        """One call, and what has to hold of every one."""
        trial = self.trial
        before = self.state_now()
        command = trial.call(faults, self.rng)
        trial.waits = None  # here somebody tells what came of closing by a rule
        if command is not None:
            assert command.state == trial.servo.state and command.reason == trial.servo.reason
            assert not command.close or (before in ("approaching", "converged") and command.state == "closing")
            assert not command.open or before == "retreating"
            assert command.state not in ("done", "empty", "retreating") or before == command.state
            self.state_now()
        return command

    def state_now(self) -> str:
        """The servo's state, which may follow the one before."""
        state = self.trial.servo.state
        assert state in NEXT[self.state], f"{self.state}, then {state}: {self.trial.servo.reason}"
        self.state = state
        return state

    @rule(times=st.integers(1, 15))
    def images(self, times: int) -> None:
        for _ in range(times):
            self.call()

    @rule()
    def goes_on_until_it_closes(self) -> None:
        for _ in range(150):
            command = self.call()
            if command is not None and (command.close or self.trial.servo.over):
                break

    @rule(what=st.sampled_from(OLD), times=st.integers(1, 8))
    def old_news(self, what: str, times: int) -> None:
        for _ in range(times):
            self.call(what)

    @rule(what=st.sampled_from(UNBELIEVED), times=st.integers(1, 8))
    def not_believed(self, what: str, times: int) -> None:
        for _ in range(times):
            command = self.call(what)
            assert command is not None and not command.close

    @rule(what=st.sampled_from([name for name in FALSE if name not in (*OLD, *UNBELIEVED)]), times=st.integers(1, 12))
    def nonsense(self, what: str, times: int) -> None:
        for _ in range(times):
            self.call(what)
        if what == "other_count":
            assert self.trial.servo.over

    @rule(times=st.integers(1, 20))
    def no_image(self, times: int) -> None:
        for _ in range(times):
            command = self.call("none")
            assert command is not None and not command.close

    @rule(
        what=st.sampled_from(["time stands", "time back", "hour ahead", "hour back", "pause"]), times=st.integers(1, 6)
    )
    def clock_fails(self, what: str, times: int) -> None:
        for _ in range(times):
            assert self.call(what) is not None  # no time that is a number is refused
        self.call()

    @rule(what=st.sampled_from(["pose stuck", "pose stale", "pose jump", "pose inverse", "pose mm", "arm stands"]))
    def arm_fails(self, what: str) -> None:
        for _ in range(3):
            assert self.call(what) is not None

    @rule(what=st.sampled_from(["pose nan", "pose no rotation", "time nan"]))
    def refused_calls_change_nothing(self, what: str) -> None:
        other = copy.deepcopy(self.trial)
        assert self.call(what) is None
        pose, time = self.trial.bench.hand, self.trial.bench.time + self.trial.offsets[-1][1]
        one, two = (copy.deepcopy(t.servo).between(time=time, pose=pose) for t in (self.trial, other))
        assert one == two

    @rule()
    def images_from_the_future_are_refused(self) -> None:
        trial = self.trial
        time = trial.bench.time + trial.offsets[-1][1]
        with pytest.raises(gt.InputError, match="clock"):
            trial.servo.update(trial.bench.result(), time=time, pose=trial.bench.hand, taken=time + 0.001)

    @rule(now=st.sampled_from([False, False, True]))
    def touched(self, now: bool) -> None:
        if not now:  # it ends most stories
            return
        was = self.trial.servo.state
        self.trial.servo.touched()
        assert self.state_now() == (was if was in OVER or was == "closing" else "failed")
        self.call()

    @rule(now=st.sampled_from([False, False, True]))
    def stopped(self, now: bool) -> None:
        if not now:
            return
        was = self.trial.servo.state
        self.trial.servo.stop("a person\npressed a button")
        assert self.state_now() == (was if was in OVER else "failed")
        assert was in OVER or self.trial.servo.reason == "a person pressed a button"
        self.call()

    @rule(held=st.booleans())
    def closed(self, held: bool) -> None:
        was, left = self.trial.servo.state, self.trial.judge.retries - self.trial.judge.openings
        self.trial.servo.closed(held)
        self.expect_after_closing(was, held, left)

    @rule(part=st.booleans())
    def closed_to_an_opening(self, part: bool) -> None:
        trial, was = self.trial, self.trial.servo.state
        width = float(np.linalg.norm(trial.bench.shape[1] - trial.bench.shape[0]))
        left = trial.judge.retries - trial.judge.openings
        trial.servo.closed(opening=width if part else 0.0)
        self.expect_after_closing(was, part, left)

    def expect_after_closing(self, was: str, held: bool, left: int) -> None:
        """What came of closing counts only while it closes."""
        state = self.state_now()
        if was != "closing":
            assert state == was
        elif held:
            assert state == "done"
        else:
            assert state == "retreating" if left else state in ("empty", "failed")
        if state == "retreating" and was == "closing":
            command = self.call()
            assert command is not None and (command.open or command.state == "failed")

    @rule(by=st.sampled_from([copy.deepcopy, lambda servo: pickle.loads(pickle.dumps(servo))]))
    def copied(self, by: object) -> None:
        self.trial.servo = by(self.trial.servo)  # type: ignore[operator]

    # --- what holds -------------------------------------------------------------------------------

    @invariant()
    def nothing_is_wrong(self) -> None:
        if not hasattr(self, "trial"):
            return
        found = [f for f in self.trial.judge.findings if not f.kind.startswith(INFERRED)]
        assert not found, found
        servo = self.trial.servo
        assert servo.over == (servo.state in OVER)
        assert servo.reason and "\n" not in servo.reason and math.isfinite(float(np.sum(self.trial.twist)))

    def teardown(self) -> None:
        """Once over it stays so, and comes to rest."""
        if hasattr(self, "trial") and self.trial.servo.over:
            for _ in range(15):
                self.call()
            self.nothing_is_wrong()
            assert not self.trial.twist.any()


TestServoMachine = ServoMachine.TestCase
TestServoMachine.settings = settings(max_examples=3, stateful_step_count=15)


def test_a_clock_that_stood_after_the_first_image_does_not_lengthen_the_time_without_any() -> None:
    """As the machine once found it: the one interval that was known held the time for which the clock stood."""
    state = ServoMachine()
    state.begin(moment="start", law="online", retries=0, dof=4)
    state.clock_fails(times=6, what="time stands")
    state.no_image(times=9)
    state.no_image(times=11)
    state.nothing_is_wrong()
