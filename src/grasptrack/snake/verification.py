# SPDX-License-Identifier: Apache-2.0
"""Whether a fitted curve is to be believed: what supports it, and what its shape space leaves unexplained."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack.snake.edge_search import FAINTEST, Model, Rows
from grasptrack.snake.template import NEAR
from grasptrack.typing import Bools, Floats

BORDER = 2.0
"""px from the image border within which a sample counts as outside: its edge could not be told from the border."""
SEEN = 1.75
"""px from the fitted curve within which an edge supports it."""
BEND = 0.05
"""Share of the object's size by which shear and perspective may plausibly bend it where nothing is seen."""
SAME, SAME_LEVELS = 0.35, 12.0
"""The material is the same within this share of the contrast, and so many grey levels."""
LIT = 0.8
"""Where of the edges that fit otherwise fewer than this show the same material, the light may have changed."""
SMALL = 0.3
"""px of bias below which weighing the edges again would change nothing."""
THIN = 3
"""Every so many-th sample is enough for how far the outline as a whole is off."""
FLOOR = 0.1
"""px. No measured edge is believed to be better than this."""


class Match(NamedTuple):
    """How a converged curve agrees with the image.

    Attributes:
        elsewhere: share of the visible samples that are not supported, but in rows of them lie on an edge beside the
            curve: the outline has moved as the shape space cannot, or something covers it along there.
        state: (dof,) px; noise: (dof, dof) px^2 of it as far as the image's noise goes, for the filter.
        misfit: px, rms distance over the outline that a homography would still move it.
        spread: px, largest standard deviation of a point of the outline.
        residual: px rms of the supported samples; common: px, rms of what neighbouring residuals still share.
        seen: (m,) supported samples; visible: (m,) samples inside the image.
        edges: (m, 4) of the edge search.
    """

    state: Floats
    noise: Floats
    misfit: float
    spread: float
    residual: float
    common: float
    seen: Bools
    visible: Bools
    edges: Floats
    elsewhere: float = 0.0

    @property
    def support(self) -> float:
        """Share of the samples inside the image that are supported."""
        inside = int(self.visible.sum())
        return float(self.seen.sum()) / inside if inside else 0.0


def verify_fit(model: Model, rows: Rows, state: Floats, shape: tuple[int, ...]) -> Match:
    """Which samples an edge like the template's supports, how well the state is known, and what it leaves unexplained.

    A shape space that fits all that is seen may still be wrong where nothing is seen: whatever a homography could have
    done there besides counts as unknown, up to BEND of the object's size.
    """
    template, space = model.template, model.space
    height, width = shape[:2]
    points, edges, gap = rows.points, rows.edges, rows.gap
    x, y = points[:, 0], points[:, 1]
    visible = (x >= BORDER) & (y >= BORDER) & (x <= width - 1 - BORDER) & (y <= height - 1 - BORDER)
    contrast = template.contrast
    like = np.abs(edges[:, 3] - edges[:, 2]) >= 2.0 * FAINTEST * contrast
    like &= rows.used & visible
    alike = like & (np.abs(edges[:, 2] - template.inside) <= SAME * contrast + SAME_LEVELS)
    if int(np.count_nonzero(alike)) < LIT * int(np.count_nonzero(like)):
        # so many that differ together are lit otherwise: what the ground says of the light is asked
        light = float(np.median(edges[like, 3])) / max(float(np.median(template.outside[like])), 1.0)
        alike = like & (np.abs(edges[:, 2] - light * template.inside) <= light * SAME * contrast + SAME_LEVELS)
    like = alike
    seen = like & (np.abs(gap) <= SEEN)
    if int(seen.sum()) <= 8:
        noise: Floats = np.full((len(state), len(state)), math.inf)
        return Match(state, noise, *(math.inf,) * 4, seen, visible, edges)
    (a, b), (c, d) = space.linear(state).tolist()
    X, Y = model.field
    F = (rows.normals @ (a, c))[:, None] * X
    F += (rows.normals @ (b, d))[:, None] * Y
    prior = np.zeros(8)
    prior[4:] = 1.0 / (BEND * space.rho) ** 2
    bias, variance, common = np.zeros(8), 1.0, 0.0
    for _ in range(2):
        r = gap - F @ bias
        w = like * np.square(np.maximum(1.0 - np.square(r / NEAR), 0.0))
        Fw = F * w[:, None]
        N = Fw.T @ F
        bias = np.linalg.solve(N + np.diag(variance * prior), Fw.T @ gap)
        if float(np.abs(bias).max()) < SMALL:
            break
    r = np.where(seen, gap - F @ bias, 0.0)
    variance = max(float(r @ r) / max(int(seen.sum()) - 8, 1), FLOOR * FLOOR)
    common = max(float(r[:-1] @ r[1:]) / max(int((seen[:-1] & seen[1:]).sum()), 1), 0.0)
    # residuals that go together count once: the variance of a mean of an AR(1) series
    together = min(common / variance, 0.8)
    variance *= (1.0 + together) / (1.0 - together)
    # twice the variance: the template carries the first image's noise
    covariance = np.linalg.inv(N / (2.0 * variance) + np.diag(prior + 1e-9))
    A = rows.A[seen]
    noise = np.asarray(np.linalg.inv(A.T @ A / variance + 1e-9 * np.eye(A.shape[1])))
    X, Y = X[::THIN], Y[::THIN]
    field = np.concatenate((a * X + b * Y, c * X + d * Y))  # x of some samples, then y
    moved = field @ bias
    spread = np.einsum("ij,ij->i", field @ covariance, field)
    spread = spread[: len(X)] + spread[len(X) :]
    g = gap[seen]
    return Match(
        state,
        noise,
        math.sqrt(float(moved @ moved) / len(X)),
        math.sqrt(float(spread.max())),
        math.sqrt(float(g @ g) / len(g)),
        math.sqrt(common),
        seen,
        visible,
        edges,
    )
