# SPDX-License-Identifier: Apache-2.0
"""Which cameras are attached, by every driver that is installed, and which one a name means."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from grasptrack.errors import InputError, SourceError
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
