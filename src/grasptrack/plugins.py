# SPDX-License-Identifier: Apache-2.0
"""What entry points add, each by its name: strategies, segmenters, sources, recorders and more; and what extras install.

A package names them in its own `pyproject.toml`, and nothing here has to be touched:

    [project.entry-points."grasptrack.strategies"]
    my-transfer = "my_package:strategy"
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, version
from importlib.util import find_spec
from typing import Any, Literal

from grasptrack.errors import InputError, install_hint

Group = Literal[
    "grasptrack.strategies",
    "grasptrack.segmenters",
    "grasptrack.sources",
    "grasptrack.cameras",
    "grasptrack.recorders",
    "grasptrack.methods",
    "grasptrack.verbs",
    "grasptrack.arms",
]


def plugin_names(group: Group) -> tuple[str, ...]:
    """Names that installed packages add to a group, sorted."""
    return tuple(sorted(_find_entries(group)))


def load_plugin(group: Group, name: str) -> Any:
    """The object that a package registered, or None where no package registered that name."""
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


def import_extra(module: str, extra: str, purpose: str) -> Any:
    """The module of a package that an extra of this one installs.

    Args:
        module: its dotted name.
        extra: of this package; see `grasptrack.errors.install_hint`.
        purpose: what needs it, as the subject of the message.

    Raises:
        InputError: it is not installed, or cannot be loaded here.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        if is_installed(package):
            raise InputError(f"{purpose} needs {package}, which cannot be loaded: {error}", module=module) from None
        raise InputError(f"{purpose} needs {package}: {install_hint(extra)}", module=module) from None


def is_installed(package: str) -> bool:
    """Whether a package is there, without loading it."""
    return find_spec(package) is not None


def version_of(package: str) -> str:
    """Of an installed package; empty where it is not."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
