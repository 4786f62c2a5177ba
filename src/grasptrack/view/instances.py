# SPDX-License-Identifier: Apache-2.0
"""Parts in an image, each with its grasp and its number in the order in which they are best picked; and parts on file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.contours import View
from grasptrack.tracking.instances import Instance
from grasptrack.tracking.parts import KnownPart
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.scene import SceneResult
from grasptrack.view import style
from grasptrack.view.draw import CANDIDATE_RGB, Canvas, as_bgr, enlarged_canvas
from grasptrack.view.style import Colour, Picture, ellipsise_text, put_text, rgb_to_bgr, text_width, write_picture

_KIND_RGB = (*CANDIDATE_RGB[1:], style.NEIGHBOUR_RGB, style.CONE_RGB, style.STRATEGY_RGB["homography"])
"""Of parts; the grasp has the colour that is left."""
_TILE, _TITLE, _COLUMNS = 320, 34, 4
"""px, side of a part's picture and height of its title; and parts in a row."""


def draw_instances(image: NDArray[Any], found: Sequence[Instance]) -> Picture:
    """The image (H, W, 3) BGR: what is found in its part's colour, numbered; what is not believed dashed, with the reason."""
    canvas = enlarged_canvas(image)
    names = sorted({one.part for one in found})
    for one in found:
        if not one.found:
            canvas.draw_last_outline(one.view)
    for one in found:
        if one.found and one.contacts is not None:
            colour = _KIND_RGB[names.index(one.part) % len(_KIND_RGB)]
            canvas.draw_lines([c.points for c in one.view.contours], colour, 1.3, casing=2.8, closed=True)
            _draw_grasp(canvas, one, style.STATUS_RGB["tracked"])
    for number, one in enumerate(found, 1):
        blocked = "" if np.isinf(one.room) else ", no room"
        _draw_tag(canvas, f"{number} {one.part}{blocked}" if one.found else f"{one.part}: {one.reason_code}", one.view)
    return canvas.picture


def draw_scene(image: NDArray[Any], told: SceneResult, last: Mapping[int | None, View] | None = None) -> Picture:
    """The image (H, W, 3) BGR: each instance in the colour of its status with its number; dashed, with the reason, where lost.

    Args:
        image: grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4), of 8 or 16 bits.
        told: of this image.
        last: where each was when it was located last, by its id; what is lost is drawn there.
    """
    canvas, known = enlarged_canvas(image), {} if last is None else last
    views = {number: known.get(number) if r.view is None else r.view for number, r in told.results.items()}
    for number, result in told.results.items():
        view, colour = views[number], style.STATUS_RGB[result.status]
        if view is not None and not result.located:
            canvas.draw_last_outline(view)
        elif view is not None and result.contacts is not None:
            canvas.draw_lines([c.points for c in view.contours], colour, 1.3, casing=2.8, closed=True)
            _draw_grasp(canvas, result, colour)
    for number, result in told.results.items():
        view = views[number]
        if view is not None:
            _draw_tag(canvas, f"{number} {result.part_id if result.located else result.reason_code}", view)
    return canvas.picture


def _draw_grasp(canvas: Canvas, one: Instance | TrackResult, colour: Colour) -> None:
    """A grasp, whose contacts are known: its line, and a ring in place of a dot where a contact's edge is not seen."""
    assert one.contacts is not None
    canvas.draw_grasp_line(one.contacts, colour)
    for contact, seen in zip(one.contacts, one.seen if one.seen is not None else (), strict=True):
        canvas.draw_contact(contact, colour, bool(seen >= 0.5))


def _draw_tag(canvas: Canvas, text: str, view: View) -> None:
    """Words on a dark plate in the middle of the top of an outline, kept inside the picture."""
    size = max(11, round(10 * canvas.unit))
    low, high = canvas.to_picture(view.outer.points).min(axis=0), canvas.to_picture(view.outer.points).max(axis=0)
    wide, tall = text_width(text, size, True) + size, round(1.6 * size)
    x = round(min(max(0.5 * (low[0] + high[0]) - 0.5 * wide, 0.0), canvas.picture.shape[1] - wide))
    y = round(min(max(low[1] - tall - 2.0, 0.0), canvas.picture.shape[0] - tall))
    cv2.rectangle(canvas.picture, (x, y), (x + wide, y + tall), rgb_to_bgr(style.PANEL_RGB), -1)
    put_text(canvas.picture, text, (x + size // 2, y + round(1.2 * size)), size, style.WHITE_RGB, True)


def write_parts(path: Path, parts: Sequence[KnownPart]) -> None:
    """A sheet of parts, each with its outline and its first grasp, as a file."""
    columns = min(_COLUMNS, len(parts))
    rows = -(-len(parts) // columns)
    sheet = np.empty((rows * (_TILE + _TITLE), columns * _TILE, 3), np.uint8)
    sheet[:] = rgb_to_bgr(style.PANEL_RGB)
    for i, part in enumerate(parts):
        top, left = (i // columns) * (_TILE + _TITLE), (i % columns) * _TILE
        height, width = part.image.shape[:2]
        scale = (_TILE - 8) / max(height, width)
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        tile = Canvas(np.asarray(cv2.resize(as_bgr(part.image), size), dtype=np.uint8), scale, 0.8)
        tile.draw_lines([c.points for c in part.view.contours], _KIND_RGB[0], 1.8, casing=3.4, closed=True)
        tile.draw_grasp_line(part.grasps[0].contacts, style.STATUS_RGB["tracked"])
        tile.draw_contacts(part.grasps[0].contacts, style.STATUS_RGB["tracked"])
        y, x = top + _TITLE + (_TILE - size[1]) // 2, left + (_TILE - size[0]) // 2
        sheet[y : y + size[1], x : x + size[0]] = tile.picture
        name = ellipsise_text(part.name, _TILE - 20, 16, True)
        put_text(sheet, name, (left + 10, top + 23), 16, style.WHITE_RGB, True)
    write_picture(path, sheet)
