# SPDX-License-Identifier: Apache-2.0
"""The mixture of an image's colours that shows an outline best, as one grey image for the whole tracker."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.contours import Contour
from grasptrack.images import PLAIN, Channel
from grasptrack.typing import Floats

BETTER = 1.5
"""A mixture replaces plain grey when its contrast over noise is this many times as high."""
CLEARLY = 2.0
"""The two sides of a clear edge differ by this many times the rms noise."""
FAINT = 0.3
"""An edge fainter than this share of the median is not required."""
LESS = 0.95
"""A mixture shows at least this share of the outline that plain grey shows."""
BESIDE = 2.5
"""px on either side of the outline at which colours are compared."""
SAMPLES = 200
"""Points of the outline that are sampled."""


def best_color_projection(image: NDArray[np.uint8], outline: Contour) -> Channel:
    """The mixture that shows an outline best, if it is much better than plain grey.

    The colours differ across the outline by d at each point. The mixture w maximises the sum of (w d)^2 over the same sum
    for differences within the background: an eigenvector.

    Args:
        image: (H, W) or BGR (H, W, 3).
        outline: found in it.
    """
    if image.ndim == 2:
        return PLAIN
    step = max(1, len(outline) // SAMPLES)
    points = outline.points[::step]
    ahead = np.roll(outline.points, -2, axis=0)[::step] - np.roll(outline.points, 2, axis=0)[::step]
    normals = np.column_stack([ahead[:, 1], -ahead[:, 0]]) / np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    within, beyond, farther = (_sample_colors(image, points + k * BESIDE * normals) for k in (-1.0, 1.0, 2.0))
    across, grain = beyond - within, beyond - farther
    between = across.T @ across / len(across)
    noise = grain.T @ grain / len(grain) + np.eye(3)
    root = np.linalg.inv(np.linalg.cholesky(noise))
    values, vectors = np.linalg.eigh(root @ between @ root.T)
    best = root.T @ vectors[:, -1]
    plain = np.array([0.114, 0.587, 0.299])
    if values[-1] < BETTER**2 * float(plain @ between @ plain) / float(plain @ noise @ plain):
        return PLAIN
    # strong edges on one part of the outline do not compensate for missing ones on another
    if _distinct_share(across, noise, best) < LESS * _distinct_share(across, noise, plain):
        return PLAIN
    best /= np.abs(best).sum()
    best = best if best.sum() >= 0.0 else -best
    b, g, r = np.round(best, 6).tolist()
    return Channel((b, g, r))


def _distinct_share(across: Floats, noise: Floats, weights: Floats) -> float:
    """Share of the outline's points with a clear difference."""
    difference = np.abs(across @ weights)
    grain = float(np.sqrt(weights @ noise @ weights))
    return float((difference >= max(CLEARLY * grain, FAINT * float(np.median(difference)))).mean())


def _sample_colors(image: NDArray[np.uint8], points: Floats) -> Floats:
    """(n, 3) colours at points (n, 2) px, clamped to the image."""
    column, row = np.rint(points).astype(np.intp).T
    return np.asarray(image[row.clip(0, image.shape[0] - 1), column.clip(0, image.shape[1] - 1)], dtype=np.float64)
