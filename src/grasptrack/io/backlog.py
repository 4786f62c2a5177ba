# SPDX-License-Identifier: Apache-2.0
"""Which images of a live source wait for who takes them: the newest, or all that came during one long step."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

from grasptrack.io.limits import HELD_BYTES

T = TypeVar("T")


class Backlog(Generic[T]):
    """The newest item only; after `keep` everything that comes during one long step.

    A first look takes as long as many images. Who goes on with the newest one has to bridge all that moved meanwhile, and an
    object that looks the same after a turn is ambiguous from then on. What came is therefore handed out in order, thinned
    evenly where it would take too much memory. What comes while that is worked on follows, for as long as it is half
    as much each time: one who does not keep up goes on with the newest.

    Args:
        most: bytes that kept items may take; two are kept in any case.
    """

    def __init__(self, most: int = HELD_BYTES) -> None:
        self._most = most
        self._handed_out: deque[T] = deque()
        self._coming: list[tuple[int, T]] = []  # with their numbers
        self._came, self._stride = 0, 1
        self._keeping = False
        self._before: int | None = None  # items that were handed out at a time before

    def keep(self) -> None:
        """Keep what comes from now on, until it has been caught up with."""
        self._coming = [(k, item) for k, (_, item) in enumerate(self._coming)]
        self._came, self._stride = len(self._coming), 1
        self._keeping, self._before = True, None

    def newest_only(self) -> None:
        """Forget all but the newest item, from now on too."""
        waiting = [*self._handed_out, *(item for _, item in self._coming)]
        self._handed_out.clear()
        self._coming, self._keeping = [(0, item) for item in waiting[-1:]], False

    def clear(self) -> None:
        """Forget everything."""
        self.newest_only()
        self._coming = []

    def __bool__(self) -> bool:
        return bool(self._handed_out or self._coming)

    def add(self, item: T, size: int) -> int:
        """Add the newest item, of so many bytes; returns how many fell away."""
        before = len(self._coming)
        if not self._keeping:
            self._coming = []
        elif self._coming and self._coming[-1][0] % self._stride:
            self._coming.pop()  # it was there as the newest
        self._coming.append((self._came, item))
        self._came += 1
        while len(self._coming) > max(2, self._most // max(size, 1)):
            self._stride *= 2
            self._coming = [entry for entry in self._coming[:-1] if entry[0] % self._stride == 0] + self._coming[-1:]
        return before + 1 - len(self._coming)

    def take(self) -> tuple[T | None, int]:
        """The next item, None where there is none, and how many fell away."""
        fell = 0
        if not self._handed_out:
            items = [item for _, item in self._coming]
            if self._before is not None and 2 * len(items) > self._before + 1:
                items = items[-1:]
            fell = len(self._coming) - len(items)
            self._keeping = self._keeping and len(items) > 1
            self._handed_out.extend(items)
            self._before, self._coming = len(items), []
            self._came, self._stride = 0, 1
        return (self._handed_out.popleft() if self._handed_out else None), fell
