# SPDX-License-Identifier: Apache-2.0
"""A part of an image with an outline and the fingers on it: the large panel and each small one of the grasps' picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats
from grasptrack.view.draw import as_bgr
from grasptrack.view.fingers import inward_normals, sector_polygon, slip_strips
from grasptrack.view.layout import Window
from grasptrack.view.style import CONE_RGB, FINGER_RGB, NEIGHBOUR_RGB, PANEL_RGB, REGION_RGB, STATUS_RGB, hex_colour

if TYPE_CHECKING:
    from grasptrack.geometry.contours import View
    from grasptrack.grasp.contacts import RankedGrasp

DARK = "#0c0e12"
FINGER, CONE, REGION, NEIGHBOUR = (hex_colour(c) for c in (FINGER_RGB, CONE_RGB, REGION_RGB, NEIGHBOUR_RGB))
LINE = hex_colour(STATUS_RGB["tracked"])


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
        axes.set(xticks=(), yticks=(), facecolor=hex_colour(PANEL_RGB))
        for side in axes.spines.values():
            side.set_visible(False)

    def frame(self) -> None:
        """A white border, for a panel that lies on another one."""
        for side in self.axes.spines.values():
            side.set(visible=True, color="white", linewidth=2.0)

    def mark(self, part: Window) -> None:
        """A white rectangle round a part."""
        left, top, right, bottom = part
        corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]])
        self.line(corners, "white", 1.2)

    def line(self, points: Floats, colour: str, width: float, **more: Any) -> None:
        """A line through (n, 2) px, `width` points wide, on a dark casing."""
        self.axes.plot(points[:, 0], points[:, 1], color=DARK, lw=width + 1.6, alpha=0.75, solid_capstyle="butt")
        self.axes.plot(points[:, 0], points[:, 1], color=colour, lw=width, **more)

    def outline(self, view: View, width: float = 1.4) -> None:
        """The object's outline."""
        for contour in view.contours:
            self.line(np.vstack([contour.points, contour.points[:1]]), "white", width)

    def neighbours(self, views: Sequence[View], width: float = 1.0) -> None:
        """Outlines of what else lies there."""
        for view in views:
            points = view.outer.points
            self.line(np.vstack([points, points[:1]]), NEIGHBOUR, width, linestyle=(0, (4, 3)))

    def polygon(self, corners: Floats, colour: str, opacity: float, width: float) -> None:
        """A translucent area with a solid edge."""
        self.axes.fill(corners[:, 0], corners[:, 1], facecolor=colour, alpha=opacity, lw=0)
        if width > 0.0:
            self.line(np.vstack([corners, corners[:1]]), colour, width)

    def small_grasp(self, grasp: RankedGrasp) -> None:
        """Fingers and the line between them."""
        for finger in grasp.fingers:
            self.polygon(finger, FINGER, 0.45, 1.0)
        self._grasp_line(grasp, 1.6, 3.5)

    def grasp(self, grasp: RankedGrasp, view: View, friction: float) -> None:
        """All of a grasp: ways in, fingers, cones, regions, line, and the contacts' numbers."""
        self._draw_cones(grasp, view, friction)
        for swept, finger in zip(grasp.swept, grasp.fingers, strict=True):
            self.line(np.vstack([swept, swept[:1]]), FINGER, 1.2, linestyle=(0, (3, 2)))
            self.polygon(finger, FINGER, 0.42, 2.0)
        for piece in slip_strips(grasp, view):
            if len(piece):
                self.line(piece, REGION, 5.0, solid_capstyle="butt")
        self._grasp_line(grasp, 2.2, 7.0)
        for i, (contact, way) in enumerate(zip(grasp.contacts, grasp.directions, strict=True)):
            self._draw_motion(contact, way, grasp.swept[i], str(i + 1), grasp.spread)

    def label(self, text: str, at: Floats, size: float = 10.0) -> None:
        """Bold text on a dark disc, within the window."""
        left, top, right, bottom = self.window
        inset = 1.1 * size * self.px_per_point
        x = min(max(float(at[0]), left + inset), right - inset)
        y = min(max(float(at[1]), top + inset), bottom - inset)
        box = {"boxstyle": "circle,pad=0.28", "fc": DARK, "ec": "white", "lw": 0.8}
        style = {"ha": "center", "va": "center", "fontsize": size, "fontweight": "bold", "color": "white"}
        self.axes.text(x, y, text, bbox=box, zorder=6, **style)

    def _draw_cones(self, grasp: RankedGrasp, view: View, friction: float) -> None:
        reach = float(np.linalg.norm(grasp.contacts - grasp.contacts.mean(axis=0), axis=1).mean())
        length = min(max(0.6 * reach, 16.0 * self.px_per_point), 90.0 * self.px_per_point)
        for contact, normal in zip(grasp.contacts, inward_normals(grasp, view, friction), strict=True):
            self.polygon(sector_polygon(contact, normal, math.atan(friction), length), CONE, 0.38, 1.0)

    def _grasp_line(self, grasp: RankedGrasp, width: float, mark: float) -> None:
        contacts = grasp.contacts
        middle = contacts.mean(axis=0)
        for spoke in [contacts] if len(contacts) == 2 else [np.vstack([middle, c]) for c in contacts]:
            self.line(spoke, LINE, width)
        self.axes.plot(contacts[:, 0], contacts[:, 1], "o", color=LINE, ms=mark, mec="white", mew=0.2 * mark, zorder=4)

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
        from matplotlib.patheffects import withStroke

        depth = float(((contact - swept) @ way).max())
        length = 22.0 * self.px_per_point
        # Along the clearance and the finger where these are large, behind them where the arrow would cover them.
        back = depth if depth > 1.5 * length else depth + 1.15 * length
        back = max(min(back, self._distance_to_border(contact, -way) - 1.4 * length), length)
        tail, tip = contact - back * way, contact - (back - length) * way
        arrow = {
            "arrowstyle": "-|>,head_width=0.32,head_length=0.5",
            "color": "white",
            "lw": 2.0,
            "mutation_scale": 12.0,
        }
        arrow.update(shrinkA=0.0, shrinkB=0.0, path_effects=[withStroke(linewidth=4.0, foreground=DARK)])
        self.axes.annotate("", tip, xytext=tail, arrowprops=arrow, zorder=5, annotation_clip=True)
        away = 14.0 * self.px_per_point
        # Fingers that spread stand back to back, so there the number goes to the other side of the contact.
        self.label(number, contact + 2.4 * away * way if spread else tail - away * way)
