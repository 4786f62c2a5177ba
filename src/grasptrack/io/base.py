# SPDX-License-Identifier: Apache-2.0
"""What every source of images is: something that iterates over frames of one size, and closes."""

from __future__ import annotations

import contextlib
import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.equality import compared_by_value
from grasptrack.errors import SourceError

Image = NDArray[Any]
UNREAD: Image = np.zeros((0, 0), np.uint8)
"""Stands for an image that is read past."""


@compared_by_value
@dataclass(frozen=True, slots=True)
class Frame:
    """One image of a source.

    Attributes:
        index: number of the frame in the order of decoding, from 0.
        time: s, later than those before; None where the source has no times, or one that does not go on.
        image: uint8, grey (H, W) or BGR (H, W, 3).
        name: what to call it in a message: the file's name, or the source's name and the frame's number.
    """

    index: int
    time: float | None
    image: NDArray[np.uint8]
    name: str

    def __repr__(self) -> str:
        when = "" if self.time is None else f", {self.time:g} s"
        return f'Frame({self.index}, "{self.name}", {_format_size(self.image.shape)} px{when})'

    def _repr_png_(self) -> bytes:
        return bytes(cv2.imencode(".png", self.image)[1])


class _GoingTimes:
    """Times of frames, which go on where a device's clock is set back."""

    def __init__(self) -> None:
        self.latest = -math.inf
        self._offset = self._step = 0.0
        self._refused: float | None = None  # by that clock, s

    def time_of(self, told: float) -> float | None:
        """The time of a frame, s; None where it is not after that of the last one.

        Of two in a row that are not, but follow one another, the clock was set back: they come as the last two did.
        """
        if self._refused is not None and self._refused < told < math.inf and not told + self._offset > self.latest:
            self._offset = self.latest + self._step - self._refused
        time, self._refused = told + self._offset, None
        if not self.latest < time < math.inf:
            self._refused = told
            return None
        self._step = time - self.latest if math.isfinite(self.latest) else 0.0
        self.latest = time
        return time


class Source(ABC):
    """Frames of one size, one at a time: memory does not grow with their number.

    Args:
        spec: what the user named.
        fps: frames/s, above 0, that give frame i the time i / fps s, in place of the source's own times; None leaves these.

    Attributes:
        kind: "folder", "glob", "image", "stack", "video", "camera", "stream", "ros2", "bag" or "stdin".
        live: whether it goes on for as long as it is read, and gives the newest image only: what comes while an image is
            worked on is dropped.
        dropped: images of a live source that were not given since iterating began.
        reconnected: how many times a live source came back after it had gone.
        waited: s that the last image of a live source had waited when it was given.
        first: index of the frame that iterating begins with; see `start_at`.
        count: number of frames, those before the first included, or None where it is not known.
        exact: whether `count` is certain; for some videos it is estimated from the duration.
        fps: frames/s, or None.
        files: that are read; none of what comes from a device or a stream.
        names: the frames' file names where frames are files, else empty.
        recorded_with: options of `grasptrack track` that track a recording of our own again alike; empty where none are known.
        shortfall: after the last frame: one sentence if there were fewer than the source tells of, else empty.

    Raises:
        SourceError: at the start when there is nothing to read, on the way when a frame cannot be read or changes size.
    """

    kind: str = ""
    live: bool = False

    def __init__(self, spec: str, fps: float | None = None) -> None:
        if fps is not None and not (0.0 < fps < math.inf):
            raise SourceError(f"fps must be a positive number of frames/s, not {fps:g}", fps=fps)
        self.spec = spec
        self.files: tuple[Path, ...] = ()
        self.first = 0
        self.count: int | None = None
        self.exact = False
        self.fps = fps
        self.names: tuple[str, ...] = ()
        self.recorded_with = ""
        self.shortfall = ""
        self.dropped = 0
        self.reconnected = 0
        self.waited = 0.0
        self._period = None if fps is None else 1.0 / fps
        self._times_warned = False
        self._running: Generator[tuple[Image, float | None, str], None, None] | None = None

    @abstractmethod
    def _read_images(self) -> Generator[tuple[Image, float | None, str], None, None]:
        """Images, their own times and their names, in order; whatever it holds open is released when it is closed.

        In the place of an image before `first` anything may be given that costs less.
        """

    def start_at(self, frame: int) -> Source:
        """The source itself, to be iterated over from the frame of this index on; frames keep their indices and times."""
        if frame and self.live:
            raise SourceError(f'"{self.spec}" is live and begins with the image that comes, not with frame {frame}')
        if self.exact and self.count is not None and frame >= self.count:
            raise self._end_before(frame, self.count)
        self.first = frame
        return self

    def _end_before(self, frame: int, count: int) -> SourceError:
        told = f'"{self.spec}" has {count} image{"s"[: count != 1]}, counted from 0: there is no frame {frame} to start with'
        return SourceError(told, frame=frame, count=count)

    def __iter__(self) -> Iterator[Frame]:
        self.close()
        self._running = running = self._read_images()
        size: tuple[int, ...] | None = None
        clock, index = _GoingTimes(), -1
        with contextlib.closing(running):
            for index, (image, time, name) in enumerate(running):
                if index < self.first:
                    pass
                elif size is None:
                    size = image.shape[:2]
                elif image.shape[:2] != size:
                    raise SourceError(
                        f"frame {index} ({name}) is {_format_size(image.shape)} px, "
                        f"but those before it are {_format_size(size)}: "
                        "all frames must have one size",
                        frame=index,
                        shape=image.shape[:2],
                        expected=size,
                    )
                if self._period is not None:
                    time = index * self._period
                elif time is not None and (told := clock.time_of(time)) is not None:
                    time = told
                elif time is not None:
                    self._warn_of_time(name, time, clock.latest)
                    time = None
                if index >= self.first:
                    yield Frame(index, time, image, name)
            if 0 <= index < self.first:
                raise self._end_before(self.first, index + 1)

    def _warn_of_time(self, name: str, time: float, latest: float) -> None:
        """Say once of a source that its times do not go on."""
        if not self._times_warned:
            self._times_warned = True
            warnings.warn(
                f'"{self.spec}": the time of {name}, {time:g} s, is not after {latest:g} s; '
                "such frames have none, and after a clock that was set back times go on (--fps gives all frames one)",
                stacklevel=4,
            )

    def close(self) -> None:
        """Release what the source holds open; iterating again starts over."""
        if self._running is not None:
            self._running.close()
            self._running = None

    def __enter__(self) -> Source:
        """The source itself; leaving closes it."""
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _format_size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"
