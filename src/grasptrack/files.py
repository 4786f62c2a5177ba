# SPDX-License-Identifier: Apache-2.0
"""Files that are whole at any moment or absent; one writer and reader of JSON, YAML and TOML; folders that one run holds."""

from __future__ import annotations

import errno
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from grasptrack.errors import InputError
from grasptrack.presentation import plain_value

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


# --- JSON, YAML and TOML --------------------------------------------------------------------------


LARGEST_BYTES = 1 << 20
"""Of a file that people or tools write; YAML takes seconds to read more."""
DEEPEST = 64
"""Lists within lists in YAML: its parser takes the square of them in time, and no calibration has more than four."""
_NUMBERS = re.compile(r"\[\n\s+([-+.,eE\d\s]+?)\n\s+\]")
"""A point in indented JSON. No line ends within a string, so that nothing else can match."""

_UNSEEN = re.compile("[\x7f-\xa0\u2028-\u202e\u2060-\u206f\ud800-\udfff\ufeff]")
"""What may be in a file's name, and no terminal or encoder should meet; JSON has escapes for it."""


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write strict JSON, a point on one line: what is not finite becomes null. The file is complete at any moment or absent.

    Raises:
        OSError: it cannot be written.
    """
    text = json.dumps(plain_value(content), indent=2, ensure_ascii=False, allow_nan=False)
    text = _NUMBERS.sub(lambda found: f"[{' '.join(found[1].split())}]", text)
    text = _UNSEEN.sub(lambda found: f"\\u{ord(found[0]):04x}", text)
    with whole_file(path) as part:
        part.write_text(text + "\n", encoding="utf-8")


def write_file(file: Path, content: str | bytes, kind: str) -> None:
    """Write text or bytes to a file of some kind, "calibration". The file is complete at any moment or absent.

    Raises:
        InputError: it cannot be written.
    """
    try:
        with whole_file(file) as part:
            if isinstance(content, bytes):
                part.write_bytes(content)
            else:
                part.write_text(content, encoding="utf-8")
    except (OSError, ValueError) as error:  # the name may be none
        why = getattr(error, "strerror", None) or error
        raise InputError(f'{kind} "{file}" cannot be written: {why}', path=str(file)) from None


def read_bytes(file: Path, kind: str, largest: int) -> bytes:
    """The bytes of a small file.

    Raises:
        InputError: it cannot be read, or is larger. The message does not name the file.
    """
    try:
        with file.open("rb") as stream:
            data = stream.read(largest + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(data) > largest:
        raise InputError(f"is too large: no {kind} has more than {largest} bytes")
    return data


def read_text(file: Path, kind: str, largest: int = LARGEST_BYTES) -> str:
    """The text of a small file in UTF-8.

    Raises:
        InputError: it cannot be read, is larger, empty, or no text. The message does not name the file.
    """
    try:
        text = read_bytes(file, kind, largest).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("is no text file") from None
    if not text.strip():
        raise InputError("is empty")
    return text


def read_keys(text: str) -> dict[str, Any]:
    """The keys of a JSON object, which begins with a brace, or of YAML; empty where YAML holds something else."""
    if text.lstrip().startswith("{"):
        return read_json(text)
    found = read_yaml(text)
    return found if isinstance(found, dict) else {}


def read_json(text: str) -> dict[str, Any]:
    """The keys of a JSON object."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is no JSON that can be read: {error}") from None
    if not isinstance(found, dict):
        raise InputError("is no JSON object, with keys")
    return found


def read_toml(text: str) -> dict[str, Any]:
    """The keys of TOML.

    Raises:
        InputError: it cannot be read, or Python is older than 3.11.
    """
    try:
        import tomllib
    except ImportError:
        raise InputError("is TOML, which Python reads from 3.11 on") from None
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"is no TOML that can be read: {error}") from None


def read_yaml(text: str) -> Any:
    """The first document of YAML as dictionaries, lists, numbers and words, OpenCV's dialect included.

    Raises:
        InputError: it cannot be read; the message names the line.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.constructor import SafeConstructor
    from ruamel.yaml.error import MarkedYAMLError
    from ruamel.yaml.nodes import MappingNode, ScalarNode

    class Constructor(SafeConstructor):
        """A safe one that takes what has a tag of its own, such as OpenCV's matrices, as if it had none."""

        def construct_tagged(self, node: Any) -> Any:
            if isinstance(node, ScalarNode):
                return self.construct_scalar(node)
            if isinstance(node, MappingNode):
                return self.construct_mapping(node, deep=True)
            return self.construct_sequence(node, deep=True)

    Constructor.add_constructor("tag:yaml.org,2002:opencv-matrix", Constructor.construct_tagged)
    Constructor.add_constructor(None, Constructor.construct_tagged)
    _check_brackets(text)
    yaml = YAML(typ="safe", pure=True)
    yaml.Constructor = Constructor
    try:
        found = next(iter(yaml.load_all(text)), None)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        why = error.problem or error.context or "unknown"
        raise InputError(
            f"line {mark.line + 1 if mark else 1} is no YAML that can be read: {' '.join(why.split())}"
        ) from None
    except RecursionError:
        raise InputError("line 1 begins what is nested too deeply") from None
    except Exception as error:  # of ruamel's own, on what no rule foresees
        raise InputError(f"line 1 is no YAML that can be read: {' '.join(str(error).split())}") from None
    if isinstance(found, str):
        raise InputError("line 1 is no YAML that can be read: it has no key")
    return found


def _check_brackets(text: str) -> None:
    """Refuse what opens so many brackets that reading it would take long only to be refused."""
    depth = 0
    for found in re.finditer(r"[\[\]{}]", text):
        depth = depth + 1 if found[0] in "[{" else max(0, depth - 1)
        if depth > DEEPEST:
            raise InputError(f"line {text.count(chr(10), 0, found.start()) + 1} begins what is nested too deeply")
