# SPDX-License-Identifier: Apache-2.0
"""Pages from templates: one HTML file that needs nothing else. All text is escaped; `templates/` holds the prose.

Charts and tables come ready from Python; `templates/parts.html` puts tables, charts and pictures together.
"""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.files import whole_file
from grasptrack_bench.charts import DASH, Chart, Series, format_number, format_percent
from grasptrack_bench.charts.palette import colour_variables, escape_html, make_slug, standalone_svg

if TYPE_CHECKING:
    from jinja2 import Environment

Tone = Literal["", "good", "bad", "muted", "warm"]
TEMPLATES = Path(__file__).parent / "templates"
_QUALITY = 86


class Column(NamedTuple):
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


class Cell(NamedTuple):
    """A cell.

    Attributes:
        text: as it is written; `code` and **weight** are marked as in Markdown.
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


CellLike = Cell | str | float | int | None
"""Numbers are written to three digits, None and NaN as a dash."""


class Line(NamedTuple):
    """A line of a table.

    Attributes:
        cells: the first one heads the line.
        series: method that it tells of, for its mark and so that it can be hidden with it.
        rule: a line above it sets it apart.
    """

    cells: Sequence[CellLike]
    series: str = ""
    rule: bool = False


class PageTable(NamedTuple):
    """A table as it stands in a page."""

    columns: Sequence[Column]
    lines: Sequence[Line]


class Figure(NamedTuple):
    """A chart in a page, with a heading and a note beside it."""

    title: str
    note: str
    svg: str


@dataclass
class Contents:
    """The sections of a page, in order, as names of their addresses and headings."""

    sections: list[tuple[str, str]] = field(default_factory=list)

    @property
    def latest(self) -> str:
        """Heading of the section that is being written."""
        return self.sections[-1][1] if self.sections else ""

    def add(self, title: str) -> str:
        """A new section; gives its name, which no other one has."""
        name = make_slug(title)
        if any(name == taken for taken, _ in self.sections):
            name = f"{name}-{len(self.sections)}"
        self.sections.append((name, title))
        return name


def write_page(
    path: Path, template: Path, title: str, kicker: str, series: dict[str, Series], focus: str = "", **content: Any
) -> Path:
    """Write a page, whole or not at all: heading, a line above it (`kicker`), and a template's body, which may use `templates`.

    The lines of `series` can be shown and hidden, in the order of the keys; the bands of `focus` are shown at first.
    """
    from markupsafe import Markup

    environment, contents = _create_environment(), Contents()
    body = environment.from_string(template.read_text(encoding="utf-8")).render(
        contents=contents, series=series, **content
    )
    page = environment.get_template("page.html").render(
        title=title,
        kicker=kicker,
        series=series,
        focus=focus,
        contents=contents,
        body=Markup(body),
        style=Markup(colour_variables(series.values()) + (TEMPLATES / "page.css").read_text(encoding="utf-8")),
        script=Markup((TEMPLATES / "page.js").read_text(encoding="utf-8")),
    )
    with whole_file(path) as part:
        part.write_text(page, encoding="utf-8")
    return path


def keep_chart(folder: Path, name: str, chart: Chart, series: dict[str, Series], bands: str = "") -> str:
    """A chart for a page, also written to a file of its own, which shows the bands of the method `bands`."""
    from markupsafe import Markup

    svg = chart.svg()
    text = standalone_svg(svg, series.values(), bands)
    (folder / f"{make_slug(name)}.svg").write_text(text + "\n", encoding="utf-8")
    return Markup(svg)


def count_phrase(n: int, what: str) -> str:
    """A number of things: "1 part", "2 parts"."""
    return f"{format_number(n)} {what}" if n == 1 else f"{format_number(n)} {what}s"


def cell_of(value: CellLike) -> Cell:
    """Any value as a cell."""
    if isinstance(value, Cell):
        return value
    if value is None:
        return Cell(DASH)
    return Cell(value) if isinstance(value, str) else Cell(format_number(value), float(value))


@lru_cache
def _create_environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    made = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(
        cell=cell_of,
        count_of=count_phrase,
        data_uri=_data_uri,
        inline=_inline_markup,
        join_words=_join_words,
        number=format_number,
        percent=format_percent,
        slug=make_slug,
    )
    made.tests.update(known=lambda value: not math.isnan(value), finite=math.isfinite)
    return made


def _inline_markup(text: object) -> str:
    """Escaped text in which `code` and **weight** are marked as in Markdown."""
    from markupsafe import Markup

    safe = re.sub(r"`([^`]+)`", r"<code>\1</code>", escape_html(text))
    return Markup(re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", safe))


def _join_words(words: Sequence[str]) -> str:
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def _data_uri(picture: NDArray[np.uint8]) -> str:
    """A BGR or grey picture inside an address: PNG, or JPEG where that is smaller, as of photos."""
    good, png = cv2.imencode(".png", picture)
    fine, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not good or not fine:
        raise ValueError(f"a picture must be 8 bit grey or BGR, not {picture.shape} of {picture.dtype}")
    kind, data = ("png", png) if len(png) <= len(jpeg) else ("jpeg", jpeg)
    return f"data:image/{kind};base64,{base64.b64encode(data.tobytes()).decode()}"
