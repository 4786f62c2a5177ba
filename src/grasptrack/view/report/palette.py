# SPDX-License-Identifier: Apache-2.0
"""How each method is drawn: a colour for light pages and one for dark, a dash and a weight, so that colour is not all."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from grasptrack.view.report.markup import make_slug
from grasptrack.view.style import STATUS_RGB, STRATEGY_RGB, Colour, hex_colour


@dataclass(frozen=True)
class Series:
    """One method in charts, tables and keys.

    Attributes:
        name: as it is written.
        light, dark: colours on light and dark pages, as CSS writes them.
        dash: pattern of its lines, "" for a solid one.
        width: px of its lines.
    """

    name: str
    light: str
    dark: str
    dash: str = ""
    width: float = 1.6

    @property
    def variable(self) -> str:
        """Name of its CSS variable."""
        return f"--m-{make_slug(self.name)}"


OURS: dict[str, Colour] = {"auto": STATUS_RGB["tracked"], **STRATEGY_RGB}
PEERS: dict[str, tuple[Colour, str]] = {
    "ecc": ((104, 112, 124), "6 3"),
    "klt": ((139, 115, 85), "2 2.5"),
    "sift": ((122, 108, 150), "8 3 2 3"),
    "otsu": ((140, 140, 140), "1 3"),
    "visp": ((84, 130, 130), "4 2"),
    "paper-rrp": (STRATEGY_RGB["rrp"], "3 3"),
    "paper-grasp-line": (STRATEGY_RGB["grasp-line"], "3 3"),
    "paper-homography": (STRATEGY_RGB["homography"], "3 3"),
}
OTHERS: tuple[tuple[Colour, str], ...] = (
    ((120, 100, 80), "5 2"),
    ((90, 110, 140), "2 2"),
    ((130, 100, 130), "7 2 1 2"),
    ((100, 125, 95), "3 2"),
)
"""For names that are not known here, one after the other."""


def series_palette(names: Iterable[str]) -> dict[str, Series]:
    """A series for each name, always the same one for a name that is known."""
    found: dict[str, Series] = {}
    strangers = 0
    for name in names:
        if name in OURS:
            width = 2.6 if name == "auto" else 1.8
            found[name] = _make_series(name, OURS[name], "", width)
        elif name in PEERS:
            found[name] = _make_series(name, *PEERS[name], 1.5)
        else:
            found[name] = _make_series(name, *OTHERS[strangers % len(OTHERS)], 1.5)
            strangers += 1
    return found


def _make_series(name: str, colour: Colour, dash: str, width: float) -> Series:
    return Series(
        name, hex_colour(_mix_colour(colour, 0, 0.16)), hex_colour(_mix_colour(colour, 255, 0.3)), dash, width
    )


def _mix_colour(colour: Colour, level: int, share: float) -> Colour:
    r, g, b = (round((1.0 - share) * part + share * level) for part in colour)
    return r, g, b
