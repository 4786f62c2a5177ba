# SPDX-License-Identifier: Apache-2.0
"""Grasp-line coordinates: the grasp line relative to the silhouette's inertia axes (Sections III-B and IV-B)."""

from __future__ import annotations

import math
from typing import NamedTuple

from grasptrack import kernels
from grasptrack.errors import (
    AmbiguousError,
    AxesError,
    ClippedError,
    ConditioningError,
    CrossingError,
    ParallelLineError,
    StrategyError,
)
from grasptrack.geometry.contours import Outline, View
from grasptrack.geometry.homographies import homography_jacobian
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer.alignment import choose_alignment, find_alignments
from grasptrack.transfer.base import Transfer
from grasptrack.typing import Floats

MIN_ANISOTROPY = 0.03
"""Below this (l1 - l2) / (l1 + l2) of the moments the axes' direction is noise."""
MIN_SINE = math.sin(math.radians(3.0))
"""A grasp line closer than this to I_min meets it nowhere that could be measured."""
SELF_SYMMETRIC = 0.01
"""A half turn that moves no contact by more than this fraction of sqrt(area) maps the grasp to itself."""
MAX_MISMATCH = 0.05
"""The outline must cross the line within this fraction of sqrt(area) of where the description puts the contact."""


class GraspLineDescription(NamedTuple):
    """The description of a two-finger grasp.

    Attributes:
        d_c: distance of the centroid from the grasp line, positive when it lies to the left seen from contact 1 to 2.
        alpha_m: rad from I_min to the grasp line's direction, positive from x to y.
        d_1, d_2: distances of the contacts along the line from where it meets I_min. All distances are in sqrt(area).
        area, centroid, theta: of the reference silhouette: px^2, px, rad.
        view: the reference view, whose outlines tell I_min's two directions apart: under tilt third moments change sign.
    """

    d_c: float
    alpha_m: float
    d_1: float
    d_2: float
    area: float
    centroid: tuple[float, float]
    theta: float
    view: Outline

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
    _check_whole(view)
    line = kernels.grasp_line(view.points, view.offsets, grasp.contacts)
    _check_axes(line.major, line.minor)
    if line.opening == 0.0:
        raise ParallelLineError("both contacts are the same point: they have no grasp line")
    if abs(line.sine) < MIN_SINE:
        apart = math.degrees(math.asin(abs(line.sine)))
        raise ParallelLineError(
            f"the grasp line runs along I_min ({apart:.1f} degrees apart) and never meets it", sine=line.sine
        )
    return GraspLineDescription(*line[:7], view)


def apply(description: GraspLineDescription, view: Outline, prior: Floats | None = None) -> Transfer:
    """The grasp with that description on another outline; its contacts lie on the outline.

    Raises:
        ClippedError, AxesError: as in `describe`.
        AmbiguousError: the outline fits itself turned by a half turn, as far as the noise of the match tells, the grasp
            does not, and there is no prior.
        ConditioningError: the prior sends the object to infinity.
        CrossingError: the line does not meet the outline where the contacts should be.
    """
    _check_whole(view)
    line, frame = description[:4], (description.area, *description.centroid, description.theta)
    ahead = _axis(description) if prior is None else _predicted_axis(description, prior)
    found = kernels.carry_grasp_line(view.points, view.offsets, line, frame, ahead)
    _check_axes(found.major, found.minor)
    if prior is None and _is_turned(description, view, found.H):
        (c, minus_s, _), (s, *_), _ = found.H.tolist()  # a similarity
        x, y = c * ahead[0] + minus_s * ahead[1], s * ahead[0] + c * ahead[1]
        found = kernels.carry_grasp_line(view.points, view.offsets, line, frame, (-x, -y))
    if not found.residual <= MAX_MISMATCH * math.sqrt(found.area):
        raise CrossingError(
            "the transferred grasp line does not meet the outline where the contacts should be", residual=found.residual
        )
    return Transfer(Grasp.of(found.contacts), found.H, None, found.residual)


def _check_whole(view: Outline) -> None:
    if view.is_clipped if isinstance(view, View) else view.clipped is not None:
        raise ClippedError("the image border cuts the object, and grasp-line coordinates need it whole")


def _check_axes(major: float, minor: float) -> None:
    if (major - minor) < MIN_ANISOTROPY * (major + minor):
        raise AxesError(
            f"the silhouette has no distinct inertia axes (moments {major:.0f} and {minor:.0f} px^2)",
            major=major,
            minor=minor,
        )


def _axis(description: GraspLineDescription) -> tuple[float, float]:
    """The unit vector of I_min in the reference view."""
    return math.cos(description.theta), math.sin(description.theta)


def _predicted_axis(description: GraspLineDescription, prior: Floats) -> tuple[float, float]:
    """Where the reference's I_min points in the current view if a predicted homography is right."""
    (x, y), (g, h, i) = description.centroid, prior[2].tolist()
    if not g * x + h * y + i:
        raise ConditioningError("the prior sends the object to infinity")
    a, b, c, d = homography_jacobian(prior, x, y)
    ex, ey = _axis(description)
    return a * ex + b * ey, c * ex + d * ey


def _is_turned(description: GraspLineDescription, view: Outline, H: Floats) -> bool:
    """Whether I_min points the other way than a similarity (3, 3) has it, by how the outlines lie on each other."""
    turn = math.atan2(H.item(1, 0), H.item(0, 0))
    ways = find_alignments(description.view.contours[0], view.contours[0])
    if len(ways) != 1 and len({math.cos(way.angle - turn) < 0.0 for way in ways}) != 1:
        try:
            ways = [choose_alignment(ways, description.view, view)]
        except AmbiguousError as error:
            d = description
            if abs(d.d_c) < SELF_SYMMETRIC and abs(d.d_1 + d.d_2) < SELF_SYMMETRIC:  # the grasp maps to itself
                return False
            raise AmbiguousError(
                "the outline maps to itself by a half turn, so one pair of views cannot tell the grasp from its turned "
                f"twin: {error}"
            ) from None
    return math.cos(ways[0].angle - turn) < 0.0
