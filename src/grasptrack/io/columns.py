# SPDX-License-Identifier: Apache-2.0
"""What is told of every frame: the one table that grasps.csv, run.json, lines of JSON, recordings, messages and the page use.

Units are for people: **degrees** for margins and tilt, px for contacts, s for times, ms for latency, the user's own unit for
distances. A cell of grasps.csv is empty where there is no value; JSON has null there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from operator import attrgetter
from typing import Any, Literal, NamedTuple

from grasptrack.io.base import Frame
from grasptrack.presentation import plain_value
from grasptrack.tracking.result import TrackResult

Kind = Literal["integer", "count", "flag", "text", "points", "matrices", "shares", "number"]
_NUMBERS = {"type": "array", "items": {"type": "number"}}
_POINTS = {"type": ["array", "null"], "items": _NUMBERS}
_SCHEMAS: dict[Kind, dict[str, Any]] = {
    "integer": {"type": "integer"},
    "count": {"type": ["integer", "null"]},
    "flag": {"type": "boolean"},
    "text": {"type": "string"},
    "points": _POINTS,
    "matrices": {"type": ["array", "null"], "items": _POINTS},
    "shares": {"type": ["array", "null"], "items": {"type": "number"}},
    "number": {"type": ["number", "null"]},
}
_NO_CONTACTS, _NO_COVARIANCE = "no contacts", "no contacts, or no covariance"
_NO_DISTANCE = "no contacts, no `--length`, or an outline that the first view cuts off"


class CsvColumn(NamedTuple):
    """One value of a frame's answer.

    Attributes:
        name: its key in JSON.
        kind: of its value in JSON.
        unit: as run.json has it; empty for words and counts.
        absent: when grasps.csv has an empty cell.
        digits: how grasps.csv writes a number, as a format.
        cells: names of its columns in grasps.csv, ``{i}`` being the contact's number; its name alone where empty.
        take: from an answer, angles in rad.
    """

    name: str
    kind: Kind
    unit: str
    absent: str
    digits: str = ""
    cells: str = ""
    take: Callable[[TrackResult], Any] | None = None

    def value_of(self, result: TrackResult) -> Any:
        """As a `TrackResult` has it, angles in rad; None or NaN where there is none."""
        return (self.take or attrgetter(self.name))(result)

    def shown_value(self, result: TrackResult) -> Any:
        """In the unit of the table."""
        value = self.value_of(result)
        return math.degrees(value) if self.unit == "degrees" else value

    def cell_names(self, fingers: int) -> list[str]:
        """Of grasps.csv for a number of contacts."""
        names = (self.cells or self.name).split()
        if "{i}" not in self.cells:
            return names
        return [name.format(i=i) for i in range(1, fingers + 1) for name in names]

    def cell_values(self, value: Any) -> list[Any]:
        """The numbers of its cells: all of an array, xx, xy and yy of each covariance."""
        if value is None or self.kind not in ("points", "shares", "matrices"):
            return [] if value is None else [value]
        flat: list[Any] = (value[:, (0, 0, 1), (0, 1, 1)] if self.kind == "matrices" else value).ravel().tolist()
        return flat


_TOLD = (
    CsvColumn("frame", "integer", "", "never"),
    CsvColumn("time_s", "number", "s", "the source has no times", ".6f", take=attrgetter("time")),
    CsvColumn("status", "text", "", "never"),
    CsvColumn("strategy", "text", "", _NO_CONTACTS),
    CsvColumn("grasp_id", "count", "", "searching"),
    CsvColumn(
        "contacts",
        "points",
        "px, the centre of the top-left pixel at (0, 0), x right, y down",
        _NO_CONTACTS,
        ".4f",
        cells="x{i} y{i}",
    ),
    CsvColumn("seen", "shares", "0 to 1", _NO_CONTACTS, ".3f", cells="seen{i}"),
    CsvColumn(
        "margin",
        "number",
        "degrees",
        _NO_CONTACTS,
        ".4f",
        take=lambda result: math.nan if result.analysis is None else result.analysis.margin,
    ),
    CsvColumn(
        "confidence",
        "number",
        "0 to 1, the complement of the probability that a contact is off or on another object",
        "never; 0 while searching",
        ".9f",
    ),
    CsvColumn("chance", "number", "probability", _NO_COVARIANCE, ".4f"),
    CsvColumn("latency_ms", "number", "ms", "never", ".4f"),
    CsvColumn("reason", "text", "", "tracked", take=lambda result: " ".join(result.reason.split())),
    CsvColumn("reason_code", "text", "", "tracked"),
    CsvColumn("tilt", "number", "degrees", _NO_CONTACTS, ".4f"),
    CsvColumn("tilt_sd", "number", "degrees", _NO_CONTACTS, ".4f"),
    CsvColumn("margin_sd", "number", "degrees", _NO_CONTACTS, ".4f"),
    CsvColumn("margin_image", "number", "degrees", _NO_CONTACTS, ".4f"),
    CsvColumn("distance", "number", "that of the length that was told", _NO_DISTANCE, ".6g"),
    CsvColumn("distance_sd", "number", "that of the length that was told", _NO_DISTANCE, ".6g"),
    CsvColumn("notice", "text", "", "a tracked frame needs none"),
    CsvColumn(
        "homography",
        "points",
        "H_current_reference, px of the grasp's first view to px of the frame, h33 being 1",
        "no contacts, or a strategy that gives none",
        ".9g",
        cells="h11 h12 h13 h21 h22 h23 h31 h32 h33",
    ),
    CsvColumn(
        "covariances",
        "matrices",
        "px^2, of each contact's x and y",
        _NO_COVARIANCE,
        ".6g",
        cells="cov_xx{i} cov_xy{i} cov_yy{i}",
        take=attrgetter("covariance"),
    ),
    CsvColumn("edge", "number", "0 to 1, share of the outline", _NO_CONTACTS, ".3f"),
    CsvColumn("surface", "number", "0 to 1, share of the surface's patches", _NO_CONTACTS, ".3f"),
    CsvColumn("object_sure", "flag", "", "never", "d"),
    CsvColumn("object_probability", "number", "probability", "no choice was made: the outline was given", ".4f"),
    CsvColumn(
        "last_seen",
        "shares",
        "frame in which the contact itself was seen last",
        _NO_CONTACTS,
        "d",
        cells="last_seen{i}",
    ),
)
_IN_DEGREES = tuple(column for column in _TOLD if column.unit == "degrees")
"""Whose names do not say so; they stay for a version."""
COLUMNS = _TOLD + tuple(each._replace(name=f"{each.name}_deg", take=each.value_of) for each in _IN_DEGREES)
"""In the order of grasps.csv; new ones come at the end."""
NAMED = {column.name: column for column in COLUMNS}
SCENE_COLUMNS = (CsvColumn("instance_id", "count", "", "never"), CsvColumn("part_id", "text", "", "never"))
"""Of a scene of many after all others, and in JSON."""
IN_JSON = (
    "frame", "time_s", "status", "reason", "reason_code", "strategy", "grasp_id", "contacts", "covariances", "seen",
    "last_seen", "edge", "surface", "homography", "confidence", "chance", "margin_deg", "margin_sd_deg", "margin_image_deg",
    "tilt_deg", "tilt_sd_deg", "distance", "distance_sd", "notice", "object_sure", "object_probability",
    "latency_ms", *(column.name for column in _IN_DEGREES),
)  # fmt: skip
"""The order of lines of JSON and of recordings."""
UNITS = {column.name: column.unit for column in COLUMNS if column.unit}


def csv_columns(fingers: int, *, scene: bool = False) -> list[str]:
    """Names of the columns of grasps.csv for a number of contacts, of one object or of a scene of many."""
    return [name for column in COLUMNS + SCENE_COLUMNS * scene for name in column.cell_names(fingers)]


def csv_cells(result: TrackResult, index: int, time: float | None, fingers: int) -> list[str]:
    """A row of grasps.csv."""
    of_frame = {"frame": index, "time_s": time, "last_seen": _frames_of(result, index)}
    cells: list[str] = []
    for column in COLUMNS + SCENE_COLUMNS * (result.instance_id is not None):
        value = of_frame[column.name] if column.name in of_frame else column.shown_value(result)
        count = len(column.cell_names(fingers))
        written = [_format_cell(part, column.digits) for part in column.cell_values(value)[:count]]
        cells += written + [""] * (count - len(written))
    return cells


def _frames_of(result: TrackResult, index: int) -> Any:
    """`last_seen` by the source's numbers of frames, of which the result's is this one."""
    return None if result.last_seen is None else result.last_seen + (index - result.frame)


def _format_cell(value: Any, digits: str) -> str:
    return "" if isinstance(value, float) and not math.isfinite(value) else format(value, digits)


def result_fields(frame: Frame, result: TrackResult, *, outline: bool = False) -> dict[str, Any]:
    """One frame as JSON has it; what does not exist is None. Lengths are in px of grasps.csv, angles in degrees."""
    fields = {name: NAMED[name].shown_value(result) for name in IN_JSON}
    fields |= {"frame": frame.index, "time_s": frame.time, "last_seen": _frames_of(result, frame.index)}
    if result.instance_id is not None:
        fields |= {column.name: column.value_of(result) for column in SCENE_COLUMNS}
    if outline:
        fields["outline"] = None if result.view is None else [c.points for c in result.view.contours]
    plain: dict[str, Any] = plain_value(fields)
    return plain


def result_schema() -> dict[str, Any]:
    """What `result_fields` gives, as a JSON schema."""
    kinds = {name: schema for kind, schema in _SCHEMAS.items() for name in IN_JSON if NAMED[name].kind == kind}
    return {"title": "grasptrack.Result", "type": "object", "properties": kinds}
