# SPDX-License-Identifier: Apache-2.0
"""The chance that a grasp still closes when its contacts are off by what the tracker cannot know."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasptrack.analysis import analyze
from grasptrack.contour import View
from grasptrack.errors import GraspError
from grasptrack.grasp import Grasp

Floats = NDArray[np.float64]

DRAWS = 200
"""Contacts drawn from their covariance."""


def chance(grasp: Grasp, view: View, friction: float, width: float, covariance: Floats) -> float:
    """0 to 1, share of grasps drawn round this one that close, each contact on the outline.

    Args:
        grasp: on the outline.
        view: the outline.
        friction: Coulomb coefficient.
        width: px, of a finger.
        covariance: (k, 2, 2) px^2 of the contacts, taken as independent.
    """
    rng = np.random.default_rng(0)
    size, V = np.linalg.eigh(covariance)
    root = V * np.sqrt(np.maximum(size, 0.0))[:, None, :]
    drawn = grasp.contacts + np.einsum("kij,nkj->nki", root, rng.standard_normal((DRAWS, *grasp.contacts.shape)))
    holding = 0
    for contacts in drawn:
        try:
            holding += analyze(Grasp.of(np.ascontiguousarray(contacts)).snapped(view), view, friction, width).stable
        except GraspError:
            continue
    return holding / DRAWS
