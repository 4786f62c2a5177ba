# SPDX-License-Identifier: Apache-2.0
"""Streams of a network through PyAV: RTSP, MJPEG over HTTP, and video that comes by UDP."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

from grasptrack.errors import SourceError
from grasptrack.io.base import Image
from grasptrack.io.live import DeviceGoneError, LiveSource, take_patience
from grasptrack.io.video import UprightImages, check_stream, open_media, warn_of_aspect

SCHEMES = ("rtsp", "rtsps", "http", "https", "udp")
_OPENING, _SILENCE = 5.0, 2.0
"""s that a server is given to answer at first, and for every image after that before the stream counts as cut."""
_PROMPT = {"fflags": "nobuffer", "flags": "low_delay", "analyzeduration": "500000"}
"""What FFmpeg is told so that it gives an image as soon as it has one; half a second in microseconds to tell the format."""
_UNTIMED = frozenset({"mpjpeg", "mjpeg", "jpeg_pipe", "image2pipe"})
"""Formats that hold no times; FFmpeg counts 25 images a second in their place."""
_BY_SCHEME = {"rtsp": {"rtsp_transport": "tcp"}, "rtsps": {"rtsp_transport": "tcp"}, "udp": {"overrun_nonfatal": "1"}}


class _Stream:
    """An open stream."""

    missed = 0

    def __init__(self, url: str, name: str, options: dict[str, str]) -> None:
        import av

        try:
            self._container: Any = open_media(url, options=options, timeout=(_OPENING, _SILENCE))
        except (av.FFmpegError, OSError, ValueError) as error:
            raise SourceError(f"{name} cannot be opened: {_reason_of(error)}", spec=url) from None
        try:
            check_stream(self._container, name)
            self._timed = self._container.format.name not in _UNTIMED
            self._base = self._container.streams.video[0].time_base
            self._packets = self._container.demux(self._container.streams.video[0])
            self._decoded: list[Any] = []
            self._upright = UprightImages(self._container.streams.video[0])
            warn_of_aspect(self._container.streams.video[0], name)
        except BaseException:
            self._container.close()
            raise

    def read(self) -> tuple[Image, float | None] | None:
        import av

        try:
            while not self._decoded:
                try:
                    packet = next(self._packets)
                except StopIteration:
                    raise DeviceGoneError("the stream has ended") from None
                try:
                    self._decoded = [f for f in packet.decode() if not getattr(f, "is_corrupt", False)]
                except av.InvalidDataError:  # after a lost packet, until the next key frame
                    self._decoded = []
        except (av.FFmpegError, OSError) as error:
            raise DeviceGoneError(_reason_of(error)) from None
        frame = self._decoded.pop(0)
        timed = self._timed and frame.pts is not None
        return self._upright(frame), float(frame.pts * (frame.time_base or self._base)) if timed else None

    def close(self) -> None:
        self._container.close()


def _reason_of(error: Exception) -> str:
    import av

    if isinstance(error, av.ExitError):  # FFmpeg's word for a time that has run out
        return "no answer in time"
    return str(getattr(error, "strerror", "") or error)


def open_stream(spec: str, fps: float | None = None, settings: Mapping[str, str] | None = None) -> LiveSource:
    """A stream as a source.

    Args:
        spec: its address, whose query is the server's.
        settings: `wait`, s without an image after which it is given up; all else is FFmpeg's, as `rtsp_transport`.
    """
    told = urlsplit(spec)
    if not told.hostname and told.scheme != "udp":
        raise SourceError(f'"{spec}" names no host, as rtsp://192.168.0.5/stream does', spec=spec)
    try:
        port = told.port
    except ValueError:
        port = None
    if told.scheme == "udp" and not port:
        raise SourceError(f'"{spec}" names no port, as udp://127.0.0.1:5000 does', spec=spec)
    more = dict(settings or {})
    patience = take_patience(more)
    options = {**_PROMPT, **_BY_SCHEME.get(told.scheme, {}), **more}
    name = f"{told.scheme}://{told.hostname or ''}{f':{port}' if port else ''}{told.path}"  # without a password
    # What stands in run.json and in messages must not hold the password.
    public = told._replace(netloc=told.netloc.rpartition("@")[2]).geturl()
    return LiveSource(public, "stream", name, lambda: _Stream(spec, name, options), fps, patience)
