# SPDX-License-Identifier: Apache-2.0
"""`grasptrack demo`: a rendered scene with known truth, tracked by every strategy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from grasptrack.cli import help_groups, options
from grasptrack.cli.terminal import format_number, show_rows, with_progress

if TYPE_CHECKING:
    from grasptrack.typing import Progress

_MEASURES = ("error px\nmedian", "\n95 %", "\nmax", "wrong", "ms\nmedian", "\n99 %")
_HEADS = ("<strategy", "tracked", "unstable", "lost", *_MEASURES)
FRAME_S = 0.05
"""s that a frame takes with all strategies; about as much again where it is filmed."""


def demo(
    frames: Annotated[
        int, typer.Option(metavar="N", min=2, rich_help_panel=help_groups.SCENE, help="Number of frames.")
    ] = 120,
    output: options.Output = options.OUTPUT_FOLDER / "demo",
    no_video: options.NoVideo = False,
    quiet: options.Quiet = False,
    risk: options.Risk = 1e-3,
) -> None:
    """Render a scene seen by a tilting camera, track a grasp by every strategy, and compare with ground truth.

    Each strategy gets a folder of its own under the output folder, as `grasptrack track` writes it.

    \b
    Examples:
      grasptrack demo
      grasptrack demo --frames 300 --output /tmp/demo
      grasptrack demo --risk 1e-5
    """
    from grasptrack.demo import STRATEGIES, run_demo

    seconds = FRAME_S * frames * (1 if no_video else 2)

    def run(tell: Progress) -> list[dict[str, Any]]:
        if not quiet:
            print(
                f"Renders {frames} frames of a part seen by a tilting camera, tracks a grasp in them by "
                f"{len(STRATEGIES)} strategies, and compares with the truth: some {max(2, round(seconds))} s.",
                flush=True,
            )
        return run_demo(output, frames=frames, video=not no_video, progress=tell, risk=risk)

    rows = with_progress(output, quiet, run)
    if quiet:
        return
    notes = [f"{row['strategy']} lost, mostly: {row['reason']}" for row in rows if row["reason"]]
    notes.append(f"{output}: " + ", ".join(f"{row['strategy']}/" for row in rows))
    shown = ["summary.png"] if no_video else ["overlay.mp4", "summary.png"]
    notes.append("Open " + " or ".join(str(output / "auto" / name) for name in shown) + ".")
    show_rows(f"{frames} frames, contacts against the truth", _HEADS, [_row_cells(row) for row in rows], notes)


def _row_cells(row: dict[str, Any]) -> list[str]:
    names = ("error_median_px", "error_p95_px", "error_max_px")
    return [
        *(str(row[name]) for name in ("strategy", "tracked", "unstable", "lost")),
        *(format_number(row[name]) for name in names),
        str(row["false_accepts"]),
        *(format_number(row[name], 1) for name in ("latency_median_ms", "latency_p99_ms")),
    ]
