# SPDX-License-Identifier: Apache-2.0
"""The outline of one object in each image of a sequence, as the tracker's own segmentation extracts it, and unjudged."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import View
from grasptrack.images import Grey
from grasptrack.segmentation.candidate import Candidate
from grasptrack.segmentation.first_look import first_look
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.typing import Floats

Seen = View | str
"""An outline, or why there is none."""


class ExtractedOutlines:
    """Each outline is looked for round the last one, and in the whole image where it is not found there.

    No outline is judged: the plain strategies of the paper take what they are given.
    """

    def __init__(self) -> None:
        self._observer = OutlineDetector()
        self._last: View | None = None

    def candidates(self, image: NDArray[Any], hints: FirstImage | None = None) -> list[Candidate]:
        """Objects of the first image, the likeliest first.

        Raises:
            ObservationError: none.
        """
        self._observer.set_image(image)
        return self._observer.find_objects(hints or FirstImage())

    def choose(self, candidate: Candidate) -> Grey:
        """Follow this object from now on. Returns the first image in the mixture of colours that shows it best."""
        self._last = candidate.view
        return self._observer.choose_object(candidate)

    def next(self, image: NDArray[Any]) -> tuple[Grey, View | str]:
        """The next image in that mixture, and the outline in it, or why there is none."""
        assert self._last is not None, "no object was chosen"
        grey = self._observer.set_image(image)
        found = self._find(grey, image, self._last)
        if isinstance(found, View):
            self._last = found
        return grey, found

    def _find(self, grey: Grey, image: NDArray[Any], last: View) -> View | str:
        centres = np.array([c.points.mean(axis=0) for c in last.contours[1:]]).reshape(-1, 2)
        view = next(self._observer.views_near(grey, last.outer.points, centres), None)
        if view is not None:
            self._observer.learn_levels(view)
            return view
        try:
            return first_look(image)[0].view
        except ObservationError as error:
            return str(error)


def begin_near(points: Floats, place: Floats) -> Floats:
    """The same closed curve (N, 2) with its point nearest to a place (2,) first."""
    return np.roll(points, -int(np.hypot(*(points - place).T).argmin()), axis=0)
