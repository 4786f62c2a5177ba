# SPDX-License-Identifier: Apache-2.0
"""Which cameras are attached, by every driver that is installed, and which one a name means; and webcams, `camera:0`."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from grasptrack.errors import InputError, SourceError
from grasptrack.io.base import Image
from grasptrack.io.live import DeviceGoneError, LiveSource, parse_address, take_number, take_patience, take_size
from grasptrack.plugins import load_plugin, plugin_names

_SYSTEM = Path("/sys/class/video4linux")


class Attached(NamedTuple):
    """A camera that is there: its name as a source is ``kind:where``, `model` what the device calls itself."""

    kind: str
    where: str
    model: str

    @property
    def source_name(self) -> str:
        """Its name as a source."""
        return f"{self.kind}:{self.where}"


class Listing(NamedTuple):
    """The cameras of one kind, "camera" or an entry point of "grasptrack.cameras".

    The note says why there may be others that are not seen; it is empty where the driver looked.
    """

    kind: str
    cameras: list[Attached]
    note: str


def choose_serial(spec: str, serial: str, serials: Sequence[str]) -> int:
    """Which of several devices is meant by a serial number, empty for the only one; `spec` is what the user named."""
    if not serials:
        raise SourceError(f'"{spec}": no camera is attached that this driver sees', spec=spec)
    there = ", ".join(serials)
    if not serial and len(serials) > 1:
        raise SourceError(f'"{spec}" may mean several cameras: say which, {there}', spec=spec, there=list(serials))
    if serial and serial not in serials:
        raise SourceError(f'"{spec}" is not attached; there is {there}', spec=spec, there=list(serials))
    return serials.index(serial) if serial else 0


def list_cameras() -> list[Listing]:
    """What is attached, one entry a kind, webcams first. Nothing is opened."""
    found = [_list_webcams()]
    for kind in plugin_names("grasptrack.cameras"):
        try:
            found.append(Listing(kind, load_plugin("grasptrack.cameras", kind)(), ""))
        except InputError as error:
            found.append(Listing(kind, [], str(error)))
    return found


def _list_webcams() -> Listing:
    """Those of Video4Linux; a camera has more than one node, of which the first gives its images."""
    if not sys.platform.startswith("linux"):
        return Listing("camera", [], "only Linux lists its webcams: try camera:0, camera:1")
    cameras = []
    for node in sorted(_SYSTEM.glob("video*"), key=lambda path: int(re.sub(r"\D", "", path.name) or 0)):
        index = node / "index"
        if index.is_file() and index.read_text(encoding="utf-8").strip() == "0":
            model = (node / "name").read_text(encoding="utf-8", errors="replace").strip()
            cameras.append(Attached("camera", re.sub(r"\D", "", node.name), model))
    return Listing("camera", cameras, "")


# --- webcams --------------------------------------------------------------------------------------


MOST_CAMERAS = 99
"""OpenCV takes the hundreds of a camera's number for a way to talk to it."""


class _Webcam:
    """An open camera."""

    missed = 0

    def __init__(
        self, which: int | str, name: str, size: tuple[int, int] | None, rate: float, settings: Mapping[str, str]
    ) -> None:
        self._name = name
        try:
            self._camera: Any = (
                cv2.VideoCapture(which) if isinstance(which, int) else cv2.VideoCapture(which, cv2.CAP_V4L2)
            )
        except cv2.error:
            raise SourceError(f"{name} cannot be opened", camera=which) from None
        try:
            if not self._camera.isOpened():
                raise SourceError(f"{name} cannot be opened: it is missing or in use", camera=which)
            self._camera.set(cv2.CAP_PROP_BUFFERSIZE, 1)
            self._apply_settings(settings)
            if rate:
                self._camera.set(cv2.CAP_PROP_FPS, rate)
            if size is not None:
                self._set_size(*size)
        except BaseException:
            self._camera.release()
            raise

    def _apply_settings(self, settings: Mapping[str, str]) -> None:
        """Settings by OpenCV's names without CAP_PROP_; the format of four letters goes first, for it decides the rest."""
        for key, text in sorted(settings.items(), key=lambda pair: pair[0].lower() != "fourcc"):
            prop = getattr(cv2, "CAP_PROP_" + key.upper(), None)
            if prop is None:
                raise SourceError(
                    f"{self._name} has no setting {key}; there are size, fps, wait, fourcc, exposure, auto_exposure, gain, "
                    "brightness, contrast, focus, autofocus, wb_temperature and OpenCV's other CAP_PROP names",
                    name=key,
                )
            try:
                value = cv2.VideoWriter.fourcc(*text) if key.lower() == "fourcc" else float(text)
            except (ValueError, TypeError):
                raise SourceError(f"{self._name}: {key} is a number, not {text!r}", name=key) from None
            if not self._camera.set(prop, value):
                raise SourceError(f"{self._name} does not take {key}={text}", name=key)

    def _set_size(self, width: int, height: int) -> None:
        self._camera.set(cv2.CAP_PROP_FRAME_WIDTH, width)
        self._camera.set(cv2.CAP_PROP_FRAME_HEIGHT, height)
        got = tuple(round(self._camera.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if got != (width, height):
            raise SourceError(f"{self._name} has no images of {width}x{height} px; nearest are {got[0]}x{got[1]}")

    def read(self) -> tuple[Image, float | None] | None:
        good, image = self._camera.read()
        if not good or image is None:
            raise DeviceGoneError("it gave no image: it may have been unplugged")
        stamp = self._camera.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
        return np.asarray(image, dtype=np.uint8), stamp if stamp > 0.0 else None

    def close(self) -> None:
        self._camera.release()


def open_webcam(spec: str, fps: float | None = None, settings: Mapping[str, str] | None = None) -> LiveSource:
    """A camera of the operating system as a source.

    Args:
        spec: ``camera:0``, ``camera:0?size=1280x720&fps=30``, or a device such as ``/dev/video0``.
        settings: `size`, `fps`, `wait` (s without an image after which it is given up), and OpenCV's properties by name.
    """
    which: int | str
    if spec.startswith("camera:"):
        address = parse_address(spec, settings)
        if not address.where.isdecimal():
            raise SourceError(f'a camera is named by its number, as in camera:0, not "{spec}"', spec=spec)
        if int(address.where) > MOST_CAMERAS:
            raise SourceError(
                f"there is no camera {address.where[:12]}: they are numbered from 0 to {MOST_CAMERAS}", spec=spec
            )
        which, more = int(address.where), address.settings
        name = f"camera {which}"
    else:
        which, more = str(Path(spec).resolve()), dict(settings or {})  # by-id names are links
        name = f"camera {spec}"
    patience, size, rate = take_patience(more), take_size(more), take_number(more, "fps", 0.0)
    return LiveSource(spec, "camera", name, lambda: _Webcam(which, name, size, rate, more), fps, patience)
