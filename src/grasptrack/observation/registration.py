# SPDX-License-Identifier: Apache-2.0
"""The homography of the reference outline to the current image, on all the edges along it, sub-pixel.

Every image is registered to the first view, so that errors do not add up. What is hidden, shadowed or cut off has no
edge where it should be, or one that does not agree with the others: it counts nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import View
from grasptrack.errors import TransferError
from grasptrack.kernels.reference_support import hidden_at
from grasptrack.observation.images import Grey

Floats = NDArray[np.float64]
Schedule = tuple[Floats, NDArray[np.int64], NDArray[np.int64]]

SPACING = 2.0
"""px between samples of the reference outline, ..."""
MOST = 480
"""... or more, so that there are at most so many."""
NEAR = 3.0
"""px within which an outline of the reference is settled on its own edges."""
WIDTHS = (4.0, 6.0, 8.0, 12.0, 16.0)
"""px of the outline on which a normal may rest: the first ..."""
WAVERING = 0.06
"""... on which normals differ by no more than this, rad, from those on the last."""
BESIDE_HIDDEN = 6.0
"""px within which of something hidden no sample is taken: an outline that ends there is bent toward it."""
MIN_STRENGTH, RELATIVE_STRENGTH = 2.0, 0.3
"""Grey levels per px of an edge; and its share of the reference's, exposure and blur of the image allowed for."""
FAR: Schedule = (
    np.array([24.0, 12.0, 8.0, 4.0, 3.0]),
    np.array([4, 4, 6, 8, 8]),
    np.array([10, 6, 3, 2, 1]),
)
"""px searched, parameters of the motion, and samples passed over, step by step, from a prediction: few parameters and few
samples bridge gaps, all of them fit."""
CLOSE: Schedule = np.array([5.0, 3.0]), np.array([8, 8]), np.array([2, 1])
"""The same from a pose that is right but for a few px."""


class Registered(NamedTuple):
    """An outline laid on the edges of an image.

    Attributes:
        homography: (3, 3) reference to current.
        left: (m,) px along the normals that it leaves, NaN without an edge.
        weights: (m,) 0 to 1.
        noise: px, of the edges.
    """

    homography: Floats
    left: Floats
    weights: Floats
    noise: float


class OutlineRegistration:
    """Samples of a reference outline, settled on its edges.

    Args:
        view: the reference outline.
        grey: the image it came from.
        polarity: +1 object darker than its surroundings, -1 lighter, 0 where its parts differ.
        clear: (H, W) px from each pixel to what is hidden, in this image and in those that follow; None where nothing is.

    Raises:
        TransferError: too little of the outline shows an edge.
    """

    def __init__(self, view: View, grey: Grey, polarity: int, clear: Grey | None = None) -> None:
        total = sum(c.length for c in view.contours)
        spacing = max(SPACING, total / MOST)
        places = [
            np.column_stack([np.full(n, float(i)), _positions(c.arc_length, n)])
            for i, c in enumerate(view.contours)
            if (n := max(8, round(c.length / spacing)))
        ]
        where = np.ascontiguousarray(np.concatenate(places))
        points = kernels.point_at(view.points, view.offsets, where)
        normals = _normals(view, where)
        edges = kernels.edge_search(grey, points, normals, NEAR, polarity)
        strength = np.abs(edges[:, 1])
        good = (np.abs(edges[:, 0]) <= 0.5 * NEAR) & (strength >= MIN_STRENGTH)
        if clear is not None:
            good &= ~hidden_at(clear, points, BESIDE_HIDDEN)
        if good.any():
            good &= strength >= RELATIVE_STRENGTH * float(np.median(strength[good]))
        if np.count_nonzero(good) < 24:
            raise TransferError("too little of the outline shows an edge to register it")
        self._points: Floats = np.ascontiguousarray((points + edges[:, :1] * normals)[good])
        self._normals: Floats = np.ascontiguousarray(normals[good])
        self._strength: Floats = np.ascontiguousarray((strength if polarity else edges[:, 1])[good])
        self._polarity = polarity
        self.clear = clear

    @property
    def samples(self) -> tuple[Floats, Floats, Floats, int]:
        """(m, 2) px, (m, 2) normals and (m,) strengths of the samples, and the polarity."""
        return self._points, self._normals, self._strength, self._polarity

    def refine(self, grey: Grey, H: Floats, schedule: Schedule = FAR) -> Registered:
        """The homography that lays the outline on the edges of an image.

        Args:
            grey: (H, W).
            H: (3, 3) to begin with.
            schedule: `FAR` from a prediction, `CLOSE` from a pose.

        Raises:
            TransferError: too few edges.
        """
        found = kernels.register_outline(
            grey,
            H,
            self._points,
            self._normals,
            self._strength,
            self._polarity,
            *schedule,
            MIN_STRENGTH,
            RELATIVE_STRENGTH,
            self.clear,
        )
        if not math.isfinite(found[3]):
            raise TransferError("too few edges along the outline where it was expected")
        return Registered(*found)


def _normals(view: View, where: Floats) -> Floats:
    """(m, 2) normals at places of an outline, as local as its noise allows: where they waver, a disc seems to show its turn."""
    far = -kernels.contact_frames(view.points, view.offsets, where, WIDTHS[-1])[:, :2]
    for width in WIDTHS[:-1]:
        near = -kernels.contact_frames(view.points, view.offsets, where, width)[:, :2]
        turn = near[:, 0] * far[:, 1] - near[:, 1] * far[:, 0]
        if 1.4826 * float(np.median(np.abs(turn))) <= WAVERING:
            return np.ascontiguousarray(near)
    return np.ascontiguousarray(far)


def _positions(arc_length: Floats, count: int) -> Floats:
    """(count,) positions at equal steps of arc length round a contour, whose (N + 1,) arc lengths are given."""
    at: Floats = np.interp(np.arange(count) * (arc_length[-1] / count), arc_length, np.arange(len(arc_length)))
    return np.asarray(np.mod(at, len(arc_length) - 1), dtype=np.float64)
