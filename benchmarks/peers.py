# SPDX-License-Identifier: Apache-2.0
"""What a user would otherwise build from OpenCV, each in a few lines: the motion from the first frame to each frame."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

Array = np.ndarray
Peer = Callable[[Array], Array | None]
"""Called with each grey image in order, the first too; gives H_current_reference (3, 3), or None without an answer."""


class OtsuMoments:
    """Otsu silhouette; centroid, area and the axis of least inertia of its outline give a similarity."""

    def __init__(self) -> None:
        self._first: tuple[Array, float, float] | None = None
        self._angle = 0.0

    def __call__(self, image: Array) -> Array | None:  # noqa: D102
        _, binary = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
        outlines, _ = cv2.findContours(binary, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        if not outlines:
            return None
        m = cv2.moments(max(outlines, key=cv2.contourArea))
        if m["m00"] <= 0.0:
            return None
        centre = np.array([m["m10"], m["m01"]]) / m["m00"]
        angle = 0.5 * np.arctan2(2.0 * m["mu11"], m["mu20"] - m["mu02"])
        angle += np.pi * round((self._angle - angle) / np.pi)  # the turn nearest to the frame before
        self._angle = angle
        if self._first is None:
            self._first = (centre, m["m00"], angle)
        centre_0, area_0, angle_0 = self._first
        scale, turn = np.sqrt(m["m00"] / area_0), angle - angle_0
        c, s = scale * np.cos(turn), scale * np.sin(turn)
        H = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        H[:2, 2] = centre - H[:2, :2] @ centre_0
        return H


class Ecc:
    """cv2.findTransformECC with a homography on the part's surroundings, started from the frame before."""

    def __init__(self, mask: Array) -> None:
        x, y, w, h = cv2.boundingRect(cv2.dilate(mask, np.ones((25, 25), np.uint8)))
        self._box, self._template, self._warp = (x, y, w, h), None, np.eye(3, dtype=np.float32)

    def __call__(self, image: Array) -> Array | None:  # noqa: D102
        x, y, w, h = self._box
        if self._template is None:
            self._template = image[y : y + h, x : x + w].copy()
            self._warp[:2, 2] = x, y
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 1e-4)
        try:
            _, self._warp = cv2.findTransformECC(
                self._template, image, self._warp, cv2.MOTION_HOMOGRAPHY, criteria, None, 5
            )
        except cv2.error:
            return None
        back = np.eye(3)
        back[:2, 2] = -x, -y
        return np.asarray(self._warp, np.float64) @ back


class Klt:
    """Good features on the part in the first frame, carried on by Lucas-Kanade; RANSAC homography from that frame."""

    def __init__(self, mask: Array) -> None:
        self._mask, self._image = mask, None

    def __call__(self, image: Array) -> Array | None:  # noqa: D102
        if self._image is None:
            self._start = cv2.goodFeaturesToTrack(image, 200, 0.01, 5, mask=self._mask)
            self._now, self._image = self._start, image
            return np.eye(3)
        if self._now is None or len(self._now) < 4:
            return None
        now, good, _ = cv2.calcOpticalFlowPyrLK(self._image, image, self._now, None)
        kept = good.ravel() == 1
        self._start, self._now, self._image = self._start[kept], now[kept], image
        if kept.sum() < 4:
            return None
        H, _ = cv2.findHomography(self._start, self._now, cv2.RANSAC, 3.0)
        return H


class Sift:
    """SIFT on the part in the first frame against the whole image, ratio test, RANSAC homography."""

    def __init__(self, mask: Array) -> None:
        self._mask, self._sift, self._matcher, self._first = mask, cv2.SIFT_create(), cv2.BFMatcher(), None

    def __call__(self, image: Array) -> Array | None:  # noqa: D102
        if self._first is None:
            self._first = self._sift.detectAndCompute(image, self._mask)
            return np.eye(3)
        points_0, described_0 = self._first
        points, described = self._sift.detectAndCompute(image, None)
        if described_0 is None or described is None or len(points) < 2:
            return None
        pairs = [p for p in self._matcher.knnMatch(described_0, described, k=2) if len(p) == 2]
        good = [m for m, n in pairs if m.distance < 0.75 * n.distance]
        if len(good) < 8:
            return None
        a = np.float32([points_0[m.queryIdx].pt for m in good])
        b = np.float32([points[m.trainIdx].pt for m in good])
        H, inliers = cv2.findHomography(a, b, cv2.RANSAC, 3.0)
        return H if H is not None and inliers.sum() >= 8 else None


def peers(mask: Array) -> dict[str, Peer]:
    """Fresh peers by name; mask (H, W), nonzero on the part in the first frame."""
    return {
        "OpenCV Otsu + moments": OtsuMoments(),
        "OpenCV ECC homography": Ecc(mask),
        "OpenCV KLT + RANSAC": Klt(mask),
        "OpenCV SIFT + RANSAC": Sift(mask),
    }
