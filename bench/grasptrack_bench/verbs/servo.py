# SPDX-License-Identifier: Apache-2.0
"""`grasptrack servo`: from an image to an object in the hand, in a physics simulation; once to look at, or many times."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasptrack.cli import first_image, help_groups, options
from grasptrack.cli.help_groups import option_or
from grasptrack.cli.terminal import show_rows, with_progress
from grasptrack.errors import InputError
from grasptrack_bench import verbs

if TYPE_CHECKING:
    from grasptrack_bench.approach.case import Row
    from grasptrack_bench.approach.runs import Trials


def servo(
    fingers: int = option_or(2, help_groups.GRASP, "N", "Number of fingers: 2, or 3 at 120 degrees on one drive."),
    sure: first_image.Sure = 0.0,
    shape: str | None = option_or(None, help_groups.SCENE, "NAME", "Built-in outline.", show_default="random"),
    silhouettes: verbs.Silhouettes = None,
    scenario: str = option_or(
        "static", help_groups.SCENE, "NAME", "Scenario: static, pushed, belt, blackout or pulled."
    ),
    images: str | None = option_or(
        None, help_groups.SCENE, "NAME", "Renderer: mujoco, planar or auto.", show_default="auto; with --trials planar"
    ),
    trials: int | None = option_or(
        None,
        help_groups.SCENE,
        "N",
        "Number of random trials, run in parallel.",
        min=1,
        show_default="one approach, which is filmed",
    ),
    seed: verbs.Seed = 3,
    arm: str = option_or("gantry", help_groups.ROBOT, "NAME", "Robot: gantry (4 DoF) or arm (6 DoF)."),
    law: str = option_or("online", help_groups.ROBOT, "NAME", "Control law: online, nominal or textbook."),
    output: options.Output = options.OUTPUT_FOLDER / "servo",
    no_video: bool = option_or(False, help_groups.OUTPUT, None, "Do not write approach.mp4.", "--no-video"),
    quiet: options.Quiet = False,
    risk: options.Risk = 1e-3,
    workers: verbs.Workers = None,
    scheduler: verbs.Scheduler = None,
) -> None:
    """Look, choose a grasp, approach, close and lift, in a physics simulation (MuJoCo) with an uncalibrated camera.

    One approach is written as approach.mp4 (the hand's view and a bystander's), approach.png (errors and twist) and
    approach.json. The hand closes only where the tracker's probability of being wrong is below --risk, as in
    `grasptrack track`. With --trials, random cases are run: trials.csv has a row for each, trials.json the figures, and
    failures/ a picture of each failure. After Ctrl-C or a crash, the same command continues where it stopped.

    \b
    Examples:
      grasptrack servo
      grasptrack servo --shape bracket --scenario belt --seed 7
      grasptrack servo --shape guitar --fingers 3 --arm arm
      grasptrack servo --trials 200 --scenario blackout --seed 1 --output blackout
      grasptrack servo --trials 200 --law textbook --silhouettes shapes
      grasptrack servo --risk 1e-5 --scenario belt
    """
    from grasptrack.first_image import FirstImage
    from grasptrack_bench.approach.case import check_options

    if trials is None and (workers is not None or scheduler is not None):
        raise InputError("--workers and --scheduler are for --trials")
    asked: dict[str, Any] = {
        "scenario": scenario,
        "arm": arm,
        "fingers": fingers,
        "law": law,
        "seed": seed,
        "risk": risk,
        "sure": sure,
    }
    with first_image.by_option():
        FirstImage.of(sure=sure)
    check_options(scenario=scenario, arm=arm, law=law, images=images or "auto", fingers=fingers)
    shapes = verbs.shapes_asked(shape, silhouettes)
    if trials is None:
        _run_single(shapes, asked, images or "auto", output, not no_video, quiet)
    else:
        _run_many(shapes, trials, asked, images or "planar", output, workers, scheduler, quiet)


def _run_single(shapes: list[Any], asked: dict[str, Any], images: str, output: Path, video: bool, quiet: bool) -> None:
    from dataclasses import replace

    from grasptrack_bench.approach.runs import draw_cases, run_and_film

    changed: dict[str, Any] = {"seed": asked["seed"], "images": images}
    case = replace(draw_cases(shapes, 1, **asked)[0], **changed)
    row = with_progress(
        output,
        quiet,
        lambda tell: run_and_film(case, output, video=video, options={**asked, "images": images}, progress=tell),
    )
    if quiet:
        return
    rows = [["outcome", row.outcome], *([["reason", row.reason]] if row.reason else []), *_figure_rows(row)]
    files = [*(["approach.mp4"] if video else []), "approach.png", "approach.json"]
    show_rows(
        f"{row.shape}, {row.scenario}, {row.arm}, {row.fingers} fingers, {row.law} law, seed {row.seed}",
        ("<", "<"),
        rows,
        [f"{output}: {', '.join(files)}"],
    )


def _figure_rows(row: Row) -> list[list[str]]:
    told = [
        ("closed after", row.time_s, "s"),
        ("from the goal", row.error_px, "px"),
        ("grasp beside the hand's axis, in truth", row.aside_mm, "mm"),
        ("tracker and servo, median", row.loop_ms, "ms"),
    ]
    return [[name, f"{value:.2f} {unit}"] for name, value, unit in told if value == value]


def _run_many(
    shapes: list[Any],
    count: int,
    asked: dict[str, Any],
    images: str,
    output: Path,
    workers: int | None,
    address: str | None,
    quiet: bool,
) -> None:
    from grasptrack_bench.approach.runs import draw_cases, run_trials
    from grasptrack_bench.schedule import create_scheduler

    cases = draw_cases(shapes, count, images=images, **asked)  # type: ignore[arg-type]
    told = {**asked, "trials": count, "images": images, "shapes": sorted({case.shape.name for case in cases})}
    schedule = create_scheduler(address, workers)
    found = with_progress(
        output,
        quiet,
        lambda tell: run_trials(output, cases, schedule, options=told, progress=tell),
        again=", and the same command goes on with it",
    )
    if not quiet:
        _show_results(found, asked, output)


def _show_results(found: Trials, asked: dict[str, Any], output: Path) -> None:
    figures = found.index_figures()
    low, high = found.success_interval()
    rows = [
        [
            "lifted and held",
            str(figures["lifted"]),
            f"{100 * found.success_rate:.1f} % of {found.tried} ({100 * low:.1f} to {100 * high:.1f})",
        ],
        *(["failed" if i == 0 else "", str(n), reason] for i, (reason, n) in enumerate(found.count_reasons())),
        ["refused at synthesis", str(figures["refused"]), f"{figures['refusals_confirmed']} confirmed by brute force"],
        ["closed unbelieved", str(figures["closed_unbelieved"]), f"of {figures['closed']} times that the hand closed"],
        ["closed wrong", str(figures["closed_wrong"]), "believed, and elsewhere in truth"],
    ]
    if asked["scenario"] == "pulled":
        told = f"noticed {figures['empty_noticed']}, lifted at the next try {figures['empty_lifted']}"
        rows.append(["first closed on nothing", str(figures["empty"]), told])
    middle = figures["median"]
    notes = [
        f"medians: closed after {middle['time_s']} s, {middle['error_px']} px from the goal, {middle['aside_mm']} mm aside; "
        f"servo {middle['servo_ms']} ms, with the tracker {middle['loop_ms']} ms",
        f"{output}: trials.csv, trials.json" + (", failures/" if figures["failed"] or figures["refused"] else ""),
    ]
    what = f"{asked['scenario']}, {asked['arm']}, {asked['fingers']} fingers, {asked['law']} law"
    if found.resumed:
        notes.append(f"gone on with an interrupted run, in which {found.resumed} trials were done")
    title = f"{figures['trials']} trials over {figures['shapes']} shapes, {what}"
    show_rows(title, ("<", "trials", "<"), rows, notes)
