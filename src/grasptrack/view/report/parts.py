# SPDX-License-Identifier: Apache-2.0
"""What pages are put together from: text and numbers as they stand in HTML, cards, and tables."""

from __future__ import annotations

import base64
import html
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

DASH = "–"
"""Where there is no value."""
_QUALITY = 86


def escape_html(text: object) -> str:
    """Text that is safe in HTML, in attributes too."""
    return html.escape(str(text), quote=True)


def make_slug(text: str) -> str:
    """A name that may stand in an id or a CSS variable."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "x"


def inline_markup(text: str) -> str:
    """Escaped text in which `code` and **weight** are marked as in Markdown."""
    safe = escape_html(text)
    safe = re.sub(r"`([^`]+)`", r"<code>\1</code>", safe)
    return re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", safe)


def format_number(value: float | int | None, digits: int = 3, unit: str = "") -> str:
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
    text = text.replace("-", "−")
    return f"{text}\u00a0{unit}" if unit else text


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


def data_uri(picture: NDArray[np.uint8]) -> str:
    """A BGR or grey picture inside an address: PNG, or JPEG where that is smaller, as of photos."""
    good, png = cv2.imencode(".png", picture)
    fine, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not good or not fine:
        raise ValueError(f"a picture must be 8 bit grey or BGR, not {picture.shape} of {picture.dtype}")
    kind, data = ("png", png) if len(png) <= len(jpeg) else ("jpeg", jpeg)
    return f"data:image/{kind};base64,{base64.b64encode(data.tobytes()).decode()}"


Tone = Literal["", "good", "bad", "muted", "warm"]


@dataclass(frozen=True)
class Card:
    """A key figure.

    Attributes:
        label: what it is.
        value: as it is written.
        note: below it.
        tone: how it is taken: bad for what should not be.
        unit: beside the value, smaller.
    """

    label: str
    value: str
    note: str = ""
    tone: Tone = ""
    unit: str = ""

    def html(self) -> str:
        """As a part of a list."""
        unit = f'<span class="unit">{escape_html(self.unit)}</span>' if self.unit else ""
        note = f'<span class="note">{inline_markup(self.note)}</span>' if self.note else ""
        return (
            f'<div class="card {self.tone}"><dt>{escape_html(self.label)}</dt>'
            f'<dd><span class="value">{escape_html(self.value)}{unit}</span>{note}</dd></div>'
        )


@dataclass(frozen=True)
class Column:
    """A column's head.

    Attributes:
        label: its name.
        unit: below it.
        tip: its meaning, shown on hovering.
        series: method whose figures it holds, so that it can be hidden with it.
        words: it holds words, which start at the left.
        rule: a line before it sets it apart from those before.
    """

    label: str
    unit: str = ""
    tip: str = ""
    series: str = ""
    words: bool = False
    rule: bool = False


@dataclass(frozen=True)
class Cell:
    """A cell.

    Attributes:
        text: as it is written.
        value: what a sort goes by; NaN comes last.
        heat: 0 to 1, how strongly it is tinted; None: not at all.
        tone: the tint.
        tip: shown on hovering.
        best: set in weight.
    """

    text: str
    value: float = math.nan
    heat: float | None = None
    tone: Tone = ""
    tip: str = ""
    best: bool = False


@dataclass(frozen=True)
class Line:
    """A line of a table.

    Attributes:
        cells: the first one heads the line.
        series: method that it tells of, for its mark and so that it can be hidden with it.
        rule: a line above it sets it apart.
    """

    cells: Sequence[Cell | str | float | int | None]
    series: str = ""
    rule: bool = False


def cell_of(value: Cell | str | float | int | None) -> Cell:
    """Any value as a cell: a dash for None and NaN."""
    if isinstance(value, Cell):
        return value
    if value is None:
        return Cell(DASH)
    if isinstance(value, str):
        return Cell(value)
    return Cell(format_number(value), float(value))


def head_html(column: Column, first: bool) -> str:
    """A column's head, to sort by."""
    names = " ".join(n for n, on in (("words", column.words or first), ("rule", column.rule)) if on)
    marks = f' data-m="{escape_html(column.series)}"' if column.series else ""
    tip = f' title="{escape_html(column.tip)}"' if column.tip else ""
    unit = f'<span class="unit">{escape_html(column.unit)}</span>' if column.unit else ""
    key = key_html(column.series) if column.series else ""
    return (
        f'<th scope="col" class="{names}"{marks}{tip}><button type="button" class="sort">{key}{escape_html(column.label)}'
        f"{unit}</button></th>"
    )


def line_html(line: Line, columns: Sequence[Column]) -> str:
    """A line under its columns."""
    parts = []
    for i, (raw, column) in enumerate(zip(line.cells, columns, strict=True)):
        cell = cell_of(raw)
        names = [n for n, on in (("words", column.words), ("rule", column.rule), ("best", cell.best)) if on]
        names += ["heat", cell.tone] if cell.heat is not None else [cell.tone] if cell.tone else []
        style = "" if cell.heat is None else f' style="--h:{min(1.0, max(0.0, cell.heat)):.2f}"'
        value = "" if math.isnan(cell.value) else f' data-v="{cell.value:.6g}"'
        tip = f' title="{escape_html(cell.tip)}"' if cell.tip else ""
        marks = f' data-m="{escape_html(column.series)}"' if column.series else ""
        if i == 0:
            key = key_html(line.series) if line.series else ""
            parts.append(f'<th scope="row" class="{" ".join(names)}"{value}{tip}>{key}{inline_markup(cell.text)}</th>')
        else:
            css = f' class="{" ".join(names)}"' if names else ""
            parts.append(f"<td{css}{style}{value}{tip}{marks}>{inline_markup(cell.text)}</td>")
    marks = f' data-m="{escape_html(line.series)}"' if line.series else ""
    rule = ' class="apart"' if line.rule else ""
    return f"<tr{marks}{rule}>{''.join(parts)}</tr>"


def key_html(name: str) -> str:
    """The mark of a method: a short piece of its line."""
    return f'<svg class="key" viewBox="0 0 22 8" aria-hidden="true"><use href="#key-{make_slug(name)}"/></svg>'
