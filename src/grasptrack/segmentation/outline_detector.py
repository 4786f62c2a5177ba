# SPDX-License-Identifier: Apache-2.0
"""Finds the outline of one object in later images: near the expected place first, otherwise anywhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.errors import ContourError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour, View
from grasptrack.images import PLAIN, Grey, to_bgr
from grasptrack.segmentation.candidate import Candidate, candidate_of_one_level, is_plausible_object, is_same_region
from grasptrack.segmentation.closed_edges import ObjectClosing, lab_planes
from grasptrack.segmentation.first_look import find_candidates
from grasptrack.segmentation.localization import localize_contour
from grasptrack.segmentation.proposals import MIN_EXTENT, PER_THRESHOLD
from grasptrack.segmentation.segmenters import Segmenter
from grasptrack.segmentation.shadow import shadow_removed
from grasptrack.segmentation.silhouettes import (
    MIN_AREA,
    Chain,
    Silhouette,
    Window,
    candidate_thresholds,
    threshold_mask,
    trace_silhouettes,
)
from grasptrack.typing import Floats

WINDOW_MARGIN = 0.3
"""Margin of the window around the expected outline on each side, as a fraction of its size, ..."""
MIN_MARGIN = 24
"""... and in px at least."""
MIN_WINDOW = 8
"""px; a narrower window shows no outline."""
LEARNING_RATE = 0.2
"""Share of a new frame in the learned grey levels, which follow slow changes of light."""
MIN_BALANCE = 0.25
"""Least distance of a threshold from the levels of object and background, as a share of the contrast."""
DISTINCT = 6.0
"""Thresholds that differ by fewer grey levels give the same outlines."""
OTHER_LIGHT = 1.12
"""A window whose contrast differs from the last one by more than this factor may be exposed differently."""
MAX_GAIN = 3.0
"""Largest factor by which edges may get steeper or fainter."""
MAX_TRIED = 2
"""Objects in the whole image that are tried for each threshold after a loss, the most similar first."""
MAX_GROWTH = 2.5
"""An area that differs from the expected one by more than this factor belongs to another object."""
MAX_ZOOM = 16.0
"""The same after a loss."""
UNDER_IGNORED = 128
"""Grey level of what is ignored: whatever lies there, and what of it a filter takes along, must not matter."""
SAME_PLACE = 0.02
"""Share of sqrt(area) by which places of one outline differ at different thresholds, see `is_same_region`."""

Unlikeness = Callable[[Silhouette], float]
"""How much a silhouette's shape differs from the object's; infinite for another object."""


class _Levels(NamedTuple):
    """Grey levels on both sides of an outline, and the threshold that found it; NaN where closed edges did."""

    inside: float
    outside: float
    level: float


@dataclass(frozen=True)
class _Search:
    """A search of the whole image, its first three as of `OutlineDetector.views_anywhere`; outlines that have been `seen`."""

    area: float
    turn: int
    unlike: Unlikeness | None
    seen: list[View] = field(default_factory=list)

    @property
    def min_area(self) -> float:
        """px^2, of the smallest silhouette that may be the object."""
        return self.area / MAX_ZOOM

    def of_right_size(self, shapes: list[Silhouette]) -> list[Silhouette]:
        """Of the largest silhouettes those that may be the object by their size."""
        largest = shapes[:PER_THRESHOLD]
        return [s for s in largest if s.longer_side >= MIN_EXTENT and s.area <= self.area * MAX_ZOOM]

    def most_similar(self, shapes: list[Silhouette]) -> list[Silhouette]:
        """The silhouettes to examine closely: the most similar, and one of the others in turn."""
        if self.unlike is None:
            return shapes
        rated = sorted((self.unlike(s), i) for i, s in enumerate(shapes))
        alike = [shapes[i] for share, i in rated if math.isfinite(share)]
        after = self.turn % max(1, len(alike) - MAX_TRIED + 1)
        return alike[: MAX_TRIED - 1] + alike[MAX_TRIED - 1 + after :][:1]

    def new_views(self, views: Iterable[View]) -> list[View]:
        """Those that are not at the place of one that was seen before, which are seen now."""
        found = []
        for view in views:
            if not any(is_same_region(view, other, SAME_PLACE) for other in self.seen):
                self.seen.append(view)
                found.append(view)
        return found


class OutlineDetector:
    """Finds outlines that may be the object's. The decision which one is right is made elsewhere.

    Args:
        hidden: (H, W) nonzero where pixels are ignored.

    Attributes:
        colours: (H, W) or BGR (H, W, 3) the image that was looked at last.
        polarity: of the object, as of `Candidate`.
    """

    def __init__(self, hidden: Grey | None = None) -> None:
        self.hidden = hidden
        self.polarity = 1
        self.colours: NDArray[np.uint8] = np.zeros((0, 0), np.uint8)
        self._channel = PLAIN
        self._recipe = -1, math.nan
        self._shaded = False
        self._inside = self._outside = math.nan
        self._balance = 0.5
        self._holes = 0
        self._levels: dict[int, _Levels] = {}  # of this image's outlines
        self._sharpness = math.nan  # of the first outline
        self._gain = 1.0  # of its edges relative to that
        self._contrast = math.nan  # of the window, in this image and in the last accepted one
        self._last_contrast = math.nan

    def set_image(self, image: NDArray[Any]) -> Grey:
        """The next image in the mixture of colours that shows the object best."""
        self._levels.clear()  # keyed by the ids of views, which later views may reuse
        self.colours = to_bgr(image)
        if self.hidden is not None and self.hidden.shape == self.colours.shape[:2]:
            self.colours = self.colours.copy()
            self.colours[self.hidden != 0] = UNDER_IGNORED
        return self._channel.to_grey(self.colours)

    def find_objects(self, said: FirstImage, segmenter: Segmenter | None = None) -> list[Candidate]:
        """Objects of the image that was looked at, the likeliest first."""
        return find_candidates(self.colours, replace(said, hidden=self.hidden), segmenter)

    def choose_object(self, candidate: Candidate) -> Grey:
        """Look for this object from now on. Returns its image in its mixture of colours."""
        self.polarity = candidate.polarity
        self._channel = candidate.channel
        self._recipe = candidate.recipe, candidate.grain
        self._shaded = candidate.shaded
        self._sharpness, self._gain, self._last_contrast = _edge_sharpness(candidate.view), 1.0, math.nan
        self._inside, self._outside = candidate.inside, candidate.outside
        self._learn_balance(_Levels(candidate.inside, candidate.outside, candidate.level))
        self._holes = len(candidate.view.contours) - 1
        return self._channel.to_grey(self.colours)

    # --- near the expected place -----------------------------------------------------------------

    def views_near(self, grey: Grey, expected: Floats, centres: Floats) -> Iterator[View]:
        """Outlines in a window around the expected one, the likeliest first. Call it first for each new image.

        Expected are (m, 2) px of the outer contour, and centres (holes, 2) px of the reference's holes.
        """
        self._levels.clear()
        (x0, y0), (x1, y1) = expected.min(axis=0).tolist(), expected.max(axis=0).tolist()
        margin = max(MIN_MARGIN, WINDOW_MARGIN * math.sqrt((x1 - x0) * (y1 - y0)))
        height, width = grey.shape
        left, top = max(0, math.floor(x0 - margin)), max(0, math.floor(y0 - margin))
        right, bottom = min(width, math.ceil(x1 + margin) + 1), min(height, math.ceil(y1 + margin) + 1)
        if right - left < MIN_WINDOW or bottom - top < MIN_WINDOW or math.isnan(self._inside):
            return
        offsets = np.array([0, len(expected)], dtype=np.int64)
        signed_area, x, y, *_ = kernels.polygon_moments(np.ascontiguousarray(expected), offsets)
        area, window = abs(signed_area), (left, top, right, bottom)
        for level, shapes in self._window_silhouettes(grey, window, area / MAX_GROWTH):
            best = _most_alike(shapes, area, x, y)
            if best is not None and not _is_cut_by_window(best, window, (width, height)):
                view = self._localize_view(grey, best, centres, level)
                if view is not None:
                    yield view
                if self._recipe[0] < 0:
                    return

    def _window_silhouettes(
        self, grey: Grey, window: Window, min_area: float
    ) -> Iterator[tuple[float, list[Silhouette]]]:
        """Silhouettes in a window and their threshold: by the learned levels, then by the window's own.

        The light may have changed since the levels were learned.
        """
        left, top, right, bottom = window
        level = self._threshold_level
        if self._recipe[0] < 0 or self.polarity:  # dark or light all around: a threshold may work, and is faster
            yield level, self._threshold_silhouettes(grey, level, min_area, window)
        if self._recipe[0] < 0:
            for own in candidate_thresholds(grey[top:bottom:2, left:right:2])[:1]:
                if abs(own - level) >= DISTINCT:
                    yield own, self._threshold_silhouettes(grey, own, min_area, window)
            return
        planes = lab_planes(self.colours[top:bottom, left:right])
        hidden = None if self.hidden is None else self.hidden[top:bottom, left:right]
        self._contrast = float(planes[:, :, 0].std())
        for gain in self._edge_gains():
            shapes = self._closing_for_gain(gain).enclosed(planes, hidden, max(min_area, MIN_AREA), (left, top))
            yield math.nan, shapes

    # --- anywhere --------------------------------------------------------------------------------

    def views_anywhere(
        self, grey: Grey, area: float, turn: int, known: View | None = None, unlike: Unlikeness | None = None
    ) -> Iterator[list[View]]:
        """Outlines anywhere in the image that may be the object's: by the learned grey levels, then by the image's own.

        Args:
            grey: (H, W).
            area: px^2, last known area of the outline.
            turn: number of this search; each search tries the next of the image's own thresholds.
            known: an outline that has been examined already.
            unlike: how much a silhouette's shape differs from the object's, infinite for another object. If given, only few
                are examined closely: the most similar always, the others in turn.
        """
        search = _Search(area, turn, unlike, [] if known is None else [known])
        if self._recipe[0] < 0 or self.polarity:
            yield self._views_at_threshold(grey, self._threshold_level, search)
        if self._recipe[0] >= 0:
            for gain in self._edge_gains():
                yield self._views_from_edges(grey, gain, search)
            return
        own = candidate_thresholds(grey if self.hidden is None else grey[self.hidden == 0])
        own = [level for level in own if abs(level - self._threshold_level) >= DISTINCT]
        if own:
            yield self._views_at_threshold(grey, own[turn % len(own)], search)

    def _views_at_threshold(self, grey: Grey, level: float, search: _Search) -> list[View]:
        """Outlines at one threshold, without those seen at another."""

        def localized_views() -> Iterator[View]:
            shapes = self._threshold_silhouettes(grey, level, search.min_area)
            for shape in search.most_similar(search.of_right_size(shapes)):
                alone = self._without_shadow(shape)
                candidate = candidate_of_one_level(grey, alone, self.polarity, self.hidden)
                if candidate is not None:  # at most as many holes as the reference: those of print come and go
                    view = View(candidate.view.contours[: self._holes + 1])
                    self._levels[id(view)] = _Levels(candidate.inside, candidate.outside, level)
                    yield view

        return search.new_views(localized_views())

    def _views_from_edges(self, grey: Grey, gain: float, search: _Search) -> list[View]:
        """Outlines from closed edges in the whole image, without those seen before."""
        closing, planes = self._closing_for_gain(gain), lab_planes(self.colours)
        shapes = closing.enclosed(planes, self.hidden, max(search.min_area, MIN_AREA), (0, 0))
        promising = search.of_right_size(sorted(shapes, key=lambda s: -s.area))
        plausible = [s for s in promising if is_plausible_object(s, grey.shape)]
        views = (self._localize_view(grey, s, np.zeros((0, 2)), math.nan) for s in search.most_similar(plausible))
        return search.new_views(view for view in views if view is not None)

    # --- what both need --------------------------------------------------------------------------

    def _threshold_silhouettes(
        self, grey: Grey, level: float, min_area: float, window: Window | None = None
    ) -> list[Silhouette]:
        """Silhouettes in a window, or in the whole image, at one threshold."""
        mask = threshold_mask(grey, level, self.polarity, self.hidden, window)
        origin = (0, 0) if window is None else window[:2]
        return trace_silhouettes(mask, max(min_area, MIN_AREA), origin, holes=self._holes > 0)

    def _edge_gains(self) -> Iterator[float]:
        """By how much edges may be steeper than in the first image: as learned, then as this image's contrast says."""
        yield self._gain
        change = self._contrast / max(self._last_contrast, 1.0)
        if not 1.0 / OTHER_LIGHT < change < OTHER_LIGHT and math.isfinite(change):
            yield self._gain * change

    def _closing_for_gain(self, gain: float) -> ObjectClosing:
        """The closing that found the object, for edges that are so many times as steep."""
        recipe, grain = self._recipe
        return ObjectClosing(recipe, grain * gain, self.colours.shape)

    def _without_shadow(self, shape: Silhouette) -> Silhouette:
        """A silhouette without its shadow, if the object had one when it was chosen."""
        return shadow_removed(self.colours, shape) if self._shaded else shape

    def _localize_view(self, grey: Grey, shape: Silhouette, centres: Floats, level: float) -> View | None:
        """The outline of a silhouette, with the holes nearest to expected centres; None where one has none."""
        shape = self._without_shadow(shape)
        try:
            edge = localize_contour(grey, shape.outer, hole=False, polarity=self.polarity, hidden=self.hidden)
            holes: list[Contour] = [
                localize_contour(grey, chain, hole=True, polarity=self.polarity, hidden=self.hidden).contour
                for chain in _nearest_holes(shape.holes, centres)
            ]
        except ContourError:
            return None
        view = View([edge.contour, *holes])
        self._levels[id(view)] = _Levels(edge.inside, edge.outside, level)
        return view

    # --- learning --------------------------------------------------------------------------------

    def learn_levels(self, view: View) -> None:
        """Learn grey levels and light from an outline that was found here and accepted."""
        levels = self._levels.get(id(view), _Levels(math.nan, math.nan, math.nan))
        inside, outside, level = levels
        self._last_contrast = self._contrast
        if math.isfinite(inside) and self._recipe[0] >= 0:
            self._gain = min(max(_edge_sharpness(view) / self._sharpness, 1.0 / MAX_GAIN), MAX_GAIN)
        if not self.polarity and math.isfinite(inside + outside):
            self._inside, self._outside = inside, outside
        elif (outside - inside) * self.polarity > 0.0:
            # an outline found by the image's own levels may be lit differently altogether
            share = 1.0 if abs(level - self._threshold_level) >= DISTINCT else LEARNING_RATE
            self._learn_balance(levels)
            self._inside += share * (inside - self._inside)
            self._outside += share * (outside - self._outside)

    @property
    def _threshold_level(self) -> float:
        """The threshold between object and background, as in the last accepted image."""
        return self._inside + self._balance * (self._outside - self._inside)

    def _learn_balance(self, levels: _Levels) -> None:
        """Learn where between object and background the threshold lies; print at the border can shift it."""
        inside, outside, level = levels
        if math.isfinite(level + inside + outside) and outside != inside:
            self._balance = min(max((level - inside) / (outside - inside), MIN_BALANCE), 1.0 - MIN_BALANCE)


def _edge_sharpness(view: View) -> float:
    """Median gradient of the outer contour's edges, grey levels per px."""
    strength = view.outer.strength
    return math.nan if strength is None else max(float(np.median(strength)), 1.0)


def _most_alike(shapes: list[Silhouette], area: float, x: float, y: float) -> Silhouette | None:
    """The silhouette nearest to the expected area and place."""

    def unlikeness(shape: Silhouette) -> float:
        bx, by, bw, bh = shape.box
        distance = math.hypot(bx + 0.5 * bw - x, by + 0.5 * bh - y) / math.sqrt(area)
        return abs(math.log(shape.area / area)) + distance

    sized = [s for s in shapes if 1.0 / MAX_GROWTH < s.area / area < MAX_GROWTH]
    return min(sized, key=unlikeness, default=None)


def _is_cut_by_window(shape: Silhouette, window: Window, image: tuple[int, int]) -> bool:
    """Whether the silhouette reaches a side of the window that is not the image's own border."""
    (left, top, right, bottom), (width, height) = window, image
    x, y, w, h = shape.box
    return x <= left > 0 or y <= top > 0 or x + w >= right < width or y + h >= bottom < height


def _nearest_holes(holes: tuple[Chain, ...], centres: Floats) -> list[Chain]:
    """The nearest hole to each expected centre, none twice, in the order of the centres."""
    left = list(holes)
    chosen = []
    for centre in centres[: len(holes)]:
        nearest = min(range(len(left)), key=lambda i: float(((left[i].mean(axis=0) - centre) ** 2).sum()))
        chosen.append(left.pop(nearest))
    return chosen
