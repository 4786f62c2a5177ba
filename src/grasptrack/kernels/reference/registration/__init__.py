# SPDX-License-Identifier: Apache-2.0
"""The pose of a plane part made exact on edges and texture, and what is told of it."""

from grasptrack.kernels.reference.registration.estimate import seen_area, surface_evidence
from grasptrack.kernels.reference.registration.pose import PoseTarget, strongest_edges

__all__ = ["PoseTarget", "seen_area", "strongest_edges", "surface_evidence"]
