# SPDX-License-Identifier: Apache-2.0
"""What is learned of camera and part from the poses that were accepted: focal length, first normal, thickness."""

from __future__ import annotations

from grasptrack.tracking.estimator import PoseEstimate
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Target

MOST = 1.2
"""Of the log of the focal length, and of the normal's slopes: beyond it a view is not believable."""


def learn_camera(target: Target, state: TrackState, estimate: PoseEstimate, numbers: Numbers) -> None:
    """A Kalman step on focal length and normal: an accepted pose must be a pinhole's view of a rigid plane."""
    height, width = state.last.levels[0].shape
    state.theta, state.theta_covariance = target.handle.learned_camera(
        estimate.G,
        estimate.P,
        state.theta,
        state.theta_covariance,
        float(width),
        float(height),
        numbers.pinhole_sd,
        numbers.camera_keep,
        MOST,
    )


def learn_thickness(state: TrackState, estimate: PoseEstimate, numbers: Numbers) -> None:
    """The part's height, from the share of this image's information that is new."""
    gained = max(0.0, 1.0 / estimate.thickness_variance - 1.0 / state.thickness_variance) * numbers.camera_keep
    total = 1.0 / state.thickness_variance + gained
    state.thickness += (estimate.thickness - state.thickness) * gained / total
    state.thickness_variance = 1.0 / total
