# SPDX-License-Identifier: Apache-2.0
"""What a scheduler is, and what it says of a task."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

ATTEMPTS = 3
"""A task during which so many workers died is given up: it may well be what kills them."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one task.

    Attributes:
        index: of the task, in the order in which they were given.
        value: what the function returned; None where it failed.
        error: empty, or what went wrong in one line.
    """

    index: int
    value: Any
    error: str


class Scheduler(Protocol):
    """Calls a function once for each task, anywhere, in any order."""

    def __call__(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Outcome]:
        """Outcomes as they come. A task that raises is an outcome with an error; the others go on.

        Args:
            function: of one task; importable by name, as pickle wants it.
            tasks: its arguments, which pickle.
        """
        ...


def in_one_line(error: BaseException) -> str:
    """An error's message with its kind, for a log."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
