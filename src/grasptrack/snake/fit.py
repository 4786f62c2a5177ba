# SPDX-License-Identifier: Apache-2.0
"""A state fitted to the edges of one image: search along normals, robust steps, verification (Blake and Isard, chs. 5, 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.homographies import displacement_fields
from grasptrack.snake.shape_space import ShapeSpace
from grasptrack.snake.template import NEAR, Grey, Template
from grasptrack.statistics import MAD_TO_SD
from grasptrack.typing import Bools, Floats

FAINTEST = 0.2
"""Share of the template's strength, and of its contrast doubled, that an edge must have: motion blur takes the rest."""


class Rows(NamedTuple):
    """A curve and the linear measurement along its normals.

    Attributes:
        points: (m, 2) px; normals: (m, 2) unit.
        A: (m, dof), n^T W: px along the normal per unit of the state.
        edges: (m, 4) of the edge search.
        gap: (m,) px from the curve to the edge along the normal, the template's own bias taken off; 0 where not used.
        used: (m,) an edge of the right kind was found.
    """

    points: Floats
    normals: Floats
    A: Floats
    edges: Floats
    gap: Floats
    used: Bools


class SnakeModel:
    """What stays the same from image to image, computed once.

    Args:
        template: the samples to search for; space: the shape space of the whole outline.

    Attributes:
        local: (m, 2) the searched points about the space's centre, in units of rho.
        W: (2, m, dof) how a state moves them along x and y.
        field: (2, m, 8) how a homography's parameters do, in the template's own frame; see `displacement_fields`.
    """

    def __init__(self, template: Template, space: ShapeSpace) -> None:
        self.template = template
        self.space = space
        self.local: Floats = space.local[template.chosen]
        self.W: Floats = np.ascontiguousarray(space.point_jacobian(template.points).transpose(1, 0, 2))
        self.field: Floats = np.ascontiguousarray(displacement_fields(self.local).transpose(1, 0, 2))


def search_along_normals(model: SnakeModel, state: Floats, image: Grey, reach: float) -> Rows:
    """Edges along the normals of the curve at a state."""
    template, space, local = model.template, model.space, model.local
    M = space.linear_part(state)
    points = local @ (space.rho * M.T)
    points += space.centre + state[:2]
    (a, b), (c, d) = M.tolist()
    normals = template.normals @ np.array(((d, -b), (-c, a)))  # the cofactors carry normals
    length = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    normals /= length[:, None]
    edges = kernels.search_along_normals(image, points, normals, reach, template.polarity)
    gap = edges[:, 0] - template.bias * ((a * d - b * c) / length)
    used = edges[:, 1] * template.sign >= FAINTEST * template.strength
    gap[~used] = 0.0
    A = normals[:, :1] * model.W[0]
    A += normals[:, 1:] * model.W[1]
    return Rows(points, normals, A, edges, gap, used)


TUKEY = 4.685
LENIENT = 0.6
"""px, least scale of Tukey's weights: a side that tilt has moved by 2 px pulls as well, it is not left behind."""
ELSEWHERE = 3.0 * NEAR
"""px from the fitted curve to which an unsupported stretch is looked for."""


def solve_robust_step(rows: Rows, prior: Floats, mean: Floats, rounds: int) -> tuple[Floats, Floats, Floats]:
    """Step of the state that explains the gaps, by iteratively reweighted least squares with Tukey's weights.

    Args:
        rows: the measurements.
        prior: (dof, dof) information on the step, 1/px^2; zeros for none.
        mean: (dof,) px, the step that the prior expects.
        rounds: reweightings.

    Returns:
        step (dof,), its information (dof, dof) from the edges alone, and the weights (m,) in 0..1.

    Raises:
        numpy.linalg.LinAlgError: too few edges to fix the step.
    """
    A, z = rows.A, rows.gap
    used = rows.used.astype(np.float64)
    count = int(used.sum())
    if count < A.shape[1]:
        raise np.linalg.LinAlgError("fewer edges than degrees of freedom")
    step: Floats = mean
    information: Floats = prior
    pull = prior @ mean
    for _ in range(rounds):
        r = np.abs(z - A @ step)
        # of those used: the others, at the end, do not shift the middle
        middle = np.partition(np.where(rows.used, r, np.inf), count // 2)[count // 2]
        scale = max(MAD_TO_SD * float(middle), LENIENT)
        w = 1.0 - np.square(r * (1.0 / (TUKEY * scale)))
        w = np.square(np.maximum(w, 0.0, out=w), out=w) * used
        Aw = A * (w * (1.0 / (scale * scale)))[:, None]
        information = Aw.T @ A
        step = np.asarray(np.linalg.solve(information + prior, Aw.T @ z + pull))
    return step, information, w


def fit_to_edges(model: SnakeModel, image: Grey, start: Floats, spread: Floats, reach: float) -> CurveMatch | None:
    """The state whose curve lies on the edges, searched from `start` with a reach that shrinks to NEAR.

    Args:
        model: what to search for.
        image: (H, W) grey.
        start: (dof,) px, predicted.
        spread: (dof, dof) px^2, covariance of the prediction: it holds what wrong edges would pull, and does not enter
            the answer, so that the answer does not lag.
        reach: px of the first search.

    Returns:
        The match, or None where too few edges were found or the fit ran away.
    """
    prior: Floats = np.asarray(np.linalg.inv(spread))
    state = start
    reaches = [reach] if reach <= 2 * NEAR else [reach, max(reach / 3.0, 1.5 * NEAR)]
    try:
        for r in reaches:
            rows = search_along_normals(model, state, image, r)
            step, _, _ = solve_robust_step(rows, prior, start - state, 2)
            state = state + step
        free = np.zeros_like(prior)
        for _ in range(4):
            rows = search_along_normals(model, state, image, NEAR)
            step, _, _ = solve_robust_step(rows, free, np.zeros_like(state), 2)
            moved = float(np.abs(step).max())
            if not moved < 3.0 * NEAR:
                return None
            state = state + step
            if moved < 0.25:
                break
        rows = rows._replace(gap=np.where(rows.used, rows.gap - rows.A @ step, 0.0))
        match = verify_fit(model, rows, state, image.shape)
    except np.linalg.LinAlgError:
        return None
    if match.support_share > 0.92:
        return match
    rows = search_along_normals(model, state, image, ELSEWHERE)
    stray = rows.used & match.visible & ~match.seen
    in_row = stray[:-1] & stray[1:] & (np.abs(rows.gap[1:] - rows.gap[:-1]) < 1.0)
    return match._replace(elsewhere=float(in_row.sum()) / max(int(match.visible.sum()), 1))


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


class CurveMatch(NamedTuple):
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
    def support_share(self) -> float:
        """Share of the samples inside the image that are supported."""
        inside = int(self.visible.sum())
        return float(self.seen.sum()) / inside if inside else 0.0


def _samples_alike(template: Template, rows: Rows, shape: tuple[int, ...]) -> tuple[Bools, Bools]:
    """Which samples have an edge like the template's, and which lie within the image."""
    height, width = shape[:2]
    points, edges, contrast = rows.points, rows.edges, template.edge_contrast
    x, y = points[:, 0], points[:, 1]
    visible = (x >= BORDER) & (y >= BORDER) & (x <= width - 1 - BORDER) & (y <= height - 1 - BORDER)
    like = np.abs(edges[:, 3] - edges[:, 2]) >= 2.0 * FAINTEST * contrast
    like &= rows.used & visible
    alike = like & (np.abs(edges[:, 2] - template.inside) <= SAME * contrast + SAME_LEVELS)
    if int(np.count_nonzero(alike)) < LIT * int(np.count_nonzero(like)):
        # so many that differ together are lit otherwise: what the ground says of the light is asked
        light = float(np.median(edges[like, 3])) / max(float(np.median(template.outside[like])), 1.0)
        alike = like & (np.abs(edges[:, 2] - light * template.inside) <= light * SAME * contrast + SAME_LEVELS)
    return alike, visible


def verify_fit(model: SnakeModel, rows: Rows, state: Floats, shape: tuple[int, ...]) -> CurveMatch:
    """Which samples an edge like the template's supports, how well the state is known, and what it leaves unexplained.

    A shape space that fits all that is seen may still be wrong where nothing is seen: whatever a homography could have
    done there besides counts as unknown, up to BEND of the object's size.
    """
    space, edges, gap = model.space, rows.edges, rows.gap
    like, visible = _samples_alike(model.template, rows, shape)
    seen = like & (np.abs(gap) <= SEEN)
    if int(seen.sum()) <= 8:
        noise: Floats = np.full((len(state), len(state)), math.inf)
        return CurveMatch(state, noise, *(math.inf,) * 4, seen, visible, edges)
    (a, b), (c, d) = space.linear_part(state).tolist()
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
    return CurveMatch(
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
