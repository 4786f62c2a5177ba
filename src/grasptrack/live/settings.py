# SPDX-License-Identifier: Apache-2.0
"""How a session tracks."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from grasptrack.first_image import FirstImage
from grasptrack.geometry.cameras import Camera
from grasptrack.grasp.force_closure import DEFAULT_FRICTION
from grasptrack.grasp.hand import Hand, Length
from grasptrack.io.recording import points_text
from grasptrack.segmentation.segmenters import OneMask, Region, Segmenter
from grasptrack.tracking.follower import AUTO
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.tracking.parts import KnownPart
from grasptrack.tracking.scene import SceneTracker
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Pixels


@dataclass(frozen=True)
class Settings:
    """How a session tracks; the attributes are those of `GraspTracker`, and mean the same; `unit` is that of the length."""

    strategy: str = AUTO
    fingers: int = 2
    friction: float = DEFAULT_FRICTION
    risk: float = DEFAULT_RISK
    hand: Hand | None = None
    segmenter: Segmenter | None = None
    camera: Camera | None = None
    length: float | None = None
    belt: tuple[float, float] | None = None
    pixel_aspect: float | None = None
    resynthesize: bool = False
    tolerance: Length | None = None
    wait: bool = False
    next_object: bool = False
    search_ms: float | None = None
    unit: str = ""

    def tracking_options(self, meant: FirstImage) -> dict[str, Any]:
        """As options of `grasptrack track`, by their names; images, hands and nets are none of it."""
        return {
            "strategy": self.strategy,
            "fingers": self.fingers if meant.grasp is None else None,
            "friction": self.friction,
            "risk": self.risk,
            "first_look_ms": meant.first_look_ms,
            "search_ms": self.search_ms,
            "resynthesize": self.resynthesize,
            "wait": self.wait,
            "next": self.next_object,
            "object": points_text(meant.object_at),
            "not": points_text(meant.not_at),
            "box": None if meant.box is None else ",".join(map(repr, meant.box)),
            "outline": points_text(meant.outline),
            "grasp": points_text(None if meant.grasp is None else meant.grasp.contacts),
            "choose": meant.number,
        }

    def make_tracker(self, meant: FirstImage) -> GraspTracker:
        """A tracker that has seen no image."""
        fingers = self.fingers if meant.grasp is None else len(meant.grasp)
        known = {name: value for name, value in vars(self).items() if name != "unit"}
        return GraspTracker(**meant.tracker_arguments(), **{**known, "fingers": fingers})


class TurnTaking:
    """A segmenter that a tracker and a hovering pointer ask from two threads, one after the other."""

    def __init__(self, segmenter: Segmenter) -> None:
        self._segmenter, self._turn = segmenter, threading.Lock()

    def regions(self, image: Pixels, hints: FirstImage) -> Sequence[Region]:
        """As of the segmenter."""
        with self._turn:
            return self._segmenter.regions(image, hints)


def shared_segmenter(segmenter: Segmenter | None) -> Segmenter | None:
    """A segmenter that two threads may ask. A user's own segmentation stays what it is: trackers know it by its type."""
    return segmenter if segmenter is None or isinstance(segmenter, OneMask) else TurnTaking(segmenter)


@dataclass(frozen=True)
class SceneSettings:
    """How a session follows parts; the attributes are those of `SceneTracker`, and mean the same."""

    parts: Sequence[KnownPart]
    risk: float = DEFAULT_RISK
    ignore: Pixels | None = None
    belt: tuple[float, float] | None = None
    look_every: float | None = None

    @property
    def names(self) -> list[str]:
        """Of the parts."""
        return [f'"{part.name}"' for part in self.parts]

    def make_tracker(self) -> SceneTracker:
        """A tracker that has seen no image."""
        return SceneTracker(**vars(self))
