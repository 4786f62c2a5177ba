# SPDX-License-Identifier: Apache-2.0
"""RealSense cameras, colour or infrared: `realsense:` for the only one, `realsense:SERIAL`. Extra `realsense`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from grasptrack.errors import SourceError
from grasptrack.io.base import Image
from grasptrack.io.cameras.attached import Attached, choose_serial
from grasptrack.io.live import DeviceGoneError, LiveSource, parse_address, take_number, take_patience, take_size
from grasptrack.plugins import import_extra

_WAIT_MS = 1000
_STREAMS = ("color", "infrared")


class _RealSense:
    """An open camera."""

    missed = 0

    def __init__(
        self,
        rs: Any,
        serial: str,
        name: str,
        stream: str,
        size: tuple[int, int] | None,
        rate: float,
        settings: Mapping[str, str],
    ) -> None:
        self._pipeline = rs.pipeline()
        config = rs.config()
        config.enable_device(serial)
        form = rs.format.bgr8 if stream == "color" else rs.format.y8
        config.enable_stream(getattr(rs.stream, stream), *(size or (0, 0)), form, round(rate))
        try:
            profile = self._pipeline.start(config)
        except RuntimeError as error:
            raise SourceError(f"{name} cannot be started: {error}") from None
        try:
            sensor = next(s for s in profile.get_device().query_sensors() if s.is_color_sensor() == (stream == "color"))
            for key, text in settings.items():
                option = getattr(rs.option, key, None)
                if option is None or not sensor.supports(option):
                    raise SourceError(f"{name} has no setting {key}", name=key)
                try:
                    sensor.set_option(option, float(text))
                except (ValueError, RuntimeError) as error:
                    raise SourceError(f"{name} does not take {key}={text}: {error}", name=key) from None
        except BaseException:
            self._pipeline.stop()
            raise
        self._color = stream == "color"

    def read(self) -> tuple[Image, float | None] | None:
        try:
            good, frames = self._pipeline.try_wait_for_frames(_WAIT_MS)
        except RuntimeError as error:
            raise DeviceGoneError(str(error)) from None
        frame = (frames.get_color_frame() if self._color else frames.get_infrared_frame()) if good else None
        if not frame:
            return None
        image = np.array(frame.get_data(), dtype=np.uint8)  # a copy: the frame's memory is used again
        return image, frame.get_timestamp() / 1000.0

    def close(self) -> None:
        self._pipeline.stop()


def _import_realsense() -> Any:
    return import_extra("pyrealsense2", "realsense", "a RealSense camera")


def _attached_devices(rs: Any) -> list[tuple[str, str]]:
    """Serial number and model of each."""
    info = rs.camera_info
    return [(d.get_info(info.serial_number), d.get_info(info.name)) for d in rs.context().query_devices()]


def attached_realsense() -> list[Attached]:
    """The cameras that librealsense sees."""
    return [Attached("realsense", serial, model) for serial, model in _attached_devices(_import_realsense())]


def open_realsense(spec: str, fps: float | None = None, settings: Mapping[str, str] | None = None) -> LiveSource:
    """A RealSense camera as a source.

    Args:
        spec: ``realsense:`` or ``realsense:SERIAL``, with settings after a question mark.
        settings: `stream` (color or infrared), `size`, `fps`, `wait` (s without an image after which it is given up), and the
            options of the sensor, as ``exposure``.
    """
    rs = _import_realsense()
    address = parse_address(spec, settings)
    more = address.settings
    patience, size, rate = take_patience(more), take_size(more), take_number(more, "fps", 0.0)
    stream = more.pop("stream", "color")
    if stream not in _STREAMS:
        raise SourceError(f'the setting stream is {" or ".join(_STREAMS)}, not "{stream}"', stream=stream)
    name = f"camera {address.where}" if address.where else "the RealSense camera"

    def open_device() -> _RealSense:
        serials = [serial for serial, _ in _attached_devices(rs)]
        serial = serials[choose_serial(spec, address.where, serials)]
        return _RealSense(rs, serial, name, stream, size, rate, more)

    return LiveSource(spec, "camera", name, open_device, fps, patience)
