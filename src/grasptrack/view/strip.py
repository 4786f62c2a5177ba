# SPDX-License-Identifier: Apache-2.0
"""The strip below a frame: status, reason, strategy, margin, chance, confidence. It hides nothing of the image."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cv2
import numpy as np

from grasptrack.tracking.messages import SENTENCES
from grasptrack.view.style import (
    INK_RGB,
    MUTED_RGB,
    PANEL_RGB,
    RULE_RGB,
    STATUS_RGB,
    Colour,
    Picture,
    ellipsise_text,
    put_text,
    rgb_to_bgr,
    text_width,
)

if TYPE_CHECKING:
    from grasptrack.tracking.result import TrackResult

_CHIP_INK: Colour = (10, 14, 18)


def add_strip(canvas: Picture, result: TrackResult, number: int) -> Picture:
    """The canvas (H, W, 3) with a strip below it; the strip's height is about 58 px at a width of 640."""
    width = canvas.shape[1]
    em = max(11, min(round(width / 640 * 14), 40))
    height = 2 * round(2.05 * em)
    strip = np.empty((height, width, 3), np.uint8)
    strip[:] = rgb_to_bgr(PANEL_RGB)
    colour = STATUS_RGB[result.status]
    strip[: max(2, round(0.2 * em))] = rgb_to_bgr(colour)
    pad = round(0.75 * em)
    first, second = round(1.72 * em), round(3.3 * em)

    small = max(10, round(0.86 * em))
    left = _draw_status_chip(strip, result.status, pad, first, em, colour) + pad
    stable = SENTENCES[result.notice] if result.notice else "stable"
    reason = " ".join(result.reason.split()) or (f"grasp located, {stable}" if result.status == "tracked" else "")
    size = em if text_width(reason, em) <= width - pad - left else small
    ink = MUTED_RGB if result.status == "tracked" else INK_RGB
    put_text(strip, ellipsise_text(reason, width - pad - left, size), left, first, size, ink)

    room = _draw_confidence(strip, result.confidence, pad, second, small, colour)
    _draw_figures(strip, result, number, pad, room, second, small)
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


def _draw_confidence(strip: Picture, confidence: float, pad: int, baseline: int, size: int, colour: Colour) -> int:
    """The confidence as a bar and a number, flush right; returns where they begin."""
    gap = round(0.6 * size)
    bar = round(0.16 * strip.shape[1])
    x: int = strip.shape[1] - pad - text_width("0.00", size, bold=True)
    put_text(strip, f"{confidence:.2f}", x, baseline, size, INK_RGB, bold=True)
    x -= bar + gap
    top, bottom = baseline - round(0.62 * size), baseline - round(0.1 * size)
    cv2.rectangle(strip, (x, top), (x + bar, bottom), rgb_to_bgr(RULE_RGB), -1)
    full = round(bar * min(max(confidence, 0.0), 1.0))
    if full > 0:
        cv2.rectangle(strip, (x, top), (x + full, bottom), rgb_to_bgr(colour), -1)
    x -= text_width("confidence", size) + gap
    put_text(strip, "confidence", x, baseline, size, MUTED_RGB)
    return x


def _draw_figures(
    strip: Picture, result: TrackResult, number: int, pad: int, room: int, baseline: int, size: int
) -> None:
    """Frame, strategy, margin, chance of closing, time and latency from the left, as far as there is room."""
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
    at, gap = pad, round(0.4 * size)
    for label, value in entries:
        wide = text_width(label, size)
        end = at + wide + gap + text_width(value, size)
        if end > room - pad:
            break
        put_text(strip, label, at, baseline, size, MUTED_RGB)
        put_text(strip, value, at + wide + gap, baseline, size, INK_RGB)
        at = end + round(1.1 * size)
