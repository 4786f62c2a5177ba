# SPDX-License-Identifier: Apache-2.0
"""The one small interface behind which everything that follows a grasp is measured: this tracker, and its peers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from numpy.typing import NDArray

from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats


@dataclass(frozen=True)
class Start:
    """What a method is told before the first image.

    Attributes:
        contacts: (k, 2) px of the grasp in the first image.
        outline: polygons of the object in the first image in px, outer first, then holes; () where it is not known.
            A method that needs to know which pixels are the object's may use it: more than a user could tell it.
        size: width and height of the images in px.
        object_at: (x, y) px of the object in the first image, where the user pointed at it.
    """

    contacts: Floats
    outline: tuple[Floats, ...]
    size: tuple[int, int]
    object_at: tuple[float, float] | None = None


class Method(Protocol):
    """Follows one grasp through one sequence."""

    def update(self, image: NDArray[Any], time: float | None) -> TrackResult:
        """Look at the next image, the first one included.

        Args:
            image: (H, W) 8 bit grey, or (H, W, 3) BGR.
            time: s.

        Returns:
            The contacts in this image, or a status other than tracked and the reason. `confidence` orders the answers
            of one method; NaN where it has none. `latency_ms` is measured by who calls.
        """
        ...


Maker = Callable[[Start], Method]
"""Makes a fresh method for one sequence."""
