# SPDX-License-Identifier: Apache-2.0
"""Which sightings are gone through again: none of an object that lay elsewhere, and none that tell too little."""

from collections.abc import Sequence
from typing import Any

import pytest

import grasptrack as gt
from grasptrack.servo.observation import Observation
from grasptrack.servo.setup_check import TiltCheck, TiltEstimate
from servo_bench import Bench


@pytest.mark.parametrize("seed", range(3))
def test_a_tilt_is_looked_for_only_where_the_exploratory_moves_are_among_the_sightings(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a part that was pushed aside only a few sightings are left, and those of a hand that goes one way look tilted."""
    begun: list[float] = []
    original = TiltCheck.check_tilt

    def look(self: TiltCheck, seen: Sequence[Observation], *args: Any) -> TiltEstimate | None:
        begun.append(seen[0].time)
        return original(self, seen, *args)

    monkeypatch.setattr(TiltCheck, "check_tilt", look)
    bench = Bench(seed, push=(1.4, 0.04))
    servo = gt.GraspServo(bench.goal(), dof=4)
    assert bench.run(servo).state == "done", servo.reason
    assert begun and max(begun) == min(begun) < 0.2
