# SPDX-License-Identifier: Apache-2.0
"""Where a region may be two things that touch: cut off at its necks, from one inward corner of its outline to another.

People part silhouettes by such cuts, and rather by short ones (Singh, Seyranian and Hoffman, Perception & Psychophysics 61,
1999). Whether a cut parts two things is told by what lies on both sides of it: the same colours and grain, or others.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.segmentation.closed_edges import CHROMA, LIGHTNESS, Planes
from grasptrack.segmentation.silhouettes import Chain, Silhouette
from grasptrack.statistics import robust_sd
from grasptrack.typing import Floats

ARM = 5
"""px of an outline on either side of a point between which it turns there."""
MOST_CORNERS, MOST_PARTS = 24, 4
"""Inward corners that are looked at, the sharpest, and parts that are offered, those with the narrowest cuts."""
SAMPLES = 16
"""Points of a cut that lie within the region."""
MOST_COMPARED, RIM, PATCH, LEAST_PATCHES = 8, 5, 7, 6
"""Cuts across which sides are compared; px of the working image beside an outline that belong to its edge; px across of patches
of each side, and how many show its look."""
GRAIN = 1.0
"""px, Gaussian blur that takes shading away and leaves grain."""
APART_NOISE = 3.0
"""Standard deviations of the patches of one thing by which two things differ."""


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
    found: list[SeamPart] = []
    for narrow, *parts in _narrow_cuts(shape):
        for part in parts:
            if all(cv2.pointPolygonTest(part, (u, v), True) >= -near for u, v in contacts.tolist()):
                found.append(SeamPart(np.ascontiguousarray(part), narrow))
        if len(found) >= MOST_PARTS:
            break
    return found[:MOST_PARTS]


def joined_parts(shape: Silhouette, planes: Planes, px: int) -> list[tuple[float, Chain, Chain]]:
    """Two things that touch, where a region may be such: how plainly it is, 0 to 1, and both; the plainest first.

    On both sides of a cut colours or grain differ by more than along one side, and the cut is narrow. The planes (h, w, C) are
    of the image reduced by `px`.
    """
    x, y, w, h = (each // px for each in shape.box)
    left, top = max(x - PATCH, 0), max(y - PATCH, 0)
    looks = _patch_looks(np.ascontiguousarray(planes[top : y + h + PATCH, left : x + w + PATCH]))
    least = np.array([LIGHTNESS, *[CHROMA] * (planes.shape[2] - 1), 1.0 / (math.sqrt(2.0) * PATCH)])  # of rounding
    found: list[tuple[float, Chain, Chain]] = []
    for narrow, one, other in islice(_narrow_cuts(shape), MOST_COMPARED):
        seen = [_looks_within(part // px - (left, top), looks) for part in (one, other)]
        if min(map(len, seen)) >= LEAST_PATCHES:
            middles = [np.median(side, axis=0) for side in seen]
            spreads = [[robust_sd(each) for each in (s - m).T] for s, m in zip(seen, middles, strict=True)]
            apart = np.abs(middles[0] - middles[1]) / np.sqrt((np.array([*spreads, least]) ** 2).sum(axis=0))
            squared = float(apart.max()) ** 2
            found.append(((1.0 - narrow) * (squared / (squared + APART_NOISE**2)) ** 2, one, other))
    return sorted(found, key=lambda each: -each[0])


def _patch_looks(window: Planes) -> Floats:
    """(h, w, C + 1) mean colours of the patch round each pixel of (h, w, C), and the logarithm of its grain."""
    means = cv2.blur(window, (PATCH, PATCH)).reshape(window.shape)
    light = np.ascontiguousarray(window[:, :, 0])
    fine = light - cv2.GaussianBlur(light, (0, 0), GRAIN)
    grain = 0.5 * np.log(cv2.blur(fine**2, (PATCH, PATCH)) + LIGHTNESS**2)
    return np.dstack([means, grain]).astype(np.float64)


def _looks_within(ring: Chain, looks: Floats) -> Floats:
    """(n, C + 1) looks of patches well within a chain (m, 2), those of every few px."""
    mask = np.zeros(looks.shape[:2], np.uint8)
    cv2.fillPoly(mask, [np.ascontiguousarray(ring, dtype=np.int32).reshape(-1, 1, 2)], (1,))
    deep = cv2.erode(mask, np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8))
    step = PATCH // 2 + 1
    return np.asarray(looks[::step, ::step][deep[::step, ::step] > 0])


def _narrow_cuts(shape: Silhouette) -> Iterator[tuple[float, Chain, Chain]]:
    """Cuts within a region that are shorter than its lesser part is large, the narrowest first: how narrow, and both parts."""
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
    for k in np.argsort(narrow, kind="stable"):
        if narrow[k] >= 1.0:
            break
        if inside[k]:
            rest = np.concatenate([shape.outer[j[k] :], shape.outer[: i[k] + 1]])
            yield float(narrow[k]), shape.outer[i[k] : j[k] + 1], rest


def _inward_corners(ring: Floats) -> NDArray[np.intp]:
    """Points of a boundary (n, 2) where it turns inward, each the sharpest within ARM px, in their order along it."""
    before, after = ring - np.roll(ring, ARM, axis=0), np.roll(ring, -ARM, axis=0) - ring
    turn = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1))
    inward = -turn * np.sign(turn.sum())
    most = np.max([np.roll(inward, k) for k in range(-ARM, ARM + 1)], axis=0)
    peaks = np.flatnonzero((inward >= most) & (inward > 2.0 / ARM))  # rounding to pixels turns it by that
    return np.sort(peaks[np.argsort(-inward[peaks], kind="stable")][:MOST_CORNERS])
