# SPDX-License-Identifier: Apache-2.0
"""The object's outline among all that are found in an image, matched as a whole under any turn, scale and tilt."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import Contour, View
from grasptrack.matching import Judgement, Sampled, judge, match
from grasptrack.matching.judgement import SLIDES, SLIDES_NOISE
from grasptrack.matching.starts import BENDS
from grasptrack.observation.candidate import Candidate, sign_of
from grasptrack.observation.observer import Observer
from grasptrack.observation.silhouettes import Silhouette
from grasptrack.tracking.target import Grey, Target
from grasptrack.transfer.alignment import alignments, as_similarity

Floats = NDArray[np.float64]

UNLIKE = 0.35
"""Share of their norm by which whitened outlines differ that are of different objects, whatever the tilt."""
COARSE, CHAIN = 64, 200
"""Samples of an outline, and of a chain of pixels, for that."""
REACH = 3.0
"""px about the outline in the first image within which grey levels on its sides are measured."""


class Outlines:
    """Finds the outline of one object anywhere in an image.

    Args:
        target: the object.
        grey: (H, W) the first image.
        observer: it has been told which object is meant, and has looked at each image that is searched. Without one, grey
            levels tell the object from the ground, where it is darker all round, or lighter.
        hidden: (H, W) nonzero where nothing belongs to the scene.
    """

    def __init__(self, target: Target, grey: Grey, observer: Observer | None, hidden: Grey | None) -> None:
        self._target = target
        self._observer = None if target.view.is_clipped else observer or _observer(grey, target.view, hidden)
        self._outline: Sampled | None = None  # made at the first loss

    def find(self, grey: Grey, H: Floats, turn: int, *, thorough: bool) -> list[Floats]:
        """(3, 3) each, the poses at which the outline lies on one of an image: all ways in which the best of them fits.

        Args:
            grey: (H, W).
            H: (3, 3) from the first image to where the object was located last. What slides along itself keeps that tilt.
            turn: number of this search: of the thresholds that an image suggests each search tries the next.
            thorough: where the learned grey levels find nothing, try what else there is, which takes longer.
        """
        if self._observer is None or not (thorough or self._observer.polarity):
            return []
        if self._outline is None:
            self._outline = Sampled(self._target.view)
        own, (height, width) = self._outline, grey.shape

        def unlike(shape: Silhouette) -> float:
            x, y, w, h = shape.box
            if min(x, y, width - x - w, height - y - h) <= 0:
                return math.inf
            return _unlike(own, shape.ring(CHAIN))

        last = self._target.view.outer.transformed(H)
        for views in self._observer.anywhere(grey, last.area, turn, None, unlike):
            told = [(judge(match(own, view, thorough=False)), view) for view in views if not view.is_clipped]
            fits = [(best.cost / best.size, t, view) for t, view in told if (best := t.best) is not None]
            if fits:
                fits.sort(key=lambda fit: fit[0])
                return [self._target.pose(way) for _, t, view in fits for way in _ways(t, view.outer, last, H)]
            if not thorough:
                break
        return []


def _ways(told: Judgement, outline: Contour, last: Contour, H: Floats) -> list[Floats]:
    """(3, 3) each, first image -> image: the ways in which the object lies on an outline, `last` being where H had it."""
    assert told.best is not None
    if told.best.slack > max(SLIDES * told.best.size, SLIDES_NOISE * told.best.residual) or told.others:
        return [m.homography for m in (told.best, *told.others)]
    found = [as_similarity(fit, last, outline) @ H for fit in alignments(last, outline)]
    return found or [told.best.homography]


def _observer(grey: Grey, view: View, hidden: Grey | None) -> Observer | None:
    """What finds an object by the grey levels on both sides of its outline; None where they do not tell."""
    polarity = sign_of(grey, view.outer)
    if not polarity:
        return None
    points = view.outer.points
    ahead = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    normals = np.column_stack([ahead[:, 1], -ahead[:, 0]]) / np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    sides = kernels.edge_search(grey, points, np.ascontiguousarray(normals), REACH, polarity)[:, 2:]
    inside, outside = np.nanmedian(sides, axis=0).tolist() if np.isfinite(sides).any() else (math.nan, math.nan)
    if not (outside - inside) * polarity > 0.0:
        return None
    observer = Observer(hidden)
    observer.look(grey)
    observer.choose(Candidate(view, polarity, inside, outside))
    return observer


def _unlike(a: Sampled, outline: Floats) -> float:
    """Share of the whitened outline's norm by which an outline (N, 2) differs at least; infinite for another object's."""
    try:
        found = kernels.outline_starts(a.outer, outline, BENDS, COARSE, 0.1, 1)
    except ValueError:  # a hair, or a tangle: so few of its points enclose nothing
        return math.inf
    share = float(found[0, 0]) if len(found) else 0.0
    return share if share <= UNLIKE else math.inf
