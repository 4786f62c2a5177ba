# SPDX-License-Identifier: Apache-2.0
"""What a segmenter is: it proposes regions of an image, each with a probability."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

from numpy.typing import NDArray

from grasptrack.first_image import FirstImage
from grasptrack.typing import Pixels


class Region(NamedTuple):
    """One region that may be the object.

    Attributes:
        mask: (H, W) nonzero on it, or how likely each pixel belongs to it, 0 to 1 in floats.
        probability: that it is the object, as far as the segmenter knows.
        is_vote: it is one of several maps of the same thing, which are averaged; otherwise regions are alternatives, of which
            one may be right.
    """

    mask: NDArray[Any]
    probability: float = 1.0
    is_vote: bool = False


@runtime_checkable
class Segmenter(Protocol):
    """Proposes regions of an image. They pass through the same sub-pixel localisation as all others."""

    def regions(self, image: Pixels, hints: FirstImage) -> Sequence[Region]:
        """Regions that may be the object, the likeliest first.

        Args:
            image: (H, W) or BGR (H, W, 3).
            hints: what a person said of it.
        """
        ...
