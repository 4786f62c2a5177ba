# SPDX-License-Identifier: Apache-2.0
"""The plain strategies along a trajectory, and how far each was off (Section V). Nothing judges what they answer."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from grasptrack.bench.metrics.errors import ErrorMeasure, error_measure, reversibility_error, sequence_error
from grasptrack.bench.paper.footage import Footage, Seen
from grasptrack.errors import StrategyError, TransferError
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer import strategy_named, transfer
from grasptrack.typing import Floats

Refused = (TransferError, StrategyError)


@dataclass(frozen=True)
class Course:
    """One strategy along one trajectory.

    Attributes:
        footage: object, contours, trajectory.
        strategy: its name.
        carried_on: each frame's grasp is transferred to the next, where the first view's is to every frame else.
        errors: of each frame from the second on, or the reason of the refusal.
    """

    footage: Footage
    strategy: str
    carried_on: bool
    errors: tuple[ErrorMeasure | str, ...]

    @property
    def answered(self) -> tuple[ErrorMeasure, ...]:
        """The frames that were not refused."""
        return tuple(e for e in self.errors if isinstance(e, ErrorMeasure))

    @property
    def sequence(self) -> ErrorMeasure | None:
        """SE over the answered frames; None where there is none."""
        return sequence_error(self.answered) if self.answered else None

    @property
    def reasons(self) -> dict[str, int]:
        """How many frames were refused for which reason, its numbers left out, the most frequent first."""
        listed = [re.sub(r"\d+(\.\d+)?", "…", e) for e in self.errors if isinstance(e, str)]
        return {r: listed.count(r) for r in sorted(set(listed), key=lambda r: (-listed.count(r), r))}


def transfer_and_measure(footage: Footage, strategy: str, carried_on: bool) -> Course:
    """Transfer the grasp to every frame and measure it.

    After a refusal, a grasp that is carried on goes on from the last frame that was answered.
    """
    outlines, contacts = footage.outlines(strategy), footage.contacts(strategy)
    found = transferred_contacts(strategy, outlines, contacts, carried_on)
    errors = tuple(
        answer if isinstance(answer, str) else error_measure(answer, footage.truth(strategy, k), footage.areas[k])
        for k, answer in enumerate(found, start=1)
    )
    return Course(footage, strategy, carried_on, errors)


def transferred_contacts(
    strategy: str, outlines: Sequence[Seen], contacts: Floats, carried_on: bool
) -> list[Floats | str]:
    """(2, 2) px in each outline after the first, or why there are none."""
    chosen, first, rest = strategy_named(strategy), outlines[0], outlines[1:]
    if isinstance(first, str):
        return [first] * len(rest)
    try:
        description: Any = chosen.describe(Grasp(contacts), first)
    except Refused as error:
        return [str(error)] * len(rest)
    found: list[Floats | str] = []
    for outline in rest:
        if isinstance(outline, str):
            found.append(outline)
            continue
        try:
            grasp = chosen.apply(description, outline).grasp
            if carried_on:
                description = chosen.describe(grasp, outline)
            found.append(grasp.contacts)
        except Refused as error:
            found.append(str(error))
    return found


def measure_reversibility(footage: Footage, strategy: str, frame: int) -> ErrorMeasure | str:
    """R_v E between the first frame and another, or why a transfer was refused."""
    outlines = footage.outlines(strategy)
    one, other = outlines[0], outlines[frame]
    if not isinstance(one, View) or not isinstance(other, View):
        return next(o for o in (one, other) if isinstance(o, str))

    def transfer_contacts(start: View, end: View, contacts: Floats) -> Floats:
        return transfer(Grasp(contacts), start, end, strategy).grasp.contacts

    try:
        return reversibility_error(
            footage.contacts(strategy),
            lambda c: transfer_contacts(one, other, c),
            lambda c: transfer_contacts(other, one, c),
            float(footage.areas[0]),
        )
    except Refused as error:
        return str(error)
