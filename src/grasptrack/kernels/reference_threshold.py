# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of the threshold that every frame begins with."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def blur_threshold(
    image: NDArray[np.uint8], left: int, top: int, right: int, bottom: int, level: float, polarity: int
) -> NDArray[np.uint8]:
    """Where a window of an image, softened by the binomial (1 2 1) both ways, is dark or light.

    One pass without threads: a library's parallel blur waits for its threads longer than a window takes.

    Args:
        image: (H, W).
        left, top, right, bottom: the window, right and bottom not included. Beyond the image its border is repeated.
        level: grey level.
        polarity: +1 marks what is at most the level, -1 what is above it.

    Returns:
        (bottom - top, right - left) of 0 and 255.
    """
    p = np.pad(image, 1, mode="edge")[top : bottom + 2, left : right + 2].astype(np.int32)
    across = p[:, :-2] + 2 * p[:, 1:-1] + p[:, 2:]
    total = across[:-2] + 2 * across[1:-1] + across[2:]
    dark = total <= math.floor(16.0 * min(max(level, -1.0), 256.0))
    return np.where(dark if polarity > 0 else ~dark, np.uint8(255), np.uint8(0))
