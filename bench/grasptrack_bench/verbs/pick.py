# SPDX-License-Identifier: Apache-2.0
"""`grasptrack pick`: a simulated robot that empties trays of parts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from grasptrack.cli import help_groups, options
from grasptrack.cli.help_groups import option
from grasptrack.cli.terminal import show_rows, with_progress
from grasptrack_bench import verbs


def pick(
    shape: Annotated[str | None, option(help_groups.SCENE, "NAME", "Built-in outline.", show_default="random")] = None,
    silhouettes: verbs.Silhouettes = None,
    parts: Annotated[int, option(help_groups.SCENE, "N", "Number of parts in each tray.", min=1, max=24)] = 12,
    trays: Annotated[int, option(help_groups.SCENE, "N", "Number of trays, emptied in parallel.", min=1)] = 1,
    snatch: Annotated[
        bool,
        option(help_groups.SCENE, None, "Pull the first part of each tray away from the closing fingers.", "--snatch"),
    ] = False,
    seed: verbs.Seed = 1,
    output: options.Output = options.OUTPUT_FOLDER / "pick",
    quiet: options.Quiet = False,
    risk: options.Risk = 1e-3,
    workers: verbs.Workers = None,
    scheduler: verbs.Scheduler = None,
) -> None:
    """Empty trays of equal parts, in a physics simulation (MuJoCo) with an uncalibrated camera on the hand.

    The part is taught from one image of one that lies alone. Then the hand looks, takes the first part of the order of
    `grasptrack find` that is sure and leaves the fingers room, approaches, closes, lifts, drops it into a bin, and looks
    again. What lies on a tray at the end is told with the reason. picks.csv has a row for each try, run.json the figures,
    tray-NAME.png each tray with the order of its picks.

    \b
    Examples:
      grasptrack pick
      grasptrack pick --shape spanner --parts 8 --snatch
      grasptrack pick --trays 50 --seed 7 --output trays
    """
    from grasptrack_bench.approach.tray_runs import draw_tray_cases, run_trays
    from grasptrack_bench.physics.model import import_mujoco
    from grasptrack_bench.schedule import create_scheduler

    import_mujoco()
    known = verbs.shapes_asked(shape, silhouettes)
    asked: dict[str, Any] = {"seed": seed, "count": parts, "snatched": snatch, "risk": risk}
    cases = draw_tray_cases(known, trays, **asked)
    found = with_progress(
        output,
        quiet,
        lambda tell: run_trays(
            output, cases, create_scheduler(scheduler, workers), options={**asked, "trays": trays}, progress=tell
        ),
    )
    if not quiet:
        _show_results(found.index_figures(), output)


def _show_results(figures: dict[str, Any], output: Path) -> None:
    low, high = (100.0 * share for share in figures["lifted_95"])
    share = 100.0 * figures["lifted"] / max(1, figures["parts"])
    rows = [
        ["lifted", str(figures["lifted"]), f"{share:.1f} % of {figures['parts']} ({low:.1f} to {high:.1f})"],
        *(["left" if i == 0 else "", str(n), why] for i, (why, n) in enumerate(figures["left"].items())),
        ["closed wrong", str(figures["closed_wrong"]), f"of {figures['closed']} times that the hand closed"],
        ["closed on nothing", str(figures["empty"]), "noticed by the gripper, and tried again"],
    ]
    for what in ("refused", "broken"):
        rows += [[what, "", f"{name}: {why}"] for name, why in figures[what].items()]
    note = f"{figures['picks_an_hour']:.0f} picks an hour of simulated time; {output}: picks.csv, run.json, tray-*.png"
    show_rows(f"{figures['emptied']} of {figures['trays']} trays emptied", ("<", "parts", "<"), rows, [note])
