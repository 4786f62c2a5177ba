# SPDX-License-Identifier: Apache-2.0
"""One robust fit of a shape-space state to the edges of one image (Blake and Isard, Active Contours, chs. 6 and 10)."""

from __future__ import annotations

import numpy as np

from grasptrack.snake.edge_search import Model, Rows, search_along_normals
from grasptrack.snake.template import NEAR, Grey
from grasptrack.snake.verification import Match, verify_fit
from grasptrack.statistics import MAD_TO_SD
from grasptrack.typing import Floats

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


def fit_to_edges(model: Model, image: Grey, start: Floats, spread: Floats, reach: float) -> Match | None:
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
    if match.support > 0.92:
        return match
    rows = search_along_normals(model, state, image, ELSEWHERE)
    stray = rows.used & match.visible & ~match.seen
    in_row = stray[:-1] & stray[1:] & (np.abs(rows.gap[1:] - rows.gap[:-1]) < 1.0)
    return match._replace(elsewhere=float(in_row.sum()) / max(int(match.visible.sum()), 1))
