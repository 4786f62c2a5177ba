# SPDX-License-Identifier: Apache-2.0
"""One frame and what the tracker said of it, as a picture to be understood at a glance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats
from grasptrack.view.geometry import cone_length, friction_cones
from grasptrack.view.strip import add_strip
from grasptrack.view.style import STATUS_RGB, Colour, Picture, blend_colour, put_text, rgb_to_bgr, text_width

if TYPE_CHECKING:
    from grasptrack.tracking.result import TrackResult

MIN_WIDTH, MAX_SIDE = 480, 1920
"""px; a smaller image is drawn enlarged, a larger one reduced: text can be read, and browsers play the video."""

_SHIFT = 4
_FAR = 1e6
_WHITE: Colour = (255, 255, 255)
_DARK: Colour = (12, 14, 18)


def draw_overlay(image: NDArray[Any], result: TrackResult, number: int | None = None) -> Picture:
    """The image with outline, grasp line, friction cones and contacts, and a strip below it that says how it stands.

    Args:
        image: grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4), of 8 or 16 bits.
        result: the tracker's answer for this image.
        number: of the frame, for the strip; default, the result's own.

    Returns:
        (H', W', 3) uint8 BGR, W' and the image's share of H' being those of the image where its longer side is at most
        1920 px and its width at least 480.
    """
    canvas, scale = _scaled_canvas(image)
    unit = math.sqrt(canvas.shape[0] * canvas.shape[1] / (640 * 480))
    unit = min(max(unit, 0.8), 3.0)
    colour = STATUS_RGB[result.status]
    _draw_outline(canvas, result, scale, unit)
    if result.contacts is not None:
        contacts = (result.contacts + 0.5) * scale - 0.5
        _draw_cones(canvas, result, scale, unit, colour)
        _draw_grasp_line(canvas, contacts, unit, colour)
        seen = np.ones(len(contacts)) if result.seen is None else result.seen
        _draw_contacts(canvas, contacts, seen, unit, colour)
    return add_strip(canvas, result, result.frame if number is None else number)


def as_bgr(image: NDArray[Any]) -> Picture:
    """(H, W, 3) uint8 BGR, a copy, of an image of any kind."""
    array = np.asarray(image)
    if array.dtype == np.uint16:
        array = (array >> 8).astype(np.uint8)
    elif array.dtype == np.bool_:
        array = array.astype(np.uint8) * 255
    if array.ndim == 2 or array.shape[2] == 1:
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(array), cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return np.ascontiguousarray(array[:, :, :3]).copy()


def draw_polyline(canvas: Picture, points: Floats, colour: Colour, width: float, closed: bool = False) -> None:
    """An anti-aliased line through points (n, 2) px, sub-pixel, in place."""
    fixed = np.rint(np.clip(points, -_FAR, _FAR) * (1 << _SHIFT)).astype(np.int32)
    cv2.polylines(canvas, [fixed], closed, rgb_to_bgr(colour), max(1, round(width)), cv2.LINE_AA, _SHIFT)


def draw_disc(canvas: Picture, centre: Floats, radius: float, colour: Colour, width: float = -1.0) -> None:
    """A filled circle, or a ring where a width is given, sub-pixel, in place."""
    x, y = np.rint(np.clip(centre, -_FAR, _FAR) * (1 << _SHIFT)).astype(int).tolist()
    thickness = -1 if width < 0 else max(1, round(width))
    cv2.circle(canvas, (x, y), round(radius * (1 << _SHIFT)), rgb_to_bgr(colour), thickness, cv2.LINE_AA, _SHIFT)


def _scaled_canvas(image: NDArray[Any]) -> tuple[Picture, float]:
    height, width = image.shape[:2]
    scale = 1.0
    if max(height, width) > MAX_SIDE:
        scale = MAX_SIDE / max(height, width)
    elif width < MIN_WIDTH:
        scale = float(min(math.ceil(MIN_WIDTH / width), max(1, MAX_SIDE // height)))
    picture = as_bgr(image)
    if scale == 1.0:
        return picture, scale
    how = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_NEAREST
    size = (round(width * scale), round(height * scale))
    return np.asarray(cv2.resize(picture, size, interpolation=how), dtype=np.uint8), scale


def _draw_outline(canvas: Picture, result: TrackResult, scale: float, unit: float) -> None:
    if result.view is None:
        return
    curves = [(c.points + 0.5) * scale - 0.5 for c in result.view.contours]
    for curve in curves:
        draw_polyline(canvas, curve, _DARK, 3.2 * unit, closed=True)
    for curve in curves:
        draw_polyline(canvas, curve, _WHITE, 1.2 * unit, closed=True)


def _draw_cones(canvas: Picture, result: TrackResult, scale: float, unit: float, colour: Colour) -> None:
    assert result.contacts is not None
    length = cone_length(result.contacts * scale, unit)
    for polygon in friction_cones(result, length / scale):
        shape = (polygon + 0.5) * scale - 0.5
        if not (np.abs(shape) < _FAR).all():
            continue
        low = np.floor(shape.min(axis=0)).astype(int) - 2
        size = np.ceil(shape.max(axis=0)).astype(int) + 3 - low
        mask = np.zeros((size[1], size[0]), np.uint8)
        fixed = np.rint((shape - low) * (1 << _SHIFT)).astype(np.int32)
        cv2.fillPoly(mask, [fixed], 140, cv2.LINE_AA, _SHIFT)
        blend_colour(canvas, mask, int(low[0]), int(low[1]), colour)
        draw_polyline(canvas, np.vstack([shape[1], shape[0], shape[-1]]), colour, 1.2 * unit)


def _draw_grasp_line(canvas: Picture, contacts: Floats, unit: float, colour: Colour) -> None:
    middle = contacts.mean(axis=0)
    spokes = [contacts] if len(contacts) == 2 else [np.vstack([middle, c]) for c in contacts]
    for spoke in spokes:
        draw_polyline(canvas, spoke, _DARK, 4.0 * unit)
    for spoke in spokes:
        draw_polyline(canvas, spoke, colour, 2.0 * unit)


def _draw_contacts(canvas: Picture, contacts: Floats, seen: Floats, unit: float, colour: Colour) -> None:
    middle = contacts.mean(axis=0)
    for i, (contact, share) in enumerate(zip(contacts, seen, strict=False)):
        if share >= 0.5:
            draw_disc(canvas, contact, 7.6 * unit, _DARK)
            draw_disc(canvas, contact, 6.4 * unit, _WHITE)
            draw_disc(canvas, contact, 4.6 * unit, colour)
        else:
            draw_disc(canvas, contact, 6.6 * unit, _DARK, 5.0 * unit)
            draw_disc(canvas, contact, 6.6 * unit, _WHITE, 1.8 * unit)
        away = contact - middle
        away = away / max(float(np.linalg.norm(away)), 1e-9)
        _draw_number(canvas, str(i + 1), contact + 20.0 * unit * away, unit)


def _draw_number(canvas: Picture, text: str, centre: Floats, unit: float) -> None:
    """A number on a dark disc, which is kept inside the picture so that a contact beyond its border is still named."""
    radius, size = 8.5 * unit, round(12 * unit)
    room = np.array([canvas.shape[1] - 1, canvas.shape[0] - 1]) - radius
    at = np.minimum(np.maximum(centre, radius), room)
    draw_disc(canvas, at, radius, _DARK)
    x = round(at[0] - text_width(text, size, bold=True) / 2)
    put_text(canvas, text, x, round(at[1] + 0.37 * size), size, _WHITE, bold=True)
