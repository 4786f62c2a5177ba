# SPDX-License-Identifier: Apache-2.0
"""The worst frames of a run as pictures, with truth and answer drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.metrics.summary import Summary, Worst
from grasptrack.typing import Floats
from grasptrack.view.report import Page, format_number
from grasptrack.view.report.answer import draw_answer

Shown = tuple[NDArray[Any], Floats | None, Sequence[Floats]]
"""An image, the true contacts (k, 2) px or None where the object is gone, the true outline's polygons in px."""
Picture = Callable[[str, str, int], Shown | None]
"""Called with a case, a method and a frame; gives what is to be shown of it, or None where it cannot be had."""
Progress = Callable[[str, int, int], None]
"""Called with the name of the step, what is done of it, and all of it."""

OF_FIRST, OF_OTHERS = 8, 3
"""Worst frames that are shown of the first method, and of each other one."""


def show_worst(page: Page, summary: Summary, first: str, picture: Picture, progress: Progress | None) -> None:
    """Add pictures of the worst frames: more of the first method, and of the others those that are bad indeed."""
    wanted = [
        w
        for m in summary.methods
        for w in summary.worst[m][: OF_FIRST if m == first else OF_OTHERS]
        if w.false_accept or m == first or w.error > 0.5 * w.limit
    ]
    found = []
    for i, w in enumerate(wanted):
        shown = picture(w.case, w.method, w.frame)
        if shown is not None:
            image, truth, outline = shown
            drawn = draw_answer(image, None if w.gone else truth, outline, np.array(w.contacts))
            found.append((_frame_caption(w), drawn, w.method))
        report_progress(progress, "worst frames", i + 1, len(wanted))
    if found:
        page.section(
            "Worst frames",
            "The worst answers of each method, wrong ones first, at most two of a sequence. White: the true outline. "
            "Green rings: where the contacts truly are. Orange: where they were said to be.",
        )
        page.pictures(found)


def report_progress(progress: Progress | None, step: str, done: int, total: int) -> None:
    """Call whoever listens."""
    if progress is not None:
        progress(step, done, total)


def _frame_caption(w: Worst) -> str:
    if w.gone:
        told = "the object is gone"
    else:
        told = f"{format_number(w.error, 3)} px off" + (
            f", limit {format_number(w.limit, 2)} px" if w.false_accept else ""
        )
    sure = "" if np.isnan(w.confidence) else f", confidence {format_number(w.confidence, 2)}"
    return f"**{w.method}**, {told}\n{w.case}, frame {w.frame}{sure}"
