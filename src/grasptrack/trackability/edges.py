# SPDX-License-Identifier: Apache-2.0
"""The edges along an outline: how strong, how sharp, how noisy."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.contours import View
from grasptrack.kernels.reference.homography import lower_median
from grasptrack.segmentation.images import Grey
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
    def used(self) -> tuple[Floats, Floats]:
        """Points and normals (m, 2) at the spacing of a registration, of clear edges only."""
        keep = self.clear & (np.arange(len(self.points)) % self.spacing == 0)
        return self.points[keep], self.normals[keep]


def edges_of(view: View, grey: Grey, polarity: int) -> Edges:
    """Edges along all contours of a view.

    Args:
        view: the outline.
        grey: (H, W) the image it came from.
        polarity: +1 object darker than its surroundings, -1 lighter, 0 where its parts differ.
    """
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
    return 1.4826 * lower_median(shown) / math.sqrt(20.0)
