# SPDX-License-Identifier: Apache-2.0
"""What other packages add by entry points: strategies, segmenters, methods and verbs, each found by its name.

A package names them in its own `pyproject.toml`, and nothing here has to be touched:

    [project.entry-points."grasptrack.strategies"]
    my-transfer = "my_package:strategy"
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal

from grasptrack.errors import InputError

Group = Literal["grasptrack.strategies", "grasptrack.segmenters", "grasptrack.methods", "grasptrack.verbs"]


def plugin_names(group: Group) -> tuple[str, ...]:
    """Names that installed packages add to a group, sorted."""
    return tuple(sorted(_find_entries(group)))


def load_plugin(group: Group, name: str) -> Any:
    """The object that a package registered, or None where no package registered that name.

    Raises:
        InputError: a package registered it, but its import fails; the message says why.
    """
    entry = _find_entries(group).get(name)
    if entry is None:
        return None
    try:
        return entry.load()
    except Exception as error:  # whatever another package's import raises
        raise InputError(
            f'"{name}" of {group} ({entry.value}) cannot be loaded: {type(error).__name__}: {error}', name=name
        ) from error


@cache
def _find_entries(group: Group) -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=group)}
