# SPDX-License-Identifier: Apache-2.0
"""Verbs that this distribution adds to `grasptrack`, one file each; here the options that more than one of them has."""

from typing import Annotated

from grasptrack.cli.help_groups import PROCESSES, SCENE, option

Silhouettes = Annotated[str | None, option(SCENE, "DIR", "Parts from silhouette images, black outside the part.")]
Seed = Annotated[int, option(SCENE, "N", "Seed of all that is random.", min=0)]
Workers = Annotated[int | None, option(PROCESSES, "N", "Number of processes.", show_default="one per core")]
Scheduler = Annotated[str | None, option(PROCESSES, "ADDRESS", "Address of a Dask scheduler.")]
