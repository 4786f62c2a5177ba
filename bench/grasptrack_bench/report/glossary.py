# SPDX-License-Identifier: Apache-2.0
"""Every measure of a report: its name, unit and meaning, where it comes from, and which way is better.

The words are those of `templates/glossary.json`.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True, slots=True)
class Term:
    """One measure.

    Attributes:
        key: its name in files.
        label, unit: as heads of columns.
        meaning: a sentence.
        source: where it is defined, "" where the sentence is all.
        kind: how it is written.
        better: "more", "less", or "" where neither is.
    """

    key: str
    label: str
    meaning: str
    unit: str = ""
    source: str = ""
    kind: Literal["share", "count", "px", "percent", "frames", "ms"] = "share"
    better: Literal["more", "less", ""] = ""


_WORDS = json.loads((Path(__file__).parent / "templates" / "glossary.json").read_text(encoding="utf-8"))
_ALL = {key: Term(key, **told) for key, told in _WORDS["terms"].items()}

COMPARED: dict[str, Term] = {
    key: _ALL[key]
    for key in (
        *("located_whole", "located_partly", "tracked_visible", "false_accepts"),
        *("median_px", "rms_px", "p95_px", "recovered", "recovery_frames", "median_ms"),
    )
}
"""What two runs are compared by, in the order of tables."""
TERMS: dict[str, Term] = {key: term for key, term in _ALL.items() if key != "recovered"}
"""What is told of one run, by key, in the order of tables."""
CURVES: tuple[tuple[str, str, str], ...] = tuple(map(tuple, _WORDS["curves"]))
"""Curves: name, meaning, source."""
