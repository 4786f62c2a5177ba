# SPDX-License-Identifier: Apache-2.0
"""What is learned of part and camera from the poses that were accepted: thickness, focal length, first normal."""

from __future__ import annotations

import math

import numpy as np

from grasptrack.tracking.estimator import PoseEstimate
from grasptrack.tracking.state import TrackState


def learn_nuisances(state: TrackState, estimate: PoseEstimate, new: float) -> None:
    """Thickness, focal length and first normal, and whether the sides are seen as the object, after an accepted image.

    Information is averaged rather than added up, as much as the view is new: much the same view errs as the last one did.

    Args:
        state: changed.
        estimate: the accepted one; its nuisances include what was known before.
        new: share of its information that is new, 0 to 1.
    """
    before, after = state.nuisance_covariance, estimate.nuisance_covariance
    both = (1.0 - new) * after + new * before
    known = np.column_stack([state.nuisance, estimate.nuisance, before])
    try:
        first, second, spread = np.split(np.linalg.solve(both, known), [1, 2], axis=1)
    except np.linalg.LinAlgError:
        return
    mean = (1.0 - new) * (after @ first[:, 0]) + new * (before @ second[:, 0])
    covariance = after @ spread
    if not np.isfinite(mean).all() or not np.isfinite(covariance).all():
        return
    state.nuisance, state.nuisance_covariance = mean, 0.5 * (covariance + covariance.T)
    if math.isfinite(estimate.sides) and state.nuisance[0] ** 2 > state.nuisance_covariance[0, 0]:  # there are sides
        state.sides += new * (estimate.sides - state.sides)
