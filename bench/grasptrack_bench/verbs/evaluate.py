# SPDX-License-Identifier: Apache-2.0
"""`grasptrack evaluate`: measure every method on scenes with known truth, on real videos, on a planar benchmark."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from grasptrack.cli import help_groups, options
from grasptrack.cli.help_groups import option_or
from grasptrack.cli.terminal import show_rows, with_progress
from grasptrack.errors import InputError
from grasptrack_bench import verbs

if TYPE_CHECKING:
    from grasptrack.typing import Progress
    from grasptrack_bench.run_folder import Filled


@dataclass(frozen=True)
class SuiteOptions:
    """What every suite is asked."""

    methods: str | None = option_or(
        None, help_groups.METHODS, "A,B", "Methods to measure, by name.", show_default="auto,rrp,grasp-line,homography"
    )
    peers: bool = option_or(
        False, help_groups.METHODS, None, "Also measure the baselines that are installed.", "--peers"
    )
    quiet: options.Quiet = False
    risk: options.Risk = 1e-3
    workers: verbs.Workers = None
    scheduler: verbs.Scheduler = None

    def with_own(self, **own: Any) -> dict[str, Any]:
        """What decides the results, with what a suite asks beside."""
        from grasptrack_bench.suites import method_names

        return {**own, "methods": method_names(_parse_names(self.methods), peers=self.peers), "risk": self.risk}


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
@help_groups.with_options
def scenes(
    fingers: options.TwoOrThree = 2,
    friction: options.Friction = 0.5,
    shapes: str | None = option_or(
        None, help_groups.SCENE, "A,B", "Built-in outlines, by name.", show_default="all, unless other parts are given"
    ),
    silhouettes: verbs.Silhouettes = None,
    photos: str | None = option_or(None, help_groups.SCENE, "DIR", "Parts from photos, with --masks."),
    masks: str | None = option_or(None, help_groups.SCENE, "DIR", "Masks of the photos, matched by name."),
    disturbances: str | None = option_or(None, help_groups.SCENE, "A,B", "Disturbances, by name.", show_default="all"),
    frames: int = option_or(100, help_groups.SCENE, "N", "Number of frames of each scene.", min=2),
    repeats: int = option_or(1, help_groups.SCENE, "N", "Number of scenes for each part and disturbance.", min=1),
    seed: verbs.Seed = 0,
    output: options.Output = options.OUTPUT_FOLDER / "evaluate-scenes",
    *,
    suite: SuiteOptions,
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

    if (photos is None) is not (masks is None):
        raise InputError("--photos and --masks go together: give both or neither")
    asked = suite.with_own(
        shapes=_parse_names(shapes),
        silhouettes=silhouettes,
        photos=photos,
        masks=masks,
        disturbances=_parse_names(disturbances),
        frames=frames,
        repeats=repeats,
        seed=seed,
        fingers=fingers,
        friction=friction,
    )
    _run_suite(output, suites.scene_suite(suites.SceneOptions(**asked)), asked, suite)


@evaluate.command(cls=help_groups.GroupedCommand, short_help="Real videos with reference homographies.")
@help_groups.with_options
def real(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Videos, each with its table: film.mp4 and film.homographies.csv.")
    ],
    fingers: options.TwoOrThree = 2,
    friction: options.Friction = 0.5,
    given: str | None = option_or(
        None,
        help_groups.SCENE,
        "NAME",
        "What the tracker is told of each object: pixel, quad, outline or nothing.",
        show_default="pixel, with scenes.csv",
    ),
    output: options.Output = options.OUTPUT_FOLDER / "evaluate-real",
    *,
    suite: SuiteOptions,
) -> None:
    """Track a grasp through real videos by every method, and compare with reference homographies.

    A table has the columns frame, h11 ... h33: H maps pixels of frame 0 to pixels of the frame. The grasp is chosen in
    the first frame and given to all methods. Writes what `grasptrack evaluate scenes` writes.

    scenes.csv in DIR says which object is meant: name of the video, object (a pixel of it, x,y, in the first frame that
    its table lists) and quad (its corners in frame 0 of the table). Tracking then starts at that frame. --given says what the
    tracker is told: pixel; quad, the pixel and contacts on two sides of the quad; outline, such contacts and the quad; or
    nothing. A video in which the tracker selects another object is left out and named.

    \b
    Examples:
      grasptrack evaluate real videos
      grasptrack evaluate real videos --given quad --methods auto,klt
      grasptrack evaluate real videos --peers --output real-with-peers
    """
    from grasptrack_bench import real as videos

    told: Any = options.one_of("--given", given, videos.GIVEN)
    asked = suite.with_own(folder=str(folder.resolve()), given=told, fingers=fingers, friction=friction)
    _run_videos(output, videos.videos_of(folder.resolve(), fingers, friction, told, suite.risk), asked, suite)


@evaluate.command(cls=help_groups.GroupedCommand, short_help="The planar tracking benchmark POT-210 or POT-280.")
@help_groups.with_options
def pot(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="Sequences: folders V24_7 of images, or V24_7.avi, and their annotation."),
    ],
    every: int = option_or(
        1, help_groups.SCENE, "N", "Number of images from one that is shown to the next: a lower frame rate.", min=1
    ),
    given: str = option_or(
        "outline", help_groups.SCENE, "NAME", "What the tracker is told of the target: pixel, quad, outline or nothing."
    ),
    output: options.Output = options.OUTPUT_FOLDER / "evaluate-pot",
    *,
    suite: SuiteOptions,
) -> None:
    """Track a grasp on the targets of the planar tracking benchmark, and compare with its corners.

    V24_7_gt_points.txt lies with the images, beside them or in DIR/annotation, and the flags V24_7_flag.txt with it. The
    contacts lie on two sides of the target. p@5 is the benchmark's score: the share of its scored frames whose corners, under
    the method's homography, are off by 5 px or less. Writes what `grasptrack evaluate scenes` writes.

    \b
    Examples:
      grasptrack evaluate pot POT --methods auto
      grasptrack evaluate pot POT --every 4 --methods auto,klt,sift,ecc --output every-4
    """
    from grasptrack_bench.pot import sequences_of
    from grasptrack_bench.real import GIVEN

    told: Any = options.one_of("--given", given, GIVEN)
    asked = suite.with_own(folder=str(folder.resolve()), every=every, given=told)
    _run_videos(output, sequences_of(folder.resolve(), every, told, suite.risk), asked, suite)


def _parse_names(text: str | None) -> tuple[str, ...]:
    """Names from "a,b"; none from None."""
    return () if text is None else tuple(part.strip() for part in text.split(",") if part.strip())


def _run_videos(output: Path, cases: Any, asked: dict[str, Any], suite: SuiteOptions) -> None:
    from grasptrack_bench.suites import video_suite

    _run_suite(output, video_suite(cases, asked["methods"]), asked, suite)


def _run_suite(output: Path, work: Any, asked: dict[str, Any], suite: SuiteOptions) -> None:
    from grasptrack_bench.report.run import PAGE, write_report
    from grasptrack_bench.report.tables import closing_table
    from grasptrack_bench.run_folder import fill_run_folder
    from grasptrack_bench.schedule import create_scheduler

    schedule = create_scheduler(suite.scheduler, suite.workers)

    def fill_and_report(tell: Progress) -> tuple[Filled, Path]:
        filled = fill_run_folder(
            output,
            work.kind,
            work.jobs,
            work.function,
            schedule,
            options=asked,
            command=shlex.join(["grasptrack", *sys.argv[1:]]),
            last=output / PAGE,
            progress=tell,
        )
        if not filled.done and not filled.resumed:
            raise InputError(f"nothing could be measured: {next(iter(filled.failed.values()), 'no case')}")
        return filled, write_report(output, picture=work.picture(output), progress=tell)

    filled, report = with_progress(output, suite.quiet, fill_and_report, again=", and the same command goes on with it")
    if suite.quiet:
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
