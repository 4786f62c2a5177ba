# SPDX-License-Identifier: Apache-2.0
"""Packages that only some users need: imported when they are used, and named with their extra when they are absent."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from grasptrack.errors import InputError, install_hint


def import_extra(module: str, extra: str, purpose: str) -> Any:
    """The module of a package that an extra of this one installs.

    Args:
        module: its dotted name.
        extra: in ``pip install "grasptrack[extra]"``.
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
