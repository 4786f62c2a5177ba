# SPDX-License-Identifier: Apache-2.0
"""How well a mask agrees with a true one: overlap of the areas, and agreement of the edges within a tolerance."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.contours import Contour, View
from grasptrack_bench.simulation.coverage import inside_mask

Mask = NDArray[np.bool_]

ENOUGH_F = 0.9
"""Of an object that counts as found: the outline is where it should be almost everywhere."""
ENOUGH_IOU = 0.7
"""Of an object that counts as found. Low, because a slender object loses much of it to a mask's own error of 2 px."""


def mask_of(view: View | Contour, shape: tuple[int, int]) -> Mask:
    """(H, W) whether each pixel's centre lies on the object: inside its outline and in no hole (even-odd rule)."""
    return inside_mask([c.points for c in view.contours], shape[1], shape[0])


def intersection_over_union(a: Mask, b: Mask) -> float:
    """Area that two masks (H, W) of one size share, over the area that either covers, 0 to 1; two empty masks agree."""
    _same_size(a, b)
    either = np.count_nonzero(a | b)
    return float(np.count_nonzero(a & b) / either) if either else 1.0


def dilate_mask(mask: Mask, radius: float) -> Mask:
    """(H, W) the pixels no farther than `radius` px from one of a mask (H, W): the mask dilated by a disc."""
    reach = math.floor(radius)
    steps = np.arange(-reach, reach + 1)
    disc = (np.hypot(steps[:, None], steps) <= radius).astype(np.uint8)
    grown = cv2.dilate(mask.astype(np.uint8), disc, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(grown, dtype=np.bool_)


def mask_boundary(mask: Mask) -> Mask:
    """(H, W) the mask's pixels beside one that is not of it, across a side; beyond the image nothing is of it."""
    return mask & dilate_mask(np.pad(~mask, 1, constant_values=True), 1.0)[1:-1, 1:-1]


def boundary_f(a: Mask, b: Mask, tolerance: float = 4.0) -> float:
    """Harmonic mean of the shares of each mask's boundary that lies near the other's, 0 to 1; two empty masks agree.

    Near is within a tolerance in px; the masks (H, W) are of one size.
    """
    _same_size(a, b)
    edge_a, edge_b = mask_boundary(a), mask_boundary(b)
    if not edge_a.any() or not edge_b.any():
        return float(edge_a.any() == edge_b.any())
    one, other = (
        float(dilate_mask(edge_b, tolerance)[edge_a].mean()),
        float(dilate_mask(edge_a, tolerance)[edge_b].mean()),
    )
    return 2.0 * one * other / (one + other) if one + other else 0.0


def band_iou(mask: Mask, radius: float = 2.0) -> tuple[float, float]:
    """IoU of a mask with itself eroded and with itself dilated by a disc: what masks no more exact than this can tell."""
    return intersection_over_union(mask, ~dilate_mask(~mask, radius)), intersection_over_union(
        mask, dilate_mask(mask, radius)
    )


def _same_size(a: Mask, b: Mask) -> None:
    if a.shape != b.shape:
        raise ValueError(f"masks to compare must be of one size, not {a.shape} and {b.shape}")
