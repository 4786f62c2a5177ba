# SPDX-License-Identifier: Apache-2.0
"""grasps.json: every object's grasps with what their rank rests on, for other programs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.io.results import software_versions, write_json
from grasptrack.view.fingers import grasp_opening

if TYPE_CHECKING:
    from grasptrack.geometry.contours import View
    from grasptrack.grasp.synthesis.result import RankedGrasp
    from grasptrack.view.grasps import Planned

FORMAT = 1
"""Raised when a key changes its meaning or goes away; new keys alone do not raise it."""
UNITS = {
    "outline, contacts, fingers, swept, centroid": "px, the centre of the top-left pixel at (0, 0), x right, y down",
    "area_px2": "px^2",
    "directions": "unit vectors in the image, in which each finger moves to touch",
    "quality, terms": "0 to 1",
    "margin_deg": "degrees",
    "opening_mm": "mm, null without a scale",
    "regions_px, hand_px": "px; null: without limit",
}


def write_grasps_json(
    path: Path,
    name: str,
    shape: tuple[int, int],
    objects: Sequence[Planned],
    options: Mapping[str, Any],
    px_per_mm: float | None = None,
) -> None:
    """Write grasps.json; the file is complete at any moment or absent.

    Args:
        path: the file, written over.
        name: the image's, as the user gave it.
        shape: height and width of the image.
        objects: outlines and their grasps, the object that was chosen first.
        options: what was asked for.
        px_per_mm: scale of the image.
    """
    write_json(
        path,
        {
            "format": FORMAT,
            "image": {"name": name, "width": shape[1], "height": shape[0]},
            "options": options,
            "versions": software_versions(),
            "units": UNITS,
            "objects": [_object_entry(found, px_per_mm) for found in objects],
            "neighbours": _neighbour_outlines(objects),
        },
    )


def _object_entry(found: Planned, px_per_mm: float | None) -> dict[str, Any]:
    area, x, y, *_ = kernels.polygon_moments(found.outline.points, found.outline.offsets)
    return {
        "outline": _outline_points(found.outline),
        "area_px2": round(area, 3),
        "centroid": [round(x, 3), round(y, 3)],
        "hand_px": {key: _rounded_or_none(value) for key, value in found.hand._asdict().items()},
        "grasps": [_grasp_entry(grasp, i + 1, px_per_mm) for i, grasp in enumerate(found.grasps)],
        "reason": found.grasps.reason,
        "refused": found.grasps.refused,
    }


def _neighbour_outlines(objects: Sequence[Planned]) -> list[Any]:
    """Outlines of what lies beside the objects and is none of them."""
    own = {id(found.outline) for found in objects}
    others = {id(view): view for found in objects for view in found.neighbours if id(view) not in own}
    return [_outline_points(view) for view in others.values()]


def _outline_points(view: View) -> list[list[list[float]]]:
    """The outer contour, then its holes."""
    return [_rounded_list(contour.points) for contour in view.contours]


def _grasp_entry(grasp: RankedGrasp, rank: int, px_per_mm: float | None) -> dict[str, Any]:
    return {
        "rank": rank,
        "spread": grasp.spread,
        "contacts": _rounded_list(grasp.contacts),
        "directions": _rounded_list(grasp.directions, 6),
        "opening_px": _rounded_or_none(grasp_opening(grasp)),
        "opening_mm": None if px_per_mm is None else _rounded_or_none(grasp_opening(grasp) / px_per_mm),
        "quality": _rounded_or_none(grasp.quality, 4),
        "terms": {key: _rounded_or_none(value, 4) for key, value in grasp.terms._asdict().items()},
        "margin_deg": _rounded_or_none(math.degrees(grasp.margin)),
        "regions_px": [_rounded_or_none(value) for value in grasp.regions.tolist()],
        "fingers": _rounded_list(grasp.fingers),
        "swept": _rounded_list(grasp.swept),
    }


def _rounded_or_none(value: float, decimals: int = 3) -> float | None:
    """JSON has no word for what is not finite."""
    return round(float(value), decimals) if math.isfinite(value) else None


def _rounded_list(values: NDArray[np.float64], decimals: int = 3) -> Any:
    return np.round(values, decimals).tolist()
