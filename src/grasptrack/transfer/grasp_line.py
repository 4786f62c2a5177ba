# SPDX-License-Identifier: Apache-2.0
"""Grasp-line coordinates: the grasp line relative to the silhouette's inertia axes (Sections III-B and IV-B)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import Outline, View
from grasptrack.errors import AmbiguousError, AxesError, ClippedError, CrossingError, ParallelLineError, StrategyError
from grasptrack.grasp import Grasp
from grasptrack.projective import jacobian, similarity
from grasptrack.transfer.base import Transfer

Floats = NDArray[np.float64]

MIN_ANISOTROPY = 0.03
"""Below this (l1 - l2) / (l1 + l2) of the moments the axes' direction is noise."""
MIN_SINE = math.sin(math.radians(3.0))
"""A grasp line closer than this to I_min meets it nowhere that could be measured."""
MIN_SKEWNESS = 3e-3
"""Third-order moments (divided by area^2.5) smaller than this do not tell the axes' two directions apart: a view tilted
by some degrees gives a symmetric object as much."""
SELF_SYMMETRIC = 0.01
"""A half turn that moves no contact by more than this fraction of sqrt(area) maps the grasp to itself."""
MAX_MISMATCH = 0.05
"""The outline must cross the line within this fraction of sqrt(area) of where the description puts the contact."""

Skewness = tuple[float, float, float, float]


class GraspLineDescription(NamedTuple):
    """The description of a two-finger grasp.

    Attributes:
        d_c: distance of the centroid from the grasp line, positive when it lies to the left seen from contact 1 to 2.
        alpha_m: rad from I_min to the grasp line's direction, positive from x to y.
        d_1, d_2: distances of the contacts along the line from where it meets I_min. All distances divide by sqrt(area).
        skewness: third-order moments in the axes, divided by area^2.5: what tells I_min's two directions apart.
        area, centroid, theta: of the reference silhouette: px^2, px, rad.
    """

    d_c: float
    alpha_m: float
    d_1: float
    d_2: float
    skewness: Skewness
    area: float
    centroid: tuple[float, float]
    theta: float

    def paper(self) -> tuple[float, float, float, float]:
        """(d_c, alpha_m in degrees, d_1, d_2) as the paper prints them: distances divided by the area, in 1/px."""
        root = math.sqrt(self.area)
        return self.d_c / root, math.degrees(self.alpha_m), self.d_1 / root, self.d_2 / root


def describe(grasp: Grasp, view: Outline) -> GraspLineDescription:
    """Grasp-line coordinates of a grasp.

    Raises:
        StrategyError: not two fingers.
        ClippedError: the border cuts the object, so that its moments are not its own.
        AxesError: no distinct inertia axes.
        ParallelLineError: the line never meets I_min.
    """
    if len(grasp.contacts) != 2:
        raise StrategyError(
            f"grasp-line coordinates carry two fingers, not {len(grasp)}; use rrp or homography", fingers=len(grasp)
        )
    area, cx, cy, theta, *skewness = _frame(view)
    root = math.sqrt(area)
    (x1, y1), (x2, y2) = grasp.contacts.tolist()
    opening = math.hypot(x2 - x1, y2 - y1)
    if opening == 0.0:
        raise ParallelLineError("both contacts are the same point: they have no grasp line")
    ux, uy = (x2 - x1) / opening, (y2 - y1) / opening
    ex, ey = math.cos(theta), math.sin(theta)
    sine = ex * uy - ey * ux
    if abs(sine) < MIN_SINE:
        raise ParallelLineError(
            f"the grasp line runs along I_min ({math.degrees(math.asin(abs(sine))):.1f} degrees apart) and never meets it",
            sine=sine,
        )
    along, left = (cx - x1) * ux + (cy - y1) * uy, (cx - x1) * uy - (cy - y1) * ux
    # along the line, I_min passes the centroid's foot by left * cot(alpha)
    meets = along - left * (ex * ux + ey * uy) / sine
    return GraspLineDescription(
        left / root,
        math.atan2(sine, ex * ux + ey * uy),
        -meets / root,
        (opening - meets) / root,
        (skewness[0], skewness[1], skewness[2], skewness[3]),
        area,
        (cx, cy),
        theta,
    )


def apply(description: GraspLineDescription, view: Outline, prior: Floats | None = None) -> Transfer:
    """The grasp with that description on another outline; its contacts lie on the outline.

    Raises:
        ClippedError, AxesError: as in `describe`.
        AmbiguousError: the object maps to itself by a half turn, the grasp does not, and there is no prior.
        CrossingError: the line does not meet the outline where the contacts should be.
    """
    area, cx, cy, theta, *skewness = _frame(view)
    if not _same_direction(description, skewness, theta, prior):
        theta += math.pi
    root = math.sqrt(area)
    ex, ey = math.cos(theta), math.sin(theta)
    cosine, sine = math.cos(description.alpha_m), math.sin(description.alpha_m)
    ux, uy = ex * cosine - ey * sine, ey * cosine + ex * sine
    # from the centroid along I_min to where the line of that d_c crosses it
    shift = -description.d_c * root / sine
    qx, qy = cx + shift * ex, cy + shift * ey
    t1, t2 = description.d_1 * root, description.d_2 * root
    x1, y1, x2, y2 = kernels.nearest_crossings(view.points, view.offsets, qx, qy, ux, uy, t1, t2)
    residual = max(abs((x1 - qx) * ux + (y1 - qy) * uy - t1), abs((x2 - qx) * ux + (y2 - qy) * uy - t2))
    if not residual <= MAX_MISMATCH * root or (x1 == x2 and y1 == y2):
        raise CrossingError(
            "the transferred grasp line does not meet the outline where the contacts should be", residual=residual
        )
    H = similarity(root / math.sqrt(description.area), theta - description.theta, description.centroid, (cx, cy))
    return Transfer(Grasp.of(np.array(((x1, y1), (x2, y2)))), H, None, residual)


def _frame(view: Outline) -> tuple[float, ...]:
    """Area, centroid, direction of I_min, and skewness, or the reason why the silhouette has no such frame."""
    if view.is_clipped if isinstance(view, View) else view.clipped is not None:
        raise ClippedError("the image border cuts the object, and grasp-line coordinates need it whole")
    area, cx, cy, theta, major, minor, *skewness = kernels.inertia(view.points, view.offsets)
    if (major - minor) < MIN_ANISOTROPY * (major + minor):
        raise AxesError(
            f"the silhouette has no distinct inertia axes (moments {major:.0f} and {minor:.0f} px^2)",
            major=major,
            minor=minor,
        )
    return area, cx, cy, theta, *skewness


def _same_direction(
    description: GraspLineDescription, skewness: list[float], theta: float, prior: Floats | None
) -> bool:
    """Whether I_min as the moments give it points the way it does in the reference, not against it."""
    if prior is not None:
        a, b, c, d = jacobian(prior, *description.centroid)
        ex, ey = math.cos(description.theta), math.sin(description.theta)
        return (a * ex + b * ey) * math.cos(theta) + (c * ex + d * ey) * math.sin(theta) > 0.0
    s = description.skewness
    agreement = sum(r * c for r, c in zip(s, skewness, strict=True))  # a half turn changes the sign of all four
    norm = math.sqrt(sum(r * r for r in s) * sum(c * c for c in skewness))
    if norm >= MIN_SKEWNESS**2 and min(sum(r * r for r in s), norm) >= MIN_SKEWNESS**2 and abs(agreement) >= 0.5 * norm:
        return agreement > 0.0
    if abs(description.d_c) < SELF_SYMMETRIC and abs(description.d_1 + description.d_2) < SELF_SYMMETRIC:
        return True
    raise AmbiguousError(
        "the outline maps to itself by a half turn, so one pair of views cannot tell the grasp from its turned twin"
    )
