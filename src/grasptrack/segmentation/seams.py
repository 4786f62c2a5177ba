# SPDX-License-Identifier: Apache-2.0
"""Where a region may be two things that touch: cut off at its necks, from one inward corner of its outline to another.

People part silhouettes by such cuts, and rather by short ones (Singh, Seyranian and Hoffman, Perception & Psychophysics 61,
1999).
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.segmentation.silhouettes import Chain, Silhouette
from grasptrack.typing import Floats

ARM = 5
"""px of an outline on either side of a point between which it turns there."""
MOST_CORNERS, MOST_PARTS = 24, 4
"""Inward corners that are looked at, the sharpest, and parts that are offered, those with the narrowest cuts."""
SAMPLES = 16
"""Points of a cut that lie within the region."""


class SeamPart(NamedTuple):
    """What a cut leaves of a region.

    Attributes:
        outer: (n, 2) px of its boundary.
        narrow: length of the cut beside the size of the lesser part, 0 to 1: as wide as it is long it is no neck.
    """

    outer: Chain
    narrow: float


def parts_with_contacts(shape: Silhouette, contacts: Floats, near: float) -> list[SeamPart]:
    """The parts of a region that all contacts (k, 2) px lie in, or no more than so many px beside, the narrowest cuts first."""
    ring = shape.outer.astype(np.float64)
    corners = _inward_corners(ring)
    i, j = (corners[k] for k in np.triu_indices(len(corners), 1))
    a, b = ring[i], ring[j]
    x, y = ring.T
    swept = np.concatenate([[0.0], np.cumsum(x * np.roll(y, -1) - y * np.roll(x, -1))])
    between = np.abs(swept[j] - swept[i] + b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])
    lesser = 0.5 * np.minimum(between, np.abs(swept[-1]) - between)
    narrow = np.hypot(*(b - a).T) / np.sqrt(np.maximum(lesser, 1.0))
    x0, y0, w, h = shape.box
    filled = shape.filled_window((x0, y0, x0 + w, y0 + h)) > 0
    along = np.linspace(0.0, 1.0, SAMPLES)[:, None, None]
    column, row = np.moveaxis(np.rint(a + along * (b - a)).astype(np.intp) - (x0, y0), 2, 0)
    inside = filled[row, column].all(axis=0)
    found: list[SeamPart] = []
    for k in np.argsort(narrow, kind="stable"):
        if narrow[k] >= 1.0 or len(found) == MOST_PARTS:
            break
        if not inside[k]:
            continue
        for part in (shape.outer[i[k] : j[k] + 1], np.concatenate([shape.outer[j[k] :], shape.outer[: i[k] + 1]])):
            if all(cv2.pointPolygonTest(part, (u, v), True) >= -near for u, v in contacts.tolist()):
                found.append(SeamPart(np.ascontiguousarray(part), float(narrow[k])))
    return found


def _inward_corners(ring: Floats) -> NDArray[np.intp]:
    """Points of a boundary (n, 2) where it turns inward, each the sharpest within ARM px, in their order along it."""
    before, after = ring - np.roll(ring, ARM, axis=0), np.roll(ring, -ARM, axis=0) - ring
    turn = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1))
    inward = -turn * np.sign(turn.sum())
    most = np.max([np.roll(inward, k) for k in range(-ARM, ARM + 1)], axis=0)
    peaks = np.flatnonzero((inward >= most) & (inward > 2.0 / ARM))  # rounding to pixels turns it by that
    return np.sort(peaks[np.argsort(-inward[peaks], kind="stable")][:MOST_CORNERS])
