# SPDX-License-Identifier: Apache-2.0
"""What a camera that is attached is called, and which one a name means."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from grasptrack.errors import SourceError


class Attached(NamedTuple):
    """A camera that is there.

    Attributes:
        kind: before the colon of its name as a source: camera, pylon, genicam, realsense.
        where: after the colon.
        model: as the device calls itself.
    """

    kind: str
    where: str
    model: str

    @property
    def spec(self) -> str:
        """Its name as a source."""
        return f"{self.kind}:{self.where}"


def choose_serial(spec: str, serial: str, serials: Sequence[str]) -> int:
    """Which of several devices is meant.

    Args:
        spec: what the user named.
        serial: the one that is asked for; empty for the only one.
        serials: of those that are there.

    Raises:
        SourceError: none is there, not this one, or several while none is asked for.
    """
    if not serials:
        raise SourceError(f'"{spec}": no camera is attached that this driver sees', spec=spec)
    there = ", ".join(serials)
    if not serial and len(serials) > 1:
        raise SourceError(f'"{spec}" may mean several cameras: say which, {there}', spec=spec, there=list(serials))
    if serial and serial not in serials:
        raise SourceError(f'"{spec}" is not attached; there is {there}', spec=spec, there=list(serials))
    return serials.index(serial) if serial else 0
