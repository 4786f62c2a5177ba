# SPDX-License-Identifier: Apache-2.0
"""What is learned of camera and part from the poses that were accepted: focal length, first normal, thickness."""

from __future__ import annotations

import numpy as np

from grasptrack.tracking.estimator import PoseEstimate
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Target

MOST = 1.2
"""Of the log of the focal length, and of the normal's slopes: beyond it a view is not believable."""


def learn_camera(target: Target, state: TrackState, estimate: PoseEstimate, numbers: Numbers) -> None:
    """A Kalman step on focal length and normal: an accepted pose must be a pinhole's view of a rigid plane."""
    height, width = state.last.levels[0].shape
    misfit, by_pose, by_camera = target.handle.pinhole(estimate.G, state.theta, float(width), float(height))
    if not np.isfinite(misfit).all():
        return
    # what the image alone says of the misfit: the pose has the camera's own prior in it, which must not confirm itself
    believed = by_camera @ state.theta_covariance @ by_camera.T + numbers.pinhole_sd**2 * np.eye(2)
    told = np.linalg.inv(by_pose @ estimate.P @ by_pose.T) - np.linalg.inv(believed)
    told, axes = np.linalg.eigh(0.5 * (told + told.T))
    told = np.maximum(told, 0.0)
    W = (axes * (told / (1.0 + numbers.pinhole_sd**2 * told))) @ axes.T * numbers.camera_keep
    P = np.linalg.inv(np.linalg.inv(state.theta_covariance) + by_camera.T @ W @ by_camera)
    state.theta = np.clip(state.theta - P @ (by_camera.T @ (W @ misfit)), -MOST, MOST)
    state.theta_covariance = 0.5 * (P + P.T)


def learn_thickness(state: TrackState, estimate: PoseEstimate, numbers: Numbers) -> None:
    """The part's height, from the share of this image's information that is new."""
    gained = max(0.0, 1.0 / estimate.thickness_variance - 1.0 / state.thickness_variance) * numbers.camera_keep
    total = 1.0 / state.thickness_variance + gained
    state.thickness += (estimate.thickness - state.thickness) * gained / total
    state.thickness_variance = 1.0 / total
