# SPDX-License-Identifier: Apache-2.0
"""What goes to the page: a moment of a session as JSON, with its image as a JPEG where the page does not have that yet.

A message is four bytes (big-endian), the length of the JSON, then the JSON in UTF-8, then the JPEG, which may be absent.
Lines are flat lists of whole numbers, x and y by turns, in hundredths of a px: JSON takes a fifth of
the time that it takes for pairs of floats.
"""

from __future__ import annotations

import json
import math
import struct
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from grasptrack.io.images import encode_jpeg
from grasptrack.live.advisor import Proposal, WireState
from grasptrack.live.state import CurvePoint, Shown, headline_of
from grasptrack.presentation import format_confidence
from grasptrack.segmentation.candidate import describe_candidate
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.scene import SceneResult
from grasptrack.typing import Floats
from grasptrack.view.draw import cone_length, friction_cones

UNITS_PER_PX = 100.0
"""Of lines."""
DIGITS = 3
"""Decimals of contacts, px, and of distances at most."""
NEARLY, MOST = 0.995, 0.999
"""Probabilities that are told to a tenth of a percent; and that are told no closer."""
FARTHEST = 1e9
"""Of lines: a friction cone under a steep homography may reach far."""
_AS_THEY_ARE = ("number", "phase", "paused", "live", "count", "speed", "image", "friction", "fingers", "files")
"""Attributes of `Shown` that the page is told so."""


class Painter:
    """Makes messages; each image is encoded once, however many look on. For one thread at a time."""

    def __init__(self) -> None:
        self._image, self._jpeg = 0, b""
        self._number, self._head = 0, b""

    def message_for(self, shown: Shown, has: int, curves: Sequence[CurvePoint] = ()) -> bytes:
        """The message for a page that has the image of number `has` already, with the points that its curves lack."""
        if shown.number != self._number:
            self._number, self._head = shown.number, moment_to_json(shown)
        jpeg = b""
        if shown.arrival is not None and shown.image != has:
            if shown.image != self._image:
                self._image, self._jpeg = shown.image, encode_jpeg(shown.arrival.frame.image)
            jpeg = self._jpeg
        # All pages share the head but for the points, which differ by what a page has seen.
        head = self._head[:-1] + b',"curves":' + json.dumps(curves, separators=(",", ":")).encode() + b"}"
        return struct.pack(">I", len(head)) + head + jpeg


def moment_to_json(shown: Shown) -> bytes:
    """A moment, without its image."""
    told = shown.verdict
    content: dict[str, Any] = {
        **{name: getattr(shown, name) for name in _AS_THEY_ARE},
        "meant": {"on": shown.meant.object_at, "off": shown.meant.not_at, "box": shown.meant.box},
        "notice": {"number": shown.notice[0], "text": shown.notice[1]},
        "recording": {"name": shown.recording, "images": shown.recorded, "dropped": shown.dropped},
        "headline": headline_of(shown)._asdict(),
        "figures": _figure_entries(shown),
        "result": None if shown.result is None else _result_entry(shown.result),
        "ghost": _ghost_entry(shown),
        "parts": [] if shown.scene is None else _part_entries(shown.scene),
        "chosen": shown.chosen,
        "sure": shown.proposal is not None and shown.proposal.is_sure(shown.meant.sure),
        "candidates": [] if shown.proposal is None else _candidate_entries(shown.proposal),
        "verdict": told and {"level": told.level, "expectation": told.expectation, "reasons": told.reasons},
        "servo": shown.servo and vars(shown.servo),
        "wire": None if shown.wire is None else _wire_entry(shown.wire),
        "hover": None if shown.hover is None else {"image": shown.hover.image, "outline": _line(shown.hover.outline)},
    }
    if shown.arrival is not None:
        frame = shown.arrival.frame
        content["size"] = [frame.image.shape[1], frame.image.shape[0]]
        content["name"] = frame.name
        content["place"] = shown.arrival.place
        content["taken_ms"] = 1e3 * (time.time() - time.perf_counter() + shown.arrival.at)
    return json.dumps(content, allow_nan=False, ensure_ascii=False, separators=(",", ":")).encode(
        errors="backslashreplace"
    )


FIGURES = {
    "image": ("Image", "Number of the image, from 1"),
    "time": ("Time", "When the source took it"),
    "last": ("Last located", "Since when the object is not located; its outline and contacts of then are drawn dashed"),
    "grasp": ("Grasp", "Number of the grasp: Choose again, or other fingers, give another one"),
    "margin": ("Margin", "How much smaller the friction angle could be before fingers slip, ± one standard deviation"),
    "chance": ("Chance to close", "Probability that the grasp holds, with all that is not known of contacts and tilt"),
    "confidence": ("Confidence", "Probability that contacts lie where they are drawn; no more than trials have shown"),
    "guess": ("Best guess", "Probability that the best guess is right: too little to show it"),
    "contacts": ("Contacts", "How far the least certain contact is off, as a root mean square: px of the image"),
    "distance": ("Distance", "From the camera to the object, in the unit of its length, ± one standard deviation"),
    "latency": ("Latency", "Time that the tracker took for the image"),
}
"""Labels, and what they mean, in the order of the page."""


def _figure_entries(shown: Shown) -> list[list[str]]:
    """Key, label, value and meaning of each figure that there is."""
    when = None if shown.arrival is None else shown.arrival.frame.time
    told = {"image": str(shown.image), "time": _with_unit(math.nan if when is None else when, 2, " s")}
    if (result := shown.result) is not None:
        lost, most = result.status == "lost", 1.0 - NUMBERS.untested
        ago = result.frame - shown.last.frame if lost and shown.last is not None else 0
        off = math.nan if result.covariance is None else _worst_error(result.covariance)
        sure = f"≥ {most:g}" if result.confidence >= most else format_confidence(result.confidence)
        told |= {
            "last": f"{ago} image{'s' if ago > 1 else ''} ago" if ago else "",
            "grasp": str(result.grasp_id or ""),
            "margin": _with_sd(result.margin_deg, result.margin_sd_deg, 1, "°"),
            "chance": _percent(result.chance),
            # Of the first view it is 1 by definition, which tells nothing.
            "confidence": sure if result.located and result.confidence < 1.0 else "",
            "guess": sure if lost else "",
            "contacts": f"± {_with_unit(off, 2, ' px')}" if math.isfinite(off) else "",
            "distance": _with_sd(result.distance, result.distance_sd, DIGITS, f" {shown.unit or '(your unit)'}"),
            "latency": _with_unit(result.latency_ms, 1, " ms"),
        }
    return [[key, label, told[key], tip] for key, (label, tip) in FIGURES.items() if told.get(key)]


def _with_unit(value: float, digits: int, unit: str) -> str:
    return f"{value:.{digits}f}{unit}" if math.isfinite(value) else ""


def _with_sd(value: float, sd: float, most: int, unit: str) -> str:
    """With as many decimals, up to some, as its standard deviation leaves certain; one where that is not known."""
    if not (0.0 < sd < math.inf and math.isfinite(value)):
        return _with_unit(value, 1, unit)
    digits = min(max(1 - math.floor(math.log10(sd)), 0), most)
    return f"{value:.{digits}f} ± {sd:.{digits}f}{unit}"


def _percent(share: float) -> str:
    """Of a probability, which is never told as certain."""
    return "> 99.9 %" if MOST < share < math.inf else _with_unit(100.0 * share, 1 if share > NEARLY else 0, " %")


def _worst_error(covariance: Floats) -> float:
    """px, rms of the least certain contact."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.sqrt(np.max(covariance[:, 0, 0] + covariance[:, 1, 1])))


def _ghost_entry(shown: Shown) -> dict[str, Any] | None:
    """Where the object was last, while it is lost."""
    if shown.result is None or shown.result.status != "lost" or shown.last is None or shown.last.contacts is None:
        return None
    return {"outlines": _outlines(shown.last), "contacts": np.round(shown.last.contacts, DIGITS).tolist()}


def _outlines(result: TrackResult) -> list[list[int]]:
    return [] if result.view is None else [_line(c.points) for c in result.view.contours]


def _result_entry(result: TrackResult) -> dict[str, Any]:
    entry: dict[str, Any] = {"status": result.status, "outlines": _outlines(result), "contacts": None}
    if result.contacts is not None:
        entry["contacts"] = np.round(result.contacts, DIGITS).tolist()
        entry["seen"] = None if result.seen is None else result.seen.tolist()
        entry["cones"] = [_line(cone) for cone in friction_cones(result, cone_length(result.contacts, 1.0))]
    return entry


def _part_entries(scene: SceneResult) -> list[dict[str, Any]]:
    """Of each part its number, name, status, why it is not located, and where it is seen."""
    return [
        {
            "number": number,
            "name": result.part_id,
            "status": result.status,
            "why": result.reason,
            "outline": _line(None if result.view is None else result.view.outer.points),
        }
        for number, result in scene.results.items()
    ]


def _candidate_entries(proposal: Proposal) -> list[dict[str, Any]]:
    first = proposal.candidates[0] if proposal.candidates else None
    return [
        {
            "number": i + 1,
            "probability": candidate.probability,
            "outline": _line(candidate.view.outer.points),
            "about": "" if first is None or i == 0 else describe_candidate(candidate, first),
        }
        for i, candidate in enumerate(proposal.candidates)
    ]


def _wire_entry(wire: WireState) -> dict[str, Any]:
    return {
        "image": wire.image,
        "points": wire.points,
        "path": _line(wire.path),
        "hover": _line(wire.hover),
        "closed": wire.closed,
    }


def _line(points: Floats | None) -> list[int]:
    if points is None:
        return []
    clipped = np.nan_to_num(np.clip(UNITS_PER_PX * points, -FARTHEST, FARTHEST))
    whole: list[int] = np.rint(clipped).astype(np.int64).ravel().tolist()
    return whole
