# SPDX-License-Identifier: Apache-2.0
"""Points on the part and a homography through them, from OpenCV: KLT and SIFT."""

from __future__ import annotations

from functools import partial
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.homographies import apply_homography, judge_distortion
from grasptrack.images import Grey
from grasptrack.typing import Floats
from grasptrack_bench.baselines.base import BaselineAnswer, LostError, Peer, region_of

Points = NDArray[np.float32]

REPROJECTION = 2.0
"""px within which a point agrees with a homography."""
LEAST = 8
"""Points that have to agree."""
MARGIN = 8
"""px round the part in which points are looked for: its corners lie on its edge."""


def robust_homography(first: Points, now: Points) -> tuple[Floats, NDArray[np.bool_]]:
    """The homography (3, 3) from points (N, 2) to points (N, 2), and which agree with it.

    Raises:
        LostError: too few points, or too few that agree.
    """
    if len(first) < LEAST:
        raise LostError(f"only {len(first)} points of the part are found; {LEAST} are needed")
    H, inliers = cv2.findHomography(first, now, cv2.USAC_MAGSAC, REPROJECTION, maxIters=2000, confidence=0.999)
    if H is None or inliers is None:
        raise LostError("no homography fits the points")
    kept = np.asarray(inliers).ravel() > 0
    if kept.sum() < LEAST:
        raise LostError(f"only {int(kept.sum())} of {len(first)} points agree; {LEAST} are needed")
    return np.asarray(H, dtype=np.float64), kept


class Klt(Peer):
    """Good features on the part, found again by Lucas and Kanade's method; points have to come back when carried back.

    Carried from frame to frame, points on a smooth part slide along its edges and add up their errors. Here they do so
    for one step, which says how to lay the new image on the first one; there the features are then found once more.
    Nothing adds up, and what was hidden is looked for again. The confidence is the share of the features that agree.
    After a loss it starts from its last answer.
    """

    name: ClassVar[str] = "klt"

    MOST = 200
    """Features that are looked for."""
    BACK = 1.0
    """px within which a point has to come back."""
    WINDOW = (21, 21)
    LEVELS = 3

    def begin(self, image: Grey) -> None:
        """See Peer."""
        region = region_of(self.start, image)
        self._corners = region.corners
        points = cv2.goodFeaturesToTrack(image, self.MOST, 0.01, 5, mask=region.grown(MARGIN))
        self._points = np.array([] if points is None else points, np.float32).reshape(-1, 2)
        if len(self._points) < LEAST:
            raise LostError(f"only {len(self._points)} points to follow on the part; {LEAST} are needed")
        self._first = self._image = image
        self._H: Floats = np.eye(3)

    def follow(self, image: Grey) -> BaselineAnswer:
        """See Peer."""
        last = apply_homography(self._H, self._points).astype(np.float32)
        now, kept = self._forward_backward_flow(self._image, image, last)
        guess, _ = robust_homography(self._points[kept], now[kept])
        judge_distortion(guess, *kernels.distortion(guess, self._corners))
        laid = cv2.warpPerspective(image, guess, image.shape[::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        now, kept = self._forward_backward_flow(self._first, np.asarray(laid, dtype=np.uint8), self._points)
        rest, inliers = robust_homography(self._points[kept], now[kept])
        found = self.moved(guess @ rest, self._corners, float(inliers.sum()) / len(self._points))
        self._H, self._image = guess @ rest, image
        return found

    def _forward_backward_flow(self, one: Grey, other: Grey, points: Points) -> tuple[Points, NDArray[np.bool_]]:
        """Where points (N, 2) of one image are in the other, and which can be relied on."""
        carry = partial(cv2.calcOpticalFlowPyrLK, winSize=self.WINDOW, maxLevel=self.LEVELS)
        there, ok, _ = carry(one, other, points.reshape(-1, 1, 2), None)
        back, ok_back, _ = carry(other, one, there, None)
        near = np.hypot(*(np.asarray(back).reshape(-1, 2) - points).T) <= self.BACK
        return np.asarray(there, np.float32).reshape(-1, 2), (np.ravel(ok) == 1) & (np.ravel(ok_back) == 1) & near


class Sift(Peer):
    """SIFT on the part in the first image against the whole of every image, ratio test, robust homography.

    Each image is looked at for itself, so that it finds the part again after a loss. Its confidence is the share of the
    matches that agree.
    """

    name: ClassVar[str] = "sift"

    RATIO = 0.75
    """A match's distance, at most, over that of the next best."""

    def begin(self, image: Grey) -> None:
        """See Peer."""
        region = region_of(self.start, image)
        self._corners = region.corners
        self._sift, self._matcher = cv2.SIFT.create(), cv2.BFMatcher(cv2.NORM_L2)
        points, self._described = self._sift.detectAndCompute(image, region.grown(MARGIN))
        self._first = np.array([p.pt for p in points], np.float32).reshape(-1, 2)
        if self._described is None or len(points) < LEAST:
            raise LostError(f"only {len(points)} points to match on the part; {LEAST} are needed")

    def follow(self, image: Grey) -> BaselineAnswer:
        """See Peer."""
        points, described = self._sift.detectAndCompute(image, None)
        if described is None or len(points) < 2:
            raise LostError("the image has no points to match")
        pairs = [pair for pair in self._matcher.knnMatch(self._described, described, k=2) if len(pair) == 2]
        good = [best for best, second in pairs if best.distance < self.RATIO * second.distance]
        first = self._first[[m.queryIdx for m in good]].reshape(-1, 2)
        now = np.array([points[m.trainIdx].pt for m in good], np.float32).reshape(-1, 2)
        H, inliers = robust_homography(first, now)
        return self.moved(H, self._corners, float(inliers.mean()))
