# SPDX-License-Identifier: Apache-2.0
"""What the image shows of an object: edges along its outline, structure of its surface and of the ground, against the noise."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.equality import compared_by_value
from grasptrack.geometry.contours import View
from grasptrack.images import Grey
from grasptrack.statistics import MAD_TO_SD, lower_median, robust_sd
from grasptrack.typing import Bools, Floats

NEAR = 3.0
"""px across the outline within which its edge is looked for."""
MIN_STRENGTH, RELATIVE_STRENGTH = 2.0, 0.3
"""Grey levels per px of a clear edge; and its share of the median edge's."""
SPACING, MOST = 2.0, 480
"""px along the outline between edges whose errors are independent, or more, so that there are at most so many."""
ACROSS = 6.0
"""px along the outline over which its direction is taken."""
LEAST = 5
"""Stretches in a row that their directions' noise is measured on."""


@compared_by_value
class Edges(NamedTuple):
    """Edges at points of an outline, about one each px.

    Attributes:
        points, normals: (n, 2) px on the edge where there is one, (n, 2) unit, out of the material.
        strength: (n,) grey levels per px; 0 without an edge.
        contrast: (n,) grey levels across it; 0 without an edge.
        beyond: (n,) grey level of the ground beside it; NaN without an edge.
        clear: (n,) strong enough for the tracker to use.
        contour: (n,) index of the contour.
        spacing: points from one that the registration would use to the next.
    """

    points: Floats
    normals: Floats
    strength: Floats
    contrast: Floats
    beyond: Floats
    clear: Bools
    contour: NDArray[np.int64]
    spacing: int

    @property
    def spaced_samples(self) -> tuple[Floats, Floats]:
        """Points and normals (m, 2) at the spacing of a registration, of clear edges only."""
        keep = self.clear & (np.arange(len(self.points)) % self.spacing == 0)
        return self.points[keep], self.normals[keep]


def edges_of(view: View, grey: Grey, polarity: int) -> Edges:
    """Edges along all contours of a view."""
    where = np.concatenate(
        [np.column_stack([np.full(len(c), float(i)), np.arange(len(c))]) for i, c in enumerate(view.contours)]
    )
    frames = kernels.contact_frames(view.points, view.offsets, np.ascontiguousarray(where), ACROSS)
    normals = np.ascontiguousarray(-frames[:, :2])
    found = kernels.search_along_normals(grey, np.ascontiguousarray(view.points), normals, NEAR, polarity)
    cut = np.concatenate([np.zeros(len(c), np.bool_) if c.clipped is None else c.clipped for c in view.contours])
    strength = np.where(np.isnan(found[:, 0]) | cut, 0.0, np.abs(found[:, 1]))
    clear = (np.abs(found[:, 0]) <= 0.5 * NEAR) & (strength >= MIN_STRENGTH)
    if clear.any():
        clear &= strength >= RELATIVE_STRENGTH * float(np.median(strength[clear]))
    offset = np.where(clear, found[:, 0], 0.0)
    total = sum(c.length for c in view.contours)
    return Edges(
        view.points + offset[:, None] * normals,
        normals,
        strength,
        np.where(strength > 0.0, np.abs(np.nan_to_num(found[:, 3] - found[:, 2])), 0.0),
        found[:, 3],
        clear,
        where[:, 0].astype(np.int64),
        max(1, round(max(SPACING, total / MOST) * len(where) / total)),
    )


def edge_direction_noise(edges: Edges) -> float:
    """rad, standard deviation of an edge's direction from noise alone: by third differences, in which curvature cancels."""
    angles = np.arctan2(edges.normals[:, 1], edges.normals[:, 0])
    step, differences = round(ACROSS), []
    for i in range(int(edges.contour.max()) + 1):
        own = angles[edges.contour == i]
        if len(own) >= LEAST * step:
            turns = np.angle(np.exp(1j * (np.roll(own, -step) - own)))  # from one stretch to the next
            differences.append(np.roll(turns, -step) - 2.0 * turns + np.roll(turns, step))
    shown = np.abs(np.concatenate(differences)) if differences else np.zeros(0)
    return MAD_TO_SD * lower_median(shown) / math.sqrt(20.0)


DEPTH = 4.0
"""px that either is looked at away from the outline, whose edge is none of theirs."""
AROUND = 0.25
"""The ground is looked at within this fraction of sqrt(area) of the outline."""
OF_SLOPES = 12.0 / 64.0
"""Variance of one component of a Sobel slope of independent pixels of variance 1."""
QUANTUM = 1.0 / math.sqrt(12.0)
"""Grey levels, the noise of rounding to whole ones."""
CUT = 3.0
"""Standard deviations beyond which a second difference is structure, ..."""
OF_NORMAL = math.sqrt(2.0 / math.pi) * (1.0 - math.exp(-0.5 * CUT**2)) / math.erf(CUT / math.sqrt(2.0))
"""... and the mean size of normal noise that is cut off there, in its standard deviation."""
DOUBT = 3.0
"""Structure counts as far as it exceeds what noise makes by so many standard deviations of that."""


@compared_by_value
class Relief(NamedTuple):
    """Slopes (m, 2), grey levels per px, at points (m, 2) px of one part of an image, and a pixel's noise, grey levels."""

    points: Floats
    slopes: Floats
    noise: float

    @property
    def rms(self) -> float:
        """Grey levels per px, rms of the slopes less what noise makes of them."""
        if not len(self.points):
            return 0.0
        excess = float(np.square(self.slopes).sum(axis=1).mean()) - 2.0 * self._noise_slope_variance
        return math.sqrt(max(excess, 0.0))

    @property
    def least(self) -> float:
        """Grey levels per px, rms slope in the direction that shows least structure, less what noise makes of it."""
        if not len(self.points):
            return 0.0
        tensor = self.slopes.T @ self.slopes / len(self.points)
        return math.sqrt(max(float(np.linalg.eigvalsh(tensor)[0]) - self._noise_slope_variance, 0.0))

    @property
    def _noise_slope_variance(self) -> float:
        """Mean square slope in one direction that may be noise."""
        return OF_SLOPES * self.noise**2 * (1.0 + DOUBT * math.sqrt(2.0 / len(self.points)))


def gradient_statistics(grey: Grey, view: View, hidden: Grey | None = None) -> tuple[Relief, Relief]:
    """Slopes within an outline, and of the ground round it, both clear of the outline itself."""
    band = math.ceil(AROUND * math.sqrt(view.outer.area) + DEPTH) + 2
    low = np.maximum(np.floor(view.outer.points.min(axis=0)).astype(int) - band, 0)
    high = np.minimum(np.ceil(view.outer.points.max(axis=0)).astype(int) + band, [grey.shape[1] - 1, grey.shape[0] - 1])
    part = grey[low[1] : high[1] + 1, low[0] : high[0] + 1].astype(np.float32)
    material = np.zeros(part.shape, np.uint8)
    cv2.fillPoly(material, [np.rint(c.points - low).astype(np.int32) for c in view.contours], (255,))
    solid = np.zeros(part.shape, np.uint8)
    cv2.fillPoly(solid, [np.rint(view.outer.points - low).astype(np.int32)], (255,))
    deep = cv2.distanceTransform(material, cv2.DIST_L2, 3)
    off = cv2.distanceTransform(255 - solid, cv2.DIST_L2, 3)
    dx, dy = (cv2.Sobel(part, cv2.CV_32F, *way, scale=0.125) for way in ((1, 0), (0, 1)))
    free = np.ones(part.shape, np.bool_)
    if hidden is not None:
        free = hidden[low[1] : high[1] + 1, low[0] : high[0] + 1] == 0
    free[[0, -1]] = free[:, [0, -1]] = False
    noise = _estimate_noise(part, free)
    made = []
    for where in (deep >= DEPTH, (off >= DEPTH) & (off <= band)):
        row, column = np.nonzero(where & free)
        slopes = np.column_stack([dx[row, column], dy[row, column]]).astype(np.float64)
        made.append(Relief(np.column_stack([column, row]).astype(np.float64) + low, slopes, noise))
    return made[0], made[1]


def _estimate_noise(part: NDArray[np.float32], free: NDArray[np.bool_]) -> float:
    """Grey levels, standard deviation of a pixel, from second differences in both directions (Immerkaer 1996), robust."""
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    left = np.abs(cv2.filter2D(part, cv2.CV_32F, kernel)[free]) / 6.0
    if not left.size:
        return QUANTUM
    rough = max(robust_sd(left), QUANTUM)
    # grey levels are whole numbers, and so would a median be: the mean of what is not plainly an edge
    return max(float(left[left <= CUT * rough].mean()) / OF_NORMAL, QUANTUM)
