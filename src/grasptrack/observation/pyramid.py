# SPDX-License-Identifier: Apache-2.0
"""The image at hand, ever further shrunk, with its light and without: made when asked for, kept until the next one."""

from __future__ import annotations

from grasptrack.observation.images import Grey
from grasptrack.observation.surface import relief, shrunk


class Pyramid:
    """Shrunk images of the image asked for last."""

    def __init__(self) -> None:
        self._image: Grey | None = None
        self._shrunk: dict[int, Grey] = {}
        self._relief: dict[int, Grey] = {}

    def shrunk(self, grey: Grey, by: int) -> Grey:
        """The image (H, W) as many times shrunk, a power of two."""
        if self._image is not grey:
            self._image, self._shrunk, self._relief = grey, {1: grey}, {}
        if by not in self._shrunk:
            self._shrunk[by] = shrunk(self.shrunk(grey, by // 2), 2)
        return self._shrunk[by]

    def relief(self, grey: Grey, by: int) -> Grey:
        """The same without the light that lies on it."""
        coarse = self.shrunk(grey, by)
        if by not in self._relief:
            self._relief[by] = relief(coarse)
        return self._relief[by]
