# SPDX-License-Identifier: Apache-2.0
"""What a snake says of one image."""

from __future__ import annotations

from dataclasses import dataclass

from grasptrack.typing import Bools, Floats


@dataclass(frozen=True, slots=True)
class SnakeFit:
    """What one image said.

    Attributes:
        ok: whether the fit is believed.
        reason: why not; empty when ok.
        homography: (3, 3) H_current_reference as measured in this image, not filtered: it does not lag.
        points: (n, 2) px, the fitted curve at the template's samples.
        seen: (n,) whether an edge like the template's lies within 1.75 px of the curve there.
        residual: px, rms distance of the supporting edges; inf where there are none.
        misfit: px, rms over the outline of what a homography would still move it: tilt that the shape space lacks.
        support: share of the samples inside the image that are seen, of those that had an edge in the first image.
        outside: share of the samples outside the image, which speak neither for nor against the fit.
    """

    ok: bool
    reason: str
    homography: Floats
    points: Floats
    seen: Bools
    residual: float
    misfit: float
    support: float
    outside: float
