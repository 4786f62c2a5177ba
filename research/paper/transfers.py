# SPDX-License-Identifier: Apache-2.0
"""Ours and the paper's strategies along a trajectory, and how far each was off (Section V). Nothing judges their answers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from grasptrack.errors import StrategyError, TransferError
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer import STRATEGIES, TransferStrategy, strategy_named
from grasptrack.typing import Floats
from grasptrack_bench.baselines.literal import PAPER
from grasptrack_bench.baselines.paper import Seen
from grasptrack_bench.metrics.errors import ErrorMeasure, error_measure, sequence_error
from research.paper.footage import Footage, nearest_points

Refused = (TransferError, StrategyError)
Answer = Floats | str
"""(k, 2) px, or why there are none."""

Way = Literal["first view", "last frame as prior", "carried on"]
WAYS: dict[Way, str] = {
    "first view": "from the first view to each frame, as a pair of views of which nothing else is known",
    "last frame as prior": "from the first view to each frame, the homography of the last frame that was answered being "
    "the prediction, as Section IV-C has it of consecutive frames",
    "carried on": "from each frame to the next, and after a refusal from the last one that was answered",
}
"""How a grasp goes along a sequence; the text does not say which it is."""

COMPARED = (*STRATEGIES, *PAPER)
"""Ours and the paper's to the letter, in the order of tables."""


def strategy_called(name: str) -> TransferStrategy:
    """Ours, or with `paper-` before it the paper's to the letter."""
    return PAPER[name] if name in PAPER else strategy_named(name)


def ways_of(strategy: str) -> tuple[Way, ...]:
    """The paper's strategies to the letter know no prediction."""
    return tuple(way for way in WAYS if way != "last frame as prior" or strategy not in PAPER)


@dataclass(frozen=True)
class Course:
    """One strategy along one trajectory.

    Attributes:
        footage: object, contours, trajectory.
        strategy: its name.
        way: how the grasp goes along it.
        answers: of each frame from the second on.
        errors: of each answer, or the reason of the refusal.
    """

    footage: Footage
    strategy: str
    way: Way
    answers: tuple[Answer, ...]
    errors: tuple[ErrorMeasure | str, ...]

    @property
    def answered(self) -> tuple[ErrorMeasure, ...]:
        """The frames that were not refused."""
        return tuple(e for e in self.errors if isinstance(e, ErrorMeasure))

    @property
    def setting(self) -> tuple[str, str, str, str, Way]:
        """Object, strategy, kind of contours, motion and way, by name."""
        return self.footage.part.name, self.strategy, self.footage.kind, self.footage.motion, self.way

    def errors_px(self, name: str) -> list[float | None]:
        """`average_px` or `maximum_px` by frame from frame 1 on; None where the strategy refused."""
        return [getattr(e, name) if isinstance(e, ErrorMeasure) else None for e in self.errors]

    @property
    def sequence(self) -> ErrorMeasure | None:
        """SE over the answered frames; None where there is none."""
        return sequence_error(self.answered) if self.answered else None

    @property
    def reasons(self) -> dict[str, int]:
        """How many frames were refused for which reason, its numbers left out, the most frequent first."""
        return count_reasons(e for e in self.errors if isinstance(e, str))


def count_reasons(reasons: Iterable[str]) -> dict[str, int]:
    """How often each reason was given, its numbers left out, the most frequent first."""
    listed = [without_numbers(reason) for reason in reasons]
    return {r: listed.count(r) for r in sorted(set(listed), key=lambda r: (-listed.count(r), r))}


def without_numbers(reason: str) -> str:
    """A reason of a refusal as it is counted."""
    return re.sub(r"\d+(\.\d+)?", "…", reason)


def transfer_and_measure(footage: Footage, strategy: str, way: Way) -> Course:
    """Transfer the grasp to every frame and measure it."""
    outlines, contacts = footage.outlines(strategy), footage.contacts(strategy)
    found = transferred_contacts(strategy_called(strategy), outlines, contacts, way, footage.quantised)
    return Course(footage, strategy, way, tuple(found), measure_answers(footage, strategy, found))


def measure_answers(footage: Footage, strategy: str, answers: Iterable[Answer]) -> tuple[ErrorMeasure | str, ...]:
    """Errors of answers from the second frame on, and why there are none."""
    return tuple(
        a if isinstance(a, str) else error_measure(a, footage.truth(strategy, k), footage.areas[k])
        for k, a in enumerate(answers, start=1)
    )


def transferred_contacts(
    strategy: TransferStrategy, outlines: Sequence[Seen], contacts: Floats, way: Way, quantised: bool = False
) -> list[Answer]:
    """(k, 2) px in each outline after the first, or why there are none."""
    first, rest = outlines[0], outlines[1:]
    if isinstance(first, str):
        return [first] * len(rest)
    try:
        description: Any = strategy.describe(Grasp(contacts), first)
    except Refused as error:
        return [str(error)] * len(rest)
    found: list[Answer] = []
    prior: Floats | None = np.eye(3)
    for outline in rest:
        if isinstance(outline, str):
            found.append(outline)
            continue
        try:
            moved = strategy.apply(description, outline, prior if way == "last frame as prior" else None)
            answer = nearest_points(moved.grasp.contacts, outline) if quantised else moved.grasp.contacts
            if way == "carried on":
                description = strategy.describe(Grasp(answer), outline)
            found.append(answer)
            prior = moved.homography
        except Refused as error:
            found.append(str(error))
    return found


@dataclass(frozen=True)
class Return:
    """A grasp transferred to another frame and back: (2, 2) px where it came back to, or why it did not."""

    footage: Footage
    strategy: str
    frame: int
    answer: Answer

    @property
    def error(self) -> ErrorMeasure | str:
        """R_v E, or why there is none."""
        if isinstance(self.answer, str):
            return self.answer
        return error_measure(self.answer, self.footage.contacts(self.strategy), float(self.footage.areas[0]))


def transfer_and_return(footage: Footage, strategy: str, frame: int) -> Return:
    """The grasp to a frame and back, each way as a pair of views."""
    outlines = footage.outlines(strategy)
    there_and_back = (outlines[0], outlines[frame]), (outlines[frame], outlines[0])
    contacts = footage.contacts(strategy)
    for pair in there_and_back:
        (answer,) = transferred_contacts(strategy_called(strategy), pair, contacts, "first view", footage.quantised)
        if isinstance(answer, str):
            return Return(footage, strategy, frame, answer)
        contacts = answer
    return Return(footage, strategy, frame, contacts)
