# SPDX-License-Identifier: Apache-2.0
"""Which mixture of an image's colours shows an outline best: one grey image, in which everything else looks for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.contours import Contour
from grasptrack.segmentation.images import PLAIN, Channel
from grasptrack.typing import Floats

BETTER = 1.5
"""A mixture replaces plain grey when it shows the outline so many times as clearly against its grain."""
CLEARLY = 2.0
"""Times the grain's rms by which the two sides of an edge differ."""
FAINT = 0.3
"""An edge so much fainter than the others, relative to their median, will not be asked for."""
LESS = 0.95
"""A mixture shows at least this share of what plain grey shows of an outline."""
BESIDE = 2.5
"""px from the outline on either side, at which colours are compared."""
SAMPLES = 200
"""Points of the outline that are asked."""


def best_color_projection(image: NDArray[np.uint8], outline: Contour) -> Channel:
    """The mixture that shows an outline best, if it is much better than plain grey.

    The colours differ across the outline by d at each point. The mixture w maximises the sum of (w d)^2 over that of the
    same differences on the ground alone: an eigenvector.

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
    # strong edges on a part of the outline do not make up for none on another part
    if _distinct_share(across, noise, best) < LESS * _distinct_share(across, noise, plain):
        return PLAIN
    best /= np.abs(best).sum()
    best = best if best.sum() >= 0.0 else -best
    b, g, r = np.round(best, 6).tolist()
    return Channel((b, g, r))


def _distinct_share(across: Floats, noise: Floats, weights: Floats) -> float:
    """Share of the outline's points across which a mixture differs clearly."""
    difference = np.abs(across @ weights)
    grain = float(np.sqrt(weights @ noise @ weights))
    return float((difference >= max(CLEARLY * grain, FAINT * float(np.median(difference)))).mean())


def _sample_colors(image: NDArray[np.uint8], points: Floats) -> Floats:
    """(n, 3) colours at the pixels of points (n, 2) px, those beyond the border at it."""
    column, row = np.rint(points).astype(np.intp).T
    return np.asarray(image[row.clip(0, image.shape[0] - 1), column.clip(0, image.shape[1] - 1)], dtype=np.float64)
