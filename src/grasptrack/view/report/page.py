# SPDX-License-Identifier: Apache-2.0
"""One page: sections of text, cards, tables, charts and pictures in a single HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasptrack.view.report.palette import colour_variables, series_palette
from grasptrack.view.report.parts import (
    Card,
    Cell,
    Column,
    Line,
    data_uri,
    escape_html,
    head_html,
    inline_markup,
    key_html,
    line_html,
    make_slug,
)

_HERE = Path(__file__).parent


class Page:
    """A page that grows from top to bottom.

    Args:
        title: its heading.
        subtitle: a line above it.
        methods: whose lines can be shown and hidden; their order is that of the keys.
        focus: the method whose bands are shown at first.
    """

    def __init__(self, title: str, subtitle: str = "", methods: Sequence[str] = (), focus: str = "") -> None:
        self.title, self.subtitle, self.focus = title, subtitle, focus
        self.series = series_palette(methods)
        self._top: list[str] = []
        self._body: list[str] = []
        self._sections: list[tuple[str, str]] = []

    def lead(self, text: str) -> None:
        """What a hurried reader takes away; `code` and **weight** are marked as in Markdown."""
        self._add_html(f'<p class="lead">{inline_markup(text)}</p>')

    def facts(self, pairs: Iterable[tuple[str, str]]) -> None:
        """Small print as pairs of a name and a value."""
        self._add_html(
            f'<dl class="facts">{"".join(f"<dt>{escape_html(a)}</dt><dd>{inline_markup(b)}</dd>" for a, b in pairs)}</dl>'
        )

    def section(self, title: str, intro: str = "", short: str = "") -> None:
        """A new section; what follows belongs to it. `short`: its name in the contents."""
        if self._sections:
            self._body.append("</section>")
        name = make_slug(title)
        taken = {n for n, _ in self._sections}
        name = name if name not in taken else f"{name}-{len(taken)}"
        self._sections.append((name, short or title))
        self._body.append(
            f'<section id="{name}" aria-labelledby="h-{name}"><h2 id="h-{name}">{escape_html(title)}</h2>'
        )
        if intro:
            self._body.append(f'<p class="intro">{inline_markup(intro)}</p>')

    def heading(self, title: str) -> None:
        """A heading within a section."""
        self._add_html(f"<h3>{escape_html(title)}</h3>")

    def text(self, *paragraphs: str) -> None:
        """Paragraphs; `code` and **weight** are marked as in Markdown."""
        self._add_html("".join(f"<p>{inline_markup(p)}</p>" for p in paragraphs))

    def points(self, items: Iterable[str]) -> None:
        """A list of sentences."""
        self._add_html(f'<ul class="plain">{"".join(f"<li>{inline_markup(i)}</li>" for i in items)}</ul>')

    def cards(self, cards: Iterable[Card]) -> None:
        """Key figures."""
        self._add_html(f'<dl class="cards">{"".join(card.html() for card in cards)}</dl>')

    def table(
        self,
        head: Sequence[Column | str],
        rows: Iterable[Line | Sequence[Cell | str | float | int | None]],
        notes: Sequence[str] = (),
        caption: str = "",
    ) -> None:
        """A table that scrolls within its box and can be sorted by a click on a head.

        Args:
            head: its columns; the first one heads the lines.
            rows: cells; numbers are written to three digits, None and NaN as a dash.
            notes: sentences below it.
            caption: what it shows, above it.
        """
        columns = [c if isinstance(c, Column) else Column(c) for c in head]
        heads = "".join(head_html(column, i == 0) for i, column in enumerate(columns))
        body = "".join(line_html(r if isinstance(r, Line) else Line(r), columns) for r in rows)
        said = f"<figcaption>{inline_markup(caption)}</figcaption>" if caption else ""
        below = f'<ul class="notes">{"".join(f"<li>{inline_markup(n)}</li>" for n in notes)}</ul>' if notes else ""
        self._add_html(
            f'<figure class="table">{said}<div class="scroll" tabindex="0" role="region" '
            f'aria-label="{escape_html(caption or self._sections[-1][1] if self._sections else self.title)}">'
            f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>{below}</figure>"
        )

    def figure(self, svg: str, caption: str) -> None:
        """One wide chart."""
        self._add_html(
            f'<figure><div class="wide">{svg}</div><figcaption>{inline_markup(caption)}</figcaption></figure>'
        )

    def figures(self, charts: Iterable[tuple[str, str, str]], caption: str, large: bool = False) -> None:
        """Charts side by side, as many as there is room for: a heading, a note beside it, and the chart."""
        parts = [f"<div>{_chart_heading(title, note)}{svg}</div>" for title, note, svg in charts]
        self._add_html(
            f'<figure><div class="charts{" large" if large else ""}">{"".join(parts)}</div>'
            f"<figcaption>{inline_markup(caption)}</figcaption></figure>"
        )

    def pictures(self, pictures: Iterable[tuple[str, NDArray[np.uint8]] | tuple[str, NDArray[np.uint8], str]]) -> None:
        """Pictures side by side: a caption, a BGR picture, and a method with which it is shown and hidden, or none.

        The first line of a caption stands out from the rest.
        """
        parts = []
        for caption, picture, *series in pictures:
            first, _, rest = caption.partition("\n")
            marks = f' data-m="{escape_html(series[0])}"' if series and series[0] else ""
            key = key_html(series[0]) if series and series[0] in self.series else ""
            height, width = picture.shape[:2]
            more = f"<br><span>{inline_markup(rest)}</span>" if rest else ""
            parts.append(
                f'<figure{marks}><img src="{data_uri(picture)}" width="{width}" height="{height}" loading="lazy" '
                f'alt="{escape_html(caption.replace(chr(10), ", "))}">'
                f"<figcaption>{key}{inline_markup(first)}{more}</figcaption></figure>"
            )
        self._add_html(f'<div class="pictures">{"".join(parts)}</div>')

    def bars(self, rows: Sequence[tuple[int, str]], total: int) -> None:
        """Numbers with what they count, and a bar for each as its share of `total`."""
        parts = [
            f'<div class="n">{n}</div><div class="b">{escape_html(what)}'
            f'<i style="width:{max(0.4, 100.0 * n / max(1, total)):.1f}%"></i></div>'
            for n, what in rows
        ]
        self._add_html(f'<div class="bars">{"".join(parts)}</div>')

    def terms(self, terms: Iterable[tuple[str, str, str]]) -> None:
        """Definitions: the term, its meaning, where it comes from."""
        parts = [
            f"<dt>{escape_html(a)}</dt><dd>{inline_markup(b)}"
            + (f' <span class="source">{inline_markup(c)}</span>' if c else "")
            + "</dd>"
            for a, b, c in terms
        ]
        self._add_html(f'<dl class="terms">{"".join(parts)}</dl>')

    @contextmanager
    def folded(self, title: str, note: str = "", series: str = "", shown: bool = False) -> Iterator[None]:
        """What is added within is folded away under a line, or unfolded at first."""
        key = key_html(series) if series in self.series else ""
        marks = f' data-m="{escape_html(series)}"' if series else ""
        said = f'<span class="note">{escape_html(note)}</span>' if note else ""
        self._add_html(f"<details{marks}{' open' if shown else ''}><summary>{key}{escape_html(title)}{said}</summary>")
        yield
        self._add_html("</details>")

    def html(self) -> str:
        """The whole file."""
        css = (_HERE / "page.css").read_text(encoding="utf-8")
        script = (_HERE / "page.js").read_text(encoding="utf-8")
        links = "".join(f'<li><a href="#{name}">{escape_html(title)}</a></li>' for name, title in self._sections)
        body = "".join(self._body) + ("</section>" if self._sections else "")
        kicker = f'<p class="kicker">{inline_markup(self.subtitle)}</p>' if self.subtitle else ""
        return (
            f'<!doctype html>\n<html lang="en" data-focus="{escape_html(self.focus)}"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<meta name="color-scheme" content="light dark"><title>{escape_html(self.title)}</title>'
            f"<style>{colour_variables(self.series.values())}{css}</style></head><body>"
            '<a class="skip" href="#main">To the text</a>'
            f'<svg width="0" height="0" style="position:absolute" aria-hidden="true">{self._symbols_svg()}</svg>'
            f'<div class="bar"><div><span class="name">{escape_html(self.title)}</span>{self._keys_html()}'
            '<button type="button" class="theme" hidden>Dark</button></div></div>'
            f'<div class="frame"><nav class="contents" aria-label="Contents"><ol>{links}</ol></nav>'
            f'<main id="main"><header class="top">{kicker}<h1>{escape_html(self.title)}</h1></header>'
            f"{''.join(self._top)}{body}</main></div><script>{script}</script></body></html>\n"
        )

    def write(self, path: Path) -> Path:
        """Write the file, whole or not at all."""
        part = path.with_name(f"{path.name}.part")
        part.write_text(self.html(), encoding="utf-8")
        part.replace(path)
        return path

    def _add_html(self, html: str) -> None:
        (self._body if self._sections else self._top).append(html)

    def _symbols_svg(self) -> str:
        return "".join(
            f'<symbol id="key-{make_slug(s.name)}" viewBox="0 0 22 8"><path d="M0,4H22" fill="none" '
            f'style="stroke:var({s.variable})" stroke-width="{s.width + 0.6:g}"'
            + (f' stroke-dasharray="{s.dash}"' if s.dash else "")
            + "/></symbol>"
            for s in self.series.values()
        )

    def _keys_html(self) -> str:
        keys = "".join(
            f'<button type="button" data-key="{escape_html(n)}" aria-pressed="true" title="Show or hide">'
            f"{key_html(n)}{escape_html(n)}</button>"
            for n in self.series
        )
        return f'<div class="keys" role="group" aria-label="Methods">{keys}</div>'


def _chart_heading(title: str, note: str) -> str:
    beside = f'<span class="note">{escape_html(note)}</span>' if note else ""
    return f"<h4>{escape_html(title)}{beside}</h4>" if title else ""
