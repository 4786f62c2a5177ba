# SPDX-License-Identifier: Apache-2.0
"""A servo from one small file: the arm, the goal, and what else `GraspServo` is to know, in TOML."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.files import read_text, read_toml
from grasptrack.servo.closing import Closing
from grasptrack.servo.controller import GraspServo
from grasptrack.servo.goal import Goal
from grasptrack.servo.law import Gain
from grasptrack.servo.loss import LossPolicy
from grasptrack.servo.steering import SLOW
from grasptrack.servo.watchdog import Bounds, Limits

NUMBERS = ("dof", "standoff", "latency", "time_limit", "max_age", "retries")
TABLES: dict[str, Any] = {"limits": Limits, "bounds": Bounds, "gain": Gain, "loss": LossPolicy, "closing": Closing}
"""By name, the classes whose arguments their keys are."""
ANY_GOAL = Goal.taught([(0.0, 0.0), (1.0, 0.0)])
"""With which a servo is made to be told what is wrong with the rest."""


@dataclass(frozen=True)
class ServoSetup:
    """What moves a hand, and how.

    Attributes:
        arm: URL of the arm, as of `grasptrack.io.arms.open_arm`.
        goal: None where a person is to mark it.
        options: others of `GraspServo`, by name.
    """

    arm: str
    goal: Goal | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    @arguments.checked(path=arguments.instance(str, os.PathLike))
    def load(cls, path: str | os.PathLike[str]) -> ServoSetup:
        """The setup that a TOML file holds.

        Keys: arm (a URL), goal (a file of `Goal.save`, beside this one unless its path is absolute), dof, standoff, latency,
        time_limit, max_age and retries as of `GraspServo`; the tables limits, bounds, gain, loss and closing, with the
        arguments of `Limits`, `Bounds`, `Gain`, `LossPolicy` and `Closing` as keys. Limits that are not told are those of
        `grasptrack.servo.steering.SLOW`.

        Raises:
            InputError: the file cannot be read, a key is unknown, or a value is none. The message names the file.
        """
        file = Path(path)
        try:
            return cls._from_content(read_toml(read_text(file, "servo setup")), file.parent)
        except InputError as error:
            raise InputError(f'servo setup "{file}": {error}', **{**error.values, "path": str(file)}) from None

    @classmethod
    def _from_content(cls, content: dict[str, Any], folder: Path) -> ServoSetup:
        _check_keys(content, ("arm", "goal", *NUMBERS, *TABLES), "")
        told: dict[str, Any] = {"limits": SLOW, **{name: content[name] for name in NUMBERS if name in content}}
        for name, kind in TABLES.items():
            if name not in content:
                continue
            if not isinstance(content[name], dict):
                raise InputError(f"{name} is a table, which begins with [{name}], not {content[name]!r}")
            _check_keys(content[name], [each.name for each in fields(kind)], f"{name}.")
            try:
                told[name] = replace(SLOW, **content[name]) if kind is Limits else kind(**content[name])
            except InputError as error:
                raise InputError(f"[{name}] {error}", **error.values) from None
        arm, goal = content.get("arm"), content.get("goal")
        if not isinstance(arm, str):
            raise InputError('needs arm, the URL of an arm in quotes: "sim:", "tcp://HOST:PORT", "ur:HOST" or another')
        if not isinstance(goal, str | None):
            raise InputError(f"goal is the name of a file in quotes, not {goal!r}")
        setup = cls(arm, None if goal is None else Goal.load(folder / goal), told)
        replace(setup, goal=setup.goal or ANY_GOAL).make_servo((1, 1))
        return setup

    def make_servo(self, size: tuple[int, int]) -> GraspServo:
        """A servo for images of (width, height) px.

        Raises:
            InputError: there is no goal yet, or what `GraspServo` raises.
        """
        if self.goal is None:
            raise InputError("there is no goal yet: mark it first")
        return GraspServo(self.goal, size=size, **self.options)


def _check_keys(content: Mapping[str, Any], known: tuple[str, ...] | list[str], table: str) -> None:
    for key in content:
        if key not in known:
            meant = get_close_matches(key, known, 1)
            hint = f'did you mean "{table}{meant[0]}"?' if meant else f"there are {', '.join(known)}"
            raise InputError(f'has no key "{table}{key}"; {hint}', key=key)
