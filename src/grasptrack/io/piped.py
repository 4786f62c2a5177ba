# SPDX-License-Identifier: Apache-2.0
"""The standard input as a source: a video, or JPEG and PNG images one after another, piped in."""

from __future__ import annotations

import sys
from collections.abc import Generator, Mapping
from typing import Any, BinaryIO

from grasptrack.errors import SourceError
from grasptrack.io.base import Image, Source
from grasptrack.io.images import decode_image
from grasptrack.io.pixels import EightBits
from grasptrack.io.video import UprightImages, check_stream, decode_frames, open_media, warn_of_aspect

NAME = "the standard input"
_JPEG, _PNG = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"
_PIECE = 1 << 16
_MOST = 1 << 28
"""Bytes of one image; more is none."""


class PipedSource(Source):
    """What is piped in, every image of it. Videos have times, images have none."""

    kind = "stdin"

    def _read_images(self) -> Generator[tuple[Image, float | None, str], None, None]:
        self.shortfall = ""
        stream: BinaryIO = sys.stdin.buffer
        if stream.isatty():
            raise SourceError(f"{NAME} is a terminal: pipe images or a video into it", spec=self.spec)
        reader = _Reader(stream)
        head = reader.peek(len(_PNG))
        if not head:
            raise SourceError(f"{NAME} is empty: pipe images or a video into it", spec=self.spec)
        yield from _piped_images(reader) if head.startswith((_JPEG, _PNG)) else self._video_frames(reader)

    def _video_frames(self, reader: _Reader) -> Generator[tuple[Image, float | None, str], None, None]:
        import av

        if _has_index_behind(reader):
            raise SourceError(
                f"{NAME} is an MP4 whose index (moov) comes last, which no pipe can reach: give the file itself, or put the "
                "index in front: ffmpeg -i IN -c copy -movflags +faststart OUT"
            )
        try:
            container: Any = open_media(reader)
        except (av.FFmpegError, OSError, ValueError):
            raise SourceError(
                f"{NAME} holds neither JPEG or PNG images nor a video that can be read from a pipe"
            ) from None
        with container:
            check_stream(container, NAME)
            stream, index = container.streams.video[0], 0
            upright = UprightImages(stream)
            warn_of_aspect(stream, NAME)
            try:
                for frame in decode_frames(container):
                    time = None if frame.pts is None else float(frame.pts * (frame.time_base or stream.time_base))
                    yield upright(frame), time, f"frame {index} of {NAME}"
                    index += 1
            except av.FFmpegError:
                raise SourceError(f"the video of {NAME} is damaged: it can be read up to frame {index}") from None
            if index < stream.frames:
                self.shortfall = f"it ends early: its header tells of {stream.frames} frames, {index} could be read"


class _Reader:
    """Bytes that can be looked at before they are taken; what PyAV reads from, too."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self._held = stream, bytearray()

    def peek(self, count: int) -> bytes:
        """So many bytes from here, or all that are left; they stay."""
        while len(self._held) < count:
            piece = self._take_piece()
            if not piece:
                break
            self._held += piece
        return bytes(self._held[:count])

    def _take_piece(self) -> bytes:
        # What is there at once: a live image must not wait until a buffer is full.
        read = getattr(self._stream, "read1", self._stream.read)
        piece: bytes = read(_PIECE)
        return piece

    def read(self, count: int) -> bytes:
        """At most so many bytes; none at the end."""
        if not self._held:
            self._held += self._take_piece()
        taken = bytes(self._held[:count])
        del self._held[:count]
        return taken

    def find(self, marker: bytes, start: int) -> int:
        """Where a marker begins at `start` or after it; -1 where none comes."""
        while True:
            at = self._held.find(marker, start)
            if at >= 0:
                return at
            start = max(start, len(self._held) - len(marker) + 1)
            before = len(self._held)
            if before > _MOST or len(self.peek(before + 1)) == before:
                return -1


def _has_index_behind(reader: _Reader) -> bool:
    """Whether it is an MP4 or MOV whose images come before what tells where they are."""
    at, kind = 0, b""
    while at < _PIECE and kind in (b"", b"ftyp", b"wide", b"free", b"skip"):
        head = reader.peek(at + 8)[at:]
        kind, at = head[4:] or b"end", at + max(8, int.from_bytes(head[:4], "big"))
    return kind == b"mdat"


def _piped_images(reader: _Reader) -> Generator[tuple[Image, float | None, str], None, None]:
    to_eight, index = EightBits(), 0
    while head := reader.peek(len(_PNG)):
        name = f"image {index} of {NAME}"
        if head.startswith(_JPEG):
            length = _jpeg_length(reader)
        elif head == _PNG:
            end = reader.find(b"IEND", len(_PNG))
            length = end + 8 if end >= 0 else -1
        else:
            raise SourceError(f"{name} is no JPEG or PNG image", frame=index)
        data = b"" if length < 0 else reader.peek(length)
        if length < 0 or len(data) < length:
            raise SourceError(f"{name} is truncated", frame=index)
        while length:
            length -= len(reader.read(length))
        yield to_eight(decode_image(data, name)), None, name
        index += 1


def _jpeg_length(reader: _Reader) -> int:
    """Bytes up to the end marker that follows a scan; thumbnails before it have their own. -1 where it is cut off."""
    at = 2
    while True:
        head = reader.peek(at + 4)[at:]
        if len(head) < 4 or head[0] != 0xFF:
            return -1
        if head[1] == 0xFF:
            at += 1
        elif head[1] == 0xDA:
            end = reader.find(b"\xff\xd9", at)
            return end + 2 if end >= 0 else -1
        else:
            at += 2 + int.from_bytes(head[2:4], "big")


def open_piped(spec: str, fps: float | None = None, settings: Mapping[str, str] | None = None) -> PipedSource:
    """The standard input as a source."""
    if settings:
        raise SourceError("the standard input has no settings: --set is for cameras, streams and bags")
    return PipedSource(spec, fps)
