# SPDX-License-Identifier: Apache-2.0
"""Verbs that this distribution adds to `grasptrack`, one file each."""

from __future__ import annotations

from typing import Any

import typer


def option(panel: str, text: str, *names: str, **settings: Any) -> Any:
    """An option of a verb, with its help page's panel and text; settings as of `typer.Option`."""
    return typer.Option(*names, rich_help_panel=panel, help=text, **settings)
