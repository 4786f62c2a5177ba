# SPDX-License-Identifier: Apache-2.0
"""One frame and what the tracker said of it, as a picture to be understood at a glance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.contours import Outline, View, as_view
from grasptrack.images import to_bgr
from grasptrack.presentation import format_confidence
from grasptrack.segmentation.candidate import Candidate
from grasptrack.tracking.messages import SENTENCES
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats
from grasptrack.view import style
from grasptrack.view.style import Colour, Picture, blend_colour, ellipsise_text, put_text, rgb_to_bgr, text_width

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
    put_text(strip, ellipsise_text(reason, width - pad - left, size), (left, first), size, ink)

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
    put_text(strip, text, (x + round(0.6 * em), baseline), size, _CHIP_INK, bold=True)
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
    put_text(strip, number, (x, baseline), size, ink, bold=True)
    x -= bar + gap
    top, bottom = baseline - round(0.62 * size), baseline - round(0.1 * size)
    cv2.rectangle(strip, (x, top), (x + bar, bottom), rgb_to_bgr(style.RULE_RGB), -1)
    full = round(bar * min(max(confidence, 0.0), 1.0))
    if full > 0:
        cv2.rectangle(strip, (x, top), (x + full, bottom), rgb_to_bgr(colour), -1)
    x -= text_width(label, size) + gap
    put_text(strip, label, (x, baseline), size, style.MUTED_RGB)
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
        put_text(strip, label, (at, baseline), size, style.MUTED_RGB)
        put_text(strip, value, (at + wide + gap, baseline), size, style.INK_RGB)
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
    canvas, colour = enlarged_canvas(image), style.STATUS_RGB[result.status]
    if result.status == "lost" and last is not None:
        canvas.draw_last_outline(last)
    elif result.view is not None:
        canvas.draw_outline([c.points for c in result.view.contours])
    if result.contacts is not None:
        canvas.draw_cones(result, colour)
        canvas.draw_grasp_line(result.contacts, colour)
        canvas.draw_contacts(result.contacts, colour, result.seen)
    return add_strip(canvas.picture, result, result.frame if number is None else number)


def draw_grasps(image: NDArray[Any], grasps: Sequence[Floats], outline: Outline | None = None) -> Picture:
    """The image with an outline and grasps, the first of which stands out.

    Args:
        image: as for `draw_overlay`; the picture is of the same size as there, without the strip.
        grasps: contacts (k, 2) px of each; up to 9 are drawn.
        outline: in the image.
    """
    canvas, colour = enlarged_canvas(image), style.STATUS_RGB["tracked"]
    if outline is not None:
        canvas.draw_outline([c.points for c in as_view(outline).contours])
    for contacts in grasps[1 : 1 + MOST_BESIDE]:
        canvas.draw_lines(grasp_spokes(contacts), style.MUTED_RGB, 1.2, casing=0.0)
    if len(grasps):
        canvas.draw_grasp_line(grasps[0], colour)
        canvas.draw_contacts(grasps[0], colour)
    return canvas.picture


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


class Canvas:
    """A picture, and what is drawn onto it, in place, at px of the image that it shows. `panel.Panel` does so on pages.

    Args:
        picture: (H, W, 3) uint8 BGR.
        scale: px of the picture for one of the image.
        unit: size of marks, 1 on 640 by 480 px.
        corner: px of the image at the upper left corner of the picture.
    """

    def __init__(
        self, picture: Picture, scale: float = 1.0, unit: float = 1.0, corner: tuple[float, float] = (-0.5, -0.5)
    ) -> None:
        self.picture, self.scale, self.unit = picture, scale, unit
        self._corner = np.array(corner)

    def to_picture(self, points: Floats) -> Floats:
        """Points (..., 2) px of the image as px of the picture."""
        return np.asarray((points - self._corner) * self.scale - 0.5, dtype=np.float64)

    def draw_lines(
        self, lines: Sequence[Floats], colour: Colour, width: float, casing: float, closed: bool = False
    ) -> None:
        """Lines through points (n, 2), `width` wide, on dark ones of the width `casing`, which lie below all of them."""
        fixed = [_fixed_point(self.to_picture(line)) for line in lines]
        for ink, wide in ((style.DARK_RGB, casing), (colour, width)):
            for line in fixed if wide else ():
                thickness = max(1, round(wide * self.unit))
                cv2.polylines(self.picture, [line], closed, rgb_to_bgr(ink), thickness, cv2.LINE_AA, _SHIFT)

    def draw_disc(self, centre: Floats, radius: float, colour: Colour, width: float = 0.0) -> None:
        """A filled circle, or a ring where a width is given."""
        x, y = _fixed_point(self.to_picture(centre)).tolist()
        thickness, size = max(1, round(width * self.unit)) if width else -1, round(radius * self.unit * (1 << _SHIFT))
        cv2.circle(self.picture, (x, y), size, rgb_to_bgr(colour), thickness, cv2.LINE_AA, _SHIFT)

    def draw_ring(self, centre: Floats, radius: float, colour: Colour, width: float, casing: float) -> None:
        """A ring on a dark one of the width `casing`."""
        self.draw_disc(centre, radius, style.DARK_RGB, casing)
        self.draw_disc(centre, radius, colour, width)

    def draw_outline(self, curves: Sequence[Floats]) -> None:
        """The closed curves (n, 2) of the object's outline."""
        self.draw_lines(curves, style.WHITE_RGB, 1.2, casing=3.2, closed=True)

    def draw_last_outline(self, view: View) -> None:
        """An outline dashed, in the colour of what is lost."""
        for contour in view.contours:
            arc = contour.arc_length
            dashes = max(4, round(arc[-1] * self.scale / (2.0 * _DASH * self.unit)))
            ends = np.linspace(0.0, arc[-1], 2 * dashes + 1)
            curve = np.vstack([contour.points, contour.points[:1]])
            for start, end in zip(ends[:-1:2], ends[1::2], strict=True):
                at = np.linspace(start, end, max(2, math.ceil((end - start) * self.scale / 3.0)))
                dash = np.column_stack([np.interp(at, arc, curve[:, axis]) for axis in (0, 1)])
                self.draw_lines([dash], style.STATUS_RGB["lost"], 1.6, casing=3.2)

    def draw_cones(self, result: TrackResult, colour: Colour) -> None:
        """Friction cones, translucent."""
        assert result.contacts is not None
        for polygon in friction_cones(result, cone_length(result.contacts, self.unit / self.scale)):
            shape = self.to_picture(polygon)
            if not (np.abs(shape) < _FAR).all():
                continue
            low = np.floor(shape.min(axis=0)).astype(int) - 2
            size = np.ceil(shape.max(axis=0)).astype(int) + 3 - low
            mask = np.zeros((size[1], size[0]), np.uint8)
            cv2.fillPoly(mask, [_fixed_point(shape - low)], 140, cv2.LINE_AA, _SHIFT)
            blend_colour(self.picture, mask, int(low[0]), int(low[1]), colour)
            self.draw_lines([np.vstack([polygon[1], polygon[0], polygon[-1]])], colour, 1.2, casing=0.0)

    def draw_grasp_line(self, contacts: Floats, colour: Colour) -> None:
        """The lines that stand for a grasp."""
        self.draw_lines(grasp_spokes(contacts), colour, 2.0, casing=4.0)

    def draw_contact(self, contact: Floats, colour: Colour, seen: bool = True) -> None:
        """A contact as a dot, or as a ring where its edge is not seen."""
        if seen:
            self.draw_disc(contact, 7.6, style.DARK_RGB)
            self.draw_disc(contact, 6.4, style.WHITE_RGB)
            self.draw_disc(contact, 4.6, colour)
        else:
            self.draw_ring(contact, 6.6, style.WHITE_RGB, 1.8, casing=5.0)

    def draw_contacts(self, contacts: Floats, colour: Colour, seen: Floats | None = None) -> None:
        """Contacts with their numbers; `seen` is the share of each one's edge that is seen, None for all of it."""
        shares = np.ones(len(contacts)) if seen is None else seen
        places = contacts + 20.0 * self.unit / self.scale * outward_directions(contacts)
        for i, (contact, share, place) in enumerate(zip(contacts, shares, places, strict=False)):
            self.draw_contact(contact, colour, bool(share >= 0.5))
            self._draw_number(str(i + 1), place)

    def _draw_number(self, text: str, centre: Floats) -> None:
        """A number on a dark disc, which is kept inside the picture so that a contact beyond its border is still named."""
        radius, size = 8.5 * self.unit, round(12 * self.unit)
        room = np.array([self.picture.shape[1] - 1, self.picture.shape[0] - 1]) - radius
        at = np.minimum(np.maximum(self.to_picture(centre), radius), room)
        Canvas(self.picture, unit=self.unit).draw_disc(at, 8.5, style.DARK_RGB)
        x = round(at[0] - text_width(text, size, bold=True) / 2)
        put_text(self.picture, text, (x, round(at[1] + 0.37 * size)), size, style.WHITE_RGB, bold=True)


def _fixed_point(points: Floats) -> NDArray[np.int32]:
    """px in the fixed-point numbers that OpenCV draws sub-pixel with."""
    return np.rint(np.clip(points, -_FAR, _FAR) * (1 << _SHIFT)).astype(np.int32)


def enlarged_canvas(image: NDArray[Any]) -> Canvas:
    """A canvas with a copy of an image, enlarged or reduced so that what is drawn can be read."""
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
    return Canvas(picture, scale, min(max(unit, 0.8), 3.0))


# --- candidates of a first look --------------------------------------------------------------------

CANDIDATE_RGB = (style.STATUS_RGB["tracked"], style.STRATEGY_RGB["rrp"], style.FINGER_RGB)


def draw_candidates(image: NDArray[Any], candidates: Sequence[Candidate]) -> Picture:
    """The image (H, W, 3) BGR with the outlines of up to three candidates and their numbers, 1 being the likeliest."""
    picture = as_bgr(to_bgr(image))
    canvas, size = Canvas(picture), max(16, round(picture.shape[0] / 24))
    for number in range(min(3, len(candidates)), 0, -1):
        for contour in candidates[number - 1].view.contours:
            wide = max(2, size // 9)
            canvas.draw_lines([contour.points], CANDIDATE_RGB[number - 1], wide, max(3, size // 5), closed=True)
    lines = [f"{number}   {100.0 * c.probability:.0f} %" for number, c in enumerate(candidates[:3], 1)]
    wide = max((text_width(line, size, True) for line in lines), default=0)
    picture[: round(1.4 * size * len(lines) + 0.5 * size), : wide + 2 * size] = rgb_to_bgr(style.PANEL_RGB)
    for row, line in enumerate(lines):
        put_text(picture, line, (size, round(1.4 * size * (row + 1))), size, CANDIDATE_RGB[row], True)
    return picture


# --- what stands for a grasp in any picture ---------------------------------------------------------

_ARC = np.linspace(-1.0, 1.0, 13)


def grasp_spokes(contacts: Floats) -> list[Floats]:
    """The lines (2, 2) that stand for a grasp: between two contacts, from the middle to each of more."""
    middle = contacts.mean(axis=0)
    return [contacts] if len(contacts) == 2 else [np.vstack([middle, c]) for c in contacts]


def outward_directions(contacts: Floats) -> Floats:
    """(k, 2) unit vectors from the middle of the contacts toward each: where its number stands."""
    away = contacts - contacts.mean(axis=0)
    return np.asarray(away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9))


def sector_polygon(
    apex: Floats, direction: Floats, half_angle: float, length: float, bent_by: Floats | None = None
) -> Floats:
    """A sector as a closed polygon (m, 2) px, from its apex, px, so many rad to both sides of a direction, px long to the arc.

    `bent_by` (2, 2) maps each of its directions; None where nothing does.
    """
    angles = math.atan2(direction[1], direction[0]) + half_angle * _ARC
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    if bent_by is not None:
        ways = ways @ bent_by.T
        sizes = np.linalg.norm(ways, axis=1, keepdims=True)
        ways = ways / np.where(sizes > 0.0, sizes, np.nan)
    return np.vstack([apex, apex + length * ways])


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
    polygons = [
        sector_polygon(contact, normal, half, length, None if H is None else jacobian_at(H, contact))
        for contact, normal in zip(result.contacts, result.analysis.normals, strict=False)
    ]
    return [polygon for polygon in polygons if np.isfinite(polygon).all()]


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
