# SPDX-License-Identifier: Apache-2.0
"""The error measures of Section V, in the paper's unit and in units that keep their meaning.

The paper divides distances by the object's area (1/px), which is not invariant to scale; each measure here has that
form for printing its tables, px, and per cent of the grasp's opening.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasptrack.typing import Floats


def contact_distances(contacts: ArrayLike, truth: ArrayLike) -> Floats:
    """(k,) px, dist_i of Section V: from each contact (k, 2) to its own true place (k, 2), never to the other's."""
    found, true = np.asarray(contacts, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    if found.shape != true.shape or found.ndim != 2 or found.shape[1] != 2 or not len(found):
        raise ValueError(f"contacts and truth must both be (k, 2), not {found.shape} and {true.shape}")
    return np.asarray(np.hypot(*(found - true).T), dtype=np.float64)


def alignment_error(corners: Floats, truth: Floats) -> float:
    """px, e_AL of the planar tracking benchmark POT: root mean square of the distances of corners (4, 2) px from the truth."""
    return float(np.sqrt(np.mean(contact_distances(corners, truth) ** 2)))


@dataclass(frozen=True, slots=True)
class ErrorMeasure:
    """Average and maximum error of one grasp, or of a sequence of them.

    Attributes:
        average_px, maximum_px: px.
        e_av, e_max: 1/px, the same over the object's area (Section V; the text prints both as e_max).
        average_percent, maximum_percent: the same in per cent of the grasp's true opening.
    """

    average_px: float
    maximum_px: float
    e_av: float
    e_max: float
    average_percent: float
    maximum_percent: float


def error_measure(contacts: ArrayLike, truth: ArrayLike, area: float) -> ErrorMeasure:
    """Average and maximum over the contacts (k, 2) px of one grasp, off the true ones (k, 2) px: R_f E or R_v E of Section V.

    The area, px^2, is the object's in the image where the distances are taken.
    """
    if not area > 0.0:
        raise ValueError(f"an object's area must be positive, not {area:g} px^2")
    distances = contact_distances(contacts, truth)
    true = np.asarray(truth, dtype=np.float64)
    opening = float(np.hypot(*(true[1] - true[0]))) if len(true) > 1 else 0.0
    opening = opening or float("nan")  # without an opening there are no per cents of it
    average, maximum = float(distances.mean()), float(distances.max())
    return ErrorMeasure(
        average, maximum, average / area, maximum / area, 100.0 * average / opening, 100.0 * maximum / opening
    )


def sequence_error(frames: Iterable[ErrorMeasure]) -> ErrorMeasure:
    """SE (Section V, 3): the mean of the frames' average errors and the largest of their maximum errors.

    Whether a frame's contacts were transferred from the first view or carried on from the frame before, which the text
    leaves open, is decided by who makes the frames' errors.
    """
    listed = list(frames)
    if not listed:
        raise ValueError("a sequence error needs at least one frame")
    return ErrorMeasure(
        float(np.mean([f.average_px for f in listed])),
        max(f.maximum_px for f in listed),
        float(np.mean([f.e_av for f in listed])),
        max(f.e_max for f in listed),
        float(np.mean([f.average_percent for f in listed])),
        max(f.maximum_percent for f in listed),
    )
