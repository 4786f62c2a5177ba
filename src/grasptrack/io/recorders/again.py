# SPDX-License-Identifier: Apache-2.0
"""Options of `grasptrack track` by which a recording is tracked again as it was, for the recording to keep."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from typing import Any

OPTIONS = (
    *("strategy", "fingers", "friction", "risk", "grasp", "object", "not", "box", "outline", "choose", "sure"),
    *("masks", "first_look_ms", "segmenter", "background", "ignore", "camera", "length"),
    *("min_opening", "max_opening", "finger_width", "finger_thickness", "clearance", "scale", "resynthesize"),
)
"""Those that decide what is tracked and how. The rate and the source's settings do not: a recording keeps the times."""


def tracking_options(asked: Mapping[str, Any]) -> str:
    """Words for a shell, in one order whatever the mapping's.

    Args:
        asked: what was asked for, by the options' names with underscores, as in run.json; what is None or False is left out,
            and so are other names. Pixels of "object" and "not" are one text, a space between two.
    """
    words: list[str] = []
    for name in OPTIONS:
        value, option = asked.get(name), "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            words.append(option)
            continue
        for text in str(value).split() if name in ("object", "not") else [str(value)]:
            words += [f"{option}={text}"] if text.startswith("-") else [option, text]
    return shlex.join(words)


def points_text(points: Iterable[Iterable[float]] | None) -> str | None:
    """Pixels as options take them, "x,y x,y", with all digits; None for none."""
    pairs = [",".join(repr(float(v)) for v in point) for point in (() if points is None else points)]
    return " ".join(pairs) or None
