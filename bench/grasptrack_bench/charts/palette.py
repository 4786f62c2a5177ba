# SPDX-License-Identifier: Apache-2.0
"""How text, numbers and methods stand on pages, with a dash for what is not known; colours as CSS variables, light and dark."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from grasptrack.view.style import STATUS_RGB, STRATEGY_RGB, Colour, hex_colour

DASH = "–"
"""Where there is no value."""


def escape_html(text: object) -> str:
    """Text that is safe in HTML, in attributes too."""
    return html.escape(str(text), quote=True)


def make_slug(text: str) -> str:
    """A name that may stand in an id or a CSS variable."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "x"


def format_number(value: float | int | None, digits: int = 3) -> str:
    """A number to so many significant digits, a dash for one that is none, a sign for an infinite one."""
    if value is None or math.isnan(value):
        return DASH
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if isinstance(value, int):
        text = f"{value:,}".replace(",", "\u202f") if abs(value) >= 10000 else str(value)
    else:
        size = abs(value)
        places = digits - 1 - math.floor(math.log10(size)) if size > 0.0 else 0
        text = f"{value:.2e}" if 0.0 < size < 1e-4 else f"{value:.{max(0, min(places, 6))}f}"
    return text.replace("-", "−")


def format_fixed(value: float | None, decimals: int) -> str:
    """A number with so many decimals, so that a column of them lines up."""
    if value is None or math.isnan(value):
        return DASH
    return format_number(value) if math.isinf(value) else f"{value:.{decimals}f}".replace("-", "−")


def format_percent(share: float | None, decimals: int = 1) -> str:
    """A share 0 to 1 in per cent; what is not quite all or none is never rounded to it."""
    if share is None or math.isnan(share):
        return DASH
    if share in (0.0, 1.0):
        return "100" if share else "0"
    least = 10.0**-decimals
    return f"{min(max(100.0 * share, least), 100.0 - least):.{decimals}f}"


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


_COLOURS = {
    "ground": ("#fafaf8", "#121518"),
    "surface": ("#ffffff", "#191d22"),
    "ink": ("#1b1f24", "#e9ebee"),
    "muted": ("#5a6370", "#a0a9b4"),
    "rule": ("#e4e6e8", "#2b3138"),
    "rule-strong": ("#b9bfc6", "#4a525c"),
    "tint": ("#f1f3f4", "#22272d"),
    "accent": ("#00744f", "#4fd0a5"),
    "good": ("#00744f", "#4fd0a5"),
    "bad": ("#b3261e", "#ff8f7e"),
    "heat": ("0 114 178", "86 160 220"),
    "heat-bad": ("213 60 30", "240 96 64"),
    "heat-warm": ("226 150 20", "222 150 40"),
}
LIGHT, DARK = ({name: pair[i] for name, pair in _COLOURS.items()} for i in (0, 1))
_STYLE = (
    "text{font:11.5px 'DejaVu Sans',Arial,sans-serif;fill:var(--muted)}.strong{font-weight:600;fill:var(--ink)}"
    ".end{text-anchor:end}.mid{text-anchor:middle}.grid{stroke:var(--rule);fill:none}"
    ".axis,.tick{stroke:var(--rule-strong);fill:none}.rule{stroke:var(--muted);stroke-dasharray:2 3;fill:none}"
    ".ln{fill:none}.band{opacity:.14}.reach{stroke-width:1.6;opacity:.55;fill:none}.dot{stroke-width:1.6}"
    ".gone{fill:var(--muted);opacity:.2}.partly{fill:var(--muted);opacity:.09}"
)


def colour_variables(series: Iterable[Series]) -> str:
    """The variables of a page: light, dark where the reader's system is, or as the switch says; paper is light."""
    listed = list(series)
    light = _css_block({**LIGHT, **{s.variable.removeprefix("--"): s.light for s in listed}}, "light")
    dark = _css_block({**DARK, **{s.variable.removeprefix("--"): s.dark for s in listed}}, "dark")
    return (
        f":root{{{light}}}"
        f"@media screen and (prefers-color-scheme:dark){{:root:not([data-theme=light]){{{dark}}}}}"
        f"@media screen{{:root[data-theme=dark]{{{dark}}}}}"
    )


def standalone_svg(svg: str, series: Iterable[Series], bands: str = "") -> str:
    """A chart as a file of its own, in light colours and without variables, which not every program knows."""
    series = list(series)
    values = {**{f"--{k}": v for k, v in LIGHT.items()}, **{s.variable: s.light for s in series}}
    kept = re.sub(r'<path class="band" data-m="([^"]*)"[^>]*/>', lambda m: m[0] if m[1] == bands else "", svg)
    found = re.search(r'viewBox="0 0 (\d+) (\d+)"', kept)
    assert found is not None
    width, height = int(found[1]), int(found[2])
    keys, below = _legend_svg([s for s in series if f'data-m="{s.name}"' in kept], width, height)
    size = f'xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height + below}" '
    ground = f'<style>{_STYLE}</style><rect width="{width}" height="{height + below}" fill="{LIGHT["surface"]}"/>'
    kept = kept.replace(found[0], f'viewBox="0 0 {width} {height + below}"', 1).replace("</svg>", f"{keys}</svg>")
    kept = kept.replace("<svg ", f"<svg {size}", 1).replace(">", f">{ground}", 1)
    return re.sub(r"var\((--[a-z0-9-]+)\)", lambda m: values.get(m[1], LIGHT["ink"]), kept)


def _legend_svg(series: list[Series], width: int, top: int) -> tuple[str, int]:
    """Keys of all series in rows below a chart, and the px that they take."""
    x, y, parts = 10.0, top + 12.0, []
    for s in series:
        wide = 34.0 + 7.0 * len(s.name)
        if x + wide > width and x > 10.0:
            x, y = 10.0, y + 17.0
        dash = f' stroke-dasharray="{s.dash}"' if s.dash else ""
        parts.append(
            f'<path d="M{x:g},{y - 4:g}h22" fill="none" stroke="{s.light}" stroke-width="{s.width + 0.6:g}"{dash}/>'
            f'<text x="{x + 27:g}" y="{y:g}">{escape_html(s.name)}</text>'
        )
        x += wide + 12.0
    return "".join(parts), round(y - top + 10.0) if parts else 0


def _css_block(values: dict[str, str], scheme: str) -> str:
    return f"color-scheme:{scheme};" + "".join(f"--{name}:{value};" for name, value in values.items())
