# SPDX-License-Identifier: Apache-2.0
"""An inspection of a straight image in px of the image as the lens shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grasptrack.segmentation.undistortion import Undistortion
from grasptrack.trackability.result import Suitability


def as_seen(found: Suitability, lens: Undistortion) -> Suitability:
    """Outlines, peaks, contacts and the errors to be expected of contacts as they are seen.

    All else stays that of the straight image: motions, widths, and what is predicted of a run.

    Args:
        found: in the straight image, with a grasp or without.
        lens: that made it straight.
    """
    grasp = found.grasp
    if grasp is not None:
        J = lens.stretch(grasp.contacts)
        covariance = np.asarray(J @ grasp.covariance @ np.swapaxes(J, 1, 2))
        sigma = np.sqrt(np.trace(covariance, axis1=1, axis2=2))
        grasp = grasp._replace(contacts=lens.seen(grasp.contacts), covariance=covariance, sigma=sigma)
    return replace(
        found,
        grasp=grasp,
        view=lens.view(found.view),
        equals=tuple(lens.view(view) for view in found.equals),
        peaks=lens.seen(found.peaks),
    )
