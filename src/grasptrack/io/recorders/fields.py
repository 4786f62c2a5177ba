# SPDX-License-Identifier: Apache-2.0
"""What viewers draw of a result, and in which px."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from grasptrack.tracking.result import TrackResult
    from grasptrack.typing import Floats

HALF = 0.5
"""px from our coordinates, with (0, 0) in the centre of the first pixel, to those that count from its corner."""
_CONFIDENT = 2.4477
"""Standard deviations within which 95 % of a normal distribution in the plane lie: sqrt(-2 ln 0.05)."""


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
