# SPDX-License-Identifier: Apache-2.0
"""Which cameras are attached, by every driver that is installed."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import NamedTuple

from grasptrack.errors import InputError
from grasptrack.io.cameras.attached import Attached
from grasptrack.io.cameras.genicam import SEARCH_PATH, attached_genicam, producers
from grasptrack.io.cameras.pylon import attached_pylon
from grasptrack.io.cameras.realsense import attached_realsense

_SYSTEM = Path("/sys/class/video4linux")


class Listing(NamedTuple):
    """The cameras of one kind.

    Attributes:
        kind: camera, pylon, genicam or realsense.
        cameras: that are attached.
        note: why there may be others that are not seen; empty where the driver looked.
    """

    kind: str
    cameras: list[Attached]
    note: str


def list_cameras() -> list[Listing]:
    """What is attached, one entry a kind, webcams first. Nothing is opened."""
    found = [_webcams()]
    for kind, look in (("pylon", attached_pylon), ("genicam", attached_genicam), ("realsense", attached_realsense)):
        try:
            cameras, note = look(), ""
        except InputError as error:
            cameras, note = [], str(error)
        if kind == "genicam" and not note and not producers():
            note = f"no GenTL producer in the folders of {SEARCH_PATH}: name one, as genicam:FILE.cti"
        found.append(Listing(kind, cameras, note))
    return found


def _webcams() -> Listing:
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
