# SPDX-License-Identifier: Apache-2.0
"""RRD files for rerun: images, outline, contacts with their uncertainty, and the numbers over time. Extra `rerun`."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack.io.base import Frame
from grasptrack.io.columns import NAMED
from grasptrack.io.images import encode_image
from grasptrack.io.recording import HALF, check_writable, covariance_ellipses, status_line
from grasptrack.plugins import import_extra
from grasptrack.tracking.result import TrackResult
from grasptrack.view.style import STATUS_RGB

IMAGE, OUTLINE, CONTACTS, ELLIPSES, STATUS, NUMBERS = (
    "image", "image/outline", "image/contacts", "image/ellipses", "status", "numbers",
)  # fmt: skip
"""Paths of entities."""
_WHITE = (255, 255, 255)
_PLOTTED = ("margin", "confidence", "chance", "latency_ms")


class RerunRecording:
    """Writes an RRD file with the timelines "frame" and, where the frames have times, "time"."""

    def __init__(self, path: Path, quality: int | None = None, options: Callable[[], str] = str) -> None:
        self.path, self._quality = path, quality
        self._rr: Any = import_extra("rerun", "rerun", "a recording for rerun")
        check_writable(path)
        self._stream: Any = self._rr.RecordingStream("grasptrack")
        self._stream.save(path)

    def write(self, frame: Frame, result: TrackResult) -> None:
        """Add a frame."""
        rr, log = self._rr, self._stream.log
        self._stream.set_time("frame", sequence=frame.index)
        if frame.time is None:
            self._stream.disable_timeline("time")
        else:
            self._stream.set_time("time", duration=frame.time)
        data, form = encode_image(frame.image, self._quality)
        log(IMAGE, rr.EncodedImage(contents=data, media_type=f"image/{form}"))
        rgb = STATUS_RGB[result.status]
        # rerun has the centre of the first pixel at 0.5; what is empty clears what was there.
        outlines = [] if result.view is None else [c.points + HALF for c in result.view.contours]
        closed = [[*points.tolist(), points[0].tolist()] for points in outlines]
        log(OUTLINE, rr.LineStrips2D(closed, colors=[rgb] * len(closed)))
        contacts = np.empty((0, 2)) if result.contacts is None else result.contacts + HALF
        log(CONTACTS, rr.Points2D(contacts, colors=[rgb] * len(contacts), radii=[3.0] * len(contacts)))
        rings = [(ring + HALF).tolist() for ring in covariance_ellipses(result)]
        log(ELLIPSES, rr.LineStrips2D([[*ring, ring[0]] for ring in rings], colors=[_WHITE] * len(rings)))
        log(STATUS, rr.StateChange(state=result.status))
        log(f"{STATUS}/text", rr.TextLog(status_line(result)))
        for name in _PLOTTED:
            if math.isfinite(value := NAMED[name].shown_value(result)):
                log(f"{NUMBERS}/{name}", rr.Scalars(value))

    def close(self) -> None:
        """Write what is still held; may be called again."""
        if self._stream is not None:
            self._stream.flush()
            self._stream.disconnect()
            self._stream = None
