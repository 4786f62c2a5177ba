# SPDX-License-Identifier: Apache-2.0
"""Where the object may be when continuity does not tell: shifted from its last look, or anywhere by its keypoints."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.projective import apply_homography
from grasptrack.tracking.estimator import Hypothesis
from grasptrack.tracking.state import Look
from grasptrack.tracking.target import Grey, Target

Floats = NDArray[np.float64]

SMALL = 28.0
"""px, size of the object on the image on which a shift is looked for."""
SHIFTS = 3
"""Places that are tried."""
LEAST_LIKE = 0.4
"""Correlation of a look at a place that is tried."""


class Keypoints:
    """Keypoints of the object in the first image, to be found anywhere.

    Args:
        target: the object.
        grey: (H, W) the first image.
    """

    def __init__(self, target: Target, grey: Grey) -> None:
        self._target = target
        self._detector: Any = cv2.ORB.create(1200, fastThreshold=8)
        mask = np.zeros_like(grey)
        outline = target.view.outer.points
        cv2.fillPoly(mask, [np.round(outline).astype(np.int32)], 255)
        self._points, self._descriptors = self._detector.detectAndCompute(
            grey, cv2.dilate(mask, np.ones((9, 9), np.uint8))
        )

    def find(self, grey: Grey) -> Floats | None:
        """(3, 3) a pose on which enough keypoints of an image (H, W) agree, or None."""
        if self._descriptors is None or len(self._descriptors) < 8:
            return None
        points, descriptors = self._detector.detectAndCompute(grey, None)
        if descriptors is None or len(points) < 8:
            return None
        pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(self._descriptors, descriptors, k=2)
        good = [a for a, b in (p for p in pairs if len(p) == 2) if a.distance < 0.8 * b.distance]
        if len(good) < 8:
            return None
        source = np.array([self._points[m.queryIdx].pt for m in good], np.float32)
        place = np.array([points[m.trainIdx].pt for m in good], np.float32)
        H, inliers = cv2.findHomography(source, place, cv2.RANSAC, 4.0)
        if H is None or inliers.sum() < 8:
            return None
        return self._target.pose(np.asarray(H, dtype=np.float64))


def shifted_looks(target: Target, look: Look, levels: list[Grey]) -> list[Floats]:
    """Poses (3, 3) at which the last look fits again, moved as a whole, the best first."""
    outline = apply_homography(look.G, target.outline)
    size = math.sqrt(abs(cv2.contourArea(outline.astype(np.float32))) + 1.0)
    scale = min(1.0, SMALL / size)
    height, width = levels[0].shape
    small = (max(8, int(width * scale)), max(8, int(height * scale)))
    level = 0
    while level + 1 < len(levels) and min(levels[level + 1].shape) >= min(small):
        level += 1
    before, now = (
        cv2.GaussianBlur(cv2.resize(pyramid[level], small, interpolation=cv2.INTER_AREA), (0, 0), 0.8)
        for pyramid in (look.levels, levels)
    )
    mask: Grey = np.zeros(before.shape, np.uint8)
    cv2.fillPoly(mask, [np.round(outline * scale).astype(np.int32)], 255)
    mask = np.asarray(cv2.dilate(mask, np.ones((5, 5), np.uint8)), dtype=np.uint8)
    x, y, w, h = cv2.boundingRect(mask)
    if w < 6 or h < 6:
        return []
    pad = max(w, h) // 2
    wide = cv2.copyMakeBorder(now, pad, pad, pad, pad, cv2.BORDER_REPLICATE).astype(np.float32)
    patch, weight = before[y : y + h, x : x + w].astype(np.float32), (mask[y : y + h, x : x + w] > 0).astype(np.float32)
    likeness = cv2.matchTemplate(wide, patch, cv2.TM_CCOEFF_NORMED, mask=weight)
    likeness[~np.isfinite(likeness)] = -1.0
    poses = []
    for _ in range(SHIFTS):
        _, best, _, (i, j) = cv2.minMaxLoc(likeness)
        if best < LEAST_LIKE:
            break
        T = np.eye(3)
        T[:2, 2] = (i - pad - x) / scale, (j - pad - y) / scale
        poses.append(T @ look.G)
        cv2.circle(likeness, (i, j), max(3, min(w, h) // 3), -1.0, -1)
    return poses


def wide_prior(target: Target) -> Floats:
    """(8, 8) covariance of a pose that was found, work px^2."""
    return np.asarray(np.diag([0.03 * target.size] * 6 + [0.01 * target.size] * 2) ** 2, dtype=np.float64)


def search(target: Target, located: Look, keypoints: Keypoints, levels: list[Grey]) -> list[Hypothesis]:
    """Hypotheses that continuity did not give."""
    wide = wide_prior(target)
    found = [Hypothesis("shifted", G, wide) for G in shifted_looks(target, located, levels)]
    G = keypoints.find(levels[0])
    if G is not None:
        found.append(Hypothesis("keypoints", G, wide))
    return found


CONTINUOUS = ("texture", "background", "at rest", "moving on")
"""Origins of hypotheses that continue what was."""
