# SPDX-License-Identifier: Apache-2.0
"""What goes on for as long as it is read: a thread drains the device, and only its newest image is worked on.

A device that goes away is opened again, and the frames go on after a gap in time: whoever tracks keeps its state. One that
gives no image for as long as the user's patience ends the source with an error.
"""

from __future__ import annotations

import contextlib
import contextvars
import math
import threading
import time
from collections.abc import Callable, Generator, Mapping
from typing import Any, NamedTuple, Protocol
from urllib.parse import parse_qsl, urlsplit

from grasptrack.errors import GraspTrackError, SourceError
from grasptrack.io.base import Image, Source
from grasptrack.io.limits import Backlog
from grasptrack.io.video import UprightImages, check_stream, open_media, warn_of_aspect

PATIENCE = 10.0
"""s without an image, after which a live source is given up; the setting `wait` says otherwise."""
RETRY = 0.5
"""s between two attempts to open a device that has gone."""
_WAKE = 0.25
"""s after which who waits looks up, so that Ctrl-C is seen."""
_ENDING = 3.0
"""s that a device is given to end a read when the source is closed."""


class DeviceGoneError(Exception):
    """A device does not answer any more; the message says what it said."""


def driver_message(error: Exception) -> str:
    """The first sentence of what a driver raised, without where in its code it arose; its name where it says nothing."""
    return " ".join(str(error).split()).partition(" : ")[0].rstrip(".") or type(error).__name__


class Device(Protocol):
    """Something open that gives images; `missed` ones it dropped by itself since that was last set to 0."""

    missed: int

    def read(self) -> tuple[Image, float | None] | None:
        """The next image, 8 bits, and its time by the device's own clock in s, or None for the time.

        None in place of both where none came within about a second.

        Raises:
            DeviceGoneError: the device was unplugged, or the stream has ended.
            SourceError: its images cannot be read, and will not be another time.
        """

    def close(self) -> None:
        """Release it."""


class LiveSource(Source):
    """A device as a source. Times are s since the first image, by the device's clock where it has one.

    Args:
        spec: what the user named.
        kind: "camera", "stream" or "ros2".
        name: what to call it in messages, as in "camera 0".
        open_device: opens it; raises SourceError where that cannot be.
        fps: must be None, because a live source has times of its own.
        patience: s without an image after which it is given up.

    Attributes:
        on_wait: called some four times a second while no image comes; what it raises ends the source.
        catches_up: hand out the images that came while the first one was worked on, see `Backlog`, instead of the newest alone.
    """

    live = True

    def __init__(
        self,
        spec: str,
        kind: str,
        name: str,
        open_device: Callable[[], Device],
        fps: float | None = None,
        patience: float = PATIENCE,
    ) -> None:
        super().__init__(spec, fps)
        if fps is not None:
            raise SourceError(f"{name} has times of its own: leave out the rate in frames/s (--fps)", spec=spec)
        self.kind = kind
        self.label = name
        self.on_wait: Callable[[], None] = lambda: None
        self.catches_up = False
        self._open_device = open_device
        self._patience = patience

    def _read_images(self) -> Generator[tuple[Image, float | None, str], None, None]:
        self.dropped = self.reconnected = 0
        clock, index = _Clock(), 0
        drain = _Drain(self._open_device, self._patience)
        try:
            while True:
                newest = drain.take_newest(self.on_wait)
                if newest is None and drain.refusal is not None:
                    raise drain.refusal
                if newest is None:
                    said = f": {drain.error}" if drain.error else ""
                    raise SourceError(
                        f"{self.label} gave no image for {self._patience:g} s after {index} frames{said}", frame=index
                    )
                self.dropped, self.reconnected = drain.dropped, newest.connection
                self.waited = time.monotonic() - newest.arrived
                if index == 0 and self.catches_up:
                    drain.keep_all()
                yield newest.image, clock.time_of(newest), f"frame {index} of {self.label}"
                index += 1
        finally:
            drain.stop()


class _Newest(NamedTuple):
    image: Image
    stamp: float | None
    arrived: float
    connection: int


class _Drain:
    """The thread that owns a device: opens it, reads all it gives, keeps the last, and opens it again when it has gone.

    It opens also the first time, because drivers take over Ctrl-C when they are opened in the main thread.
    """

    def __init__(self, open_device: Callable[[], Device], patience: float) -> None:
        self.refusal: GraspTrackError | None = None
        self.dropped = 0
        self.error = ""
        self._open_device, self._patience = open_device, patience
        self._waiting: Backlog[_Newest] = Backlog()
        self._ending, self._over = threading.Event(), False
        self._ready = threading.Condition()
        run = contextvars.copy_context().run  # the limit of size holds there, too
        self._thread = threading.Thread(target=run, args=(self._read_device,), name="grasptrack-drain", daemon=True)
        self._thread.start()

    def take_newest(self, on_wait: Callable[[], None]) -> _Newest | None:
        """The newest image, waited for; None where there will be none."""
        while True:
            with self._ready:
                self._ready.wait_for(lambda: self._over or self._waiting, _WAKE)
                if self._waiting:
                    newest, fell = self._waiting.take()
                    self.dropped += fell
                    return newest
                if self._over:
                    return None
            on_wait()

    def keep_all(self) -> None:
        """Keep the images that come until the next one is taken."""
        with self._ready:
            self._waiting.keep_all()

    def stop(self) -> None:
        """End the thread, which closes the device."""
        self._ending.set()
        self._thread.join(_ENDING)

    def _read_device(self) -> None:
        device: Device | None = None
        try:
            device = self._open_device()
            connection, heard, fresh = 0, time.monotonic(), False
            while not self._ending.is_set() and time.monotonic() - heard < self._patience:
                if device is None:
                    try:
                        device, fresh = self._open_device(), True
                    except SourceError as error:
                        self.error = str(error)
                        self._ending.wait(RETRY)
                        continue
                try:
                    given = device.read()
                except DeviceGoneError as error:
                    self.error = str(error)
                    _close_quietly(device)
                    device = None
                    self._ending.wait(RETRY)
                    continue
                self.dropped, device.missed = self.dropped + device.missed, 0
                if given is None:
                    continue
                heard = time.monotonic()
                connection, fresh = connection + fresh, False
                self._keep_image(_Newest(*given, heard, connection))
        except GraspTrackError as error:
            self.refusal = error
        except Exception as error:  # whatever a driver raises ends the source with it, not the thread alone
            self.error = " ".join(f"{type(error).__name__}: {error}".split())
        finally:
            _close_quietly(device)
            with self._ready:
                self._over = True
                self._ready.notify_all()

    def _keep_image(self, newest: _Newest) -> None:
        with self._ready:
            self.dropped += self._waiting.add(newest, newest.image.nbytes)
            self._ready.notify_all()


def _close_quietly(device: Device | None) -> None:
    if device is not None:
        with contextlib.suppress(Exception):  # one that has gone may not even close
            device.close()


class _Clock:
    """Time since the first image. Device clocks begin anew with a connection; the wall between two is our own."""

    def __init__(self) -> None:
        self._last: tuple[float, _Newest] | None = None

    def time_of(self, newest: _Newest) -> float:
        if self._last is None:
            elapsed = 0.0
        else:
            then, before = self._last
            elapsed = then + newest.arrived - before.arrived
            if newest.connection == before.connection and newest.stamp is not None and before.stamp is not None:
                step = newest.stamp - before.stamp
                elapsed = then + step if step > 0.0 else elapsed  # a clock that stands still is none
        self._last = elapsed, newest
        return elapsed


# --- names of live sources -------------------------------------------------------------------------


class Address(NamedTuple):
    """A source's name in its parts: what is between the kind and the question mark, and the settings behind that.

    Settings that were given apart from the name go before these.
    """

    where: str
    settings: dict[str, str]


def parse_address(spec: str, settings: Mapping[str, str] | None = None) -> Address:
    """Take a name apart."""
    where, mark, query = spec.partition(":")[2].partition("?")
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True) if mark else []
    except ValueError:
        raise SourceError(f'"{spec}": after the question mark come NAME=VALUE, joined by &', spec=spec) from None
    return Address(where, {**dict(pairs), **dict(settings or {})})


def take_patience(settings: dict[str, str]) -> float:
    """Take the setting `wait` out of the others, in s."""
    return take_number(settings, "wait", PATIENCE)


def take_number(settings: dict[str, str], name: str, otherwise: float) -> float:
    """Take a setting that is a positive number out of the others."""
    text = settings.pop(name, None)
    if text is None:
        return otherwise
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise SourceError(f"the setting {name} is a positive number, not {text!r}", name=name)
    return value


def take_size(settings: dict[str, str]) -> tuple[int, int] | None:
    """Take the setting `size`, as 1280x720, out of the others: width and height in px."""
    text = settings.pop("size", None)
    if text is None:
        return None
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise SourceError(f"the setting size is WIDTHxHEIGHT, as 1280x720, not {text!r}", size=text)
    return int(width), int(height)


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
