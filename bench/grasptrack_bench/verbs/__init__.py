# SPDX-License-Identifier: Apache-2.0
"""Verbs that this distribution adds to `grasptrack`, one file each; here the options that more than one of them has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from grasptrack.cli.help_groups import PROCESSES, SCENE, option
from grasptrack.errors import InputError

if TYPE_CHECKING:
    from grasptrack_bench.simulation.outlines import Shape

Silhouettes = Annotated[str | None, option(SCENE, "DIR", "Parts from silhouette images, black outside the part.")]
Seed = Annotated[int, option(SCENE, "N", "Seed of all that is random.", min=0)]
Workers = Annotated[int | None, option(PROCESSES, "N", "Number of processes.", show_default="one per core")]
Scheduler = Annotated[str | None, option(PROCESSES, "ADDRESS", "Address of a Dask scheduler.")]


def shapes_asked(shape: str | None, silhouettes: str | None) -> list[Shape]:
    """The outline of a name, those of silhouettes, or all that are built in where neither is given."""
    if shape is not None and silhouettes is not None:
        raise InputError("--shape and --silhouettes both say which part: give one of them")
    from grasptrack_bench.scenes import built_in, parts_from_silhouettes

    found = parts_from_silhouettes(silhouettes) if silhouettes is not None else built_in([shape] if shape else [])
    return [part.shape for part in found]
