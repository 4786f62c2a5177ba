# SPDX-License-Identifier: Apache-2.0
"""Files that are whole at any moment or absent, and folders that one run at a time writes to."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from grasptrack.errors import InputError

_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS}
_held: ContextVar[frozenset[Path]] = ContextVar("held_folders", default=frozenset())


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A path beside a file, to be written to; the file is replaced by it when that is done, and is left as it was otherwise."""
    part = path.with_name(f"{path.name}.part")
    try:
        yield part
        part.replace(path)
    except BaseException as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename is None:  # as of a write
            error.filename = str(path)
        raise


def is_full_disk(error: OSError) -> bool:
    """Whether it says that a file system, or a limit of this user's or process's, takes no more."""
    return error.errno in _NO_ROOM


OUTPUTS = frozenset(
    {"run.json", "grasps.csv", "overlay.mp4", "summary.png", "candidates.png", "grasps.json", "grasps.png"}
    | {"inspect.json", "inspect.png", "transfer.json", "transfer.png", "parts.json", "parts.png"}
    | {"instances.json", "instances.csv", "instances.png"}
)
"""Names that verbs give what they write; each JSON file tells which of them were written with it."""


def keep_inputs(written: Iterable[Path], read: Iterable[str | Path]) -> None:
    """Refuse, before anything is written, to write over what is to be read, or over what others have written."""
    inputs = {Path(each).resolve() for each in read}
    for path in written:
        if path.resolve() in inputs:
            raise InputError(
                f'"{path}" is to be read, and would be written over: name another folder or file for what is written',
                path=str(path),
            )
        if path.name in OUTPUTS and path.exists() and path.name not in written_before(path.parent):
            with hold_folder(path.parent):  # else it is of a run that goes on
                told = "is not of an earlier run, and would be written over: move it, or name another folder (--output)"
                raise InputError(f'"{path}" {told}', path=str(path))


def written_before(folder: Path) -> set[str]:
    """Names of the files that runs have written to a folder, by what they say of themselves."""
    names: set[str] = set()
    for path in (folder / name for name in OUTPUTS if name.endswith(".json")):
        with suppress(OSError, ValueError):
            told = json.loads(path.read_bytes())
            if isinstance(told, dict) and "grasptrack" in (told.get("versions") or ()):
                names |= {path.name, *told.get("files", OUTPUTS)}
    return names


def prepare_folder(output: Path) -> None:
    """Make a folder and see that it can be written to."""
    try:
        output.mkdir(parents=True, exist_ok=True)
        probe = output / ".grasptrack-probe"
        probe.touch()
        probe.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f'output folder "{output}" cannot be written: {error.strerror or error}', path=str(output)
        ) from None


@contextmanager
def hold_folder(output: Path) -> Iterator[None]:
    """Make a folder and keep other runs out of it, in this process and in others; within, it may be held again.

    The lock is on the folder itself: it leaves no file behind and ends with the process, however that ends. Where the file
    system or the operating system has no such locks, nothing is kept out.

    Raises:
        InputError: it cannot be written to, another run holds it, or the disk gets full within.
    """
    prepare_folder(output)
    place = output.resolve()
    with ExitStack() as stack:
        if place not in _held.get():
            descriptor = _lock_folder(place)
            if descriptor is not None:
                stack.callback(os.close, descriptor)
            token = _held.set(_held.get() | {place})
            stack.callback(_held.reset, token)
        try:
            yield
        except OSError as error:
            if not is_full_disk(error):
                raise
            where = error.filename or output
            raise InputError(
                f'"{where}" cannot be written: {error.strerror or error}; what was computed before is in "{output}"',
                path=str(where),
            ) from error


def _lock_folder(folder: Path) -> int | None:
    """A descriptor with which the lock ends; None where there are no locks."""
    try:
        import fcntl
    except ImportError:
        return None
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise InputError(
            f'another run writes to "{folder}" now: wait for its end, or name another folder (--output)',
            path=str(folder),
        ) from None
    except OSError:
        os.close(descriptor)
        return None
    return descriptor
