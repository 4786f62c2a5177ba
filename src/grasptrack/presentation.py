# SPDX-License-Identifier: Apache-2.0
"""How results show themselves: as plain values for JSON and data frames, as a picture in a notebook."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

_drawing: list[Callable[[object], bytes]] = []


def draw_by(function: Callable[[object], bytes]) -> None:
    """Which function makes the PNG of a result: given by the package, for results know nothing of pictures."""
    _drawing[:] = [function]


def png_of(value: object) -> bytes:
    """A result as the bytes of a PNG, on plain ground."""
    return _drawing[0](value)


def format_confidence(confidence: float, decimals: int = 3) -> str:
    """A confidence with so many decimals, or as many more, up to 9, as tell how far from 1 it is: 0.9961 is no 1.00."""
    off, kept = 1.0 - confidence, 2 + decimals
    told = f"{confidence:.{min(9, max(decimals, 1 - math.floor(math.log10(off))))}f}" if off > 0.0 else "1"
    return told[:kept] + told[kept:].rstrip("0")


def to_dict(record: object) -> dict[str, Any]:
    """The public parts of a result of this package by name, as `plain_value` gives them, in the units of the attributes."""
    from grasptrack.equality import public_parts

    return {name: plain_value(part) for name, part in public_parts(record, whole=True).items()}


def plain_value(value: Any, digits: int | None = None) -> Any:
    """A value as JSON has it: dictionaries, lists, text, numbers, truth values; None for what is not finite.

    Args:
        value: records, mappings, sequences, arrays, paths and plain values; of anything else its `repr`.
        digits: significant digits that floats are rounded to; None leaves them.
    """
    import numpy as np

    from grasptrack.equality import is_record

    if isinstance(value, (np.ndarray, np.generic)):
        return plain_value(value.tolist(), digits)
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return value if digits is None else float(f"{value:.{digits}g}")
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, Mapping):
        return {str(key): plain_value(part, digits) for key, part in value.items()}
    own = getattr(value, "to_dict", None)
    if own is not None:
        return own()
    if is_record(value) and (hasattr(value, "_fields") or not isinstance(value, (list, tuple))):
        return to_dict(value)
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain_value(part, digits) for part in value]
    return str(value) if isinstance(value, Path) else repr(value)
