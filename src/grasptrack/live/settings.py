# SPDX-License-Identifier: Apache-2.0
"""How a session tracks, and what a person has said of the object in one image."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from grasptrack.geometry.cameras import Camera
from grasptrack.grasp.force_closure import DEFAULT_FRICTION
from grasptrack.grasp.hand import Hand
from grasptrack.io.recorders.again import points_text
from grasptrack.live.commands import Point, Points
from grasptrack.segmentation.first_look import DEFAULT_SURE
from grasptrack.segmentation.hints import Box, Hints
from grasptrack.segmentation.regions import Region, Segmenter
from grasptrack.segmentation.segmenters import OneMask
from grasptrack.tracking.follower import AUTO
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Pixels


@dataclass(frozen=True)
class Meant:
    """What a person said of the object in one image, px; empty or None where nothing.

    Attributes:
        on, off: pixels on it, and beside it.
        box: left, top, width and height of a rectangle round it.
        outline: corners of a rough polygon round it.
        contacts: where the fingers shall touch.
        number: of the candidate that was taken, from 1.
    """

    on: Points = ()
    off: Points = ()
    box: Box | None = None
    outline: Points | None = None
    contacts: Points | None = None
    number: int | None = None

    @property
    def is_told(self) -> bool:
        """Whether a person said anything."""
        return bool(self.on or self.off) or self.points_at

    @property
    def points_at(self) -> bool:
        """Whether it says which object is meant."""
        told = (self.box, self.outline, self.contacts, self.number)
        return bool(self.on) or any(word is not None for word in told)

    @property
    def is_settled(self) -> bool:
        """Whether it leaves no choice of the object: its outline, its contacts, or a candidate."""
        return any(word is not None for word in (self.outline, self.contacts, self.number))

    def options(self) -> dict[str, Any]:
        """As options of `grasptrack track`, by their names."""
        return {
            "object": points_text(self.on),
            "not": points_text(self.off),
            "box": None if self.box is None else ",".join(repr(float(v)) for v in self.box),
            "outline": points_text(self.outline),
            "grasp": points_text(self.contacts),
            "choose": self.number,
        }

    def with_pixel(self, at: Point, on: bool) -> Meant:
        """A pixel more. One on the object takes the place of a box, an outline or contacts."""
        if on:
            return Meant(on=(*self.on, at), off=self.off)
        return replace(self, off=(*self.off, at), number=None, contacts=None)


@dataclass(frozen=True)
class Settings:
    """How a session tracks; the attributes are those of `GraspTracker`, and mean the same."""

    strategy: str = AUTO
    fingers: int = 2
    friction: float = DEFAULT_FRICTION
    risk: float = DEFAULT_RISK
    sure: float = DEFAULT_SURE
    first_look_ms: float | None = None
    hand: Hand | None = None
    segmenter: Segmenter | None = None
    background: NDArray[Any] | None = None
    ignore: NDArray[Any] | None = None
    camera: Camera | None = None
    length: float | None = None
    resynthesize: bool = False

    def options(self) -> dict[str, Any]:
        """What can be said in options of `grasptrack track`, by their names; images, hands and nets are none of it."""
        return {
            "strategy": self.strategy,
            "fingers": self.fingers,
            "friction": self.friction,
            "risk": self.risk,
            "first_look_ms": self.first_look_ms,
            "resynthesize": self.resynthesize,
        }

    def tracker(self, meant: Meant) -> GraspTracker:
        """A tracker that has seen no image.

        Raises:
            InputError: what does not go together.
        """
        return GraspTracker(
            fingers=self.fingers if meant.contacts is None else len(meant.contacts),
            strategy=self.strategy,
            friction=self.friction,
            risk=self.risk,
            grasp=meant.contacts,
            object_at=meant.on or None,
            not_at=meant.off or None,
            box=meant.box,
            outline=meant.outline,
            number=meant.number,
            sure=self.sure,
            first_look_ms=self.first_look_ms,
            hand=self.hand,
            segmenter=self.segmenter,
            background=self.background,
            ignore=self.ignore,
            camera=self.camera,
            length=self.length,
            resynthesize=self.resynthesize,
        )


class TurnTaking:
    """A segmenter that a tracker and a hovering pointer ask from two threads, one after the other."""

    def __init__(self, segmenter: Segmenter) -> None:
        self._segmenter, self._turn = segmenter, threading.Lock()

    def regions(self, image: Pixels, hints: Hints) -> Sequence[Region]:
        """As of the segmenter."""
        with self._turn:
            return self._segmenter.regions(image, hints)


def shared(segmenter: Segmenter | None) -> Segmenter | None:
    """A segmenter that two threads may ask. A user's own segmentation stays what it is: trackers know it by its type."""
    return segmenter if segmenter is None or isinstance(segmenter, OneMask) else TurnTaking(segmenter)
