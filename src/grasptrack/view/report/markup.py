# SPDX-License-Identifier: Apache-2.0
"""Text and numbers as they stand in HTML; what is not known is a dash."""

from __future__ import annotations

import base64
import html
import math
import re

import cv2
import numpy as np
from numpy.typing import NDArray

DASH = "–"
"""Where there is no value."""
_QUALITY = 86


def escape_html(text: object) -> str:
    """Text that is safe in HTML, in attributes too."""
    return html.escape(str(text), quote=True)


def make_slug(text: str) -> str:
    """A name that may stand in an id or a CSS variable."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "x"


def inline_markup(text: str) -> str:
    """Escaped text in which `code` and **weight** are marked as in Markdown."""
    safe = escape_html(text)
    safe = re.sub(r"`([^`]+)`", r"<code>\1</code>", safe)
    return re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", safe)


def format_number(value: float | int | None, digits: int = 3, unit: str = "") -> str:
    """A number to so many significant digits, a dash for one that is none, a sign for an infinite one."""
    if value is None or math.isnan(value):
        return DASH
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if isinstance(value, int):
        text = f"{value:,}".replace(",", "\u202f") if abs(value) >= 10000 else str(value)
    else:
        size = abs(value)
        places = digits - 1 - math.floor(math.log10(size)) if size > 0.0 else 0
        text = f"{value:.2e}" if 0.0 < size < 1e-4 else f"{value:.{max(0, min(places, 6))}f}"
    text = text.replace("-", "−")
    return f"{text}\u00a0{unit}" if unit else text


def format_fixed(value: float | None, decimals: int) -> str:
    """A number with so many decimals, so that a column of them lines up."""
    if value is None or math.isnan(value):
        return DASH
    return format_number(value) if math.isinf(value) else f"{value:.{decimals}f}".replace("-", "−")


def format_percent(share: float | None, decimals: int = 1) -> str:
    """A share 0 to 1 in per cent; what is not quite all or none is never rounded to it."""
    if share is None or math.isnan(share):
        return DASH
    if share in (0.0, 1.0):
        return "100" if share else "0"
    least = 10.0**-decimals
    return f"{min(max(100.0 * share, least), 100.0 - least):.{decimals}f}"


def data_uri(picture: NDArray[np.uint8]) -> str:
    """A BGR or grey picture inside an address: PNG, or JPEG where that is smaller, as of photos."""
    good, png = cv2.imencode(".png", picture)
    fine, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not good or not fine:
        raise ValueError(f"a picture must be 8 bit grey or BGR, not {picture.shape} of {picture.dtype}")
    kind, data = ("png", png) if len(png) <= len(jpeg) else ("jpeg", jpeg)
    return f"data:image/{kind};base64,{base64.b64encode(data.tobytes()).decode()}"
