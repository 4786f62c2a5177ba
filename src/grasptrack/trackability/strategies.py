# SPDX-License-Identifier: Apache-2.0
"""Which strategies can carry a grasp on this outline, and why the others cannot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.errors import GraspTrackError
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.segmentation.images import Grey
from grasptrack.tracking.initialization import AUTO
from grasptrack.tracking.strategies import Silhouettes, Snakes
from grasptrack.transfer.homography import PROMINENCE, SEPARATION, SMOOTHING
from grasptrack.typing import Floats

ORDER = ("homography", "grasp-line", "rrp")
"""The strategies of the paper, those that need most first."""
PEAKS = 4
"""That a homography needs."""


class Usable(NamedTuple):
    """Whether a strategy can carry the grasp.

    Attributes:
        name: of the strategy; "auto" stands for the registration of all that is seen.
        reason: why not; empty when it can.
    """

    name: str
    reason: str


def peaks_of(view: View) -> Floats:
    """(n, 2) px, peaks of curvature of the outer contour that a homography may rest on."""
    outer = view.outer
    arc, curvature = kernels.curvature_vector(outer.points, outer.clipped, SMOOTHING)
    peaks, _ = kernels.select_points(outer.points, arc, curvature, SEPARATION * arc.item(-1), PROMINENCE)
    return outer.points[peaks].reshape(-1, 2)


def strategies_of(grasp: Grasp, view: View, grey: Grey, refusal: str = "") -> tuple[Usable, ...]:
    """`auto`'s registration and the three strategies, each tried on the view of the choice itself.

    Args:
        grasp: on the outline.
        view: the outline.
        grey: (H, W) its image.
        refusal: why no transfer is believed, of whatever strategy; else empty.
    """

    def why(name: str) -> str:
        try:
            if name == "rrp":
                Snakes(grasp, view, grey).carry(grey, None, np.eye(3))
            elif name != AUTO:
                Silhouettes(name, grasp, view)
        except GraspTrackError as error:
            return str(error)
        return refusal

    return tuple(Usable(name, why(name)) for name in (AUTO, *ORDER))


def recommended_strategy(usable: tuple[Usable, ...]) -> str:
    """The strategy to take: `auto` where anything can carry the grasp, for it asks all of them; else none, empty."""
    return AUTO if any(not u.reason for u in usable) else ""
