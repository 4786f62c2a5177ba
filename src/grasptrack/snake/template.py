# SPDX-License-Identifier: Apache-2.0
"""What a snake knows of its object from the first image: the sampled B-spline outline and what its edge looks like."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack import kernels
from grasptrack.errors import ObservationError
from grasptrack.geometry.contours import Contour, Outline, View
from grasptrack.snake.bspline import ClosedSpline, fit_spline
from grasptrack.typing import Bools, Floats

Grey = NDArray[np.uint8] | NDArray[np.float32]

NEAR = 4.0
"""px searched on either side of an outline that is believed to be in place."""
MAX_SPANS = 96
MAX_SEARCHED = 160
"""Samples whose normals are searched; more cost time and add little."""
MAX_BIAS = 1.5
"""px between the spline and the image's edge up to which a sample is used; corners that the spline cuts have more."""
MIN_STRENGTH = 3.0
"""Grey levels per px below which an edge is noise."""
MIN_SHARE = 0.35
"""An edge weaker than this share of the outline's median is not relied on."""
LEARNING = 0.05
"""How much of a new frame's grey levels goes into the template."""


def sampled_outline(view: Outline, tolerance: float, contacts: ArrayLike | None = None) -> tuple[View, Floats, float]:
    """The outline as points sampled from closed cubic B-splines, of as few spans as do.

    Args:
        view: outer contour and holes.
        tolerance: px; rms distance of each spline from its contour.
        contacts: (k, 2) px that must also lie within the tolerance of the sampled polygon, where spans allow it.

    Returns:
        The sampled View (6 points per span, so that every 6th is a reference point of the RRP coordinates), the
        spline's (n, 2) normals at its points, and the largest rms distance in px.
    """
    longest = max(c.length for c in view.contours)
    spans = 16
    while True:
        splines: list[ClosedSpline] = []
        rms = 0.0
        for contour in view.contours:
            spline, gap = fit_spline(contour.points, max(8, math.ceil(spans * contour.length / longest)))
            splines.append(spline)
            rms = max(rms, gap)
        curves = [Contour.trusted(s.sample(), hole=c.hole) for s, c in zip(splines, view.contours, strict=True)]
        sampled = View(curves, view.image)
        gap = rms
        if contacts is not None:
            places = kernels.project_to_contour(sampled.points, sampled.offsets, np.array(contacts, dtype=np.float64))
            gap = max(rms, float(places[:, 2].max()))
        if gap <= tolerance or spans >= MAX_SPANS:
            return sampled, np.concatenate([s.normals() for s in splines]), rms
        spans = min(spans + max(2, spans // 4), MAX_SPANS)


class Template:
    """The searched samples of an outline, and the edge that the first image shows at each.

    Args:
        view: sampled outline.
        normals: (n, 2) unit, of its points.
        image: (H, W) grey.

    Attributes:
        chosen: (m,) indices of the samples that have an edge to rely on; only these are searched.
        polarity: +1 dark object, -1 light object, 0 where its parts differ.
        sign, strength, inside, outside, bias: (m,) of the edge: direction of grey, grey levels per px, grey levels on
            either side, px from the spline along the normal (corners that it cuts, noise).

    Raises:
        ObservationError: less than half of the outline has an edge.
    """

    def __init__(self, view: View, normals: Floats, image: Grey) -> None:
        step = max(1, math.ceil(len(view.points) / MAX_SEARCHED))
        candidates = np.arange(0, len(view.points), step)
        points, across = view.points[candidates], np.ascontiguousarray(normals[candidates])
        edges = kernels.search_along_normals(image, points, across, NEAR, 0)
        found = np.isfinite(edges[:, 0])
        if 2 * int(found.sum()) < len(found):
            share = float(found.mean())
            raise ObservationError(f"only {share:.0%} of the outline lies on an edge of the image", share=share)
        rising = float((edges[found, 1] > 0).mean())
        self.polarity = 1 if rising > 0.7 else -1 if rising < 0.3 else 0
        if self.polarity:
            edges = kernels.search_along_normals(image, points, across, NEAR, self.polarity)
            found = np.isfinite(edges[:, 0])
        size = np.abs(edges[:, 1])
        enough = max(MIN_STRENGTH, MIN_SHARE * float(np.median(size[found]))) if found.any() else MIN_STRENGTH
        # NaN compares false
        good = found & (size >= enough) & (np.abs(edges[:, 0]) <= MAX_BIAS)
        if 2 * int(good.sum()) < len(good):
            share = float(good.mean())
            raise ObservationError(f"only {share:.0%} of the outline has an edge to hold on to", share=share)
        self.chosen = candidates[good]
        self.points: Floats = points[good]
        self.normals: Floats = across[good]
        self.sign: Floats = np.sign(edges[good, 1])
        self.strength: Floats = size[good]
        self.bias: Floats = edges[good, 0].copy()
        self.inside: Floats = edges[good, 2].copy()
        self.outside: Floats = edges[good, 3].copy()

    @property
    def edge_contrast(self) -> Floats:
        """(m,) grey levels across the edge, positive."""
        return np.abs(self.outside - self.inside)

    def learn_levels(self, edges: Floats, seen: Bools) -> None:
        """Let the grey levels follow the light, slowly, where an edge (m, 4) was seen."""
        self.inside[seen] += LEARNING * (edges[seen, 2] - self.inside[seen])
        self.outside[seen] += LEARNING * (edges[seen, 3] - self.outside[seen])
        self.strength[seen] += LEARNING * (np.abs(edges[seen, 1]) - self.strength[seen])
