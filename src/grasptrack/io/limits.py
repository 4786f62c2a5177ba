# SPDX-License-Identifier: Apache-2.0
"""How large an image may be, told by its header before memory is asked for; which images are held while one is worked on."""

from __future__ import annotations

import math
import os
from collections import deque
from contextvars import ContextVar
from typing import Any, Generic, TypeVar

from numpy.typing import NDArray

from grasptrack.errors import InputError, SourceError

T = TypeVar("T")
DEFAULT_MEGAPIXELS = 100.0
"""10^6 px; the largest cameras give 150, those on a hand 20 at most."""
VARIABLE = "GRASPTRACK_MAX_MEGAPIXELS"
"""Environment variable that sets another limit, for all processes of an evaluation."""
HELD, HELD_BYTES = 32, 64 << 20
"""Images that are held for what comes after tracking, and what they may take in memory."""
_asked: ContextVar[float | None] = ContextVar("max_megapixels", default=None)


def limit_megapixels(most: float | None) -> None:
    """Set the limit of what is read from now on in this context; None takes the default."""
    _asked.set(None if most is None else _positive_number(most, "max_megapixels"))


def max_megapixels() -> float:
    """The limit, in 10^6 px."""
    asked = _asked.get()
    if asked is not None:
        return asked
    text = os.environ.get(VARIABLE)
    return DEFAULT_MEGAPIXELS if not text else _positive_number(text, VARIABLE)


def check_size(width: int, height: int, name: str) -> None:
    """See that an image is not above the limit."""
    most = max_megapixels()
    if width * height > most * 1e6:
        raise SourceError(
            f"{name} is {width}x{height} px, {width * height / 1e6:.3g} megapixels; "
            f"at most {most:g} are read (--max-megapixels)",
            width=width,
            height=height,
            most=most,
        )


def most_held(image: NDArray[Any]) -> int:
    """How many images like this one may wait, or be kept, at a time: `HELD`, fewer of large ones, and 2 at least."""
    return max(2, min(HELD, HELD_BYTES // max(image.nbytes, 1)))


def _positive_number(value: float | str, name: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not 0.0 < number < math.inf:
        raise InputError(f"{name} must be a positive number of megapixels, not {value}", value=value)
    return number


class Backlog(Generic[T]):
    """The newest item only; after `keep_all` everything that comes during one long step.

    A first look takes as long as many images. Who goes on with the newest one has to bridge all that moved meanwhile, and an
    object that looks the same after a turn is ambiguous from then on. What came is therefore handed out in order, thinned
    evenly where it would take too much memory. What comes while that is worked on follows, for as long as it is half
    as much each time: one who does not keep up goes on with the newest. Kept items take at most `most` bytes, but two are kept.
    """

    def __init__(self, most: int = HELD_BYTES) -> None:
        self._most = most
        self._handed_out: deque[T] = deque()
        self._coming: list[tuple[int, T]] = []  # with their numbers
        self._came, self._stride = 0, 1
        self._keeping = False
        self._before: int | None = None  # items that were handed out at a time before

    def keep_all(self) -> None:
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
