# SPDX-License-Identifier: Apache-2.0
"""Any GenICam camera through its maker's GenTL producer: `genicam:FILE.cti#SERIAL`. Extra `genicam`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack.errors import InputError, SourceError
from grasptrack.io.base import Image
from grasptrack.io.cameras.attached import Attached, choose_serial
from grasptrack.io.limits import check_size
from grasptrack.io.live import DeviceGoneError, LiveSource, driver_message, parse_address, take_patience
from grasptrack.io.pixels import genicam_format, raw_image, to_image
from grasptrack.plugins import import_extra

_WAIT_S = 1.0
_TICKS = 1e9
SEARCH_PATH = "GENICAM_GENTL64_PATH"
"""Environment variable in which producers' installers list their folders."""


class _GenICam:
    """An open camera, with the producer loaded for it alone."""

    missed = 0

    def __init__(self, producer: Path, serial: str, spec: str, name: str, settings: Mapping[str, str]) -> None:
        self._name = name
        self._genapi = import_extra("genicam.gentl", "genicam", "a GenICam camera")
        self._harvester = _open_harvester(producer)
        self._camera: Any = None
        try:
            serials = [_serial_of(info) for info in self._harvester.device_info_list]
            at = choose_serial(spec, serial, serials)
            try:
                self._camera = self._harvester.create(at)
                nodes = self._camera.remote_device.node_map
                for key, value in settings.items():
                    self._set_node(nodes, key, value)
                self._camera.num_buffers = 4
                self._camera.start()
            except SourceError:
                raise
            except Exception as error:  # drivers raise what they like
                raise SourceError(f"{name} cannot be opened: {driver_message(error)}", spec=spec) from None
        except BaseException:
            self.close()
            raise

    def _set_node(self, nodes: Any, key: str, value: str) -> None:
        if not nodes.has_node(key):
            raise SourceError(f"{self._name} has no setting {key}", name=key)
        try:
            nodes.get_node(key).from_string(value)
        except Exception as error:
            raise SourceError(f"{self._name} does not take {key}={value}: {driver_message(error)}", name=key) from None

    def read(self) -> tuple[Image, float | None] | None:
        try:
            buffer = self._camera.fetch(timeout=_WAIT_S)
        except self._genapi.TimeoutException:
            return None
        except Exception as error:
            raise DeviceGoneError(driver_message(error)) from None
        with buffer:
            part = buffer.payload.components[0]
            check_size(part.width, part.height, f"an image of {self._name}")
            form = genicam_format(part.data_format)
            data = np.ascontiguousarray(part.data).view(np.uint8).ravel()
            image = to_image(raw_image(data, part.width, part.height, form), form)
            return image, _stamp_of(buffer)

    def close(self) -> None:
        try:
            if self._camera is not None:
                self._camera.stop()
                self._camera.destroy()
        finally:
            self._harvester.reset()


def _stamp_of(buffer: Any) -> float | None:
    """s by the device's clock; None where it has none."""
    try:
        ticks = int(buffer.timestamp or 0)
    except Exception:
        return None
    try:
        rate = float(buffer.timestamp_frequency or _TICKS)
    except Exception:
        rate = _TICKS
    return ticks / rate if ticks else None


def _serial_of(info: Any) -> str:
    return str(info.property_dict.get("serial_number") or info.property_dict.get("id_"))


def _open_harvester(producer: Path) -> Any:
    """A harvester that has looked for the cameras of one producer."""
    core = import_extra("harvesters.core", "genicam", "a GenICam camera")
    if not producer.is_file():
        raise SourceError(f'there is no GenTL producer "{producer}": the camera\'s maker installs a file .cti')
    harvester = core.Harvester()
    try:
        harvester.add_file(str(producer), check_existence=True, check_validity=True)
        harvester.update()
    except Exception as error:
        harvester.reset()
        raise SourceError(f'"{producer}" is no GenTL producer that can be loaded: {driver_message(error)}') from None
    return harvester


def installed_producers() -> list[Path]:
    """The producers that are installed, by the folders in the environment."""
    folders = [Path(part) for part in os.environ.get(SEARCH_PATH, "").split(os.pathsep) if part]
    return sorted({file for folder in folders if folder.is_dir() for file in folder.glob("*.cti")})


def attached_genicam() -> list[Attached]:
    """The cameras of all producers that are installed."""
    import_extra("harvesters.core", "genicam", "a GenICam camera")
    found, installed = [], installed_producers()
    if not installed:
        raise InputError(f"no GenTL producer in the folders of {SEARCH_PATH}: name one, as genicam:FILE.cti")
    for producer in installed:
        harvester = _open_harvester(producer)
        try:
            for info in harvester.device_info_list:
                found.append(Attached("genicam", f"{producer}#{_serial_of(info)}", str(info.property_dict["model"])))
        finally:
            harvester.reset()
    return found


def open_genicam(spec: str, fps: float | None = None, settings: Mapping[str, str] | None = None) -> LiveSource:
    """A GenICam camera as a source; its pixels must be Mono, Bayer, RGB, BGR or YUV.

    Args:
        spec: ``genicam:FILE.cti#SERIAL``; without the serial number the only one, without the file the only producer of those
            that ``GENICAM_GENTL64_PATH`` lists.
        settings: `wait`, s without an image after which it is given up; all else the camera's features, as ``ExposureTime``.
    """
    import_extra("harvesters.core", "genicam", "a GenICam camera")
    address = parse_address(spec, settings)
    patience = take_patience(address.settings)
    file, _, serial = address.where.rpartition("#") if "#" in address.where else (address.where, "", "")
    if file:
        producer = Path(file)
    else:
        installed = installed_producers()
        if len(installed) != 1:
            there = ", ".join(map(str, installed)) or f"none in the folders of {SEARCH_PATH}"
            raise SourceError(f'"{spec}" names no GenTL producer, as genicam:FILE.cti#SERIAL does; there is {there}')
        producer = installed[0]
    if not producer.is_file():
        raise SourceError(
            f'there is no GenTL producer "{producer}": the camera\'s maker installs a file .cti', spec=spec
        )
    name = f"camera {serial}" if serial else "the GenICam camera"
    return LiveSource(
        spec, "camera", name, lambda: _GenICam(producer, serial, spec, name, address.settings), fps, patience
    )
