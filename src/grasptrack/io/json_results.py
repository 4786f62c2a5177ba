# SPDX-License-Identifier: Apache-2.0
"""grasps.json, inspect.json, transfer.json, instances.json and .csv, and parts.json: what a verb found, for other programs.

Lengths are in px, the centre of the top-left pixel at (0, 0), x right and y down. What is not finite is written as null.
A format is raised when a key changes its meaning or goes away; new keys alone do not raise it.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack import kernels
from grasptrack.files import whole_file
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import RankedGrasp
from grasptrack.io.results import software_versions
from grasptrack.presentation import plain_value
from grasptrack.trackability import Suitability
from grasptrack.trackability.result import Held
from grasptrack.tracking.image_pair import Outcome, Place
from grasptrack.tracking.instances import Instance
from grasptrack.tracking.parts import KnownPart
from grasptrack.typing import Floats
from grasptrack.view.grasps import Planned
from grasptrack.view.panel import grasp_opening

GRASPS_FORMAT, INSPECTION_FORMAT, TRANSFER_FORMAT, INSTANCES_FORMAT = 1, 3, 1, 1
GRASPS_UNITS = {
    "outline, contacts, fingers, swept, centroid": "px, the centre of the top-left pixel at (0, 0), x right, y down",
    "area_px2": "px^2",
    "directions": "unit vectors in the image, in which each finger moves to touch",
    "quality, terms": "0 to 1",
    "margin_deg": "degrees",
    "opening_mm": "mm, null without a scale",
    "regions_px, hand_px": "px; null: without limit",
}


def _head(form: int, name: str, shape: tuple[int, ...], options: Mapping[str, Any]) -> dict[str, Any]:
    """Of what was found in one image."""
    image = {"name": name, "width": shape[1], "height": shape[0]}
    return {"format": form, "image": image, "options": dict(options), "versions": software_versions()}


def _outline_points(view: View) -> list[Floats]:
    """Points (n, 2) px of the outer contour, then of its holes, as files tell of them."""
    return [contour.points.round(3) for contour in view.contours]


# --- grasps.json ---------------------------------------------------------------------------------


def grasps_to_dict(
    objects: Sequence[Planned],
    name: str,
    shape: tuple[int, ...],
    options: Mapping[str, Any],
    px_per_mm: float | None = None,
) -> dict[str, Any]:
    """Every object's grasps with what their rank rests on."""
    own = {id(found.outline) for found in objects}
    others = {id(view): view for found in objects for view in found.neighbours if id(view) not in own}
    return {
        **_head(GRASPS_FORMAT, name, shape, options),
        "units": GRASPS_UNITS,
        "objects": [_object_entry(found, px_per_mm) for found in objects],
        "neighbours": [_outline_points(view) for view in others.values()],
    }


def _object_entry(found: Planned, px_per_mm: float | None) -> dict[str, Any]:
    area, x, y, *_ = kernels.polygon_moments(found.outline.points, found.outline.offsets)
    return {
        "outline": _outline_points(found.outline),
        "area_px2": round(area, 3),
        "centroid": [round(x, 3), round(y, 3)],
        "hand_px": {key: round(float(value), 3) for key, value in found.hand._asdict().items()},
        "grasps": [_ranked_entry(grasp, i + 1, px_per_mm) for i, grasp in enumerate(found.grasps)],
        "reason": found.grasps.reason,
        "refused": found.grasps.refused,
    }


def _ranked_entry(grasp: RankedGrasp, rank: int, px_per_mm: float | None) -> dict[str, Any]:
    opening = grasp_opening(grasp)
    return {
        "rank": rank,
        "spread": grasp.spread,
        "contacts": np.round(grasp.contacts, 3),
        "directions": np.round(grasp.directions, 6),
        "opening_px": round(opening, 3),
        "opening_mm": None if px_per_mm is None else round(opening / px_per_mm, 3),
        "quality": round(grasp.quality, 4),
        "terms": {key: round(value, 4) for key, value in grasp.terms._asdict().items()},
        "margin_deg": round(math.degrees(grasp.margin), 3),
        "regions_px": [round(value, 3) for value in grasp.regions.tolist()],
        "fingers": np.round(grasp.fingers, 3),
        "swept": np.round(grasp.swept, 3),
    }


# --- inspect.json --------------------------------------------------------------------------------


def inspection_to_dict(
    found: Suitability, name: str, shape: tuple[int, ...], options: Mapping[str, Any], files: Sequence[str] = ()
) -> dict[str, Any]:
    """How well an object can be tracked, as plain values to six digits."""
    run, symmetry, settled = found.prediction, found.symmetry, found.settled
    by = ("outline", "surface", "ground")
    evidence = None if settled is None else dict(zip(by, settled.contact_deviations, strict=True))
    measured = {
        "level": found.level,
        "verdict": found.verdict,
        "reasons": [reason._asdict() for reason in found.reasons],
        "strategy": found.strategy,
        "located": found.located,
        "located_interval": found.located_interval,
        "error_px": found.error_px,
        "error_interval_px": found.error_interval,
        "drawn": None if run is None else run.drawn._asdict(),
        "object": found.looks._asdict(),
        "object_sure": found.object_sure,
        "object_probability": found.object_probability,
        "motions": [motion._asdict() for motion in found.motions.motions],
        "models": {
            key: {"observable": m.observable, "weakest": m.weakest, "least": m.least}
            for key, m in found.motions.models.items()
        },
        "symmetry": {"known": symmetry.known, "every_turn": symmetry.every, "turns_deg": symmetry.turns},
        "equals": [view.outer.points for view in found.equals],
        "peaks": found.peaks,
        "strategies": {u.name: {"usable": not u.reason, "reason": u.reason} for u in found.strategies},
        "texture": {"surface": found.surface._asdict(), "ground": found.ground._asdict()},
        "fixed_by": found.by,
        "evidence_px": evidence,
        "grasp": None if found.grasp is None else _held_entry(found.grasp),
        "outline": [contour.points for contour in found.view.contours],
    }
    head = _head(INSPECTION_FORMAT, name, shape, options)
    return {**head, "files": files, **plain_value(measured, digits=6)}


def _held_entry(grasp: Held) -> dict[str, Any]:
    return {
        "contacts": grasp.contacts,
        "opening_px": grasp.opening,
        "margin_deg": math.degrees(grasp.margin),
        "stable": grasp.stable,
        "chance": grasp.chance,
        "sigma_px": grasp.sigma,
        "covariance_px2": grasp.covariance,
        "limit_px": grasp.limit,
        "tolerance_px": grasp.tolerance,
    }


# --- transfer.json -------------------------------------------------------------------------------


def transfer_to_dict(
    images: tuple[str, str],
    contacts: Floats,
    outcomes: Sequence[Outcome],
    places: Sequence[Place],
    ambiguous: str,
    options: Mapping[str, Any],
) -> dict[str, Any]:
    """A grasp in two images."""
    return {
        "format": TRANSFER_FORMAT,
        "images": images,
        "options": dict(options),
        "versions": software_versions(),
        "contacts": contacts,
        "believed": any(not o.reason for o in outcomes),
        "outcomes": [_outcome_entry(o) for o in outcomes],
        "ambiguous": ambiguous,
        "places": [{"contacts": p.contacts, "share": p.share, "turn_deg": p.turn} for p in places],
    }


def _outcome_entry(outcome: Outcome) -> dict[str, Any]:
    """Of one strategy: contacts only where they are believed, as everywhere."""
    believed = not outcome.reason
    analysis = outcome.analysis if believed else None
    return {
        "strategy": outcome.strategy,
        "believed": believed,
        "confidence": outcome.confidence,
        "reason": outcome.reason,
        "reason_code": outcome.code,
        "contacts": outcome.contacts if believed else None,
        "off_px": outcome.off,
        "stable": None if analysis is None else analysis.stable,
        "margin_deg": None if analysis is None else math.degrees(analysis.margin),
    }


# --- instances.json, instances.csv and parts.json ------------------------------------------------

COLUMNS = ("number", "part", "found", "mirrored", "confidence", "edge", "room_px")


def instances_to_dict(
    found: Sequence[Instance], name: str, shape: tuple[int, ...], options: Mapping[str, Any]
) -> dict[str, Any]:
    """Every instance with its pose and contacts, of an image of a name, as the user gave it, and (height, width) px."""
    return {
        **_head(INSTANCES_FORMAT, name, shape, options),
        "instances": [_instance_entry(number, one) for number, one in enumerate(found, 1)],
    }


def _instance_entry(number: int, one: Instance) -> dict[str, Any]:
    return {
        "number": number,
        "part": one.part,
        "found": one.found,
        "mirrored": one.mirrored,
        "confidence": one.confidence,
        "reason": one.reason,
        "reason_code": one.reason_code,
        "contacts": one.contacts,
        "covariance_px2": one.covariance,
        "seen": one.seen,
        "edge": one.edge,
        "room_px": one.room,
        "homography": one.homography,
        "outline": _outline_points(one.view),
        "turns_deg": list(one.turns),
        "any_turn": one.any_turn,
        "stable": None if one.analysis is None else one.analysis.stable,
        "margin_deg": None if one.analysis is None else math.degrees(one.analysis.margin),
    }


def write_instances_csv(path: Path, found: Sequence[Instance]) -> None:
    """A row for every instance, contacts and their visibility as x1,y1,... and seen1,..., empty where there are none.

    Raises:
        OSError: it cannot be written.
    """
    most = max((0 if one.contacts is None else len(one.contacts) for one in found), default=2) or 2
    places = [f"{axis}{k + 1}" for k in range(most) for axis in "xy"] + [f"seen{k + 1}" for k in range(most)]
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow([*COLUMNS, *places, "reason_code"])
        for number, one in enumerate(found, 1):
            contacts = [] if one.contacts is None else [f"{v:.3f}" for v in one.contacts.ravel().tolist()]
            seen = [] if one.seen is None else [f"{v:.3f}" for v in one.seen.tolist()]
            room = "" if math.isinf(one.room) else f"{one.room:.1f}"
            known = [number, one.part, int(one.found), int(one.mirrored), f"{one.confidence:.6f}", f"{one.edge:.3f}"]
            contacts += [""] * (2 * most - len(contacts))
            rows.writerow([*known, room, *contacts, *seen, *[""] * (most - len(seen)), one.reason_code])


def parts_to_dict(parts: Sequence[KnownPart], files: Sequence[str]) -> dict[str, Any]:
    """Parts on file with what is known of each; their files are as the user gave them."""
    listed = [
        {
            "file": file,
            "name": part.name,
            "area_px2": part.view.outer.area,
            "holes": len(part.view.contours) - 1,
            "size_mm": part.size_mm,
            "friction": part.friction,
            "grasps": [g.contacts for g in part.grasps],
        }
        for part, file in zip(parts, files, strict=True)
    ]
    return {"format": INSTANCES_FORMAT, "versions": software_versions(), "parts": listed}
