# SPDX-License-Identifier: Apache-2.0
"""How long each step takes beside the paper's times: the same two fingers, the same 300 points, the same meaning of a step."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from time import perf_counter_ns
from typing import Any

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography, judge_distortion
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import analyze
from grasptrack.grasp.synthesis import synthesize
from grasptrack.transfer import STRATEGIES, TransferStrategy, homography, strategy_named
from grasptrack_bench.baselines.literal import PAPER, LiteralHomography
from grasptrack_bench.report.table import Cell, Table
from research.paper.footage import FilmedPart, ideal_footage

VIEWS, ROUNDS, SEARCHED = 60, 5, 10
"""Outlines, each timed anew so often on copies that nothing was worked out of before; those in which a grasp is searched."""
PRINTED_US = {"rrp": 15.0, "grasp-line": 35.0, "homography": 290.0}
"""The text's "below 15 and 35 us", and its "290 ns", which is read as microseconds; a 2.5 GHz Celeron."""
PRINTED_ANALYSIS_US = 370.0
PRINTED_SEARCH = 60.0
"""Per cent of the homography's time that the search of correspondences takes."""
_HEAD = ("step", "paper, us", "ours, median us", "99th percentile us", "to the letter, median us")


def table_of_times(part: FilmedPart) -> Table:
    """Times per call through Python, of our transfers and of the paper's to the letter.

    A transfer is describing the grasp on the first contour and applying the description to the second. The search of
    correspondences is step 1 of Fig. 9: curvature of both contours, selection of the peaks, alignment, eq. (3).
    """
    footage = ideal_footage(part, "resampled", "6 DoF", VIEWS + 1, 0)
    first, *rest = (view for view in footage.silhouettes if isinstance(view, View))
    grasp = Grasp(footage.on_silhouette)
    fast: dict[str, Sequence[float]] = {}
    slow: dict[str, Sequence[float]] = {}
    for name in STRATEGIES:
        seconds = [v for v in footage.tracked[1:] if isinstance(v, View)] if name == "rrp" else rest
        for taken, strategy in ((fast, strategy_named(name)), (slow, PAPER[f"paper-{name}"])):
            taken[name] = _time(_transfer(strategy, grasp), _pairs(first, seconds))
    moved = [homography.apply(homography.describe(grasp, first), view) for view in rest]
    analysis = _time(lambda _, view, found: analyze(found, view), _pairs(first, rest, [m.grasp for m in moved]))
    known = [m.homography for m in moved]
    fast_after = _time(_steps_after_search(homography.describe(grasp, first)), _pairs(first, rest, known))
    described = LiteralHomography().describe(grasp, first)
    slow_after = _time(lambda _, view, H: LiteralHomography().applied(described, view, H), _pairs(first, rest, known))
    whole, letter = (float(np.median(taken["homography"])) for taken in (fast, slow))
    search, letter_search = whole - float(np.median(fast_after)), letter - float(np.median(slow_after))
    searched = _time(lambda _, view, __: synthesize(view, top=1), _pairs(first, rest[:SEARCHED]))
    judged = float(np.median(analysis))
    rows: list[tuple[Cell, ...]] = [
        (f"{name}: transfer", PRINTED_US[name], *_two(fast[name]), float(np.median(slow[name]))) for name in STRATEGIES
    ]
    share = PRINTED_SEARCH / 100.0
    rows += [
        ("homography: search of correspondences", PRINTED_US["homography"] * share, search, None, letter_search),
        (
            "homography: search, % of the transfer",
            PRINTED_SEARCH,
            100.0 * search / whole,
            None,
            100.0 * letter_search / letter,
        ),
        ("analysis", PRINTED_ANALYSIS_US, *_two(analysis), None),
        (
            "homography and analysis",
            PRINTED_US["homography"] + PRINTED_ANALYSIS_US,
            whole + judged,
            None,
            letter + judged,
        ),
        ("search for a grasp", None, *_two(searched), None),
    ]
    return Table(
        "times",
        "Time per call beside the paper's, two fingers, contours of 300 points",
        _HEAD,
        tuple(rows),
        (
            "These figures are of this machine and this moment: they alone differ from run to run.",
            "A transfer is the description on the first contour and its application to the second, each on contours that "
            "nothing was worked out of before. The search is step 1 of Fig. 9: curvature of both contours, peaks, where "
            "to search, eq. (3); its time is that of the transfer less that of the other steps. The paper's times are of a "
            "2.5 GHz Celeron.",
            "To the letter in NumPy, not compiled: its shares compare with the paper's, its times say little. "
            "-: nothing to measure.",
        ),
    )


def _transfer(strategy: TransferStrategy, grasp: Grasp) -> Callable[[View, View, Any], object]:
    return lambda first, second, _: strategy.apply(strategy.describe(grasp, first), second)


def _steps_after_search(description: homography.HomographyDescription) -> Callable[[View, View, Any], object]:
    """Steps 2 to 4 as the library does them, given where H (3, 3) takes the selected points."""
    selected, contacts = description.peaks[:4], description.contacts

    def finish(first: View, second: View, H: Any) -> object:
        matched = apply_homography(H, first.outer.points[selected])
        fitted, *worst = kernels.fit_homography(first.outer.points, selected, matched, [0, 1, 2, 3])
        judge_distortion(fitted, *worst)
        return kernels.refine_contacts(fitted, contacts, description.normals, second.points, second.offsets)

    return finish


def _pairs(first: View, rest: Sequence[View], more: Sequence[Any] | None = None) -> Iterable[tuple[View, View, Any]]:
    """Copies of the first view and each other, with what belongs to it."""
    for _ in range(ROUNDS):
        for i, view in enumerate(rest):
            yield _fresh(first), _fresh(view), None if more is None else more[i]


def _fresh(view: View) -> View:
    """The same outlines, of which nothing has been worked out yet."""
    made = View([type(c).trusted(c.points, hole=c.hole) for c in view.contours])
    assert len(made.points) and made.offsets[0] == 0
    return made


def _time(call: Callable[[View, View, Any], object], arguments: Iterable[tuple[View, View, Any]]) -> list[float]:
    """us of each call."""
    taken = []
    for first, second, more in list(arguments):
        began = perf_counter_ns()
        call(first, second, more)
        taken.append(1e-3 * (perf_counter_ns() - began))
    return taken


def _two(taken: Sequence[float]) -> tuple[float, float]:
    return float(np.median(taken)), float(np.percentile(taken, 99))
