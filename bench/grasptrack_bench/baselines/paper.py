# SPDX-License-Identifier: Apache-2.0
"""Otsu's silhouettes with the motion that their moments tell, and the paper's three methods to the letter.

No evidence is asked of the image, no verdict passed but the paper's own analysis of the transferred grasp.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import similarity_transform
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import analyze
from grasptrack.images import Grey
from grasptrack.segmentation.candidate import Candidate
from grasptrack.segmentation.first_look import first_look
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.segmentation.silhouettes import Silhouette, trace_silhouettes
from grasptrack.snake.active_contour import Snake
from grasptrack.transfer.base import Transfer
from grasptrack.typing import Floats
from grasptrack_bench.baselines.base import NO_CONFIDENCE, BaselineAnswer, LostError, Peer, farthest_contact_distance
from grasptrack_bench.baselines.literal import LiteralGraspLine, LiteralHomography, LiteralRRP
from grasptrack_bench.method import MethodStart

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
        """Objects of the first image, the likeliest first."""
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


LEAST = 2e-4
"""Smallest silhouette as a share of the image."""


class SilhouettePlace(NamedTuple):
    """Where a silhouette is: centroid (2,) px, area px^2, angle rad of the axis of least inertia, modulo pi."""

    centre: Floats
    area: float
    angle: float


class OtsuSilhouettes:
    """Finds one silhouette in every image: in the first the one that has the contacts, then that most like the last.

    Whether the part is darker or lighter than the ground is settled in the first image, as a user would. There is no
    test: if the part is gone, something else is the most like it.
    """

    def __init__(self, contacts: Floats) -> None:
        self._contacts = contacts
        self._dark = True
        self._last: SilhouettePlace | None = None

    def __call__(self, image: Grey) -> Silhouette:
        """The silhouette in the next image.

        Raises:
            LostError: there is none.
        """
        if self._last is None:
            both = [(shape, dark) for dark in (True, False) for shape in _otsu_silhouettes(image, dark)]
            if not both:
                raise LostError("the threshold leaves no silhouette")
            shape, self._dark = min(
                both, key=lambda pair: farthest_contact_distance(pair[0].outer.astype(np.float64), self._contacts)
            )
        else:
            found, last = _otsu_silhouettes(image, self._dark), self._last
            if not found:
                raise LostError("the threshold leaves no silhouette")
            shape = min(found, key=lambda s: _silhouette_distance(place_of(s), last))
        self._last = place_of(shape)
        return shape


def _otsu_silhouettes(image: Grey, dark: bool) -> list[Silhouette]:
    kind = cv2.THRESH_BINARY_INV if dark else cv2.THRESH_BINARY
    smooth = cv2.GaussianBlur(image, (5, 5), 0)
    _, binary = cv2.threshold(smooth, 0, 255, kind + cv2.THRESH_OTSU)
    return trace_silhouettes(np.asarray(binary, dtype=np.uint8), LEAST * image.size)


def place_of(shape: Silhouette) -> SilhouettePlace:
    """Centroid, area and axis of a silhouette, its holes filled."""
    m = cv2.moments(shape.outer.reshape(-1, 1, 2))
    centre = np.array([m["m10"], m["m01"]]) / m["m00"]
    return SilhouettePlace(centre, float(m["m00"]), 0.5 * math.atan2(2.0 * m["mu11"], m["mu20"] - m["mu02"]))


def _silhouette_distance(one: SilhouettePlace, other: SilhouettePlace) -> float:
    """How far two silhouettes are apart: their distance in sqrt(area), and the logarithm of the ratio of their areas."""
    apart = math.hypot(*(one.centre - other.centre).tolist()) / math.sqrt(other.area)
    return apart + abs(math.log(one.area / other.area))


class Otsu(Peer):
    """Otsu silhouette; centroid, area and the axis of least inertia of its outline give a similarity.

    The axis has no direction: the turn nearest to that of the frame before is taken.
    """

    name: ClassVar[str] = "otsu"

    def __init__(self, start: MethodStart) -> None:
        super().__init__(start)
        self._find = OtsuSilhouettes(self.contacts)
        self._angle = 0.0

    def begin(self, image: Grey) -> None:
        """See Peer."""
        self._first = place_of(self._find(image))
        self._angle = self._first.angle

    def follow(self, image: Grey) -> BaselineAnswer:
        """See Peer."""
        now, first = place_of(self._find(image)), self._first
        self._angle = now.angle + math.pi * round((self._angle - now.angle) / math.pi)
        scale, turn = math.sqrt(now.area / first.area), self._angle - first.angle
        x, y = first.centre.tolist()
        u, v = now.centre.tolist()
        return self.moved(similarity_transform(scale, turn, (x, y), (u, v)), self.contacts, NO_CONFIDENCE)


class PaperTransfer(Peer):
    """One of the paper's transfers to the letter, then its analysis in the image (Fig. 3), on the tracker's own outlines.

    Each image's outline is extracted as the tracker's is, and taken for what it is: nothing asks whether the answer is right.
    A transferred grasp that does not close in the image is refused, and the last accepted one goes on.
    """

    def begin(self, image: Grey) -> None:
        """See Peer."""
        self._extracted = ExtractedOutlines()
        pointed = self.start.object_at
        found = self._extracted.candidates(image, FirstImage(object_at=() if pointed is None else (pointed,)))
        nearest = min(found, key=lambda candidate: farthest_contact_distance(candidate.view.points, self.contacts))
        self._learn(nearest.view, self._extracted.choose(nearest))

    def follow(self, image: Grey) -> BaselineAnswer:
        """See Peer."""
        grey, view = self._extracted.next(image)
        moved, view = self._transfer(grey, view)
        analysis = analyze(moved.grasp, view)
        if not analysis.stable:
            raise LostError(f"the transferred grasp does not close in this image: {analysis.reason}")
        self._accept(moved, view)
        return BaselineAnswer(moved.grasp.contacts, None, NO_CONFIDENCE)

    @abstractmethod
    def _learn(self, view: View, grey: Grey) -> None:
        """The first outline, and the first image (H, W)."""

    @abstractmethod
    def _transfer(self, grey: Grey, view: Seen) -> tuple[Transfer, View]:
        """The grasp in an image (H, W) of which this outline was extracted, and the outline that it lies on.

        Raises:
            LostError: no outline.
            TransferError: see the strategies.
        """

    def _accept(self, moved: Transfer, view: View) -> None:
        """The grasp closes on this outline."""


class PaperGraspLine(PaperTransfer):
    """Grasp-line coordinates of the first image; the last one tells the two directions of I_min apart."""

    name: ClassVar[str] = "paper-grasp-line"

    def _learn(self, view: View, grey: Grey) -> None:
        self._strategy = LiteralGraspLine()
        self._description = self._strategy.describe(Grasp(self.contacts), view)
        self._last: Floats | None = None

    def _transfer(self, grey: Grey, view: Seen) -> tuple[Transfer, View]:
        seen = _outline_or_lost(view)
        return self._strategy.apply(self._description, seen, self._last), seen

    def _accept(self, moved: Transfer, view: View) -> None:
        self._last = moved.homography


class PaperHomography(PaperTransfer):
    """Homography from the four highest peaks of curvature, from each image to the next: consecutive frames, as the text asks.

    Each outline is begun where it is nearest to where the last one began: a window about an index is of no use without it.
    """

    name: ClassVar[str] = "paper-homography"

    def _learn(self, view: View, grey: Grey) -> None:
        self._strategy = LiteralHomography()
        self._first_point = view.outer.points[0]
        self._description = self._strategy.describe(Grasp(self.contacts), view)

    def _transfer(self, grey: Grey, view: Seen) -> tuple[Transfer, View]:
        found = _outline_or_lost(view)
        outer = Contour.trusted(begin_near(found.outer.points, self._first_point))
        seen = View([outer, *found.contours[1:]])
        return self._strategy.apply(self._description, seen), seen

    def _accept(self, moved: Transfer, view: View) -> None:
        self._first_point = view.outer.points[0]
        self._description = self._strategy.describe(moved.grasp, view)


class PaperRRP(PaperTransfer):
    """RRP coordinates in whole numbers on a B-spline snake of 4 DoF (Section IV-A), which is laid round the first outline.

    The snake is that of this library with its judgement of itself passed over: its curve is the answer wherever it found
    an edge at all.
    """

    name: ClassVar[str] = "paper-rrp"

    def _learn(self, view: View, grey: Grey) -> None:
        self._snake = Snake(view, grey, contacts=self.contacts)
        self._strategy = LiteralRRP()
        self._description = self._strategy.describe(Grasp(self.contacts), self._snake.template)

    def _transfer(self, grey: Grey, view: Seen) -> tuple[Transfer, View]:
        self._snake.predict()
        fit = self._snake.update(grey)
        if not np.isfinite(fit.residual):
            raise LostError("no edge near the predicted outline")
        followed = self._snake.view(fit)
        return self._strategy.apply(self._description, followed), followed


def _outline_or_lost(view: Seen) -> View:
    if isinstance(view, str):
        raise LostError(view)
    return view
