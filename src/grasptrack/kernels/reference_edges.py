# SPDX-License-Identifier: Apache-2.0
"""Edges of an image, sub-pixel, along the normals of a curve."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Image = NDArray[np.uint8] | NDArray[np.float32]

SPACING = 0.5  # px between samples
WINDOW = 2.0  # px on either side of the edge whose gradients count
AWAY = 1.5  # px from the edge where its two sides begin
MIN_SAMPLES = 7


def _profile(image: Image, x: float, y: float, nx: float, ny: float, half: int) -> Floats:
    """Bilinear samples at SPACING * (-half..half) along (nx, ny); NaN outside the image."""
    height, width = image.shape
    along = SPACING * np.arange(-half, half + 1)
    px, py = x + along * nx, y + along * ny
    out = np.full(len(along), np.nan)
    inside = (px >= 0) & (px <= width - 1) & (py >= 0) & (py <= height - 1)
    px, py = px[inside], py[inside]
    ix, iy = np.minimum(px.astype(np.intp), max(width - 2, 0)), np.minimum(py.astype(np.intp), max(height - 2, 0))
    fx, fy = px - ix, py - iy
    jx, jy = np.minimum(ix + 1, width - 1), np.minimum(iy + 1, height - 1)
    top = image[iy, ix] + fx * (image[iy, jx].astype(np.float64) - image[iy, ix])
    bottom = image[jy, ix] + fx * (image[jy, jx].astype(np.float64) - image[jy, ix])
    out[inside] = top + fy * (bottom - top)
    return out


def _window(gradient: Floats, start: float, centre: float) -> tuple[float, float, float, float]:
    """Mass and first moment about `centre` of stepwise gradients in a window, and the gradients at its ends."""
    left = start + SPACING * np.arange(len(gradient))
    low = np.maximum(left, centre - WINDOW)
    high = np.minimum(left + SPACING, centre + WINDOW)
    span = np.maximum(high - low, 0.0)
    mass = float((gradient * span).sum())
    moment = float((gradient * span * ((low + high) / 2 - centre)).sum())
    ends = []
    for end in (centre - WINDOW, centre + WINDOW):
        i = math.floor((end - start) / SPACING)
        ends.append(float(gradient[i]) if 0 <= i < len(gradient) else 0.0)
    return mass, moment, ends[0], ends[1]


def _centre(profile: Floats, start: float, sign: float, peak: float) -> float:
    """Where the window's centroid of the gradients of one sign is its own centre: the edge, near `peak`."""
    gradient = np.maximum(sign * np.diff(profile), 0.0) / SPACING
    centre = peak
    for _ in range(3):
        mass, moment, before, after = _window(gradient, start, centre)
        mean = moment / mass
        # The centroid follows the window at this rate; the step is Newton's on centroid - centre.
        rate = ((WINDOW - mean) * after + (WINDOW + mean) * before) / mass
        centre += mean / max(1.0 - rate, 0.2)
        centre = min(max(centre, peak - 1.0), peak + 1.0)
    return centre


def edge_search(image: Image, points: Floats, normals: Floats, reach: float, polarity: int) -> Floats:
    """The strongest edge along the normal at each point, by the centroid of its gradients.

    Args:
        image: (H, W) uint8 or float32 grey levels.
        points: (n, 2) px.
        normals: (n, 2) unit, out of the material.
        reach: px searched on either side; farther finds larger motions, and more of the wrong edges.
        polarity: +1 for grey that rises outward (a dark object), -1 for grey that falls, 0 for either.

    Returns:
        (n, 4) offset px along the normal, strength (grey levels per px at the peak, signed along the normal), mean
        grey inside and outside (1.5 px or farther from the edge within reach, the last sample where there is none).
        NaN, 0, NaN, NaN where fewer than 7 samples lie in the image, nothing rises as asked, or the strongest rise
        is at the end of the profile, so that the edge may lie beyond.

    Raises:
        ValueError: reach not above 0, or as many points as normals are not given.
    """
    if not 0 < reach <= 1000:
        raise ValueError(f"reach must be above 0 and at most 1000 px, not {reach:g}")
    if len(points) != len(normals):
        raise ValueError(f"{len(points)} points but {len(normals)} normals")
    half = int(reach / SPACING + 1e-9)
    out = np.tile([np.nan, 0.0, np.nan, np.nan], (len(points), 1))
    for row, (x, y), (nx, ny) in zip(out, points, normals, strict=True):
        profile = _profile(image, x, y, nx, ny, half)
        valid = np.flatnonzero(np.isfinite(profile))
        if len(valid) < MIN_SAMPLES:
            continue
        first, last = int(valid[0]), int(valid[-1])
        profile = profile[first : last + 1]
        start = SPACING * (first - half)
        slope = (profile[2:] - profile[:-2]) / (2 * SPACING)
        score = np.abs(slope) if polarity == 0 else slope * (1 if polarity > 0 else -1)
        peak = int(np.argmax(score))
        if not score[peak] > 0 or peak in (0, len(score) - 1):
            continue
        sign = 1.0 if slope[peak] > 0 else -1.0
        offset = _centre(profile, start, sign, start + SPACING * (peak + 1))
        along = start + SPACING * np.arange(len(profile))
        inside, outside = profile[along <= offset - AWAY], profile[along >= offset + AWAY]
        row[:] = (
            offset,
            slope[peak],
            inside.mean() if len(inside) else profile[0],
            outside.mean() if len(outside) else profile[-1],
        )
    return out
