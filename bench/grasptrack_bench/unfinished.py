# SPDX-License-Identifier: Apache-2.0
"""Runs that were interrupted or killed, and can be gone on with."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

SAME = ("format", "kind", "code", "backend", "options")
"""What two runs must share for one to go on with the other's results."""


def read_unfinished(index: Path, head: Mapping[str, Any], last: Path | None = None) -> dict[str, Any] | None:
    """The index of a run that did not finish, with the same options and code as the one at hand, or None.

    Args:
        index: the JSON file; its key `ended` says how the run ended.
        head: what the run at hand writes into it first.
        last: a file without which a run has not finished, whatever its index says.
    """
    try:
        before = json.loads(index.read_text(encoding="utf-8"))
        wanted = json.loads(json.dumps({key: head[key] for key in SAME}))
        finished = before["ended"] == "finished" and (last is None or last.exists())
        if not finished and all(before[key] == wanted[key] for key in SAME):
            return dict(before)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        pass
    return None
