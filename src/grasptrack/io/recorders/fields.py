# SPDX-License-Identifier: Apache-2.0
"""A result as plain fields, the same in every recording, and as what a viewer draws."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from grasptrack.presentation import plain_value

if TYPE_CHECKING:
    from grasptrack.io.base import Frame
    from grasptrack.tracking.result import TrackResult
    from grasptrack.typing import Floats

HALF = 0.5
"""px from our coordinates, with (0, 0) in the centre of the first pixel, to those that count from its corner."""
_CONFIDENT = 2.4477
"""Standard deviations within which 95 % of a normal distribution in the plane lie: sqrt(-2 ln 0.05)."""


def result_fields(frame: Frame, result: TrackResult, *, outline: bool = False) -> dict[str, Any]:
    """One frame as JSON has it; what does not exist is None. Lengths are in px of grasps.csv, angles in degrees.

    Args:
        frame: the image.
        result: the tracker's answer.
        outline: tell the outline that was observed, the outer contour first, then holes.
    """
    analysis = result.analysis
    fields: dict[str, Any] = {
        "frame": frame.index,
        "time_s": frame.time,
        "status": result.status,
        "reason": " ".join(result.reason.split()),
        "reason_code": result.reason_code,
        "strategy": result.strategy,
        "grasp_id": result.grasp_id,
        "contacts": result.contacts,
        "covariances": result.covariance,
        "seen": result.seen,
        "homography": result.homography,
        "confidence": result.confidence,
        "chance": result.chance,
        "margin": None if analysis is None else math.degrees(analysis.margin),
        "margin_sd": math.degrees(result.margin_sd),
        "margin_image": math.degrees(result.margin_image),
        "tilt": math.degrees(result.tilt),
        "tilt_sd": math.degrees(result.tilt_sd),
        "distance": result.distance,
        "distance_sd": result.distance_sd,
        "mended": result.mended,
        "notice": result.notice,
        "latency_ms": result.latency_ms,
    }
    if outline:
        fields["outline"] = None if result.view is None else [c.points for c in result.view.contours]
    plain: dict[str, Any] = plain_value(fields)
    return plain


def result_schema() -> dict[str, Any]:
    """What `result_fields` gives, as a JSON schema."""
    number, text = {"type": ["number", "null"]}, {"type": "string"}
    points = {"type": ["array", "null"], "items": {"type": "array", "items": {"type": "number"}}}
    matrices = {"type": ["array", "null"], "items": points}
    kinds = {
        "frame": {"type": "integer"},
        "grasp_id": {"type": ["integer", "null"]},
        **dict.fromkeys(("status", "reason", "reason_code", "strategy", "notice"), text),
        **dict.fromkeys(("contacts", "homography"), points),
        "covariances": matrices,
        "seen": {"type": ["array", "null"], "items": {"type": "number"}},
    }
    numbers = ("time_s", "confidence", "chance", "margin", "margin_sd", "margin_image", "tilt", "tilt_sd")
    rest = ("distance", "distance_sd", "mended", "latency_ms")
    return {
        "title": "grasptrack.Result",
        "type": "object",
        "properties": {**kinds, **dict.fromkeys((*numbers, *rest), number)},
    }


def covariance_ellipses(result: TrackResult, points: int = 24) -> list[Floats]:
    """(points, 2) px on the 95 % ellipse of each contact; none where no covariance is known."""
    if result.contacts is None or result.covariance is None:
        return []
    turn = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    circle = np.column_stack([np.cos(turn), np.sin(turn)]) * _CONFIDENT
    found = []
    for contact, covariance in zip(result.contacts, result.covariance, strict=True):
        if np.isfinite(covariance).all():
            values, axes = np.linalg.eigh(covariance)
            found.append(contact + circle * np.sqrt(np.maximum(values, 0.0)) @ axes.T)
    return found


def status_line(result: TrackResult) -> str:
    """Status, and why where it is not tracked."""
    return f"{result.status}: {result.reason}" if result.reason else result.status
