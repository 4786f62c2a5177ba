# SPDX-License-Identifier: Apache-2.0
"""Edges of an image, sub-pixel, along the normals of a curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats

Image = NDArray[np.uint8] | NDArray[np.float32]

SPACING = 0.5  # px between samples
WINDOW = 3.0  # px on either side of the edge whose gradients count, ever less outward
AWAY = 1.5  # px from the edge where its two sides begin
SETTLED = 1e-3  # px; Newton's steps halve their digits, so that the next would change nothing
MIN_SAMPLES = 7
MARGIN = int((WINDOW + 1) / SPACING) + 1  # samples that the window of an edge may need beyond it


def _sample_profile(image: Image, x: float, y: float, nx: float, ny: float, half: int) -> Floats:
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


def _gradient_centroid(profile: Floats, start: float, sign: float, peak: float) -> float:
    """Where gradients of one sign balance under the weight u (1 - u^2), u = (x - centre) / WINDOW, near `peak`.

    By Newton's steps. A weight that fades out does not feel where the samples lie.
    """
    gradient = np.maximum(sign * np.diff(profile), 0.0)
    along = start + SPACING * (np.arange(len(gradient)) + 0.5)
    centre = peak
    for _ in range(3):
        u = (along - centre) / WINDOW
        weight = np.maximum(1 - u * u, 0.0)
        mass = float((weight * gradient).sum())
        moment = float((weight * u * gradient).sum())
        rate = float(((1 - 3 * u * u) * gradient)[weight > 0].sum())
        before = centre
        centre = min(max(centre + WINDOW * moment / max(rate, 0.2 * mass), peak - 1.0), peak + 1.0)
        if abs(centre - before) < SETTLED:
            break
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
        # Beyond its reach an edge is not looked for, but the window of one found near the end needs its samples.
        samples = _sample_profile(image, x, y, nx, ny, half + MARGIN)
        valid = np.flatnonzero(np.isfinite(samples))
        within = valid[(valid >= MARGIN) & (valid <= 2 * half + MARGIN)]
        if len(within) < MIN_SAMPLES:
            continue
        profile, along = samples[within], SPACING * (within - half - MARGIN)
        slope = (profile[2:] - profile[:-2]) / (2 * SPACING)
        score = np.abs(slope) if polarity == 0 else slope * (1 if polarity > 0 else -1)
        peak = int(np.argmax(score))
        if not score[peak] > 0 or peak in (0, len(score) - 1):
            continue
        at = int(within[peak + 1])
        wide = valid[(valid >= at - MARGIN) & (valid <= at + MARGIN)]
        sign = 1.0 if slope[peak] > 0 else -1.0
        offset = _gradient_centroid(
            samples[wide], SPACING * (int(wide[0]) - half - MARGIN), sign, float(along[peak + 1])
        )
        inside, outside = profile[along <= offset - AWAY], profile[along >= offset + AWAY]
        row[:] = (
            offset,
            slope[peak],
            inside.mean() if len(inside) else profile[0],
            outside.mean() if len(outside) else profile[-1],
        )
    return out
