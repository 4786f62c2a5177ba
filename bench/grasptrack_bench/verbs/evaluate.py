# SPDX-License-Identifier: Apache-2.0
"""`grasptrack evaluate`: measure every method on scenes with known truth, or on real videos."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from grasptrack.cli import help_groups, options
from grasptrack.cli.help_groups import option
from grasptrack.cli.terminal import command_line, show_rows, with_progress
from grasptrack.errors import InputError

if TYPE_CHECKING:
    from grasptrack.typing import Progress
    from grasptrack_bench.run_folder import Filled


MethodNames = Annotated[
    str | None,
    option(help_groups.METHODS, "A,B", "Methods to measure, by name.", show_default="auto,rrp,grasp-line,homography"),
]
Peers = Annotated[bool, option(help_groups.METHODS, None, "Also measure the baselines that are installed.", "--peers")]

MOST_NAMED = 10
"""Sequences without results that are named one by one."""

evaluate = typer.Typer(
    help="Measure every method: on rendered scenes, or on real videos.",
    cls=help_groups.GroupedVerbs,
    add_completion=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@evaluate.command(cls=help_groups.GroupedCommand, short_help="Parts x disturbances, rendered, with exact truth.")
def scenes(
    fingers: options.TwoOrThree = 2,
    friction: options.Friction = 0.5,
    shapes: Annotated[
        str | None,
        option(
            help_groups.SCENE, "A,B", "Built-in outlines, by name.", show_default="all, unless other parts are given"
        ),
    ] = None,
    silhouettes: options.Silhouettes = None,
    photos: Annotated[str | None, option(help_groups.SCENE, "DIR", "Parts from photos, with --masks.")] = None,
    masks: Annotated[str | None, option(help_groups.SCENE, "DIR", "Masks of the photos, matched by name.")] = None,
    disturbances: Annotated[
        str | None, option(help_groups.SCENE, "A,B", "Disturbances, by name.", show_default="all")
    ] = None,
    frames: Annotated[int, option(help_groups.SCENE, "N", "Number of frames of each scene.", min=2)] = 100,
    repeats: Annotated[
        int, option(help_groups.SCENE, "N", "Number of scenes for each part and disturbance.", min=1)
    ] = 1,
    seed: options.Seed = 0,
    methods: MethodNames = None,
    peers: Peers = False,
    output: options.Output = options.OUTPUT_FOLDER / "evaluate-scenes",
    quiet: options.Quiet = False,
    risk: options.Risk = 1e-3,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
) -> None:
    """Render parts under many disturbances, track a grasp by every method, and compare with the exact ground truth.

    Writes evaluation.json, cases/*.csv (every frame of every method), summary.csv, figures and report.html. After
    Ctrl-C or a crash, the same command continues where it stopped.

    \b
    Examples:
      grasptrack evaluate scenes
      grasptrack evaluate scenes --shapes bracket,gear --disturbances noise,bar --frames 40
      grasptrack evaluate scenes --peers --output with-peers
      grasptrack evaluate scenes --silhouettes shapes --methods auto --repeats 3
      grasptrack evaluate scenes --scheduler tcp://host:8786
    """
    from grasptrack_bench import suites
    from grasptrack_bench.schedule import create_scheduler as schedule

    if (photos is None) is not (masks is None):
        raise InputError("--photos and --masks go together: give both or neither")
    asked: dict[str, Any] = {
        "shapes": options.parse_names(shapes),
        "silhouettes": silhouettes,
        "photos": photos,
        "masks": masks,
        "disturbances": options.parse_names(disturbances),
        "methods": suites.method_names(options.parse_names(methods), peers=peers),
        "frames": frames,
        "repeats": repeats,
        "seed": seed,
        "fingers": fingers,
        "friction": friction,
        "risk": risk,
    }
    work = suites.scene_suite(suites.SceneOptions(**asked))
    _run_suite(output, work, schedule(scheduler, workers), asked, quiet)


@evaluate.command(cls=help_groups.GroupedCommand, short_help="Real videos with reference homographies.")
def real(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Videos, each with its table: film.mp4 and film.homographies.csv.")
    ],
    fingers: options.TwoOrThree = 2,
    friction: options.Friction = 0.5,
    given: Annotated[
        str | None,
        option(
            help_groups.SCENE,
            "NAME",
            "What the tracker is told of each object: pixel, quad or nothing.",
            show_default="pixel, with scenes.csv",
        ),
    ] = None,
    methods: MethodNames = None,
    peers: Peers = False,
    output: options.Output = options.OUTPUT_FOLDER / "evaluate-real",
    quiet: options.Quiet = False,
    risk: options.Risk = 1e-3,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
) -> None:
    """Track a grasp through real videos by every method, and compare with reference homographies.

    A table has the columns frame, h11 ... h33: H maps pixels of frame 0 to pixels of the frame. The grasp is chosen in
    the first frame and given to all methods. Writes what `grasptrack evaluate scenes` writes.

    scenes.csv in DIR says which object is meant: name of the video, object (a pixel of it, x,y, in the first frame that
    its table lists) and quad (its corners in frame 0 of the table). Tracking then starts at that frame. --given says what the
    tracker is told: the pixel; the quad, on two of whose sides the contacts are placed; or nothing. A video in which
    the tracker selects another object is left out and named.

    \b
    Examples:
      grasptrack evaluate real videos
      grasptrack evaluate real videos --given quad --methods auto,klt
      grasptrack evaluate real videos --peers --output real-with-peers
    """
    from grasptrack_bench import suites
    from grasptrack_bench.real import GIVEN
    from grasptrack_bench.schedule import create_scheduler as schedule

    asked: dict[str, Any] = {
        "folder": str(folder.resolve()),
        "given": options.one_of("--given", given, GIVEN),
        "methods": suites.method_names(options.parse_names(methods), peers=peers),
        "fingers": fingers,
        "friction": friction,
        "risk": risk,
    }
    work = suites.real_suite(**asked)
    _run_suite(output, work, schedule(scheduler, workers), asked, quiet)


def _run_suite(output: Path, work: Any, schedule: Any, asked: dict[str, Any], quiet: bool) -> None:
    """Score, report, tell."""
    from grasptrack_bench.report.run import PAGE, write_report
    from grasptrack_bench.report.tables import closing_table
    from grasptrack_bench.run_folder import fill_run_folder

    def fill_and_report(tell: Progress) -> tuple[Filled, Path]:
        filled = fill_run_folder(
            output,
            work.kind,
            work.jobs,
            work.function,
            schedule,
            options=asked,
            command=command_line(),
            last=output / PAGE,
            progress=tell,
        )
        if not filled.done and not filled.resumed:
            raise InputError(f"nothing could be measured: {next(iter(filled.failed.values()), 'no case')}")
        return filled, write_report(output, picture=work.picture(output), progress=tell)

    filled, report = with_progress(output, quiet, fill_and_report, again=", and the same command goes on with it")
    if quiet:
        return
    heads, rows = closing_table(output)
    notes = [f"{name} left out: {reason}" for name, reason in list(filled.failed.items())[:MOST_NAMED]]
    if len(filled.failed) > MOST_NAMED:
        notes.append(f"and {len(filled.failed) - MOST_NAMED} more, named in {output / 'evaluation.json'}")
    if filled.resumed:
        notes.append(f"gone on with an interrupted run, in which {filled.resumed} sequences were done")
    notes.append(str(report))
    count = filled.done + filled.resumed
    show_rows(f"{count} sequence{'s' * (count > 1)} in {filled.seconds:.0f} s", heads, rows, notes, optional=3)
