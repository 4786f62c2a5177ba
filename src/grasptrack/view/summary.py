# SPDX-License-Identifier: Apache-2.0
"""A whole run on one page: a strip of frames, and how margin, confidence, chance of closing and latency went."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from itertools import islice, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import one_line
from grasptrack.view.style import INK, RULE, STATUS_RGB, Picture, create_figure, hex_colour, save_whole

if TYPE_CHECKING:
    from grasptrack.io.results import RunSummary

SHOWN = 6
_THUMB_WIDTH = 480
_COLUMNS = 1600
_ORDER = ("tracked", "unstable", "lost", "searching")
_CURVES = (
    ("margin", "margin\n(degrees)"),
    ("confidence", "confidence,\nchance to close"),
    ("latency_ms", "latency\n(ms)"),
)
_SECOND = "chance"
"""Shares the panel of the confidence."""
_NAMES = (*(name for name, _ in _CURVES), _SECOND)
_LINE, _OTHER = "#23303f", "#0072b2"


class Filmstrip:
    """A few frames spread evenly over a run whose length nobody knows: at most 12 small pictures are held."""

    def __init__(self) -> None:
        self._kept: list[tuple[int, Picture]] = []
        self._stride = 1

    def wants_frame(self, index: int) -> bool:
        """Whether this frame may come to be shown."""
        return index % self._stride == 0

    def add_frame(self, index: int, picture: Picture) -> None:
        """Keep a small copy of a frame's picture (H, W, 3), BGR."""
        height = max(1, round(picture.shape[0] * _THUMB_WIDTH / picture.shape[1]))
        small = cv2.resize(picture, (_THUMB_WIDTH, height), interpolation=cv2.INTER_AREA)
        self._kept.append((index, np.asarray(small, dtype=np.uint8)))
        if len(self._kept) > 2 * SHOWN:
            del self._kept[1::2]
            self._stride *= 2

    def pick_frames(self) -> list[tuple[int, Picture]]:
        """Up to six frames' numbers and pictures, evenly spread."""
        count = len(self._kept)
        chosen = np.linspace(0, count - 1, min(SHOWN, count)).round().astype(int).tolist()
        return [self._kept[i] for i in chosen]


class BinnedCurves:
    """The columns of grasps.csv over the frames, in as many bins as a page has room for, whatever the run's length."""

    def __init__(self, path: Path, frames: int) -> None:
        self.bins = min(frames, _COLUMNS)
        self.frames, self.first = frames, 0
        self.low = {name: np.full(self.bins, np.nan) for name in _NAMES}
        self.high = {name: np.full(self.bins, np.nan) for name in _NAMES}
        votes = np.zeros((self.bins, len(_ORDER)), dtype=np.int64)
        with path.open(newline="", encoding="utf-8") as file:
            for row, cells in enumerate(islice(csv.DictReader(file), frames)):
                self.first = int(cells["frame"]) - row
                place = row * self.bins // frames
                votes[place, _ORDER.index(cells["status"])] += 1
                for name in _NAMES:
                    if cells[name]:
                        value = float(cells[name])
                        self.low[name][place] = np.fmin(self.low[name][place], value)
                        self.high[name][place] = np.fmax(self.high[name][place], value)
        self.status: NDArray[np.int64] = votes.argmax(axis=1)

    @property
    def bin_centres(self) -> NDArray[np.float64]:
        """(bins,) frame number in the middle of each bin."""
        step = self.frames / self.bins
        return np.asarray(self.first + np.arange(self.bins) * step + (step - 1) / 2, dtype=np.float64)

    def status_spans(self) -> Iterator[tuple[str, float, float]]:
        """Status, first and last frame (half a frame beyond either) of each stretch of one status."""
        edges = [0, *(np.flatnonzero(np.diff(self.status)) + 1).tolist(), self.bins]
        step = self.frames / self.bins
        for start, stop in pairwise(edges):
            yield _ORDER[int(self.status[start])], self.first + start * step - 0.5, self.first + stop * step - 0.5


def write_summary(path: Path, rows: Path, strip: Filmstrip, summary: RunSummary, title: str) -> None:
    """Write summary.png."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    pictures = strip.pick_frames()
    curves = BinnedCurves(rows, summary.frames)
    across = min(3, max(1, len(pictures)))
    down = math.ceil(len(pictures) / across) if pictures else 0
    tall = 0.6 + sum(12.4 / across * p.shape[0] / p.shape[1] + 0.16 for _, p in pictures[::across])
    layout = ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.08)
    figure = create_figure(12.6, tall + 5.0, layout=layout, facecolor="white")
    parts: Any = figure.subfigures(2, 1, height_ratios=[tall, 5.0])
    top, bottom = parts
    counts = ", ".join(f"{summary.counts[s]} {s}" for s in _ORDER if summary.counts.get(s))
    headline = one_line(f"{title}: {summary.frames} frame{'s' * (summary.frames != 1)}, {counts}")
    top.suptitle(headline, x=0.012, ha="left", fontsize=13, color=INK, fontweight="bold", parse_math=False)
    if pictures:
        _show_pictures(top, pictures, down, across)
    _show_curves(bottom, curves, summary)
    save_whole(figure, path, 110)


def _show_pictures(figure: Any, pictures: list[tuple[int, Picture]], down: int, across: int) -> None:
    for axes, (_, picture) in zip(
        figure.subplots(down, across, squeeze=False).flat, [*pictures, *[(0, None)] * 6], strict=False
    ):
        axes.set_axis_off()
        if picture is not None:
            axes.imshow(picture[:, :, ::-1], interpolation="antialiased")


def _show_curves(figure: Any, curves: BinnedCurves, summary: RunSummary) -> None:
    from matplotlib.patches import Patch
    from matplotlib.ticker import MaxNLocator

    from grasptrack.grasp.closure_probability import CHANCE

    panels = figure.subplots(len(_CURVES), 1, sharex=True)
    at = curves.bin_centres
    alone = ".-" if curves.bins <= 60 else "-"
    for axes, (name, label) in zip(panels, _CURVES, strict=True):
        for status, start, stop in curves.status_spans():
            axes.axvspan(start, stop, color=hex_colour(STATUS_RGB[status]), alpha=_status_alpha(status), lw=0)
        for curve, colour in ((name, _LINE), *([(_SECOND, _OTHER)] if name == "confidence" else [])):
            low, high = curves.low[curve], curves.high[curve]
            if curves.bins < curves.frames:
                axes.fill_between(at, low, high, color=colour, alpha=0.35, lw=0)
            axes.plot(at, 0.5 * (low + high), alone, color=colour, lw=1.3, ms=4, label=curve)
        axes.set_ylabel(label, color=INK)
        axes.grid(axis="y", color=RULE, lw=0.7)
        axes.set_axisbelow(True)
        axes.tick_params(colors=INK, length=3)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    margin, confidence, latency = panels
    margin.margins(y=0.12)
    margin.axhline(0.0, color=INK, lw=0.9, ls=(0, (4, 3)))
    confidence.set_ylim(-0.03, 1.05)
    confidence.axhline(CHANCE, color=_OTHER, lw=0.9, ls=(0, (4, 3)))
    confidence.legend(
        *confidence.get_legend_handles_labels(), loc="lower right", ncols=2, frameon=False, fontsize=9, labelcolor=INK
    )
    _latency_axis(latency, curves, summary)
    latency.set_xlabel("frame", color=INK)
    latency.set_xlim(curves.first - 0.5, curves.first + max(curves.frames - 0.5, 0.5))
    latency.xaxis.set_major_locator(MaxNLocator(integer=True))
    marks = [
        Patch(
            facecolor=hex_colour(STATUS_RGB[s]),
            alpha=_status_alpha(s) + 0.25,
            label=f"{s} ({summary.counts.get(s, 0)})",
        )
        for s in _ORDER
    ]
    margin.legend(handles=marks, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=10)


def _latency_axis(axes: Any, curves: BinnedCurves, summary: RunSummary) -> None:
    """Scaled to the 99th percentile and a little more: the first frame, which synthesises, would flatten the rest."""
    high = curves.high["latency_ms"]
    if not np.isfinite(high).any():
        return
    ceiling = max(2.0 * summary.latency_p99_ms if curves.frames > 20 else float(np.nanmax(high)), 1e-3) * 1.08
    ceiling = min(ceiling, float(np.nanmax(high)) * 1.08)
    axes.set_ylim(0.0, ceiling)
    axes.axhline(summary.latency_median_ms, color=INK, lw=0.9, ls=(0, (4, 3)))
    text = f"median {summary.latency_median_ms:.2f} ms, 99th percentile {summary.latency_p99_ms:.2f} ms"
    beyond = int((high > ceiling).sum())
    if beyond:
        text += f"; {beyond} beyond the scale, up to {np.nanmax(high):.0f} ms"
    axes.set_title(text, loc="right", fontsize=9, color=INK, pad=3)


def _status_alpha(status: str) -> float:
    """Denser the worse, so that the order survives a black-and-white print."""
    return {"tracked": 0.16, "unstable": 0.38, "lost": 0.55, "searching": 0.30}[status]
