# SPDX-License-Identifier: Apache-2.0
"""A thin tool pushed fast before a camera whose shutter is open but for a moment, which nothing says beforehand."""

import cv2
import numpy as np
import pytest

from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.tracker import GraspTracker

WIDTH, HEIGHT = 480, 400
TOOL = np.array(
    [[-3, -120], [3, -120], [4, 0], [11, 8], [11, 90], [7, 110], [-7, 110], [-11, 90], [-11, 8], [-4, 0]], float
)
"""px of a screwdriver about its middle."""
MIDDLE = np.array([40.0, 150.0])
"""px where that lies in the picture of the tool."""
TOLERANCE = 3.0
"""px by which a contact of something so small may be off."""


def drawn_tool(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(300, 80) its grey levels, a light blade and a dark handle, and how much of each pixel it covers."""
    grey = np.full((300, 80), 120.0, np.float32)
    grey[:150], grey[150:190] = 215.0, 90.0
    grey += 10.0 * cv2.GaussianBlur(rng.normal(size=grey.shape).astype(np.float32), (0, 0), 1.0)
    cover = np.zeros((1200, 320), np.uint8)
    cv2.fillPoly(cover, [np.round(4.0 * (TOOL + MIDDLE)).astype(int)], (255,))
    return grey, cv2.resize(cover, (80, 300), interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0


def exposed(place: tuple[float, float], turn: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """An image of the tool on a rough bench, and the (3, 3) pose that carries the tool's picture there."""
    rough = np.random.default_rng(7).normal(size=(HEIGHT, WIDTH)).astype(np.float32)
    grey, cover = drawn_tool(np.random.default_rng(3))
    c, s = np.cos(turn), np.sin(turn)
    pose = np.array([[c, -s, place[0]], [s, c, place[1]], [0.0, 0.0, 1.0]])
    pose[:2, 2] -= pose[:2, :2] @ MIDDLE
    own = cv2.warpAffine(cover, pose[:2], (WIDTH, HEIGHT))
    lit = cv2.warpAffine(grey, pose[:2], (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
    image = (70.0 + 60.0 * cv2.GaussianBlur(rough, (0, 0), 1.5)) * (1.0 - own) + lit * own
    noise = np.random.default_rng(seed).normal(0.0, 2.0, image.shape)
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.7) + noise, 0, 255).astype(np.uint8), pose


@pytest.mark.parametrize(("step", "way", "turn", "spin"), [(9.0, -1.07, 0.5, 0.01), (4.0, -1.0, 0.2, 0.012)])
def test_a_tool_does_not_slide_along_itself(step: float, way: float, turn: float, spin: float) -> None:
    """Blur that was only believed hid the ends, and print of the bench bore the believed answer out: it was off by 9 px."""
    tracker, first = None, np.empty((0, 2))
    for k in range(16):
        moved = max(0, k - 4)
        place = (200.0 + moved * step * np.cos(way), 200.0 + moved * step * np.sin(way))
        image, pose = exposed(place, turn + spin * moved, seed=k)
        if tracker is None:
            tracker, start = GraspTracker(outline=apply_homography(pose, TOOL + MIDDLE)), pose
        result = tracker.update(image, time=k / 30.0)
        if result.contacts is None:
            continue
        first = result.contacts if k == 0 else first
        away = result.contacts - apply_homography(pose @ np.linalg.inv(start), first)
        assert np.hypot(*away.T).max() < TOLERANCE, (k, away)
