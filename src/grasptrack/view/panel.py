# SPDX-License-Identifier: Apache-2.0
"""A part of an image with outlines and fingers on it, where such panels lie on a page, and the column of text beside them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import GraspError, one_line
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import RankedGrasp
from grasptrack.grasp.force_closure import analyze
from grasptrack.typing import Floats
from grasptrack.undistortion import SeenGrasp
from grasptrack.view import style
from grasptrack.view.draw import as_bgr, cone_length, grasp_spokes, sector_polygon
from grasptrack.view.style import add_legend, hex_colour, text_width

Window = tuple[float, float, float, float]
"""left, top, right, bottom in px."""
_FARTHEST = 0.6
"""Fingers are shown up to this share of the outline's extent beyond it."""
_CAPTION, _GAP = 0.27, 0.12
Box = tuple[float, float, float, float]
"""left, bottom, width and height in inches."""


def image_window(
    outlines: Sequence[Floats],
    fingers: Sequence[Floats],
    shape: tuple[int, ...],
    aspect: float,
    room: float,
    most: float = 1.0,
) -> Window:
    """The part of an image that shows outlines and fingers, in the proportions of its frame.

    Where the image is too small for that the window reaches beyond it, as fingers do.

    Args:
        outlines: arrays (n, 2) px, which are shown altogether.
        fingers: arrays (..., 2) px, shown as far as they do not dwarf the outlines.
        shape: height and width of the image.
        aspect: width over height of the frame.
        room: share of the larger extent that is added on every side.
        most: show all that the frame can of an image that is at most so many times as wide and high as the window.
    """
    low, high = _bounding_box(outlines)
    reach = _FARTHEST * float((high - low).max())
    if fingers:
        first, last = _bounding_box(fingers)
        low, high = np.maximum(np.minimum(low, first), low - reach), np.minimum(np.maximum(high, last), high + reach)
    margin = room * float((high - low).max()) + 2.0
    limit = np.array([shape[1], shape[0]], dtype=np.float64)
    # Room is left beyond the image only where something is drawn there.
    low = np.where(low >= -0.5, np.maximum(low - margin, -0.5), low - margin)
    high = np.where(high <= limit - 0.5, np.minimum(high + margin, limit - 0.5), high + margin)
    size = _expand_to_aspect(high - low, aspect)
    if (limit <= most * size).all():
        filled = np.minimum(limit, [aspect * limit[1], limit[0] / aspect])
        if (filled >= high - low).all():
            size = filled  # as much of the image as fills the frame
        else:
            low, high = np.minimum(low, -0.5), np.maximum(high, limit - 0.5)
            size = _expand_to_aspect(high - low, aspect)
    # Moved into the image as far as that hides nothing, for what is outside of it says nothing.
    start = 0.5 * (low + high - size)
    start = np.where(size <= limit, np.minimum(np.maximum(start, -0.5), limit - 0.5 - size), start)
    left, top = np.minimum(np.maximum(start, high - size), low).tolist()
    return left, top, left + float(size[0]), top + float(size[1])


def _expand_to_aspect(size: Floats, aspect: float) -> Floats:
    """The least size of some proportions that holds another."""
    return np.maximum(size, [aspect * size[1], size[0] / aspect])


def quiet_corner(frame: Window, share: float, seen: Floats, rather: Sequence[Floats]) -> int | None:
    """Which corner of a window has room for an inset: 0 to 3 as read, None where each hides what must be seen.

    It takes a share of width and height. Points (n, 2) px must be seen; of the arrays `rather`, (n, 2) px, as few points as can
    be are hidden.
    """
    hidden = _in_corners(frame, share, seen)
    others = np.sum([_in_corners(frame, share, points) for points in rather], axis=0) if rather else np.zeros(4)
    free = [i for i in range(4) if hidden[i] == 0]
    return min(free, key=lambda i: float(others[i])) if free else None


def _in_corners(frame: Window, share: float, points: Floats) -> list[int]:
    left, top, right, bottom = frame
    x, y = (points[:, 0] - left) / (right - left), (points[:, 1] - top) / (bottom - top)
    inside = (x >= 0.0) & (x <= 1.0) & (y >= 0.0) & (y <= 1.0)
    across, down = (x < share, x > 1.0 - share), (y < share, y > 1.0 - share)
    return [int(np.count_nonzero(inside & across[i % 2] & down[i // 2])) for i in range(4)]


def _bounding_box(parts: Sequence[Floats]) -> tuple[Floats, Floats]:
    listed = np.vstack([p.reshape(-1, 2) for p in parts])
    return listed.min(axis=0), listed.max(axis=0)


def panel_grid(area: Box, count: int, aspect: float) -> list[Box]:
    """Places of small panels, row by row, in as many columns as make a subject of some proportions largest."""

    def cell_size(columns: int) -> tuple[float, float]:
        rows = -(-count // columns)
        tall = (area[3] - (rows - 1) * _GAP) / rows - _CAPTION
        return (area[2] - (columns - 1) * _GAP) / columns, tall

    columns = max(range(1, min(count, 3) + 1), key=lambda n: min(cell_size(n)[0] / aspect, cell_size(n)[1]))
    wide, tall = cell_size(columns)
    tall = min(tall, 1.2 * max(wide, wide / aspect))
    left, top = area[0], area[1] + area[3]
    return [
        (
            left + (i % columns) * (wide + _GAP),
            top - (i // columns) * (tall + _CAPTION + _GAP) - _CAPTION - tall,
            wide,
            tall,
        )
        for i in range(count)
    ]


def aspect_of(points: Floats) -> float:
    """Width over height of an outline, a very thin one being taken as less so."""
    width, height = np.ptp(points, axis=0).tolist()
    return float(min(max(width / max(height, 1e-9), 0.2), 5.0))


def grasp_opening(grasp: RankedGrasp) -> float:
    """Px by which the hand opens: two contacts' distance; twice the way of the farthest of more to their mean."""
    contacts = grasp.straight if isinstance(grasp, SeenGrasp) else grasp.contacts
    if len(grasp) == 2:
        return math.dist(contacts[0], contacts[1])
    return 2.0 * float(np.linalg.norm(contacts - contacts.mean(axis=0), axis=1).max())


def inward_normals(grasp: RankedGrasp, view: View, friction: float) -> Floats:
    """(k, 2) unit normals into the material; where the analysis refuses the outline, the directions of motion."""
    try:
        return analyze(grasp, view, friction).normals
    except GraspError:
        return grasp.directions


def slip_strips(grasp: RankedGrasp, view: View) -> list[Floats]:
    """For each contact the piece of outline (m, 2) px within its region; empty where it may not slip at all."""
    return [
        contour_strip(view, int(contour), position, region)
        for (contour, position, _), region in zip(grasp.on(view).tolist(), grasp.regions.tolist(), strict=True)
    ]


def contour_strip(view: View, contour: int, position: float, half: float) -> Floats:
    """The piece (m, 2) px of one contour that reaches `half` px of arc length to both sides of a position, along the outline.

    The whole contour where it is no longer than twice that; (0, 2) where `half` is not positive.
    """
    if not half > 0.0:
        return np.zeros((0, 2))
    curve = view.contours[contour]
    arc, length = curve.arc_length, curve.length
    closed = np.vstack([curve.points, curve.points[:1]])
    half = min(half, 0.5 * length)
    middle = float(np.interp(position, np.arange(len(arc)), arc))
    knots = np.concatenate([arc[:-1] - length, arc[:-1], arc[:-1] + length])
    between = knots[(knots > middle - half) & (knots < middle + half)]
    at = np.concatenate([[middle - half], between, [middle + half]]) % length
    return np.column_stack([np.interp(at, arc, closed[:, axis]) for axis in (0, 1)])


FINGER, CONE, REGION, NEIGHBOUR = (
    hex_colour(c) for c in (style.FINGER_RGB, style.CONE_RGB, style.REGION_RGB, style.NEIGHBOUR_RGB)
)
LINE = hex_colour(style.STATUS_RGB["tracked"])
CLEAR, WEAK, BAD = (hex_colour(style.STATUS_RGB[s]) for s in ("tracked", "unstable", "lost"))
PEAK = hex_colour(style.STRATEGY_RGB["grasp-line"])
_DASHED = (0, (4, 3))
_MARKS: dict[str, dict[str, Any]] = {
    "finger": {"facecolor": FINGER, "edgecolor": FINGER, "alpha": 0.7},
    "its way in": {"color": FINGER, "lw": 1.8, "ls": (0, (3, 2))},
    "friction cone": {"facecolor": CONE},
    "where it may slip to": {"color": REGION, "lw": 5},
    "clear edge": {"color": CLEAR, "lw": 4},
    "faint edge": {"color": WEAK, "lw": 4},
    "no edge": {"color": BAD, "lw": 5},
    "peaks": {"color": PEAK, "marker": "D", "ms": 7, "lw": 0},
    "outline slides": {"color": BAD, "marker": r"$\rightarrow$", "ms": 14, "lw": 0},
    "neighbours": {"color": NEIGHBOUR, "lw": 1.6, "ls": _DASHED},
    "grasp": {"color": LINE, "lw": 2, "marker": "o", "mec": "white"},
    "errors": {"color": style.INK, "marker": "o", "ms": 12, "mfc": "none", "lw": 0},
}
"""What a legend shows of each mark: an area where it has a face, else a line or a marker."""


def draw_legend(axes: Any, shown: Mapping[str, str | bool]) -> None:
    """What is what, below a panel: the marks that are shown, True or the words for it where its name is not what to say."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    for mark, words in shown.items():
        if words:
            label, look = words if isinstance(words, str) else mark, _MARKS[mark]
            handles.append(Patch(label=label, **look) if "facecolor" in look else Line2D([], [], label=label, **look))
    if handles:
        add_legend(axes, handles)


def mute_image(image: NDArray[Any]) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB: an image of any kind with less colour and less light, so that what is drawn stands out."""
    rgb = as_bgr(image)[:, :, ::-1].astype(np.float32)
    grey = rgb @ np.array([0.3, 0.59, 0.11], np.float32)
    return np.asarray(0.72 * (0.55 * rgb + 0.45 * grey[:, :, None]), dtype=np.uint8)


class Panel:
    """A window of an image on axes of a known size, and what is drawn into it.

    Args:
        axes: matplotlib's, that fill their place in the figure.
        picture: (H, W, 3) uint8 RGB.
        window: the part of it that is shown, px.
        size: width and height of the axes in points.
    """

    def __init__(self, axes: Any, picture: NDArray[np.uint8], window: Window, size: tuple[float, float]) -> None:
        left, top, right, bottom = window
        self.axes, self.window = axes, window
        self.px_per_point = max((right - left) / size[0], (bottom - top) / size[1])
        height, width = picture.shape[:2]
        # Only what is shown, so that a large image does not cost time in every small panel.
        x0, x1 = max(math.floor(left), 0), min(math.ceil(right) + 1, width)
        y0, y1 = max(math.floor(top), 0), min(math.ceil(bottom) + 1, height)
        extent = (x0 - 0.5, x1 - 0.5, y1 - 0.5, y0 - 0.5)
        axes.imshow(picture[y0:y1, x0:x1], extent=extent, interpolation="hanning", aspect="auto")
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)
        axes.set(xticks=(), yticks=(), facecolor=hex_colour(style.PANEL_RGB))
        for side in axes.spines.values():
            side.set_visible(False)

    def draw_rectangle(self, part: Window) -> None:
        """A white rectangle round a part."""
        left, top, right, bottom = part
        corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]])
        self.draw_line(corners, "white", 1.2)

    def draw_line(self, points: Floats, colour: str, width: float, **more: Any) -> None:
        """A line through (n, 2) px, `width` points wide, on a dark casing."""
        self.axes.plot(points[:, 0], points[:, 1], color=style.DARK, lw=width + 1.6, alpha=0.75, solid_capstyle="butt")
        self.axes.plot(points[:, 0], points[:, 1], color=colour, lw=width, **more)

    def draw_outline(self, view: View, width: float = 1.4) -> None:
        """The object's outline."""
        for contour in view.contours:
            self.draw_line(np.vstack([contour.points, contour.points[:1]]), "white", width)

    def draw_neighbours(self, views: Sequence[View], width: float = 1.0) -> None:
        """Outlines of what else lies there."""
        for view in views:
            points = view.outer.points
            self.draw_line(np.vstack([points, points[:1]]), NEIGHBOUR, width, linestyle=_DASHED)

    def draw_polygon(self, corners: Floats, colour: str, opacity: float, width: float) -> None:
        """A translucent area with a solid edge."""
        self.axes.fill(corners[:, 0], corners[:, 1], facecolor=colour, alpha=opacity, lw=0)
        if width > 0.0:
            self.draw_line(np.vstack([corners, corners[:1]]), colour, width)

    def draw_small_grasp(self, grasp: RankedGrasp) -> None:
        """Fingers and the line between them."""
        for finger in grasp.fingers:
            self.draw_polygon(finger, FINGER, 0.45, 1.0)
        self.draw_grasp_line(grasp.contacts, 1.6, 3.5)

    def draw_grasp(self, grasp: RankedGrasp, view: View, friction: float) -> None:
        """All of a grasp: ways in, fingers, cones, regions, line, and the contacts' numbers."""
        self._draw_cones(grasp, view, friction)
        for swept, finger in zip(grasp.swept, grasp.fingers, strict=True):
            self.draw_line(np.vstack([swept, swept[:1]]), FINGER, 1.2, linestyle=(0, (3, 2)))
            self.draw_polygon(finger, FINGER, 0.42, 2.0)
        for piece in slip_strips(grasp, view):
            if len(piece):
                self.draw_line(piece, REGION, 5.0, solid_capstyle="butt")
        self.draw_grasp_line(grasp.contacts, 2.2, 7.0)
        for i, (contact, way) in enumerate(zip(grasp.contacts, grasp.directions, strict=True)):
            self._draw_motion(contact, way, grasp.swept[i], str(i + 1), grasp.spread)

    def draw_arrow(self, tail: Floats, tip: Floats, colour: str, head: float) -> None:
        """An arrow between two places, its head `head` ems wide, with a dark casing."""
        from matplotlib.patheffects import withStroke

        arrow = {"arrowstyle": f"-|>,head_width={head},head_length=0.5", "color": colour, "lw": 2.0}
        arrow.update(mutation_scale=12.0, shrinkA=0.0, shrinkB=0.0)
        arrow["path_effects"] = [withStroke(linewidth=4.0, foreground=style.DARK)]
        self.axes.annotate("", tip, xytext=tail, arrowprops=arrow, zorder=5, annotation_clip=True)

    def draw_label(self, text: str, at: Floats, size: float = 10.0) -> None:
        """Bold text on a dark disc, within the window."""
        left, top, right, bottom = self.window
        inset = 1.1 * size * self.px_per_point
        x = min(max(float(at[0]), left + inset), right - inset)
        y = min(max(float(at[1]), top + inset), bottom - inset)
        box = {"boxstyle": "circle,pad=0.28", "fc": style.DARK, "ec": "white", "lw": 0.8}
        font = {"ha": "center", "va": "center", "fontsize": size, "fontweight": "bold", "color": "white"}
        self.axes.text(x, y, text, bbox=box, zorder=6, **font)

    def draw_grasp_line(self, contacts: Floats, width: float, mark: float) -> None:
        """The lines that stand for a grasp, and a dot at each contact, `mark` points wide."""
        for spoke in grasp_spokes(contacts):
            self.draw_line(spoke, LINE, width)
        self.axes.plot(contacts[:, 0], contacts[:, 1], "o", color=LINE, ms=mark, mec="white", mew=0.2 * mark, zorder=4)

    def _draw_cones(self, grasp: RankedGrasp, view: View, friction: float) -> None:
        length = cone_length(grasp.contacts, 1.25 * self.px_per_point)
        for contact, normal in zip(grasp.contacts, inward_normals(grasp, view, friction), strict=True):
            self.draw_polygon(sector_polygon(contact, normal, math.atan(friction), length), CONE, 0.38, 1.0)

    def _distance_to_border(self, start: Floats, way: Floats) -> float:
        """px from a point to the window's border in a direction."""
        left, top, right, bottom = self.window
        rooms = [
            (high - at if step > 0.0 else low - at) / step
            for at, step, low, high in zip(start.tolist(), way.tolist(), (left, top), (right, bottom), strict=True)
            if abs(step) > 1e-9
        ]
        return min(rooms, default=math.inf)

    def _draw_motion(self, contact: Floats, way: Floats, swept: Floats, number: str, spread: bool) -> None:
        """An arrow along the way in, long enough to be seen, and the number where nothing else is."""
        depth = float(((contact - swept) @ way).max())
        length = 22.0 * self.px_per_point
        # Along the clearance and the finger where these are large, behind them where the arrow would cover them.
        back = depth if depth > 1.5 * length else depth + 1.15 * length
        back = max(min(back, self._distance_to_border(contact, -way) - 1.4 * length), length)
        tail, tip = contact - back * way, contact - (back - length) * way
        self.draw_arrow(tail, tip, "white", 0.32)
        away = 14.0 * self.px_per_point
        # Fingers that spread stand back to back, so there the number goes to the other side of the contact.
        self.draw_label(number, contact + 2.4 * away * way if spread else tail - away * way)


# --- pages ---------------------------------------------------------------------------------------

PAGE = (16.0, 9.0)
"""inches; at PAGE_DPI px each, a slide of 1600 by 900 px."""
PAGE_DPI = 100


def add_panel(figure: Any, picture: NDArray[np.uint8], shown: Window, box: Box) -> Panel:
    """A panel at a place of a page."""
    left, bottom, width, height = box
    axes = figure.add_axes((left / PAGE[0], bottom / PAGE[1], width / PAGE[0], height / PAGE[1]))
    return Panel(axes, picture, shown, (72.0 * width, 72.0 * height))


class TextColumn:
    """The column of text and bars beside the large panel of a page, filled from the top."""

    def __init__(self, figure: Any, box: Box) -> None:
        self._figure = figure
        self._left, self._bottom, self._width, height = box
        self._y = self._bottom + height

    def write_title(self, name: str, left: float, more: str = "") -> None:
        """What the picture is of, above everything."""
        y = PAGE[1] - 0.42
        name = one_line(name)
        short = name if len(name) <= 60 else name[:28] + "…" + name[-28:]
        self._write_text(left, y, short, 17.0, weight="bold")
        if more:
            self._write_text(self._left + self._width, y, more, 12.0, color=style.MUTED, ha="right")

    def write_heading(self, text: str) -> None:
        """A line in bold."""
        self._y -= 0.3
        self._write_text(self._left, self._y, text, 13.0, weight="bold")
        self._y -= 0.1

    def write_lines(self, text: str, size: float = 11.0, indent: float = 0.0, **more: Any) -> None:
        """A text in as many lines as the column's width makes of it."""
        for line in wrap_to_width(text, self._width - indent, size):
            self._y -= 0.21
            self._write_text(self._left + indent, self._y, line, size, **more)

    def _write_text(self, x: float, y: float, text: str, size: float, **more: Any) -> None:
        font = {"color": style.INK, "va": "baseline", "parse_math": False, **more}
        self._figure.text(x / PAGE[0], y / PAGE[1], text, fontsize=size, **font)

    def _draw_bar(self, left: float, width: float, height: float, share: float, colour: str) -> None:
        """A bar in the present line, of which a share between 0 and 1 is filled."""
        self._draw_box(left, self._y - 0.02, width, height, style.RULE)
        self._draw_box(left, self._y - 0.02, min(max(share, 0.0), 1.0) * width, height, colour)

    def _draw_box(self, left: float, bottom: float, width: float, height: float, colour: str) -> None:
        from matplotlib.patches import Rectangle

        place = (left / PAGE[0], bottom / PAGE[1]), width / PAGE[0], height / PAGE[1]
        self._figure.add_artist(Rectangle(*place, facecolor=colour, transform=self._figure.transFigure))


def wrap_to_width(text: str, room: float, size: float) -> list[str]:
    """Lines of a text that are at most so many inches wide at a size in points."""
    whole = max(text_width(text, 100) / 7200.0 * size, 1e-6)
    return wrap(text, max(12, int(0.97 * len(text) * room / whole))) if text else []
