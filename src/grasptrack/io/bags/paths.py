# SPDX-License-Identifier: Apache-2.0
"""Which files and folders are bags."""

from __future__ import annotations

from pathlib import Path

SUFFIXES = frozenset({".bag", ".mcap", ".db3"})


def is_bag(path: Path) -> bool:
    """Whether a path is that of a bag: a file by its suffix, a folder by what `ros2 bag` puts into it."""
    if path.is_file():
        return path.suffix.lower() in SUFFIXES
    return path.is_dir() and (path / "metadata.yaml").is_file()
