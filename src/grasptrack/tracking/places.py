# SPDX-License-Identifier: Apache-2.0
"""The regions of one image that known parts may explain, looked for at the scale that suffices for the least of them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property

import cv2
import numpy as np

from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.images import PLAIN, Channel, Grey
from grasptrack.matching import Sampled
from grasptrack.segmentation.candidate_search import CandidateSearch, RoughOutline
from grasptrack.segmentation.silhouettes import to_binary
from grasptrack.tracking.target import as_grey, build_pyramid
from grasptrack.typing import Floats, Pixels

ENOUGH = 64.0
"""px, sqrt(area), that the least outline keeps that is looked for: at half of that 2 % of the parts on trays were missed."""
OVERLAP_SIDE = 64
"""px, the longer side of the image on which two outlines are laid over each other."""


class ImagePyramids:
    """An image, its pyramid made once for each mixture of colours.

    Args:
        colours: (H, W) or BGR (H, W, 3).
    """

    def __init__(self, colours: Pixels) -> None:
        self.colours = colours
        self._levels: dict[Channel, list[Grey]] = {}

    def levels_in(self, channel: Channel) -> list[Grey]:
        """The pyramid in a mixture of colours."""
        if channel not in self._levels:
            self._levels[channel] = build_pyramid(channel.to_grey(self.colours))
        return self._levels[channel]


class Spot:
    """A region of the reduced image that something may explain, whole or in part.

    Args:
        rough: the region, in px of the reduced image.
        to_image: (3, 3) from there to the image.

    Attributes:
        outline: samples of its boundary, in px of the reduced image.
    """

    def __init__(self, rough: RoughOutline, to_image: Floats) -> None:
        self.rough, self.to_image, self.outline = rough, to_image, Sampled(rough.view)

    @cached_property
    def whole_outline(self) -> Sampled | None:
        """Samples of its contour; None where it has none."""
        found = self.rough.localized_candidate
        with suppress(ValueError):  # a hair, or a tangle
            return None if found is None else Sampled(found.view)
        return None

    @property
    def best_channel(self) -> Channel:
        """The mixture of colours that shows it best."""
        found = self.rough.localized_candidate
        return PLAIN if found is None else found.channel

    @property
    def image_area(self) -> float:
        """px^2 of the image within its boundary."""
        return self.rough.view.outer.area * float(self.to_image[0, 0] * self.to_image[1, 1])

    @property
    def image_view(self) -> View:
        """Its boundary in the image."""
        return self.rough.view.transformed(self.to_image)


class PlaceSearch:
    """The regions of an image, and of what is left of it.

    Args:
        colours: (H, W) or BGR (H, W, 3).
        said: what is hidden in it.
        least: px, sqrt(area) of the least outline that is looked for.
    """

    def __init__(self, colours: Pixels, said: FirstImage, least: float) -> None:
        (height, width), shrink = colours.shape[:2], max(1.0, least / ENOUGH)
        self._size = max(1, round(height / shrink)), max(1, round(width / shrink))
        down, right = height / self._size[0], width / self._size[1]
        # the centre of a pixel goes to that of the block that it stands for
        self._to_image = np.array([[right, 0.0, 0.5 * right - 0.5], [0.0, down, 0.5 * down - 0.5], [0.0, 0.0, 1.0]])
        if said.hidden is not None:
            said = replace(said, hidden=to_binary(self._reduce_image(said.hidden) > 0))
        self._search = CandidateSearch(self._reduce_image(colours), said, None, ranked=False)

    def _reduce_image(self, image: Pixels) -> Pixels:
        if image.shape[:2] == self._size:
            return image
        return as_grey(cv2.resize(image, self._size[::-1], interpolation=cv2.INTER_AREA))

    def find_spots(self) -> list[Spot]:
        """Those that enclose something."""
        spots: list[Spot] = []
        for rough in self._search.rough_outlines():
            with suppress(ValueError):  # a hair, or a tangle
                spots.append(Spot(rough, self._to_image))
        return spots

    def leave_out(self, explained: Sequence[View]) -> None:
        """Leave of each region only what lies beside outlines of the image that are explained, their holes included."""
        taken: Grey = np.zeros(self._size, np.uint8)
        back = np.linalg.inv(self._to_image)
        for view in explained:
            ring = view.outer.points @ back[:2, :2].T + back[:2, 2]
            cv2.fillPoly(taken, [np.rint(ring).astype(np.int32)], (255,))
        self._search.leave_out(taken)


def carried_view(view: View, H: Floats) -> View:
    """An outline in the image, its points worked out."""
    return View([Contour.trusted(apply_homography(H, c.points), hole=c.hole) for c in view.contours])


def overlap_share(one: View, other: View) -> float:
    """Share of the lesser of two outlines' material, holes not counted, that lies within the other."""
    both, *areas = overlap_areas(one, other)
    return both / max(1, min(areas))


def overlap_areas(one: View, other: View) -> tuple[int, int, int]:
    """Of the material that two outlines have in common, and of the one's and the other's, in cells of a grid over both."""
    (left, top), (right, bottom) = one.outer.bounds
    (x, y), (u, v) = other.outer.bounds
    if max(left, x) > min(right, u) or max(top, y) > min(bottom, v):
        return 0, 0, 0
    low, high = np.array([min(left, x), min(top, y)]), np.array([max(right, u), max(bottom, v)])
    scale = OVERLAP_SIDE / max(1.0, float((high - low).max()))
    masks = [material_mask(view, (OVERLAP_SIDE + 1, OVERLAP_SIDE + 1), scale, low) for view in (one, other)]
    return (
        int(np.count_nonzero(masks[0] & masks[1])),
        int(np.count_nonzero(masks[0])),
        int(np.count_nonzero(masks[1])),
    )


def material_mask(view: View, shape: tuple[int, ...], scale: float = 1.0, low: Floats | float = 0.0) -> Grey:
    """(H, W) 255 on the material of an outline."""
    mask: Grey = np.zeros(shape[:2], np.uint8)
    rings = [np.rint((c.points - low) * scale).astype(np.int32) for c in view.contours]
    cv2.fillPoly(mask, rings[:1], (255,))
    cv2.fillPoly(mask, rings[1:], (0,))
    return mask
