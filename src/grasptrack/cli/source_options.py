# SPDX-License-Identifier: Apache-2.0
"""Options of where images come from and where results go: settings of devices, recordings, lines of JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from grasptrack.cli.help_groups import OUTPUT, SOURCE
from grasptrack.cli.option_groups import option
from grasptrack.errors import InputError

if TYPE_CHECKING:
    from grasptrack.io.recording import Recording


@dataclass(frozen=True)
class SourceOptions:
    """How images are read."""

    fps: Annotated[
        float | None,
        option(SOURCE, "FPS", "Frame rate, in frames/s, for folders and globs, which have no times.", "--fps"),
    ] = None
    set: Annotated[
        list[str] | None,
        option(SOURCE, "NAME=VALUE", "Setting of a camera, a stream or a bag; may be repeated.", "--set"),
    ] = None

    def camera_settings(self) -> dict[str, str]:
        """The settings of --set by name.

        Raises:
            InputError: one that is not NAME=VALUE.
        """
        found = {}
        for pair in self.set or ():
            name, sign, value = pair.partition("=")
            if not (name.strip() and sign):
                raise InputError(f'--set takes NAME=VALUE, as --set ExposureTime=2000, not "{pair}"', text=pair)
            found[name.strip()] = value.strip()
        return found


@dataclass(frozen=True)
class RecordingOptions:
    """What is written beside the run's own files."""

    record: Annotated[
        list[Path] | None,
        option(
            OUTPUT,
            "FILE",
            "Record images and results: .mcap for Foxglove, .rrd for rerun; may be repeated.",
            "--record",
        ),
    ] = None
    record_quality: Annotated[
        int | None,
        option(
            OUTPUT,
            "N",
            "Record images as JPEG of this quality, 1 to 100.",
            "--record-quality",
            show_default="as they are, so that a replay gives the same",
        ),
    ] = None
    jsonl: Annotated[
        str | None,
        option(
            OUTPUT, "FILE", "Write a JSON object for every frame, one a line; - for the standard output.", "--jsonl"
        ),
    ] = None
    outline_in_jsonl: Annotated[
        bool, option(OUTPUT, None, "Write the outline in --jsonl, too.", "--outline-in-jsonl")
    ] = False

    def as_written(self) -> dict[str, Any]:
        """As written, for the record of a run."""
        return {"record": self.record, "record_quality": self.record_quality, "jsonl": self.jsonl}

    def open_recordings(self, asked: Mapping[str, Any]) -> list[Recording]:
        """What the options ask for; recordings keep the options of `asked`.

        Raises:
            InputError: an option without the one it belongs to; a file that cannot be recorded to; an extra that is absent.
        """
        from grasptrack.io.recording import JsonLines, open_recording, tracking_options

        if self.record_quality is not None and not self.record:
            raise InputError("--record-quality is for --record: give both")
        if self.outline_in_jsonl and self.jsonl is None:
            raise InputError("--outline-in-jsonl is for --jsonl: give both")
        opened: list[Recording] = []
        try:
            for path in self.record or ():
                opened.append(
                    open_recording(path, quality=self.record_quality, options=lambda: tracking_options(asked))
                )
            if self.jsonl is not None:
                opened.append(JsonLines(Path(self.jsonl), outline=self.outline_in_jsonl))
        except BaseException:
            for recording in opened:
                recording.close()
            raise
        return opened
