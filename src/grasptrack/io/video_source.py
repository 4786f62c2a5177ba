# SPDX-License-Identifier: Apache-2.0
"""A video file as a source, decoded by PyAV."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack.errors import SourceError
from grasptrack.io.base import Image, Source
from grasptrack.io.whole import is_whole_video

_TEXT_ART = frozenset({"ansi", "bintext", "xbin", "idf"})
"""Decoders with which FFmpeg draws any text file as a video of letters."""


class VideoSource(Source):
    """The first video stream of a file: grey where it is recorded so, else BGR, turned upright as its header asks.

    Times are presentation times in s, as the file has them. A file that is damaged or cut short raises SourceError
    after the frames that can be read.
    """

    kind = "video"

    def __init__(self, path: Path, fps: float | None = None) -> None:
        super().__init__(str(path), fps)
        self._path = path
        if path.stat().st_size == 0:
            raise SourceError(f'video "{path}" is empty', path=str(path))
        with self._open_container() as container:
            stream = container.streams.video[0]
            rate = float(stream.average_rate or 0)
            self.fps = fps or (rate if rate > 0 else None)
            self.exact = stream.frames > 0
            self.count = stream.frames or _estimate_frame_count(container, rate)

    def _open_container(self) -> Any:
        import av

        try:
            container = av.open(str(self._path))
        except (av.FFmpegError, OSError) as error:
            if not is_whole_video(self._path):
                reason = "is truncated: no frame of it can be read"
            elif isinstance(error, PermissionError):
                reason = "cannot be read: Permission denied"
            else:
                reason = "is no video that can be read"
            raise SourceError(f'"{self._path}" {reason}', path=str(self._path)) from None
        codec = container.streams.video[0].codec_context if container.streams.video else None
        if codec is None or codec.name in _TEXT_ART:
            container.close()
            why = "it has no video stream" if codec is None else "it is text"
            raise SourceError(f'"{self._path}" is no video that can be read: {why}', path=str(self._path))
        return container

    def _read(self) -> Generator[tuple[Image, float | None, str], None, None]:
        import av

        index = 0
        with self._open_container() as container:
            try:
                base = container.streams.video[0].time_base
                for frame in _decode_frames(container):
                    time = None if frame.pts is None else float(frame.pts * (frame.time_base or base))
                    yield _upright_image(frame), time, f"frame {index} of {self._path.name}"
                    index += 1
            except av.FFmpegError:
                kind = "damaged" if is_whole_video(self._path) else "truncated"
                raise SourceError(
                    f'video "{self._path}" is {kind}: it can be read up to frame {index}',
                    path=str(self._path),
                    frame=index,
                ) from None
        if not is_whole_video(self._path):
            raise SourceError(
                f'video "{self._path}" is truncated: it ends after {index} frames', path=str(self._path), frame=index
            )
        if index == 0:
            raise SourceError(f'video "{self._path}" holds no frame that can be read', path=str(self._path))


def _decode_frames(container: Any) -> Iterator[Any]:
    """All frames; before a decoding error is raised, those that the decoder still holds."""
    import av

    stream = container.streams.video[0]
    try:
        for packet in container.demux(stream):
            for frame in packet.decode():
                if getattr(frame, "is_corrupt", False):
                    raise av.InvalidDataError(1, "damaged frame")
                yield frame
    except av.FFmpegError:
        try:
            held = [f for f in stream.codec_context.decode(None) if not getattr(f, "is_corrupt", False)]
        except av.FFmpegError:
            held = []
        yield from held
        raise


def _upright_image(frame: Any) -> Image:
    """The picture as (H, W) or (H, W, 3) uint8, turned by the rotation that the file's header gives."""
    grey = frame.format.name.startswith(("gray", "mono"))
    image: Image = frame.to_ndarray(format="gray" if grey else "bgr24")
    quarters = round(getattr(frame, "rotation", 0) / 90) % 4
    return np.ascontiguousarray(np.rot90(image, quarters)) if quarters else image


def _estimate_frame_count(container: Any, rate: float) -> int | None:
    """Number of frames from the duration in microseconds, where the header gives one."""
    count = round((container.duration or 0) * 1e-6 * rate)
    return count if count > 0 else None
