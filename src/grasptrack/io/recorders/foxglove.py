# SPDX-License-Identifier: Apache-2.0
"""MCAP files for Foxglove: images, what is drawn on them, and the results as JSON. Extra `foxglove`."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from grasptrack.errors import InputError
from grasptrack.io.bags.source import IMAGE_TOPIC, METADATA, RESULT_TOPIC
from grasptrack.io.base import Frame
from grasptrack.io.columns import result_fields, result_schema
from grasptrack.io.images import encode_image
from grasptrack.io.recording import HALF, check_writable, covariance_ellipses, status_line
from grasptrack.io.video import DEFAULT_FPS
from grasptrack.plugins import import_extra
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats
from grasptrack.view.style import STATUS_RGB

ANNOTATION_TOPIC = "/grasptrack/annotations"
_FRAME = "camera"
_THICKNESS = 2.0
_ROOM = 1 << 20
"""Bytes that a piece takes beside its image, and an index, at most."""


class FoxgloveRecording:
    """Writes `IMAGE_TOPIC`, `ANNOTATION_TOPIC` and `RESULT_TOPIC`.

    Stamps are those of the frames, from the hour at which the recording begins; frames without a time stand 1/25 s after the
    one before. The results keep the times as they are, so that what is tracked again is the same.
    """

    def __init__(self, path: Path, quality: int | None = None, options: Callable[[], str] = str) -> None:
        self.path, self._quality = path, quality
        self._sdk: Any = import_extra("foxglove", "foxglove", "a recording for Foxglove")
        channels = import_extra("foxglove.channels", "foxglove", "a recording for Foxglove")
        self._messages: Any = import_extra("foxglove.messages", "foxglove", "a recording for Foxglove")
        # Not the global one: two recordings must not see each other's images. It must live as long as its channels.
        self._context = context = self._sdk.Context()
        check_writable(path)
        try:
            self._writer: Any = self._sdk.open_mcap(path, allow_overwrite=True, context=context)
        except (OSError, RuntimeError) as error:
            raise InputError(f'"{path}" cannot be written: {error}', path=str(path)) from None
        self._options: Callable[[], str] | None = options
        self._largest = 0
        self._images = channels.CompressedImageChannel(IMAGE_TOPIC, context=context)
        self._annotations = channels.ImageAnnotationsChannel(ANNOTATION_TOPIC, context=context)
        self._results = self._sdk.Channel(RESULT_TOPIC, schema=result_schema(), context=context)
        self._begin = time.time_ns()
        self._last = self._begin - 1

    def write(self, frame: Frame, result: TrackResult) -> None:
        """Add a frame; it can be read from then on, whatever becomes of this process."""
        if self._options is not None:
            self._writer.write_metadata(METADATA, {"version": version("grasptrack"), "options": self._options()})
            self._options = None
        own = None if frame.time is None else self._begin + round(frame.time * 1e9)
        stamp = own if own is not None and own > self._last else self._last + round(1e9 / DEFAULT_FPS)
        self._last = stamp
        data, form = encode_image(frame.image, self._quality)
        at = self._messages.Timestamp(sec=stamp // 1_000_000_000, nsec=stamp % 1_000_000_000)
        image = self._messages.CompressedImage(timestamp=at, frame_id=_FRAME, data=data, format=form)
        self._images.log(image, log_time=stamp)
        self._results.log(result_fields(frame, result), log_time=stamp)
        self._annotations.log(self._image_annotations(result, at), log_time=stamp)
        self._largest = max(self._largest, frame.image.nbytes)
        with self._errors_of_the_file():
            self._writer.flush()

    def _image_annotations(self, result: TrackResult, at: Any) -> Any:
        m = self._messages
        colour = m.Color(**dict(zip("rgb", (part / 255.0 for part in STATUS_RGB[result.status]), strict=True)), a=1.0)
        white = m.Color(r=1.0, g=1.0, b=1.0, a=1.0)
        loop = partial(m.PointsAnnotation, timestamp=at, type=m.PointsAnnotationType.LineLoop, thickness=_THICKNESS)
        curves = [(c.points, colour) for c in (() if result.view is None else result.view.contours)]
        curves += [(ellipse, white) for ellipse in covariance_ellipses(result)]
        loops = [loop(points=self._foxglove_points(points), outline_color=color) for points, color in curves]
        contacts = [] if result.contacts is None else self._foxglove_points(result.contacts)
        circle = partial(m.CircleAnnotation, timestamp=at, diameter=8.0, thickness=_THICKNESS, outline_color=colour)
        circles = [circle(position=p) for p in contacts]
        corner = m.Point2(x=8.0, y=20.0)
        text = m.TextAnnotation(
            timestamp=at, position=corner, text=status_line(result), font_size=14.0, text_color=colour
        )
        return m.ImageAnnotations(circles=circles, points=loops, texts=[text])

    def _foxglove_points(self, points: Floats) -> list[Any]:
        """In Foxglove's px, which count from the corner of the first pixel."""
        point = self._messages.Point2
        return [point(x=x, y=y) for x, y in (points + HALF).tolist()]

    def close(self) -> None:
        """Write the index; may be called again."""
        if self._writer is None:
            return
        writer, self._writer = self._writer, None
        with self._errors_of_the_file():
            writer.close()

    @contextmanager
    def _errors_of_the_file(self) -> Iterator[None]:
        try:
            yield
        except RuntimeError:
            error = _why_not(self.path, self._largest + _ROOM)
            if error is None:
                raise
            raise error from None


def _why_not(path: Path, room: int) -> OSError | None:
    """What the operating system says to so many bytes more at a file's end; None where it takes them.

    The library says that a write failed, not why. To write through a file of ours would tell, but its calls back into Python
    wait for the tracker's thread, each of them.
    """
    try:
        size = path.stat().st_size
        try:
            with path.open("ab", buffering=0) as file:
                left = memoryview(bytes(room))
                while left:
                    left = left[file.write(left) or 0 :]
        finally:
            os.truncate(path, size)
    except OSError as error:
        return OSError(error.errno, error.strerror, str(path))
    return None
