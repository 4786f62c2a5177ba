# SPDX-License-Identifier: Apache-2.0
"""Basler cameras through pylon: `pylon:` for the only one, `pylon:SERIAL` for one of several. Extra `pylon`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from grasptrack.errors import SourceError
from grasptrack.io.base import Image
from grasptrack.io.cameras.attached import Attached, choose_serial
from grasptrack.io.limits import check_size
from grasptrack.io.live import DeviceGoneError, LiveSource, driver_message, parse_address, take_patience
from grasptrack.io.pixels import genicam_format, raw_image, to_image
from grasptrack.plugins import import_extra

_WAIT_MS = 1000
_TICKS = 1e9
"""Ticks a second of a device's clock where it does not tell them."""


class _Basler:
    """An open camera."""

    missed = 0

    def __init__(self, pylon: Any, device: Any, name: str, settings: Mapping[str, str]) -> None:
        self._pylon, self._name = pylon, name
        try:
            self._camera = pylon.InstantCamera(pylon.TlFactory.GetInstance().CreateDevice(device))
            self._camera.Open()
        except pylon.GenericException as error:
            raise SourceError(f"{name} cannot be opened: {driver_message(error)}") from None
        try:
            nodes = self._camera.GetNodeMap()
            for key, value in settings.items():
                self._set_node(nodes, key, value)
            self._ticks = _node_value(nodes, "GevTimestampTickFrequency", _TICKS)
            self._camera.StartGrabbing(pylon.GrabStrategy_LatestImageOnly)
        except BaseException as error:
            self._camera.Close()
            if isinstance(error, pylon.GenericException):
                raise SourceError(f"{name} cannot be started: {driver_message(error)}") from None
            raise

    def _set_node(self, nodes: Any, key: str, value: str) -> None:
        try:
            node = nodes.GetNode(key)
        except self._pylon.GenericException:
            node = None
        if node is None or not node.IsValid():
            raise SourceError(f"{self._name} has no setting {key}", name=key)
        try:
            node.FromString(value)
        except self._pylon.GenericException as error:
            raise SourceError(f"{self._name} does not take {key}={value}: {driver_message(error)}", name=key) from None

    def read(self) -> tuple[Image, float | None] | None:
        pylon = self._pylon
        try:
            if self._camera.IsCameraDeviceRemoved():
                raise DeviceGoneError("it was unplugged")
            result = self._camera.RetrieveResult(_WAIT_MS, pylon.TimeoutHandling_Return)
            if result is None or not result.IsValid():
                return None
            with result:
                self.missed += int(result.GetNumberOfSkippedImages())
                if not result.GrabSucceeded():  # one damaged image is no reason to begin anew
                    return None
                width, height = result.GetWidth(), result.GetHeight()
                check_size(width, height, f"an image of {self._name}")
                form = genicam_format(self._camera.PixelFormat.Value)
                data = np.frombuffer(result.GetBuffer(), np.uint8)
                step = 0 if form.packed else width * form.channels * form.value_type().itemsize + result.GetPaddingX()
                image = to_image(raw_image(data, width, height, form, step), form)
                stamp = result.GetTimeStamp()
        except pylon.GenericException as error:
            raise DeviceGoneError(driver_message(error)) from None
        return image, stamp / self._ticks if stamp else None

    def close(self) -> None:
        self._camera.StopGrabbing()
        self._camera.Close()


def _node_value(nodes: Any, key: str, otherwise: float) -> float:
    try:
        return float(nodes.GetNode(key).ToString()) or otherwise
    except Exception:  # a node that is absent, or not readable now
        return otherwise


def _import_pylon() -> Any:
    return import_extra("pypylon.pylon", "pylon", "a camera of Basler's")


def attached_pylon() -> list[Attached]:
    """The cameras that pylon sees."""
    return [
        Attached("pylon", device.GetSerialNumber(), device.GetModelName())
        for device in _import_pylon().TlFactory.GetInstance().EnumerateDevices()
    ]


def open_pylon(spec: str, fps: float | None = None, settings: Mapping[str, str] | None = None) -> LiveSource:
    """A camera of Basler's as a source; its pixels must be Mono, Bayer, RGB, BGR or YUV.

    Args:
        spec: ``pylon:`` or ``pylon:SERIAL``, with settings after a question mark.
        settings: `wait`, s without an image after which it is given up; all else the camera's features, as ``ExposureTime``.
    """
    pylon = _import_pylon()
    address = parse_address(spec, settings)
    patience = take_patience(address.settings)
    name = f"camera {address.where}" if address.where else "the pylon camera"

    def open_device() -> _Basler:
        devices = pylon.TlFactory.GetInstance().EnumerateDevices()
        at = choose_serial(spec, address.where, [device.GetSerialNumber() for device in devices])
        return _Basler(pylon, devices[at], name, address.settings)

    return LiveSource(spec, "camera", name, open_device, fps, patience)
