# SPDX-License-Identifier: Apache-2.0
"""The folder of an evaluation: filled case by case, and read.

`evaluation.json` says what was run, `cases/NAME.csv` holds the scored frames, one file for each sequence, so that an
interrupted run goes on where it stopped.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from functools import cached_property
from pathlib import Path
from typing import Any

from grasptrack import kernels
from grasptrack.errors import InputError
from grasptrack.files import hold_folder, prepare_folder, write_json
from grasptrack.io.results import software_versions
from grasptrack.typing import Progress
from grasptrack_bench.metrics.score import FrameScore
from grasptrack_bench.records import read_records, write_records
from grasptrack_bench.schedule import Scheduler, code_fingerprint

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
        """Scored frames by case and method, of the cases that have results."""
        return {c.name: read_records(case_file(self.path, c.name)) for c in self.cases if not c.error}

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
    """Read the index of a run's folder."""
    file = path / INDEX
    try:
        index = json.loads(file.read_text(encoding="utf-8"))
        if not isinstance(index, dict):
            raise ValueError("it holds no object")
    except FileNotFoundError:
        raise InputError(f'"{path}" is no folder of an evaluation: it has no {INDEX}', path=str(path)) from None
    except (OSError, ValueError, RecursionError) as error:
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
            cases = tuple(
                c if c.error or case_file(path, c.name).exists() else replace(c, error=NOT_YET) for c in cases
            )
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InputError(f'"{file}": its list of cases is broken ({error!r})', path=str(file)) from error
    if not any(not c.error for c in cases):
        raise InputError(f'"{file}" names no case with results', path=str(file))
    return EvaluationRun(path, index["kind"], index, cases)


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


@dataclass(frozen=True)
class Job:
    """One sequence to be scored.

    Attributes:
        name: of the case, and of its file.
        frames: of the sequence, for the progress.
        about: what the index tells of it.
        task: what the function is called with; it pickles.
    """

    name: str
    frames: int
    about: Mapping[str, Any]
    task: Any


@dataclass
class Filled:
    """What became of a run.

    Attributes:
        folder: of the run.
        done: cases scored in this run.
        resumed: cases that an interrupted run had scored before.
        failed: reason by case, of those that could not be scored.
        seconds: that it took, with those of the runs before it.
    """

    folder: Path
    done: int = 0
    resumed: int = 0
    failed: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0


def describe_machine() -> str:
    """Processor, its cores and the operating system, in one line."""
    name = platform.processor() or platform.machine()
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), name)
    return f"{name}, {os.cpu_count() or 1} cores, {platform.system()}"


def fill_run_folder(
    folder: Path,
    kind: str,
    jobs: Sequence[Job],
    function: Callable[[Any], dict[str, list[FrameScore]]],
    schedule: Scheduler,
    *,
    options: Mapping[str, Any],
    command: str = "",
    last: Path | None = None,
    progress: Progress | None = None,
) -> Filled:
    """Score every job and write `evaluation.json` and `cases/NAME.csv`.

    A folder that holds a run which did not finish, with the same options and the same code, is gone on with; any other
    run in it is written over. A case that fails is told in the index, and the others go on.

    Args:
        folder: made when missing.
        kind: "scenes" or "real".
        jobs: with distinct names.
        function: of a job's task; gives scored frames by method.
        schedule: who does the work.
        options: what decides the results, for the index.
        command: that repeats the run, for the index.
        last: file that the caller writes when all is scored; a run without it did not finish.
        progress: see `Progress`; when it raises, the run stops and can be gone on with.
    """
    head = {**index_head(kind, options), "machine": describe_machine(), "command": command}
    with hold_folder(folder):
        before = read_unfinished(folder / INDEX, head, last)
        if before is None:
            _remove_old_cases(folder)
            if last is not None:
                last.unlink(missing_ok=True)
        told = before or {}
        run = Filled(folder, seconds=told["seconds"] if isinstance(told.get("seconds"), float) else 0.0)
        head["started"] = told.get("started", datetime.now(timezone.utc).isoformat(timespec="seconds"))
        prepare_folder(folder / CASES)
        missing = [job for job in jobs if not case_file(folder, job.name).exists()]
        run.resumed = len(jobs) - len(missing)
        total, done = (
            sum(job.frames for job in jobs),
            sum(job.frames for job in jobs) - sum(job.frames for job in missing),
        )
        began, earlier, ended = time.perf_counter(), run.seconds, "interrupted"

        def write_index(state: str) -> None:
            run.seconds = earlier + time.perf_counter() - began
            cases = [{"name": j.name, "frames": j.frames, **j.about, "error": run.failed.get(j.name, "")} for j in jobs]
            write_json(folder / INDEX, {**head, "ended": state, "seconds": round(run.seconds, 3), "cases": cases})

        write_index("running")
        try:
            if progress is not None:
                progress(kind, done, total)
            for outcome in schedule(function, [job.task for job in missing]):
                job = missing[outcome.index]
                if outcome.error:
                    run.failed[job.name] = outcome.error
                else:
                    write_records(case_file(folder, job.name), outcome.value)
                    run.done += 1
                done += job.frames
                if progress is not None:
                    progress(kind, done, total)
            ended = "finished"
        finally:
            write_index(ended)
    return run


def case_file(folder: Path, name: str) -> Path:
    """Where the scored frames of a case are."""
    return folder / CASES / f"{name}.csv"


def _remove_old_cases(folder: Path) -> None:
    for path in [*(folder / CASES).glob("*.csv"), *(folder / CASES).glob("*.part")]:
        try:
            with contextlib.suppress(FileNotFoundError):
                path.unlink()
        except OSError as error:
            raise InputError(f'"{path}" cannot be replaced: {error.strerror or error}') from None


def index_head(kind: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """What the index of a run begins with: what was asked for, and what software did it."""
    return {
        "format": FORMAT,
        "kind": kind,
        "options": dict(options),
        "versions": software_versions(),
        "backend": kernels.BACKEND,
        "code": code_fingerprint(),
    }


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
