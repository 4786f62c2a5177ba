# SPDX-License-Identifier: Apache-2.0
"""One frame and what the tracker said of it, as a picture to be understood at a glance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.files import whole_file
from grasptrack.geometry.contours import Outline, View, as_view
from grasptrack.presentation import format_confidence
from grasptrack.tracking.messages import SENTENCES
from grasptrack.typing import Floats
from grasptrack.view import style
from grasptrack.view.style import Colour, Picture, blend_colour, ellipsise_text, put_text, rgb_to_bgr, text_width

if TYPE_CHECKING:
    from grasptrack.segmentation.candidate import Candidate
    from grasptrack.tracking.result import TrackResult


_CHIP_INK: Colour = (10, 14, 18)


def add_strip(canvas: Picture, result: TrackResult, number: int) -> Picture:
    """The canvas (H, W, 3) with a strip below it; the strip's height is about 58 px at a width of 640."""
    width = canvas.shape[1]
    em = max(11, min(round(width / 640 * 14), 40))
    height = 2 * round(2.05 * em)
    strip = np.empty((height, width, 3), np.uint8)
    strip[:] = rgb_to_bgr(style.PANEL_RGB)
    colour = style.STATUS_RGB[result.status]
    strip[: max(2, round(0.2 * em))] = rgb_to_bgr(colour)
    pad = round(0.75 * em)
    first, second = round(1.72 * em), round(3.3 * em)

    small = max(10, round(0.86 * em))
    left = _draw_status_chip(strip, result.status, pad, first, em, colour) + pad
    stable = SENTENCES[result.notice] if result.notice else "stable"
    reason = " ".join(result.reason.split()) or (f"grasp located, {stable}" if result.status == "tracked" else "")
    size = em if text_width(reason, em) <= width - pad - left else small
    ink = style.MUTED_RGB if result.status == "tracked" else style.INK_RGB
    put_text(strip, ellipsise_text(reason, width - pad - left, size), left, first, size, ink)

    room = _draw_confidence(strip, result, pad, second, small, colour)
    _draw_figures(strip, result, number, (pad, room - pad), second, small)
    return np.vstack([canvas, strip])


def _draw_status_chip(strip: Picture, status: str, x: int, baseline: int, em: int, colour: Colour) -> int:
    """The status on a rounded plate; returns where the plate ends."""
    text = status.upper()
    size = max(10, round(0.86 * em))
    wide = text_width(text, size, bold=True) + round(1.2 * em)
    top, bottom = baseline - round(1.08 * em), baseline + round(0.42 * em)
    radius = (bottom - top) // 2
    for cx in (x + radius, x + wide - radius):
        cv2.circle(strip, (cx, top + radius), radius, rgb_to_bgr(colour), -1, cv2.LINE_AA)
    cv2.rectangle(strip, (x + radius, top), (x + wide - radius, top + 2 * radius), rgb_to_bgr(colour), -1)
    put_text(strip, text, x + round(0.6 * em), baseline, size, _CHIP_INK, bold=True)
    return x + wide


def _draw_confidence(strip: Picture, result: TrackResult, pad: int, baseline: int, size: int, colour: Colour) -> int:
    """The confidence as a bar and a number, flush right; returns where they begin.

    With as many digits as keep it from reading as certain. Of a lost frame it is that of a guess, not given out, and grey.
    """
    confidence, label, ink = result.confidence, "confidence", style.INK_RGB
    number = format_confidence(confidence, 2)
    if result.status == "lost":
        label, colour, ink = "best guess", style.MUTED_RGB, style.MUTED_RGB
    gap = round(0.6 * size)
    bar = round(0.16 * strip.shape[1])
    x: int = strip.shape[1] - pad - text_width(number, size, bold=True)
    put_text(strip, number, x, baseline, size, ink, bold=True)
    x -= bar + gap
    top, bottom = baseline - round(0.62 * size), baseline - round(0.1 * size)
    cv2.rectangle(strip, (x, top), (x + bar, bottom), rgb_to_bgr(style.RULE_RGB), -1)
    full = round(bar * min(max(confidence, 0.0), 1.0))
    if full > 0:
        cv2.rectangle(strip, (x, top), (x + full, bottom), rgb_to_bgr(colour), -1)
    x -= text_width(label, size) + gap
    put_text(strip, label, x, baseline, size, style.MUTED_RGB)
    return x


def _draw_figures(
    strip: Picture, result: TrackResult, number: int, within: tuple[int, int], baseline: int, size: int
) -> None:
    """Frame, strategy, margin, chance of closing, time and latency from the left, as far as there is room within."""
    entries = [("frame", str(number))]
    if result.strategy:
        entries.append(("by", result.strategy))
    if result.analysis is not None and math.isfinite(result.analysis.margin):
        entries.append(("margin", f"{math.degrees(result.analysis.margin):+.1f}°"))
    if math.isfinite(result.chance):
        entries.append(("closes", f"{100.0 * result.chance:.0f} %"))
    if result.time is not None:
        entries.append(("at", f"{result.time:.2f} s"))
    if math.isfinite(result.latency_ms):
        entries.append(("in", f"{result.latency_ms:.1f} ms"))
    (at, room), gap = within, round(0.4 * size)
    for label, value in entries:
        wide = text_width(label, size)
        end = at + wide + gap + text_width(value, size)
        if end > room:
            break
        put_text(strip, label, at, baseline, size, style.MUTED_RGB)
        put_text(strip, value, at + wide + gap, baseline, size, style.INK_RGB)
        at = end + round(1.1 * size)


MIN_WIDTH, MAX_SIDE = 480, 1920
"""px; a smaller image is drawn enlarged, a larger one reduced: text can be read, and browsers play the video."""

MOST_BESIDE = 8
"""Grasps that are drawn beside the best."""

_DASH = 9.0
"""Length of a dash, and of the gap after it, px at a width of 640."""
_SHIFT = 4
_FAR = 1e6


def draw_overlay(
    image: NDArray[Any], result: TrackResult, number: int | None = None, last: View | None = None
) -> Picture:
    """The image with outline, grasp line, friction cones and contacts, and a strip below it that says how it stands.

    Args:
        image: grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4), of 8 or 16 bits.
        result: the tracker's answer for this image.
        number: of the frame, for the strip; default, the result's own.
        last: where the object was when it was located last: drawn dashed while it is lost.

    Returns:
        (H', W', 3) uint8 BGR, W' and the image's share of H' being those of the image where its longer side is at most
        1920 px and its width at least 480.
    """
    canvas, scale, unit = _scaled_canvas(image)
    colour = style.STATUS_RGB[result.status]
    if result.status == "lost" and last is not None:
        _draw_last_outline(canvas, last, scale, unit)
    elif result.view is not None:
        _draw_outline(canvas, result.view, scale, unit)
    if result.contacts is not None:
        contacts = (result.contacts + 0.5) * scale - 0.5
        _draw_cones(canvas, result, scale, unit, colour)
        _draw_grasp_line(canvas, contacts, unit, colour)
        seen = np.ones(len(contacts)) if result.seen is None else result.seen
        _draw_contacts(canvas, contacts, seen, unit, colour)
    return add_strip(canvas, result, result.frame if number is None else number)


def draw_grasps(image: NDArray[Any], grasps: Sequence[Floats], outline: Outline | None = None) -> Picture:
    """The image with an outline and grasps, the first of which stands out.

    Args:
        image: as for `draw_overlay`; the picture is of the same size as there, without the strip.
        grasps: contacts (k, 2) px of each; up to 9 are drawn.
        outline: in the image.
    """
    canvas, scale, unit = _scaled_canvas(image)
    if outline is not None:
        _draw_outline(canvas, as_view(outline), scale, unit)
    for contacts in grasps[1 : 1 + MOST_BESIDE]:
        for spoke in grasp_spokes((contacts + 0.5) * scale - 0.5):
            draw_polyline(canvas, spoke, style.MUTED_RGB, 1.2 * unit)
    if len(grasps):
        best, colour = (grasps[0] + 0.5) * scale - 0.5, style.STATUS_RGB["tracked"]
        _draw_grasp_line(canvas, best, unit, colour)
        _draw_contacts(canvas, best, np.ones(len(best)), unit, colour)
    return canvas


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


def _scaled_canvas(image: NDArray[Any]) -> tuple[Picture, float, float]:
    """A copy to draw on, how much larger than the image it is, and the size of marks on it."""
    height, width = image.shape[:2]
    scale = 1.0
    if max(height, width) > MAX_SIDE:
        scale = MAX_SIDE / max(height, width)
    elif width < MIN_WIDTH:
        scale = float(min(math.ceil(MIN_WIDTH / width), max(1, MAX_SIDE // height)))
    picture = as_bgr(image)
    if scale != 1.0:
        how = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_NEAREST
        size = (round(width * scale), round(height * scale))
        picture = np.asarray(cv2.resize(picture, size, interpolation=how), dtype=np.uint8)
    unit = math.sqrt(picture.shape[0] * picture.shape[1] / (640 * 480))
    return picture, scale, min(max(unit, 0.8), 3.0)


def _draw_outline(canvas: Picture, view: View, scale: float, unit: float) -> None:
    curves = [(c.points + 0.5) * scale - 0.5 for c in view.contours]
    for curve in curves:
        draw_polyline(canvas, curve, style.DARK_RGB, 3.2 * unit, closed=True)
    for curve in curves:
        draw_polyline(canvas, curve, style.WHITE_RGB, 1.2 * unit, closed=True)


def _draw_last_outline(canvas: Picture, view: View, scale: float, unit: float) -> None:
    """Dashed, in the colour of what is lost."""
    for contour in view.contours:
        arc = contour.arc_length
        dashes = max(4, round(arc[-1] * scale / (2.0 * _DASH * unit)))
        ends = np.linspace(0.0, arc[-1], 2 * dashes + 1)
        curve = np.vstack([contour.points, contour.points[:1]])
        for start, end in zip(ends[:-1:2], ends[1::2], strict=True):
            at = np.linspace(start, end, max(2, math.ceil((end - start) * scale / 3.0)))
            dash = np.column_stack([np.interp(at, arc, curve[:, axis]) for axis in (0, 1)])
            dash = (dash + 0.5) * scale - 0.5
            draw_polyline(canvas, dash, style.DARK_RGB, 3.2 * unit)
            draw_polyline(canvas, dash, style.STATUS_RGB["lost"], 1.6 * unit)


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
    for spoke in grasp_spokes(contacts):
        draw_polyline(canvas, spoke, style.DARK_RGB, 4.0 * unit)
    for spoke in grasp_spokes(contacts):
        draw_polyline(canvas, spoke, colour, 2.0 * unit)


def _draw_contacts(canvas: Picture, contacts: Floats, seen: Floats, unit: float, colour: Colour) -> None:
    middle = contacts.mean(axis=0)
    for i, (contact, share) in enumerate(zip(contacts, seen, strict=False)):
        if share >= 0.5:
            draw_disc(canvas, contact, 7.6 * unit, style.DARK_RGB)
            draw_disc(canvas, contact, 6.4 * unit, style.WHITE_RGB)
            draw_disc(canvas, contact, 4.6 * unit, colour)
        else:
            draw_disc(canvas, contact, 6.6 * unit, style.DARK_RGB, 5.0 * unit)
            draw_disc(canvas, contact, 6.6 * unit, style.WHITE_RGB, 1.8 * unit)
        away = contact - middle
        away = away / max(float(np.linalg.norm(away)), 1e-9)
        _draw_number(canvas, str(i + 1), contact + 20.0 * unit * away, unit)


def _draw_number(canvas: Picture, text: str, centre: Floats, unit: float) -> None:
    """A number on a dark disc, which is kept inside the picture so that a contact beyond its border is still named."""
    radius, size = 8.5 * unit, round(12 * unit)
    room = np.array([canvas.shape[1] - 1, canvas.shape[0] - 1]) - radius
    at = np.minimum(np.maximum(centre, radius), room)
    draw_disc(canvas, at, radius, style.DARK_RGB)
    x = round(at[0] - text_width(text, size, bold=True) / 2)
    put_text(canvas, text, x, round(at[1] + 0.37 * size), size, style.WHITE_RGB, bold=True)


# --- candidates of a first look --------------------------------------------------------------------

CANDIDATE_RGB = (style.STATUS_RGB["tracked"], style.STRATEGY_RGB["rrp"], style.FINGER_RGB)


def draw_candidates(image: NDArray[Any], candidates: Sequence[Candidate]) -> Picture:
    """The image (H, W, 3) BGR with the outlines of up to three candidates and their numbers, 1 being the likeliest."""
    from grasptrack.images import to_bgr

    picture = as_bgr(to_bgr(image))
    size = max(16, round(picture.shape[0] / 24))
    for number in range(min(3, len(candidates)), 0, -1):
        candidate, colour = candidates[number - 1], CANDIDATE_RGB[number - 1]
        for contour in candidate.view.contours:
            draw_polyline(picture, contour.points, (0, 0, 0), max(3, size // 5), closed=True)
            draw_polyline(picture, contour.points, colour, max(2, size // 9), closed=True)
    lines = [f"{number}   {100.0 * c.probability:.0f} %" for number, c in enumerate(candidates[:3], 1)]
    wide = max((text_width(line, size, True) for line in lines), default=0)
    picture[: round(1.4 * size * len(lines) + 0.5 * size), : wide + 2 * size] = rgb_to_bgr(style.PANEL_RGB)
    for row, line in enumerate(lines):
        put_text(picture, line, size, round(1.4 * size * (row + 1)), size, CANDIDATE_RGB[row], True)
    return picture


def write_candidates(path: Path, image: NDArray[Any], candidates: Sequence[Candidate]) -> None:
    """The picture as a file.

    Raises:
        OSError: it cannot be written.
    """
    good, data = cv2.imencode(path.suffix, draw_candidates(image, candidates))
    if not good:
        raise OSError(f'"{path}" cannot be written')
    with whole_file(path) as part:
        part.write_bytes(data.tobytes())


# --- what stands for a grasp in any picture ---------------------------------------------------------

_ARC = np.linspace(-1.0, 1.0, 13)


def grasp_spokes(contacts: Floats) -> list[Floats]:
    """The lines (2, 2) that stand for a grasp: between two contacts, from the middle to each of more."""
    middle = contacts.mean(axis=0)
    return [contacts] if len(contacts) == 2 else [np.vstack([middle, c]) for c in contacts]


def sector_polygon(apex: Floats, direction: Floats, half_angle: float, length: float) -> Floats:
    """A sector as a closed polygon (m, 2) px.

    Args:
        apex: (2,) px.
        direction: (2,) of its middle.
        half_angle: rad.
        length: px from apex to arc.
    """
    angles = math.atan2(direction[1], direction[0]) + half_angle * np.linspace(-1.0, 1.0, 17)
    return np.vstack([apex, apex + length * np.column_stack([np.cos(angles), np.sin(angles)])])


def friction_cones(result: TrackResult, length: float) -> list[Floats]:
    """Friction cones as closed polygons (m, 2) px of the current image: apex at the contact, opening into the material.

    A cone that was judged in the object's own plane, or in the reference view, is bent by the same perspective as the object:
    each of its directions is carried over by the derivative of the homography at the contact.

    Args:
        result: contacts and their analysis; empty without them.
        length: px from apex to arc.
    """
    if result.contacts is None or result.analysis is None:
        return []
    half, H = math.atan(result.analysis.friction), None
    if result.homography is not None and result.analysis.judged_in == "reference":
        H = result.homography
    elif result.homography is not None and result.rectification is not None and result.analysis.judged_in == "plane":
        H = result.homography @ np.linalg.inv(result.rectification)
    polygons = []
    for contact, normal in zip(result.contacts, result.analysis.normals, strict=False):
        angles = math.atan2(normal[1], normal[0]) + half * _ARC
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        if H is not None:
            directions = directions @ jacobian_at(H, contact).T
        norms = np.linalg.norm(directions, axis=1, keepdims=True)
        if not np.isfinite(norms).all() or norms.min() <= 0.0:
            continue
        polygons.append(np.vstack([contact, contact + length * directions / norms]))
    return polygons


def jacobian_at(H_current_reference: Floats, point: Floats) -> Floats:
    """(2, 2) derivative of a homography at the reference point that it maps to `point` of the current view."""
    H = H_current_reference / np.linalg.norm(H_current_reference)
    u, v, w = np.linalg.solve(H, np.array([point[0], point[1], 1.0]))
    scale = float(H[2] @ np.array([u / w, v / w, 1.0]))
    x, y = point
    J: Floats = np.array([H[0, :2] - x * H[2, :2], H[1, :2] - y * H[2, :2]]) / scale
    return J


def cone_length(contacts: Floats, unit: float) -> float:
    """px; a third of the way to the contacts' middle on either side, within what is legible."""
    reach = float(np.linalg.norm(contacts - contacts.mean(axis=0), axis=1).mean())
    return min(max(0.62 * reach, 14.0 * unit), 64.0 * unit)
