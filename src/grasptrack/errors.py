# SPDX-License-Identifier: Apache-2.0
"""Every error that the library raises on purpose: one root, and each keeps the values that caused it."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path
from typing import Any

_LINE_ENDS = re.compile(r"\s*[\r\n]\s*")
LONGEST = 300
"""Characters of a message."""
IN_A_COPY = " in a copy of the repository"


def one_line(text: str) -> str:
    """Text on one line that fits, in which a terminal finds no command: what is not to be seen, as in a file's name, becomes an
    escape, and of what is too long the middle is left out, for its ends say what it is about and what to do."""
    line = _LINE_ENDS.sub(" ", text)
    if not line.isprintable():
        line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
    return line if len(line) <= LONGEST else f"{line[:180]} ... {line[-115:]}"


class GraspTrackError(Exception):
    """Root of all errors of this package.

    Args:
        message: that says what was wrong and what would be right; it becomes one line.
        **values: the values behind it, kept in `values` for programs that react to them.
    """

    def __init__(self, message: str, **values: object) -> None:
        super().__init__(one_line(message))
        self.values = values


def own_pip() -> str:
    """The command of this environment's own pip: another one on the path would install elsewhere."""
    return f"{shlex.quote(sys.executable)} -m pip"


def install_hint(extra: str) -> str:
    """How to install what an extra of this package adds: from where this installation came, which need not be an index."""
    origin = _told_origin()
    vcs = origin.get("vcs_info")
    if "dir_info" in origin:
        return f"{own_pip()} install {_copied_package(extra)}{'' if _copy_folder() else IN_A_COPY}"
    where = f" @ {vcs['vcs']}+{origin['url']}@{vcs['commit_id']}" if vcs else f" @ {origin['url']}" if origin else ""
    return f'{own_pip()} install "grasptrack[{extra}]{where}"'


def bench_hint(extra: str = "") -> str:
    """How to install what the distribution grasptrack-bench adds, with an extra of this one where it needs that."""
    own, folder = f"{_copied_package(extra)} " if extra else "", _copy_folder()
    bench = shlex.quote(str(folder / "bench")) if folder else f"./bench{IN_A_COPY}"
    return f"which is not installed: {own_pip()} install {own}{bench}"


def _told_origin() -> dict[str, Any]:
    """What pip noted of where this installation came from (PEP 610); empty where it came from an index."""
    import json
    from importlib import metadata

    try:
        noted = metadata.distribution("grasptrack").read_text("direct_url.json")
    except metadata.PackageNotFoundError:  # it runs out of a copy
        return {"dir_info": {}, "url": ""}
    origin: dict[str, Any] = json.loads(noted) if noted else {}
    return origin


def _copy_folder() -> Path | None:
    """The copy of the repository that was installed, where it is still there."""
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    origin = _told_origin()
    folder = Path(url2pathname(urlsplit(origin.get("url", "")).path))
    return folder if "dir_info" in origin and origin["url"] and (folder / "pyproject.toml").is_file() else None


def _copied_package(extra: str) -> str:
    """The words by which pip installs this package out of a copy, as it is installed now."""
    editable = "-e " if _told_origin().get("dir_info", {}).get("editable") else ""
    return f'{editable}"{_copy_folder() or "."}[{extra}]"'


def without_kernels(why: str) -> ImportError:
    """The error of an installation whose compiled kernels are missing or cannot be loaded."""
    again = f"{own_pip()} install --force-reinstall --no-binary grasptrack grasptrack"
    return ImportError(
        f"grasptrack's compiled kernels cannot be loaded ({why}): install a C++17 compiler, then install grasptrack again "
        f"({again}, or make .venv/.package in a clone)",
        name="_grasptrack_native",
    )


# --- what a user can put right -------------------------------------------------------------------


class InputError(GraspTrackError):
    """Something handed in cannot be used: exit status 2 on the command line."""


class SourceError(InputError):
    """A source of images, or one of its images, is missing, unreadable or of another size."""


class ContourError(InputError):
    """Points that are no contour: fewer than 8, not finite, too far away, without area, or crossing themselves."""


class GraspError(InputError):
    """Contacts that are no grasp on this object: too few, repeated, or not on its outline."""


class StrategyError(InputError):
    """An unknown strategy, or a grasp that the strategy cannot carry."""


# --- what an image did not allow -----------------------------------------------------------------


class ObservationError(GraspTrackError):
    """No object could be made out in an image."""


class TransferError(GraspTrackError):
    """A grasp could not be carried over; the message is the reason."""


class AxesError(TransferError):
    """The silhouette has no distinct inertia axes (Section III-B)."""


class ParallelLineError(TransferError):
    """The grasp line runs along I_min and never meets it: d_1 and d_2 are infinite."""


class AmbiguousError(TransferError):
    """More than one alignment fits equally well and they put the grasp in different places."""


class PeaksError(TransferError):
    """Fewer than four usable curvature peaks, or no well-conditioned four among them (Section IV-C)."""


class ConditioningError(TransferError):
    """A homography that is badly conditioned, mirrors the object or sends part of it to infinity."""


class ClippedError(TransferError):
    """The object is cut by the image border and the strategy needs it whole."""


class CrossingError(TransferError):
    """The transferred grasp line does not meet the outline where the contacts should be."""
