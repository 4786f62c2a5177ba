# SPDX-License-Identifier: Apache-2.0
"""What waits for a session's thread: what it was told, in order, and images: the newest, or all since the one that is held."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict, deque
from dataclasses import dataclass
from typing import Any

from grasptrack.errors import InputError
from grasptrack.io.base import Frame
from grasptrack.io.limits import Backlog, most_held

MOST = 256
"""Commands that wait; a person gives a few in a second."""


@dataclass(frozen=True)
class Arrival:
    """An image, and the time of `time.perf_counter` at which it came out of its source, s."""

    frame: Frame
    at: float
    run: int
    """Which playing of the source it is from."""


class KeptImages:
    """The last images by their numbers: a click belongs to the image that was seen, which is not the newest any more."""

    def __init__(self) -> None:
        self._kept: OrderedDict[int, Arrival] = OrderedDict()

    def add(self, image: int, arrival: Arrival) -> None:
        """Keep one more, and forget the oldest where they are too many."""
        self._kept[image] = arrival
        while len(self._kept) > most_held(arrival.frame.image):
            self._kept.popitem(last=False)

    def get_image(self, image: int) -> Arrival:
        """An image that a person saw.

        Raises:
            InputError: it is too long ago, or was never there.
        """
        if image not in self._kept:
            raise InputError(f"image {image} is not kept any more: pause first, or try again")
        return self._kept[image]


class Inbox:
    """One reader of a source and any number of people on one side, the session's thread on the other."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._told: deque[Any] = deque()
        self._waiting: Backlog[Arrival] = Backlog()
        self._closed = False

    def tell(self, what: Any, *, bounded: bool = True) -> None:
        """Add what the session's thread shall do; its own helpers' answers are not bounded.

        Raises:
            InputError: too much waits already.
        """
        with self._changed:
            if bounded and len(self._told) >= MOST:
                raise InputError("too many commands at once: this one was dropped")
            self._told.append(what)
            self._changed.notify_all()

    def replace_image(self, arrival: Arrival) -> None:
        """An image of a live source: one that was not looked at yet is dropped, but after `keep_images`."""
        with self._changed:
            self._waiting.add(arrival, arrival.frame.image.nbytes)
            self._changed.notify_all()

    def keep_images(self) -> None:
        """An image is held, and what comes meanwhile is to be caught up with."""
        with self._changed:
            self._waiting.keep_all()

    def newest_only(self) -> None:
        """Nothing is held any more, and what came meanwhile does not matter."""
        with self._changed:
            self._waiting.newest_only()

    def hand_over(self, arrival: Arrival) -> bool:
        """An image of a file: waits until the one before it was taken. False where the inbox was closed meanwhile."""
        with self._changed:
            while self._waiting and not self._closed:
                self._changed.wait()
            if self._closed:
                return False
            self._waiting.add(arrival, 0)
            self._changed.notify_all()
            return True

    def wait_taken(self) -> None:
        """Wait until no image waits: the end of a file is told after its last one."""
        with self._changed:
            while self._waiting and not self._closed:
                self._changed.wait()

    def drop_frame(self) -> None:
        """Forget the images that wait."""
        with self._changed:
            self._waiting.clear()
            self._changed.notify_all()

    def take_next(self, wants_frame: bool, seconds: float) -> Any:
        """What was told, else an `Arrival` where one is wanted; None when `seconds` s have passed, or closed."""
        until = time.monotonic() + seconds
        with self._changed:
            while not self._closed:
                if self._told:
                    return self._told.popleft()
                if wants_frame and self._waiting:
                    arrival, _ = self._waiting.take()
                    self._changed.notify_all()
                    return arrival
                left = until - time.monotonic()
                if left <= 0.0:
                    return None
                self._changed.wait(left)
        return None

    def close(self) -> None:
        """Nobody waits any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
