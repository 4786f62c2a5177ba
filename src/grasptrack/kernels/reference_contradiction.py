# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of what an image shows where an outline should be and is not: another shape, or a cover.

A covered edge says nothing. Ground where material should be, or material that ends farther out than it should, says
that this is another object, however well the rest of the outline fits: a near twin, or its mirror image.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

ALIKE = 0.3
"""A grey level is the ground's or the object's within this share of the contrast between them."""
GRAIN = 0.6
"""Single pixels of a ground may differ from it by this share of the contrast."""
BEYOND = 0.4
"""A tab ends within this fraction of sqrt(area) of the outline, ..."""
ATTACHED = 0.7
"""... or of this where several colours hide how wide it is, ..."""
SLENDER = 1.3
"""... or within so many times its own width; what goes on farther in any direction lies in front of the object."""
DIRECTIONS = np.radians(np.arange(-80.0, 81.0, 10.0))
"""rad from the normal, in which it is followed."""
DEEP = 2.0
"""It is no contradiction but a transfer that is a little off when the edge lies within so many times the reach."""
COLOURS = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Quantiles of the grey along the inner side of an outline that stand for the object's colours."""


def contradicted(
    grey: Grey,
    points: Floats,
    normals: Floats,
    missed: Bools,
    inside: Floats,
    outside: Floats,
    reach: float,
    size: float,
    hidden: Grey | None = None,
) -> Bools:
    """(m,) which samples of an outline the image contradicts.

    Args:
        grey: (H, W).
        points, normals: (m, 2) px and unit, in the order of the outline.
        missed: (m,) in the image, but without their edge within reach.
        inside, outside: (m,) grey levels expected on the material's side and on the ground's.
        reach: px on either side in which the edge was searched.
        size: px, sqrt(area).
        hidden: (H, W) nonzero where nothing belongs to the scene.
    """
    against = np.zeros(len(points), dtype=np.bool_)
    index = np.flatnonzero(missed & np.isfinite(inside + outside))
    if not len(index):
        return against
    contrast = (outside - inside)[index, None]
    # 0 at the object's level, 1 at the ground's
    depth = np.linspace(1.5, DEEP * reach, 5)
    within, beyond = (
        (_levels(grey, points[index], normals[index], along, hidden) - inside[index, None]) / contrast
        for along in (-depth, depth)
    )
    # an edge that is faint, as in shadow, is still there; out of the image there is none
    edge = np.abs((beyond - within).mean(axis=1)) > ALIKE
    # a ground with grain is itself on the whole
    against[index] = (np.abs(within.mean(axis=1) - 1.0) <= ALIKE) & (np.abs(within - 1.0) <= GRAIN).all(axis=1) & ~edge
    material_like = (np.abs(beyond) <= ALIKE).all(axis=1) & ~edge
    for run in _runs(index[material_like], len(points)) if material_like.any() else []:
        against[run] = _ends(
            grey, points, normals, run, inside[run].mean(), outside[run].mean(), reach, BEYOND * size, hidden
        )
    return against


def attached(
    grey: Grey,
    points: Floats,
    normals: Floats,
    inside: Floats,
    outside: Floats,
    reach: float,
    size: float,
    hidden: Grey | None = None,
) -> Bools:
    """(m,) samples of the outline of an object of several colours beyond which one of its colours ends farther out.

    Where a dark part joins a light one there is an edge, as there was between the light one and the ground: samples that
    show their edge are asked as well.

    Args:
        grey, points, normals, inside, outside, reach, size, hidden: as for `contradicted`.
    """
    against = np.zeros(len(points), dtype=np.bool_)
    told = np.isfinite(inside + outside)
    if not told.any():
        return against
    ground = float(np.median(outside[told]))
    colours = np.quantile(inside[told], COLOURS)
    depth = np.linspace(0.6, 1.0, 3) * DEEP * reach  # nearer to the outline, other colours come and go
    beyond = _levels(grey, points, normals, depth, hidden)
    alike = np.abs(beyond[:, :, None] - colours) <= ALIKE * np.abs(ground - colours)
    index = np.flatnonzero(alike.all(axis=1).max(axis=1))
    for run in _runs(index, len(points)) if len(index) else []:
        against[run] = _ends(grey, points, normals, run, beyond[run].mean(), ground, reach, ATTACHED * size, hidden)
    return against


def _ends(
    grey: Grey,
    points: Floats,
    normals: Floats,
    run: NDArray[np.intp],
    low: float,
    high: float,
    reach: float,
    far: float,
    hidden: Grey | None,
) -> bool:
    """Whether what lies beyond samples that follow one another ends farther out in every direction.

    Args:
        run: the samples.
        low, high: grey levels of what lies there and of the ground.
        far: px within which it ends.
    """
    width = math.hypot(*(points[run[-1]] - points[run[0]]).tolist()) * (1.0 + 1.0 / len(run))
    along = np.arange(DEEP * reach, max(far, SLENDER * width, DEEP * reach + 4.0), 2.0)
    nx, ny = normals[run].mean(axis=0).tolist()
    cosine, sine = np.cos(DIRECTIONS), np.sin(DIRECTIONS)
    rays = np.column_stack([nx * cosine - ny * sine, nx * sine + ny * cosine]) / max(math.hypot(nx, ny), 1e-9)
    middle = np.broadcast_to(points[run].mean(axis=0), rays.shape)
    depths = (_levels(grey, middle, rays, along, hidden) - low) / (high - low)
    goes_on = ~(np.abs(depths) > ALIKE).any(axis=1)  # out of the image it may go on as well
    return not goes_on.any()


def levels_at(grey: Grey, points: Floats, hidden: Grey | None = None) -> Floats:
    """(...) grey levels of the pixels at points (..., 2) px; NaN outside the image and where it is hidden."""
    column, row = np.rint(points[..., 0]).astype(np.intp), np.rint(points[..., 1]).astype(np.intp)
    out = (column < 0) | (row < 0) | (column >= grey.shape[1]) | (row >= grey.shape[0])
    column[out] = row[out] = 0
    values = grey[row, column].astype(np.float64)
    values[out if hidden is None else out | (hidden[row, column] != 0)] = math.nan
    return values


def _levels(grey: Grey, points: Floats, normals: Floats, along: Floats, hidden: Grey | None) -> Floats:
    """(m, k) grey levels at distances (k,) px along the normals."""
    return levels_at(grey, points[:, None, :] + along[None, :, None] * normals[:, None, :], hidden)


def _runs(index: NDArray[np.intp], count: int) -> list[NDArray[np.intp]]:
    """Samples that follow one another round the outline, with gaps of at most one."""
    pieces = np.split(index, np.flatnonzero(np.diff(index) > 2) + 1)
    if len(pieces) > 1 and index[0] + count - index[-1] <= 2:
        pieces[0] = np.concatenate([pieces.pop(), pieces[0]])
    return pieces
