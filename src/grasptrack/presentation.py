# SPDX-License-Identifier: Apache-2.0
"""How results show themselves: as plain values for JSON and data frames, as a picture in a notebook; and what to try."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

REMEDIES = {
    "no-object": "say which object is meant, or let a net look (--object x,y, --box, --outline, --segmenter u2netp)",
    "object-gone": "keep the object in view while another grasp is chosen, or keep the grasp it has (--resynthesize left out)",
    "no-grasp": "give contacts of your own (--grasp), a larger friction if it is true (--friction), or a hand that opens wider",
    "waiting": "show a part alone and whole, or say which one is meant (--object, --background, --sure)",
    "no-description": "let the program's own strategy follow, which carries every grasp (--strategy auto)",
    "not-found": "bring the object back into view, or move less from one image to the next; it is looked for in every image",
    "not-there": "take away what stands before it; the gripper's own fingers are to be ignored (--ignore FILE)",
    "other-place": "wait until what fits as well is out of view, or choose another object in the first image",
    "uncertain": "come nearer, or choose contacts where the outline bends (--grasp): on a straight edge they can slide",
    "other-shape": "take away what covers or touches it; where its first outline was wrong, draw it (--outline, --masks)",
    "apart": "a part that opens or comes apart needs a grasp on one piece of it; take away what covers its edge",
    "outline-open": "look at the first outline: where it is wrong, draw it (--outline, --masks), or click contacts (--grasp)",
    "image-fixed": "leave out what lies over the image, as a crosshair, a watermark or dirt on the lens (--ignore FILE)",
    "other-surface": "take away what covers it, glare and hard shadows; where the object was exchanged, start anew",
    "ambiguous": "put a mark on the object that tells its turn, or keep the ground's texture in view",
    "lookalike": "keep equal parts apart, start while one is in view or all are at rest, say how a belt moves (--belt)",
    "no-transfer": "let the program's own strategy follow, which needs neither peaks nor the whole outline (--strategy auto)",
    "strategy-off": "use another strategy: this one of the paper is not exact for this motion (--strategy auto)",
    "off-outline": "use another strategy: this one of the paper is not exact for this motion (--strategy auto)",
    "contact-unseen": "take away what stands before the contacts, or choose contacts that stay in view (--grasp)",
    "not-flat": "choose contacts on the outline of its top (--grasp), and start with the most frontal image",
    "not-pinhole": "say how wide a pixel is for its height (--pixel-aspect), or give a calibration (--camera)",
    "tilt-open": "let the camera tilt by ten degrees once, so that views differ",
    "turned-over": "turn it over, or teach that side as a part of its own",
    "which-part": "look for one of them at a time, or print on one what tells them apart",
    "not-closing": "choose contacts that face each other (--grasp), or let another grasp be chosen (--resynthesize)",
    "open-margin": "let the camera look at the object from another side, or choose a grasp with more margin",
    "slips": "come nearer: contacts become surer",
}
"""By the codes of `tracking.messages:SENTENCES`; options stand in parentheses, which the live page leaves out."""

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
