# SPDX-License-Identifier: Apache-2.0
"""instances.json and instances.csv: every part that was found in an image, for other programs.

Lengths are in px, the centre of the top-left pixel at (0, 0), x right and y down. What is not finite is written as null.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from grasptrack.files import whole_file
from grasptrack.io.results import image_entry, outline_points, software_versions
from grasptrack.tracking.instances import Instance
from grasptrack.tracking.parts import KnownPart

INSTANCES_FORMAT = 1
COLUMNS = ("number", "part", "found", "mirrored", "confidence", "edge", "room_px")


def instances_to_dict(
    found: Sequence[Instance], name: str, shape: tuple[int, ...], options: Mapping[str, Any]
) -> dict[str, Any]:
    """Every instance with its pose and contacts, of an image of a name, as the user gave it, and (height, width) px."""
    return {
        "format": INSTANCES_FORMAT,
        "image": image_entry(name, shape),
        "options": dict(options),
        "versions": software_versions(),
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
        "outline": outline_points(one.view),
        "turns_deg": list(one.turns),
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
