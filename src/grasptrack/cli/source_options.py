# SPDX-License-Identifier: Apache-2.0
"""Options of where images come from and where results go: settings of devices, recordings, lines of JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from grasptrack.cli import help_groups
from grasptrack.errors import InputError

if TYPE_CHECKING:
    from grasptrack.io.recording import Recording

Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        rich_help_panel=help_groups.SOURCE,
        help="Setting of a camera, a stream or a bag; may be repeated.",
    ),
]
RecordPaths = Annotated[
    list[Path] | None,
    typer.Option(
        "--record",
        metavar="FILE",
        rich_help_panel=help_groups.OUTPUT,
        help="Record images and results: .mcap for Foxglove, .rrd for rerun; may be repeated.",
    ),
]
RecordQuality = Annotated[
    int | None,
    typer.Option(
        "--record-quality",
        metavar="N",
        rich_help_panel=help_groups.OUTPUT,
        help="Record images as JPEG of this quality, 1 to 100.",
        show_default="as they are, so that a replay gives the same",
    ),
]
JsonlPath = Annotated[
    str | None,
    typer.Option(
        "--jsonl",
        metavar="FILE",
        rich_help_panel=help_groups.OUTPUT,
        help="Write a JSON object for every frame, one a line; - for the standard output.",
    ),
]
OutlineInJsonl = Annotated[
    bool,
    typer.Option("--outline-in-jsonl", rich_help_panel=help_groups.OUTPUT, help="Write the outline in --jsonl, too."),
]


def device_settings(pairs: Sequence[str] | None) -> dict[str, str]:
    """The settings of --set by name.

    Raises:
        InputError: one that is not NAME=VALUE.
    """
    found = {}
    for pair in pairs or ():
        name, sign, value = pair.partition("=")
        if not (name.strip() and sign):
            raise InputError(f'--set takes NAME=VALUE, as --set ExposureTime=2000, not "{pair}"', text=pair)
        found[name.strip()] = value.strip()
    return found


def open_recordings(
    paths: Sequence[Path] | None, quality: int | None, jsonl: str | None, outline: bool, asked: Mapping[str, Any]
) -> list[Recording]:
    """What --record, --record-quality, --jsonl and --outline-in-jsonl ask for; recordings keep the options of `asked`.

    Raises:
        InputError: an option without the one it belongs to; a file that cannot be recorded to; an extra that is absent.
    """
    from grasptrack.io.recorders.again import tracking_options
    from grasptrack.io.recorders.json_lines import JsonLines
    from grasptrack.io.recording import open_recording

    if quality is not None and not paths:
        raise InputError("--record-quality is for --record: give both")
    if outline and jsonl is None:
        raise InputError("--outline-in-jsonl is for --jsonl: give both")
    opened: list[Recording] = []
    try:
        for path in paths or ():
            opened.append(open_recording(path, quality=quality, options=lambda: tracking_options(asked)))
        if jsonl is not None:
            opened.append(JsonLines(Path(jsonl), outline=outline))
    except BaseException:
        for recording in opened:
            recording.close()
        raise
    return opened
