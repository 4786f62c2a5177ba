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

from grasptrack.io.columns import NAMED
from grasptrack.io.images import encode_jpeg
from grasptrack.live.advisor import Proposal, WireState
from grasptrack.live.state import CurvePoint, Shown
from grasptrack.presentation import plain_value
from grasptrack.segmentation.candidate import describe_candidate
from grasptrack.tracking.messages import SENTENCES
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats
from grasptrack.view.draw import cone_length, friction_cones

UNITS_PER_PX = 100.0
"""Of lines."""
DIGITS = 3
"""Decimals of contacts, px."""
FARTHEST = 1e9
"""Of lines: a friction cone under a steep homography may reach far."""


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
        "number": shown.number,
        "phase": shown.phase,
        "paused": shown.paused,
        "live": shown.live,
        "image": shown.image,
        "friction": shown.friction,
        "fingers": shown.fingers,
        "meant": {"on": shown.meant.object_at, "off": shown.meant.not_at, "box": shown.meant.box},
        "notice": {"number": shown.notice[0], "text": shown.notice[1]},
        "recording": {"name": shown.recording, "images": shown.recorded, "dropped": shown.dropped},
        "files": shown.files,
        "result": None if shown.result is None else _result_entry(shown.result),
        "candidates": [] if shown.proposal is None else _candidate_entries(shown.proposal),
        "verdict": told and {"level": told.level, "expectation": told.expectation, "reasons": told.reasons},
        "wire": None if shown.wire is None else _wire_entry(shown.wire),
        "hover": None if shown.hover is None else {"image": shown.hover.image, "outline": _line(shown.hover.outline)},
    }
    if shown.arrival is not None:
        frame = shown.arrival.frame
        content["size"] = [frame.image.shape[1], frame.image.shape[0]]
        content["time"] = None if frame.time is None else _finite_or_none(frame.time)
        content["name"] = frame.name
        content["taken_ms"] = 1e3 * (time.time() - time.perf_counter() + shown.arrival.at)
    return json.dumps(content, allow_nan=False, ensure_ascii=False, separators=(",", ":")).encode(
        errors="backslashreplace"
    )


_FIELDS = {
    **{name: name for name in ("status", "reason", "strategy", "confidence", "chance", "latency_ms", "distance")},
    "grasp": "grasp_id",
    "margin_deg": "margin",
}
"""Columns that the page shows, by its own names for them."""


def _result_entry(result: TrackResult) -> dict[str, Any]:
    entry: dict[str, Any] = {
        **{key: plain_value(NAMED[name].shown_value(result)) for key, name in _FIELDS.items()},
        "notice": SENTENCES.get(result.notice, "") if result.notice else "",
        "object_sure": result.object_sure,
        "outlines": [] if result.view is None else [_line(c.points) for c in result.view.contours],
        "contacts": None,
    }
    if result.contacts is not None:
        entry["contacts"] = np.round(result.contacts, DIGITS).tolist()
        entry["seen"] = None if result.seen is None else result.seen.tolist()
        entry["cones"] = [_line(cone) for cone in friction_cones(result, cone_length(result.contacts, 1.0))]
        entry["sigmas"] = None if result.covariance is None else _contact_sigmas(result.covariance)
    return entry


def _contact_sigmas(covariance: Floats) -> list[float | None]:
    """px, rms error of each contact."""
    with np.errstate(over="ignore", invalid="ignore"):
        variances = covariance[:, 0, 0] + covariance[:, 1, 1]
    return [_finite_or_none(round(math.sqrt(v), DIGITS)) if 0.0 <= v < math.inf else None for v in variances.tolist()]


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


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
