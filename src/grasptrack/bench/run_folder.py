# SPDX-License-Identifier: Apache-2.0
"""The folder of an evaluation: `evaluation.json` says what was run, `cases/NAME.csv` holds the scored frames."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from grasptrack.bench.metrics.score import FrameScore
from grasptrack.bench.records import read_records
from grasptrack.errors import InputError
from grasptrack.io.results import write_json

INDEX = "evaluation.json"
CASES = "cases"
FORMAT = 1
KINDS = {"scenes": "disturbance", "real": "video"}
"""What the cases of a run of each kind are grouped by."""
NOT_YET = "the run ended before it was scored"


@dataclass(frozen=True)
class Case:
    """One sequence that all methods were shown.

    Attributes:
        name: of its file.
        frames: of the sequence.
        shape: the part; "" where it has no name.
        disturbance: what was done to it; the video's name in a run of kind "real".
        group: of the disturbance; "" without one.
        seed: of the scene, or None.
        error: why there are no results, "" where there are.
    """

    name: str
    frames: int
    shape: str = ""
    disturbance: str = ""
    group: str = ""
    seed: int | None = None
    error: str = ""


@dataclass(frozen=True)
class EvaluationRun:
    """What a run's folder holds; the scored frames are read when they are first asked for.

    Attributes:
        path: of the folder.
        kind: "scenes" or "real".
        index: all of `evaluation.json`.
        cases: in the order of the index; those that failed have an error.
    """

    path: Path
    kind: str
    index: Mapping[str, Any] = field(repr=False)
    cases: tuple[Case, ...] = field(repr=False)

    @cached_property
    def scores(self) -> dict[str, dict[str, list[FrameScore]]]:
        """Scored frames by case and method, of the cases that have results.

        Raises:
            InputError: a file of scored frames is missing or broken.
        """
        return {c.name: read_records(_case_path(self.path, c)) for c in self.cases if not c.error}

    @cached_property
    def methods(self) -> tuple[str, ...]:
        """Names in the order in which they were asked for, then in which they were met."""
        met = dict.fromkeys(m for case in self.scores.values() for m in case)
        asked = self.options.get("methods")
        first = [m for m in asked if m in met] if isinstance(asked, list) else []
        return tuple(dict.fromkeys([*first, *met]))

    @property
    def factor(self) -> str:
        """What cases are grouped by: "disturbance" or "video"."""
        return KINDS[self.kind]

    @property
    def scored(self) -> tuple[Case, ...]:
        """The cases with results."""
        return tuple(c for c in self.cases if not c.error)

    @property
    def failed(self) -> tuple[Case, ...]:
        """The cases without."""
        return tuple(c for c in self.cases if c.error)

    @property
    def options(self) -> dict[str, Any]:
        """What was asked for."""
        return dict(self.index.get("options") or {})

    def runs(self, method: str, cases: Iterable[Case]) -> list[list[FrameScore]]:
        """The frames of one method in each of some cases that it took part in."""
        found = (self.scores.get(c.name, {}).get(method) for c in cases)
        return [frames for frames in found if frames is not None]


def read_run(path: Path) -> EvaluationRun:
    """Read the index of a run's folder.

    Raises:
        InputError: no such folder, or what it holds is no evaluation of this format.
    """
    file = path / INDEX
    try:
        index = json.loads(file.read_text(encoding="utf-8"))
        if not isinstance(index, dict):
            raise ValueError("it holds no object")
    except FileNotFoundError:
        raise InputError(f'"{path}" is no folder of an evaluation: it has no {INDEX}', path=str(path)) from None
    except (OSError, ValueError) as error:
        raise InputError(f'cannot read "{file}": {error}', path=str(file)) from error
    if index.get("format") != FORMAT or index.get("kind") not in KINDS:
        raise InputError(
            f'"{file}" is of format {index.get("format")}, kind {index.get("kind")}: '
            f"format {FORMAT} of kind {' or '.join(KINDS)} can be read",
            path=str(file),
        )
    try:
        cases = tuple(_parse_case(entry, index["kind"]) for entry in index["cases"])
        if index.get("ended") in ("running", "interrupted"):
            cases = tuple(c if c.error or _case_path(path, c).exists() else replace(c, error=NOT_YET) for c in cases)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f'"{file}": its list of cases is broken ({error!r})', path=str(file)) from error
    if not any(not c.error for c in cases):
        raise InputError(f'"{file}" names no case with results', path=str(file))
    return EvaluationRun(path, index["kind"], index, cases)


def write_index(path: Path, kind: str, cases: Iterable[Case], **content: Any) -> None:
    """Write `evaluation.json` of a folder, which is made when missing.

    Args:
        path: the folder.
        kind: "scenes" or "real".
        cases: whose frames are, or will be, in `cases/NAME.csv`.
        **content: what else to tell: options, versions, machine, command, started, seconds.
    """
    (path / CASES).mkdir(parents=True, exist_ok=True)
    listed = [{key: getattr(c, key) for key in _TOLD[kind]} for c in cases]
    write_json(path / INDEX, {"format": FORMAT, "kind": kind, **content, "cases": listed})


_TOLD = {
    "scenes": ("name", "frames", "shape", "disturbance", "group", "seed", "error"),
    "real": ("name", "frames", "error"),
}


def _case_path(folder: Path, case: Case) -> Path:
    return folder / CASES / f"{case.name}.csv"


def _parse_case(entry: Mapping[str, Any], kind: str) -> Case:
    name = str(entry["name"])
    if not name or Path(name).name != name:
        raise ValueError(f'"{name}" is no name of a case')
    return Case(
        name=name,
        frames=int(entry["frames"]),
        shape=str(entry.get("shape") or ""),
        disturbance=name if kind == "real" else str(entry["disturbance"]),
        group=str(entry.get("group") or ""),
        seed=None if entry.get("seed") is None else int(entry["seed"]),
        error=str(entry.get("error") or ""),
    )
