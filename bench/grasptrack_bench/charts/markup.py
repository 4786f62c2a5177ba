# SPDX-License-Identifier: Apache-2.0
"""Text and numbers as they stand in HTML; what is not known is a dash."""

from __future__ import annotations

import html
import math
import re

DASH = "–"
"""Where there is no value."""


def escape_html(text: object) -> str:
    """Text that is safe in HTML, in attributes too."""
    return html.escape(str(text), quote=True)


def make_slug(text: str) -> str:
    """A name that may stand in an id or a CSS variable."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "x"


def format_number(value: float | int | None, digits: int = 3) -> str:
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
    return text.replace("-", "−")


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
