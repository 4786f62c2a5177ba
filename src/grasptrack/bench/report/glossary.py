# SPDX-License-Identifier: Apache-2.0
"""Every measure of a report: its name, unit and meaning, where it comes from, and which way is better."""

from __future__ import annotations

from dataclasses import dataclass
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
    unit: str
    meaning: str
    source: str = ""
    kind: Literal["share", "count", "px", "percent", "frames", "ms"] = "share"
    better: Literal["more", "less", ""] = ""


_V = "After dist_i of Section V of the paper, in px instead of over the area."

TERMS: dict[str, Term] = {
    t.key: t
    for t in (
        Term(
            "frames",
            "frames",
            "",
            "Frames that were looked at, without those in which a grasp is first told.",
            "",
            "count",
        ),
        Term(
            "frames_whole",
            "whole",
            "frames",
            "Frames with the whole object in view. A real video without the object's quadrilateral does not tell: there it "
            "is all frames with a truth.",
            "",
            "count",
        ),
        Term(
            "located",
            "located",
            "%",
            "Contacts given, of the frames with 70 % of the outline in view or more.",
            better="more",
        ),
        Term(
            "located_whole",
            "located, whole",
            "%",
            "Contacts given, of the frames with the whole object in view. Says nothing of whether they were right.",
            better="more",
        ),
        Term(
            "located_partly",
            "located, partly",
            "%",
            "Contacts given, of the frames with 70 % of the outline in view or more, but not all.",
            better="more",
        ),
        Term(
            "tracked_visible",
            "tracked",
            "%",
            "Status tracked (located, believed and stable), of the frames with 70 % of the outline in view or more.",
            better="more",
        ),
        Term(
            "false_accepts",
            "wrong",
            "frames",
            "False accepts: contacts given with at least one further from the truth than max(3 px, 4 % of the root of "
            "the object's area), or given while the object was gone.",
            "`bench.metrics.score:accept_limit`.",
            "count",
            "less",
        ),
        Term(
            "false_given_gone",
            "of these, gone",
            "frames",
            "False accepts in which the object was not there, or nothing of it could be seen.",
            "",
            "count",
            "less",
        ),
        Term(
            "false_bound",
            "bound",
            "%",
            "Upper 95 % bound of the rate of false accepts among all frames, as if frames were independent.",
            "Rule of three, 3/n, where there was none in n; else Wilson's bound, one-sided.",
            better="less",
        ),
        Term(
            "median_px",
            "median",
            "px",
            "Distance of a contact from its own true place, each contact for itself, over all frames answered with the "
            "object there, wrong ones included.",
            _V,
            "px",
            "less",
        ),
        Term(
            "rms_px", "RMS", "px", "Root mean square of the same distances: one wrong answer shows.", _V, "px", "less"
        ),
        Term("p95_px", "95th pct", "px", "The distance that 95 % of the same stay below.", _V, "px", "less"),
        Term("max_px", "largest", "px", "The largest of the same.", _V, "px", "less"),
        Term(
            "median_percent",
            "median",
            "% of opening",
            "Median of the same in per cent of the true distance between the first two contacts.",
            "The paper divides by the object's area, which is not invariant to scale.",
            "percent",
            "less",
        ),
        Term(
            "in_ellipse",
            "in ellipse",
            "%",
            "Share of the contacts within the 95 % ellipse of the covariance that came with them; 95 would be honest. "
            "A dash where a method gives no covariance.",
        ),
        Term(
            "risk_area",
            "mean risk",
            "%",
            "Area under the risk-coverage curve over the coverage that it reaches: answers are taken by falling "
            "confidence, and the share of wrong ones among those taken is averaged on the way. A dash without a confidence.",
            better="less",
        ),
        Term(
            "recoveries",
            "recovered",
            "times",
            "How often the object was rightly located again before it was hidden once more or the sequence ended.",
            "",
            "count",
            "more",
        ),
        Term(
            "returns",
            "of returns",
            "times",
            "How often the object came back to whole view after less than 70 % of its outline was.",
            "",
            "count",
        ),
        Term(
            "recovery_frames",
            "wait",
            "frames",
            "Mean number of frames from its return until it was rightly located; 0 is the frame of its return. Over the "
            "times that it was.",
            "",
            "frames",
            "less",
        ),
        Term(
            "median_ms", "median", "ms", "Time of an update, without reading, rendering and drawing.", "", "ms", "less"
        ),
        Term("p99_ms", "99th pct", "ms", "The time that 99 % of the updates stay below.", "", "ms", "less"),
    )
}
"""By key, in the order of tables."""

CURVES: tuple[tuple[str, str, str], ...] = (
    (
        "Precision at t px",
        "Share of the frames with 70 % of the outline in view or more whose contacts were all within t px of the truth. "
        "A frame without contacts counts as missed.",
        "",
    ),
    (
        "Error over time",
        "Of each frame number the worst contact's distance: the median over the sequences that answered, and the band "
        "between which 95 % of them lie. A line stops where fewer than a quarter answered.",
        "",
    ),
    (
        "Risk and coverage",
        "Coverage: share of all frames whose answer is taken. Risk: share of false accepts among those. The curve runs "
        "from the most confident answers to all.",
        "",
    ),
)
"""Curves: name, meaning, source."""

_RECOVERED = Term(
    "recovered",
    "recovered",
    "%",
    "Share of the object's returns to whole view after which it was rightly located again.",
    better="more",
)
COMPARED: dict[str, Term] = {
    t.key: t
    for t in (
        *(TERMS[key] for key in ("located_whole", "located_partly", "tracked_visible", "false_accepts")),
        *(TERMS[key] for key in ("median_px", "rms_px", "p95_px")),
        _RECOVERED,
        *(TERMS[key] for key in ("recovery_frames", "median_ms")),
    )
}
"""What two runs are compared by, in the order of tables."""
