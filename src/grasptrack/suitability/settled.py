# SPDX-License-Identifier: Apache-2.0
"""What fixes the contacts: the outline alone, the surface of the object as well, or only the ground round it."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import TransferError
from grasptrack.observation.restaged import course, denoised, restaged
from grasptrack.suitability.first import FirstView

Floats = NDArray[np.float64]
By = Literal["outline", "surface", "ground", "nothing"]

VIEWS = 3
"""Small motions of the image in which it is looked at."""
MORE = 0.5
"""A surface settles a motion only where it leaves less than this share of the error that the outline leaves."""


class Settled(NamedTuple):
    """How far the tracker's evidence fixes the contacts.

    Attributes:
        covariances: (3, 2 k, 2 k) px^2 of all contacts: by the outline alone, with the surface, and with the ground too.
        by: the least of these that fixes every contact as the tracker asks for; "outline" only where it shows all motions.
    """

    covariances: Floats
    by: By

    @property
    def deviations(self) -> tuple[float, float, float]:
        """px, the largest standard deviation of a contact by each of the three."""
        outline, surface, ground = (
            math.sqrt(float(np.linalg.eigvalsh(_own(C))[:, -1].max())) for C in self.covariances
        )
        return outline, surface, ground

    @property
    def joint(self) -> Floats:
        """(2 k, 2 k) px^2 by what fixes the contacts, or by all there is."""
        return np.asarray(self.covariances[{"outline": 0, "surface": 1}.get(self.by, 2)])

    @property
    def covariance(self) -> Floats:
        """(k, 2, 2) px^2 of each contact, the same."""
        return _own(self.joint)


def settled(first: FirstView, noise: float, limit: float, shown: bool) -> Settled | None:
    """What fixes the contacts, as the tracker itself counts it; None where it looks at no surface.

    Args:
        first: the first view.
        noise: grey levels, standard deviation of a pixel.
        limit: px, the standard deviation of a contact from which on it is not believed.
        shown: the outline shows all motions.
    """
    registration = None if first.reference is None else first.reference.registration
    if first.reference is None or registration is None:
        return None
    source, rng = denoised(first.colours, noise), np.random.default_rng(0)
    middle = 0.5 * np.array([first.grey.shape[1] - 1.0, first.grey.shape[0] - 1.0])
    found = []
    for H in course(VIEWS, np.array(first.reference.centre), first.reference.size, middle):
        try:
            found.append(registration.fusion.covariances(first.observer.look(restaged(source, H, noise, rng)), H))
        except TransferError:
            continue
    if not found:
        return None
    covariances = np.array(sorted(found, key=lambda each: float(np.trace(each[-1])))[len(found) // 2])
    alone, surface, ground = Settled(covariances, "nothing").deviations
    by: By = "nothing"
    if shown and alone <= limit:
        by = "outline"
    elif surface <= min(limit, MORE * alone):
        by = "surface"
    elif ground <= min(limit, MORE * alone):
        by = "ground"
    return Settled(covariances, by)


def _own(joint: Floats) -> Floats:
    """(k, 2, 2) of each contact, of a joint covariance (2 k, 2 k)."""
    return np.stack([joint[i : i + 2, i : i + 2] for i in range(0, len(joint), 2)])
