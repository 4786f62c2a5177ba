# SPDX-License-Identifier: Apache-2.0
"""Finds the outline of one object in later images: near the expected place first, otherwise anywhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.errors import ContourError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour, View
from grasptrack.images import PLAIN, Grey
from grasptrack.segmentation.candidate import Candidate, is_plausible_object, of_one_level
from grasptrack.segmentation.candidate_search import MIN_EXTENT
from grasptrack.segmentation.closed_edges import Closing
from grasptrack.segmentation.first_look import find_candidates
from grasptrack.segmentation.localization import localize_contour
from grasptrack.segmentation.normalized_gradient import lab_planes
from grasptrack.segmentation.places import (
    MAX_GROWTH,
    area_and_centre,
    area_and_mean_point,
    cut_by_window,
    edge_sharpness,
    most_alike,
    nearest_holes,
    same_place,
)
from grasptrack.segmentation.proposals import PER_THRESHOLD
from grasptrack.segmentation.regions import Segmenter
from grasptrack.segmentation.shadow import shadow_removed
from grasptrack.segmentation.silhouettes import Silhouette, trace_silhouettes
from grasptrack.segmentation.thresholds import candidate_thresholds
from grasptrack.typing import Floats

MARGIN = 0.3
"""Margin of the window around the expected outline on each side, as a fraction of its size, ..."""
MIN_MARGIN = 24
"""... and in px at least."""
LEARNING = 0.2
"""Share of a new frame in the learned grey levels, which follow slow changes of light."""
BALANCE = 0.25
"""Least distance of a threshold from the levels of object and background, as a share of the contrast."""
DISTINCT = 6.0
"""Thresholds that differ by fewer grey levels give the same outlines."""
OTHER_LIGHT = 1.12
"""A window whose contrast differs from the last one by more than this factor may be exposed differently."""
MOST_GAIN = 3.0
"""Largest factor by which edges may get steeper or fainter."""
ANYWHERE = 2
"""Objects in the whole image that are tried for each threshold after a loss, the most similar first."""
MAX_ZOOM = 16.0
"""After a loss, an area that differs from the last one by more than this factor belongs to another object."""


class OutlineDetector:
    """Finds outlines that may be the object's. The decision which one is right is made elsewhere.

    Args:
        hidden: (H, W) nonzero where pixels are ignored.
    """

    def __init__(self, hidden: Grey | None = None) -> None:
        self.hidden = hidden
        self.polarity = 1
        self._channel = PLAIN
        self._recipe = -1, math.nan
        self._shaded = False
        self._colours: NDArray[np.uint8] = np.zeros((0, 0), np.uint8)
        self._inside = self._outside = math.nan
        self._balance = 0.5
        self._holes = 0
        self._levels: dict[int, tuple[float, float, float]] = {}  # of this image's outlines
        self._sharpness = math.nan  # of the first outline
        self._gain = 1.0  # of its edges relative to that
        self._contrast = math.nan  # of the window, in this image and in the last accepted one
        self._last_contrast = math.nan

    def look(self, image: NDArray[Any]) -> Grey:
        """The next image in the mixture of colours that shows the object best.

        Raises:
            SourceError: an image that cannot be used.
        """
        self._levels.clear()  # keyed by the ids of views, which later views may reuse
        self._colours, grey = self._channel.look(image)
        return grey

    def first(self, hints: FirstImage, segmenter: Segmenter | None = None) -> list[Candidate]:
        """Objects of the image that was looked at, the likeliest first.

        Args:
            hints: what is known of it; `hidden` is this detector's own.
            segmenter: proposes regions beside the own search.

        Raises:
            ObservationError: none.
        """
        return find_candidates(self._colours, replace(hints, hidden=self.hidden), segmenter)

    def choose(self, candidate: Candidate) -> Grey:
        """Look for this object from now on. Returns its image in its mixture of colours."""
        self.polarity = candidate.polarity
        self._channel = candidate.channel
        self._recipe = candidate.recipe, candidate.grain
        self._shaded = candidate.shaded
        self._sharpness, self._gain, self._last_contrast = edge_sharpness(candidate.view), 1.0, math.nan
        self._inside, self._outside = candidate.inside, candidate.outside
        self._learn_balance(candidate.level, candidate.inside, candidate.outside)
        self._holes = len(candidate.view.contours) - 1
        return self._channel.grey(self._colours)

    def near(self, grey: Grey, expected: Floats, centres: Floats) -> Iterator[View]:
        """Outlines in a window around the expected one, the likeliest first. Call it first for each new image.

        Args:
            grey: (H, W).
            expected: (m, 2) px, predicted points of the outer contour.
            centres: (holes, 2) px, predicted centres of the reference's holes.
        """
        self._levels.clear()
        (x0, y0), (x1, y1) = expected.min(axis=0).tolist(), expected.max(axis=0).tolist()
        margin = max(MIN_MARGIN, MARGIN * math.sqrt((x1 - x0) * (y1 - y0)))
        height, width = grey.shape
        left, top = max(0, math.floor(x0 - margin)), max(0, math.floor(y0 - margin))
        right, bottom = min(width, math.ceil(x1 + margin) + 1), min(height, math.ceil(y1 + margin) + 1)
        if right - left < 8 or bottom - top < 8 or math.isnan(self._inside):
            return
        area, x, y = area_and_centre(expected)
        window = left, top, right, bottom
        for level, shapes in self._window_silhouettes(grey, window, area / MAX_GROWTH):
            best = most_alike(shapes, area, x, y)
            if best is not None and not cut_by_window(best, window, (width, height)):
                view = self._localize_view(grey, best, centres, level)
                if view is not None:
                    yield view
                if self._recipe[0] < 0:
                    return

    def _window_silhouettes(
        self, grey: Grey, window: tuple[int, int, int, int], least: float
    ) -> Iterator[tuple[float, list[Silhouette]]]:
        """Silhouettes in a window and their threshold: by the learned levels, then by the window's own.

        The light may have changed since the levels were learned.
        """
        left, top, right, bottom = window
        if self._recipe[0] >= 0:
            if self.polarity:  # dark or light all around: a threshold may work as well, and is faster
                yield self._threshold_level, self._threshold_window(grey, window, self._threshold_level, least)
            part = lab_planes(self._colours[top:bottom, left:right])
            hidden = None if self.hidden is None else self.hidden[top:bottom, left:right]
            self._contrast = float(part[:, :, 0].std())
            for gain in self._edge_gains():
                yield math.nan, self._closing_for_gain(gain).shapes(part, hidden, max(least, 30.0), (left, top))
            return
        own: list[float] | None = None
        while own is None or own:
            level = self._threshold_level if own is None else own.pop(0)
            yield level, self._threshold_window(grey, window, level, least)
            if own is None:
                own = [
                    other
                    for other in candidate_thresholds(grey[top:bottom:2, left:right:2])[:1]
                    if abs(other - level) >= DISTINCT
                ]

    def _threshold_window(
        self, grey: Grey, window: tuple[int, int, int, int], level: float, least: float
    ) -> list[Silhouette]:
        """Silhouettes in a window at one threshold."""
        left, top, right, bottom = window
        binary = kernels.blur_threshold(grey, *window, level, self.polarity)
        if self.hidden is not None:
            binary[self.hidden[top:bottom, left:right] != 0] = 0
        return trace_silhouettes(binary, max(least, 30.0), (left, top), holes=self._holes > 0)

    def _edge_gains(self) -> Iterator[float]:
        """By how much edges may be steeper than in the first image: as learned, then as this image's contrast says."""
        yield self._gain
        change = self._contrast / max(self._last_contrast, 1.0)
        if not 1.0 / OTHER_LIGHT < change < OTHER_LIGHT and math.isfinite(change):
            yield self._gain * change

    def _closing_for_gain(self, gain: float) -> Closing:
        """The closing that found the object, for edges that are so many times as steep."""
        recipe, grain = self._recipe
        return Closing(recipe, grain * gain, self._colours.shape)

    @property
    def colours(self) -> NDArray[np.uint8]:
        """(H, W) or BGR (H, W, 3) the image that was looked at last."""
        return self._colours

    @property
    def size(self) -> tuple[int, ...]:
        """Height and width of the image that was looked at last."""
        return self._colours.shape[:2]

    @property
    def levels(self) -> tuple[float, float]:
        """Learned grey levels of the object and of the background around it."""
        return self._inside, self._outside

    def anywhere(
        self,
        grey: Grey,
        area: float,
        turn: int,
        known: View | None = None,
        unlike: Callable[[Silhouette], float] | None = None,
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
        seen = [] if known is None else [area_and_mean_point(known)]
        if self._recipe[0] >= 0:
            if self.polarity:
                yield self._views_at_threshold(grey, self._threshold_level, area, seen, turn, unlike)
            for gain in self._edge_gains():
                yield self._views_from_edges(grey, area, seen, gain, turn, unlike)
            return
        yield self._views_at_threshold(grey, self._threshold_level, area, seen, turn, unlike)
        own = candidate_thresholds(grey if self.hidden is None else grey[self.hidden == 0])
        own = [level for level in own if abs(level - self._threshold_level) >= DISTINCT]
        if own:
            yield self._views_at_threshold(grey, own[turn % len(own)], area, seen, turn, unlike)

    def _views_at_threshold(
        self,
        grey: Grey,
        level: float,
        area: float,
        seen: list[tuple[float, float, float]],
        turn: int,
        unlike: Callable[[Silhouette], float] | None,
    ) -> list[View]:
        """Outlines at one threshold, without those seen at another."""
        views = []
        height, width = grey.shape
        binary = kernels.blur_threshold(grey, 0, 0, width, height, level, self.polarity)
        if self.hidden is not None:
            binary[self.hidden != 0] = 0
        shapes = trace_silhouettes(binary, max(area / MAX_ZOOM, 30.0), holes=self._holes > 0)[:PER_THRESHOLD]
        shapes = [s for s in shapes if max(s.box[2:]) >= MIN_EXTENT and s.area <= area * MAX_ZOOM]
        for shape in _select_likeliest(shapes, turn, unlike):
            candidate = of_one_level(grey, self._without_shadow(shape), self.polarity, self.hidden)
            if candidate is None or any(same_place(area_and_mean_point(candidate.view), other) for other in seen):
                continue
            seen.append(area_and_mean_point(candidate.view))
            view = self._with_holes(candidate.view)
            self._levels[id(view)] = candidate.inside, candidate.outside, level
            views.append(view)
        return views

    def _views_from_edges(
        self,
        grey: Grey,
        area: float,
        seen: list[tuple[float, float, float]],
        gain: float,
        turn: int,
        unlike: Callable[[Silhouette], float] | None,
    ) -> list[View]:
        """Outlines from closed edges in the whole image, without those seen before."""
        least = max(area / MAX_ZOOM, 30.0)
        shapes = self._closing_for_gain(gain).shapes(lab_planes(self._colours), self.hidden, least, (0, 0))
        views = []
        shapes = sorted(shapes, key=lambda s: -s.area)[:PER_THRESHOLD]
        shapes = [s for s in shapes if max(s.box[2:]) >= MIN_EXTENT and s.area <= area * MAX_ZOOM]
        for shape in _select_likeliest([s for s in shapes if is_plausible_object(s, grey.shape)], turn, unlike):
            view = self._localize_view(grey, shape, np.zeros((0, 2)), math.nan)
            if view is not None and not any(same_place(area_and_mean_point(view), other) for other in seen):
                seen.append(area_and_mean_point(view))
                views.append(view)
        return views

    def _without_shadow(self, shape: Silhouette) -> Silhouette:
        """A silhouette without its shadow, if the object had one when it was chosen."""
        return shadow_removed(self._colours, shape) if self._shaded else shape

    def _localize_view(self, grey: Grey, shape: Silhouette, centres: Floats, level: float) -> View | None:
        shape = self._without_shadow(shape)
        try:
            edge = localize_contour(grey, shape.outer, hole=False, polarity=self.polarity, hidden=self.hidden)
        except ContourError:
            return None
        holes: list[Contour] = []
        for chain in nearest_holes(shape.holes, centres):
            try:
                holes.append(
                    localize_contour(grey, chain, hole=True, polarity=self.polarity, hidden=self.hidden).contour
                )
            except ContourError:
                return None
        view = View([edge.contour, *holes])
        self._levels[id(view)] = edge.inside, edge.outside, level
        return view

    def believe(self, view: View) -> None:
        """Learn grey levels and light from an outline that was found here and accepted."""
        inside, outside, level = self._levels.get(id(view), (math.nan, math.nan, math.nan))
        self._last_contrast = self._contrast
        if math.isfinite(inside) and self._recipe[0] >= 0:
            self._gain = min(max(edge_sharpness(view) / self._sharpness, 1.0 / MOST_GAIN), MOST_GAIN)
        if not self.polarity and math.isfinite(inside + outside):
            self._inside, self._outside = inside, outside
        elif (outside - inside) * self.polarity > 0.0:
            # an outline found by the image's own levels may be lit differently altogether
            share = 1.0 if abs(level - self._threshold_level) >= DISTINCT else LEARNING
            self._learn_balance(level, inside, outside)
            self._inside += share * (inside - self._inside)
            self._outside += share * (outside - self._outside)

    @property
    def _threshold_level(self) -> float:
        """The threshold between object and background, as in the last accepted image."""
        return self._inside + self._balance * (self._outside - self._inside)

    def _learn_balance(self, level: float, inside: float, outside: float) -> None:
        """Learn where between object and background the threshold lies; print at the border can shift it."""
        if math.isfinite(level + inside + outside) and outside != inside:
            self._balance = min(max((level - inside) / (outside - inside), BALANCE), 1.0 - BALANCE)

    def _with_holes(self, view: View) -> View:
        """At most as many holes as the reference has; apparent holes from print come and go with a threshold."""
        return view if len(view.contours) <= self._holes + 1 else View(view.contours[: self._holes + 1])


def _select_likeliest(
    shapes: list[Silhouette], turn: int, unlike: Callable[[Silhouette], float] | None
) -> list[Silhouette]:
    """The silhouettes to examine closely in this search: the most similar, and one of the others in turn."""
    if unlike is None:
        return shapes
    rated = sorted(((unlike(s), i) for i, s in enumerate(shapes)), key=lambda pair: pair)
    alike = [shapes[i] for share, i in rated if math.isfinite(share)]
    after = turn % max(1, len(alike) - ANYWHERE + 1)
    return alike[: ANYWHERE - 1] + alike[ANYWHERE - 1 + after :][:1]
