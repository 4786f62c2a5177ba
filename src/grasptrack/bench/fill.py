# SPDX-License-Identifier: Apache-2.0
"""Fill a run's folder with scored sequences, one file for each, so that an interrupted run goes on where it stopped."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from grasptrack import kernels
from grasptrack.bench.metrics.score import FrameScore
from grasptrack.bench.records import write_records
from grasptrack.bench.run_folder import CASES, FORMAT, INDEX
from grasptrack.bench.schedule import Scheduler, code_fingerprint
from grasptrack.errors import InputError
from grasptrack.io.results import describe_machine, software_versions, write_json
from grasptrack.io.run import prepare_folder

Progress = Callable[[str, int, int], None]
"""Called with the name of the step, what is done of it, and all of it, in frames."""


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


def fill_run_folder(
    folder: Path,
    kind: str,
    jobs: Sequence[Job],
    function: Callable[[Any], dict[str, list[FrameScore]]],
    schedule: Scheduler,
    *,
    options: Mapping[str, Any],
    command: str = "",
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
        progress: see `Progress`; when it raises, the run stops and can be gone on with.

    Raises:
        InputError: the folder cannot be written.
    """
    prepare_folder(folder)
    head: dict[str, Any] = {
        "format": FORMAT,
        "kind": kind,
        "options": dict(options),
        "versions": software_versions(),
        "backend": kernels.BACKEND,
        "code": code_fingerprint(),
        "machine": describe_machine(),
        "command": command,
    }
    before = _find_unfinished_run(folder, head)
    run = Filled(folder, seconds=float(before.get("seconds", 0.0)) if before else 0.0)
    if before is None:
        _remove_old_cases(folder)
    head["started"] = before["started"] if before else datetime.now(UTC).isoformat(timespec="seconds")
    (folder / CASES).mkdir(exist_ok=True)
    missing = [job for job in jobs if not case_file(folder, job.name).exists()]
    run.resumed = len(jobs) - len(missing)
    total, done = sum(job.frames for job in jobs), sum(job.frames for job in jobs) - sum(job.frames for job in missing)
    began, earlier, ended = time.perf_counter(), run.seconds, "interrupted"

    def index(state: str) -> None:
        run.seconds = earlier + time.perf_counter() - began
        cases = [{"name": j.name, "frames": j.frames, **j.about, "error": run.failed.get(j.name, "")} for j in jobs]
        write_json(folder / INDEX, {**head, "ended": state, "seconds": round(run.seconds, 3), "cases": cases})

    index("running")
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
        index(ended)
    return run


def case_file(folder: Path, name: str) -> Path:
    """Where the scored frames of a case are."""
    return folder / CASES / f"{name}.csv"


def _find_unfinished_run(folder: Path, head: Mapping[str, Any]) -> dict[str, Any] | None:
    """The index of a run in this folder that can be gone on with, or None."""
    try:
        before = json.loads((folder / INDEX).read_text(encoding="utf-8"))
        wanted = json.loads(json.dumps(dict(head["options"])))
        same = all(before.get(key) == head[key] for key in ("format", "kind", "code", "backend"))
        if same and before["options"] == wanted and before["ended"] != "finished":
            return dict(before)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        pass
    return None


def _remove_old_cases(folder: Path) -> None:
    """Remove the cases of an earlier run.

    Raises:
        InputError: a file cannot be removed.
    """
    for path in [*(folder / CASES).glob("*.csv"), *(folder / CASES).glob("*.part")]:
        try:
            with contextlib.suppress(FileNotFoundError):
                path.unlink()
        except OSError as error:
            raise InputError(f'"{path}" cannot be replaced: {error.strerror or error}') from None
