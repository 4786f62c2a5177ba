# SPDX-License-Identifier: Apache-2.0
"""Colours and type, shared by all pictures.

Colours are Okabe and Ito's, which colour-blind people can tell apart, in RGB; a status is never told by colour alone.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.files import whole_file

Colour = tuple[int, int, int]
Picture = NDArray[np.uint8]

STATUS_RGB: dict[str, Colour] = {
    "tracked": (0, 168, 120),
    "unstable": (240, 170, 20),
    "lost": (222, 84, 24),
    "searching": (150, 156, 164),
}
STRATEGY_RGB: dict[str, Colour] = {"rrp": (230, 159, 0), "grasp-line": (204, 121, 167), "homography": (0, 114, 178)}
FINGER_RGB: Colour = (86, 180, 233)
CONE_RGB: Colour = (240, 228, 66)
REGION_RGB: Colour = (230, 110, 0)
NEIGHBOUR_RGB: Colour = (224, 150, 190)
INK_RGB: Colour = (236, 239, 243)
MUTED_RGB: Colour = (152, 161, 173)
PANEL_RGB: Colour = (22, 26, 33)
RULE_RGB: Colour = (58, 65, 76)
DARK_RGB: Colour = (12, 14, 18)
WHITE_RGB: Colour = (255, 255, 255)
INK, MUTED, RULE, DARK = "#1d232b", "#5a6472", "#d5dae1", "#0c0e12"
"""Of text, side notes and rules on white pages, and of casings."""


def rgb_to_bgr(colour: Colour) -> Colour:
    """A colour as OpenCV wants it."""
    return colour[2], colour[1], colour[0]


def hex_colour(colour: Colour) -> str:
    """A colour as matplotlib wants it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def create_figure(width: float, height: float, **more: Any) -> Any:
    """A figure of matplotlib's, of a size in inches, that needs no screen."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), **more)
    FigureCanvasAgg(figure)
    return figure


def add_legend(axes: Any, handles: Sequence[Any], most: int | None = None) -> None:
    """A legend below a panel, with `most` entries in a row, or as many as keep it from running out beside the panel."""
    place = {"loc": "upper left", "bbox_to_anchor": (0.0, -0.005), "borderaxespad": 0.3, "borderpad": 0.0}
    style = {"frameon": False, "fontsize": 11, "labelcolor": INK, "handlelength": 1.6, "columnspacing": 1.3}
    room = axes.get_window_extent().width
    for columns in range(min(len(handles), most or len(handles)), 0, -1):
        legend = axes.legend(handles=handles, ncols=columns, **place, **style)
        if legend.get_window_extent(axes.figure.canvas.get_renderer()).width <= room:
            break


def save_whole(figure: Any, path: Path, dpi: int, **more: Any) -> None:
    """Write a figure as PNG; the file is complete at any moment or absent."""
    with whole_file(path) as part:
        figure.savefig(part, dpi=dpi, format="png", **more)


def write_picture(path: Path, picture: Picture) -> None:
    """Write a picture in the format of the file's name; the file is complete at any moment or absent, an OSError says why."""
    good, data = cv2.imencode(path.suffix, picture)
    if not good:
        raise OSError(f'"{path}" cannot be written')
    with whole_file(path) as part:
        part.write_bytes(data.tobytes())


def text_width(text: str, size: int, bold: bool = False) -> int:
    """Width in px of a line of text of a given size in px."""
    return int(_render_text(text, size, bold)[0].shape[1])


def put_text(picture: Picture, text: str, at: tuple[int, int], size: int, colour: Colour, bold: bool = False) -> None:
    """Write a line of text from `at`, x and the baseline's y, in place; what falls outside the picture is cut off.

    OpenCV's stroke fonts are hard to read at this size, so the typeface is the one that comes with matplotlib.
    """
    if not text:
        return
    alpha, descent = _render_text(text, size, bold)
    x, baseline = at
    blend_colour(picture, alpha, x, baseline + descent - alpha.shape[0], colour)


def ellipsise_text(text: str, room: int, size: int, bold: bool = False) -> str:
    """The text, cut with an ellipsis where it is wider than `room` px; empty where nothing of it fits."""
    if text_width(text, size, bold) <= room:
        return text
    low, high = 0, len(text)
    while low < high:
        middle = (low + high + 1) // 2
        if text_width(text[:middle].rstrip() + "…", size, bold) <= room:
            low = middle
        else:
            high = middle - 1
    return text[:low].rstrip() + "…" if low else ""


def blend_colour(picture: Picture, alpha: NDArray[np.uint8], x: int, y: int, colour: Colour) -> None:
    """Lay a colour (RGB) over a BGR picture, in place, through a mask (h, w) whose top-left pixel goes to (x, y)."""
    height, width = picture.shape[:2]
    x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + alpha.shape[1], width), min(y + alpha.shape[0], height)
    if x0 >= x1 or y0 >= y1:
        return
    part = alpha[y0 - y : y1 - y, x0 - x : x1 - x, None].astype(np.uint16)
    under = picture[y0:y1, x0:x1]
    under[:] = (under * (255 - part) + np.array(rgb_to_bgr(colour), np.uint16) * part + 127) // 255


_lettering = threading.Lock()
"""A font holds the glyphs of the text that was set last: another thread's text in between writes beyond its image."""


@lru_cache(maxsize=2)
def _load_font(bold: bool) -> Any:
    import matplotlib
    from matplotlib.ft2font import FT2Font

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return FT2Font(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name))


@lru_cache(maxsize=512)
def _render_text(text: str, size: int, bold: bool) -> tuple[NDArray[np.uint8], int]:
    """Coverage (h, w) of a line of text, 0 to 255, and how many of its rows lie below the baseline."""
    with _lettering:
        font = _load_font(bold)
        font.set_size(float(size), 72.0)
        font.set_text(text, 0.0)
        font.draw_glyphs_to_bitmap(antialiased=True)
        coverage = np.array(font.get_image(), dtype=np.uint8)
        descent = round(font.get_descent() / 64)
    if coverage.size == 0:
        coverage = np.zeros((1, max(1, size // 3)), np.uint8)
    return coverage, descent
