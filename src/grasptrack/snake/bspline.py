# SPDX-License-Identifier: Apache-2.0
"""Closed uniform cubic B-splines: the curve that a snake moves (Blake and Isard, Active Contours, ch. 3)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from grasptrack import kernels
from grasptrack.errors import ContourError
from grasptrack.typing import Floats

MIN_SPANS = 4
PER_SPAN = 6
"""Sampled points per span, the paper's number of interpolated points (Table IV: p = 6 ref + interp)."""

# Span i in u = 0..1: [1, u, u^2, u^3] @ _CUBIC @ control points i - 1 ... i + 2.
_CUBIC = np.array([[1.0, 4.0, 1.0, 0.0], [-3.0, 0.0, 3.0, 0.0], [3.0, -6.0, 3.0, 0.0], [-1.0, 3.0, -3.0, 1.0]]) / 6.0


def basis_matrix(parameters: ArrayLike, spans: int, derivative: int = 0) -> Floats:
    """Values at given parameters of the periodic uniform cubic basis functions.

    Args:
        parameters: (M,) in spans, taken modulo `spans`; span i runs from i to i + 1.
        spans: number of spans, and of control points.
        derivative: 0 for the curve, 1 for its derivative by the parameter.

    Returns:
        (M, spans), each row with four entries that are not zero; rows sum to 1 (to 0 for a derivative).

    Raises:
        ContourError: fewer than 4 spans, with which the basis would overlap itself.
    """
    if spans < MIN_SPANS:
        raise ContourError(f"a closed cubic spline needs at least {MIN_SPANS} spans, not {spans}", spans=spans)
    t = np.asarray(parameters, dtype=np.float64) % spans
    span = np.minimum(t.astype(np.int64), spans - 1)
    u = t - span
    one, zero = np.ones_like(u), np.zeros_like(u)
    powers = (one, u, u * u, u * u * u) if derivative == 0 else (zero, one, 2.0 * u, 3.0 * u * u)
    weights = np.column_stack(powers) @ _CUBIC
    out = np.zeros((len(t), spans))
    rows = np.arange(len(t))
    for j in range(4):
        out[rows, (span + j - 1) % spans] = weights[:, j]
    return out


@lru_cache(maxsize=64)
def _sampling_matrix(spans: int, per_span: int, derivative: int) -> Floats:
    return basis_matrix(np.arange(spans * per_span) / per_span, spans, derivative)


class ClosedSpline:
    """One closed curve given by its control points.

    Args:
        control: (spans, 2) px, at least 4; the curve lies inside the hull of each four in a row.
    """

    __slots__ = ("control",)

    def __init__(self, control: ArrayLike) -> None:
        points = np.array(control, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < MIN_SPANS:
            raise ContourError(f"control points have shape (spans, 2) with spans >= {MIN_SPANS}, not {points.shape}")
        self.control: Floats = points

    @property
    def spans(self) -> int:
        """Number of spans, and of control points."""
        return len(self.control)

    def sample(self, per_span: int = PER_SPAN) -> Floats:
        """(spans * per_span, 2) px: points at equal steps of the parameter, the first at 0."""
        return np.asarray(_sampling_matrix(self.spans, per_span, 0) @ self.control)

    def normals(self, per_span: int = PER_SPAN) -> Floats:
        """(spans * per_span, 2) unit normals at those points: (ty, -tx), out of the material of a contour."""
        tangent = _sampling_matrix(self.spans, per_span, 1) @ self.control
        length = np.hypot(tangent[:, 0], tangent[:, 1])
        tangent /= np.where(length > 0.0, length, 1.0)[:, None]
        return np.column_stack([tangent[:, 1], -tangent[:, 0]])


def fit_spline(points: ArrayLike, spans: int) -> tuple[ClosedSpline, float]:
    """The spline nearest to a closed polygon in least squares, its parameter proportional to arc length.

    Args:
        points: (N, 2) px, not repeated at the end; they may be far apart.
        spans: more follow corners closer, and noise too; uniform in arc length.

    Returns:
        The spline, whose parameter 0 is at the first point, and the rms distance in px across the curve.
    """
    polygon = np.ascontiguousarray(points, dtype=np.float64)
    each = max(PER_SPAN, -(-len(polygon) // spans))
    observed = kernels.resample(polygon, spans * each, 0.0)
    basis = _sampling_matrix(spans, each, 0) if spans >= MIN_SPANS else basis_matrix((), spans)
    spline = ClosedSpline(np.linalg.solve(basis.T @ basis, basis.T @ observed))
    gap = observed - spline.sample(each)
    across = np.einsum("ij,ij->i", gap, spline.normals(each))
    return spline, float(np.sqrt(np.mean(across * across)))
