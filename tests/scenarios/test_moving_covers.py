# SPDX-License-Identifier: Apache-2.0
"""What moves over an object, before an outline that slides along itself, carries no contact along."""

import cv2
import numpy as np
import pytest

from grasptrack import GraspTracker

FINER = 4
RADIUS = 95.0


def nearly_round(k: int, rate: float, seed: int) -> np.ndarray:
    """A part at rest that is round but for two notches; from frame 8 on a cover hides one of them and creeps along the rim."""
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    radius = RADIUS + 5.0 * np.cos(angle - 0.5) + 2.0 * np.cos(2.0 * angle)
    for at, width, depth in ((-0.4, 0.1, 6.0), (1.9, 0.12, 15.0)):
        radius -= depth * np.exp(-((np.angle(np.exp(1j * (angle - at))) / width) ** 2))
    large = np.full((480 * FINER, 640 * FINER), 200, np.uint8)
    shapes = [(np.column_stack([320.0 + radius * np.cos(angle), 240.0 + radius * np.sin(angle)]), 60)]
    if k >= 8:
        turn = 1.9 + rate * (k - 8)
        size = 45.0 + 8.0 * np.cos(3.0 * (angle - turn))
        middle = np.array([320.0 + 80.0 * np.cos(turn), 240.0 + 80.0 * np.sin(turn)])
        shapes.append((middle + size[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), 250))
    for points, level in shapes:
        cv2.fillPoly(large, [np.rint(points * FINER).astype(np.int32)], level)
    image = cv2.GaussianBlur(cv2.resize(large, (640, 480), interpolation=cv2.INTER_AREA), (0, 0), 1.5)
    noise = np.random.default_rng(1000 * seed + k).normal(0.0, 4.0, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("rate", [0.01, 0.04])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_cover_carries_no_contact_along(rate: float, seed: int) -> None:
    tracker, first, found = GraspTracker(object_at=(320.0, 240.0)), None, 0
    for k in range(40):
        contacts = tracker.update(nearly_round(k, rate, seed)).contacts
        if contacts is None:
            continue
        first = contacts if first is None else first
        assert np.hypot(*(contacts - first).T).max() < 0.04 * np.sqrt(np.pi) * RADIUS, k
        found += 1
    assert found > 8  # until it is covered at least
