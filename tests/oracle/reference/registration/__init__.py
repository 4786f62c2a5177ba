# SPDX-License-Identifier: Apache-2.0
"""The pose of a plane part made exact on edges and texture, and what is told of it."""

from reference.registration.estimate import seen_area, surface_evidence, surface_probability
from reference.registration.pose import strongest_edges
from reference.registration.texture import patch_noise

__all__ = ["patch_noise", "seen_area", "strongest_edges", "surface_evidence", "surface_probability"]
