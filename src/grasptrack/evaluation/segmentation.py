# SPDX-License-Identifier: Apache-2.0
"""How well a mask agrees with a true one: overlap of the areas, and agreement of the edges within a tolerance."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.contour import Contour, View
from grasptrack.simulation.coverage import inside_mask

Mask = NDArray[np.bool_]

ENOUGH_F = 0.9
"""Of an object that counts as found: the outline is where it should be almost everywhere."""
ENOUGH_IOU = 0.7
"""Of an object that counts as found. Low, because a slender object loses much of it to a mask's own error of 2 px."""

_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], dtype=np.uint8)


def mask_of(view: View | Contour, shape: tuple[int, int]) -> Mask:
    """(H, W) whether each pixel's centre lies on the object: inside its outline and in no hole (even-odd rule).

    Args:
        view: px, pixel centres at integer coordinates.
        shape: (H, W) px; what lies outside is cut off.
    """
    return inside_mask([c.points for c in view.contours], shape[1], shape[0])


def iou(a: Mask, b: Mask) -> float:
    """Area that two masks (H, W) share, over the area that either covers, 0 to 1; two empty masks agree.

    Raises:
        ValueError: the masks differ in size.
    """
    _same_size(a, b)
    either = np.count_nonzero(a | b)
    return float(np.count_nonzero(a & b) / either) if either else 1.0


def boundary(mask: Mask) -> Mask:
    """(H, W) the mask's pixels beside one that is not of it, across a side; beyond the image nothing is of it."""
    binary = mask.astype(np.uint8)
    inner = cv2.erode(binary, _CROSS, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(binary > inner)


def boundary_f(a: Mask, b: Mask, tolerance: float = 4.0) -> float:
    """Harmonic mean of the shares of each mask's boundary that lies near the other's, 0 to 1; two empty masks agree.

    Args:
        a, b: (H, W).
        tolerance: px, the distance up to which a boundary pixel counts as near.

    Raises:
        ValueError: the masks differ in size.
    """
    _same_size(a, b)
    edge_a, edge_b = boundary(a), boundary(b)
    if not edge_a.any() or not edge_b.any():
        return float(edge_a.any() == edge_b.any())
    one, other = _share_near(edge_a, edge_b, tolerance), _share_near(edge_b, edge_a, tolerance)
    return 2.0 * one * other / (one + other) if one + other else 0.0


def band_iou(mask: Mask, radius: int = 2) -> tuple[float, float]:
    """IoU of a mask (H, W) with itself eroded and with itself dilated by a disc: the most that masks so exact can say.

    Args:
        mask: (H, W), with room for the dilation.
        radius: px.
    """
    x, y = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    disc = (x * x + y * y <= radius * radius).astype(np.uint8)
    binary = mask.astype(np.uint8)
    eroded = cv2.erode(binary, disc, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return iou(mask, eroded > 0), iou(mask, cv2.dilate(binary, disc) > 0)


def deepest(mask: Mask) -> tuple[float, float]:
    """(x, y) px of the mask's pixel that is farthest from all that is not of it: where a user would point.

    Raises:
        ValueError: the mask is empty.
    """
    if not mask.any():
        raise ValueError("an empty mask has no inside to point at")
    padded = np.pad(mask, 1).astype(np.uint8)
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    y, x = np.unravel_index(int(np.argmax(depth)), mask.shape)
    return float(x), float(y)


def _share_near(edge: Mask, other: Mask, tolerance: float) -> float:
    distance = cv2.distanceTransform((~other).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return float(np.mean(distance[edge] <= tolerance + 1e-3))  # the distances are rounded to single precision


def _same_size(a: Mask, b: Mask) -> None:
    if a.shape != b.shape:
        raise ValueError(f"masks to compare must be of one size, not {a.shape} and {b.shape}")
