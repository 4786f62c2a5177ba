# SPDX-License-Identifier: Apache-2.0
"""Why one grasp is carried along (Sections I and VI): beside it the one that is searched anew in every frame. Table G."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasptrack.errors import ObservationError
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.synthesis import synthesize
from grasptrack.transfer import strategy_named
from grasptrack.typing import Floats
from grasptrack_bench.metrics.errors import ErrorMeasure, error_measure
from grasptrack_bench.report.table import Cell, Table
from research.paper.footage import Footage
from research.paper.runs import OFF_PX
from research.paper.transfers import transferred_contacts

_HEAD = (
    "motion", "object", "frames", "searched anew: median px", "searched anew: worst px", "searched anew: off %",
    "carried: median px", "carried: worst px", "carried: off %", "carried: answered %",
)  # fmt: skip


def table_of_searches(footage: Sequence[Footage]) -> Table:
    """The best grasp of each frame's outline, and the first frame's best carried there by the homography."""
    rows = [row for f in footage if (row := _compare(f)) is not None]
    return Table(
        "G",
        "The grasp searched anew in every frame beside the one that is carried along, rendered contours "
        "(Sections I and VI; not a table of the paper)",
        _HEAD,
        tuple(rows),
        (
            "Searched anew: the grasp that synthesis ranks first on the outline of that frame, whichever of its contacts comes "
            "first. Carried: the one that it ranks first in the first frame, by our homography, the last frame as prior.",
            f"Both against the place of the first frame's grasp, its worst contact. Off: by more than {OFF_PX:g} px, "
            "another grasp. -: no frame was answered.",
        ),
    )


def _compare(footage: Footage) -> tuple[Cell, ...] | None:
    first = footage.silhouettes[0]
    if not isinstance(first, View):
        return None
    contacts = synthesize(first, top=1)[0].contacts
    anew: list[ErrorMeasure] = []
    for k, view in enumerate(footage.silhouettes[1:], start=1):
        if not isinstance(view, View):
            continue
        try:
            found = synthesize(view, top=1)[0].contacts
        except (ObservationError, IndexError):
            continue
        anew.append(_nearest_order(found, apply_homography(footage.H[k], contacts), float(footage.areas[k])))
    strategy = strategy_named("homography")
    answers = transferred_contacts(strategy, footage.silhouettes, contacts, "last frame as prior")
    carried = [
        error_measure(a, apply_homography(footage.H[k], contacts), float(footage.areas[k]))
        for k, a in enumerate(answers, start=1)
        if not isinstance(a, str)
    ]
    share = 100.0 * len(carried) / len(answers)
    return footage.motion, footage.part.name, len(answers), *_summary(anew), *_summary(carried), share


def _nearest_order(found: Floats, truth: Floats, area: float) -> ErrorMeasure:
    """The error, whichever contact is called the first."""
    both = (error_measure(c, truth, area) for c in (found, found[::-1]))
    return min(both, key=lambda e: e.maximum_px)


def _summary(errors: Sequence[ErrorMeasure]) -> tuple[Cell, Cell, Cell]:
    """Median and largest error of the worst contact, px, and how many per cent are off."""
    if not errors:
        return None, None, None
    worst = np.array([e.maximum_px for e in errors])
    return float(np.median(worst)), float(worst.max()), 100.0 * float(np.mean(worst > OFF_PX))
