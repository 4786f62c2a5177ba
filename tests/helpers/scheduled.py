# SPDX-License-Identifier: Apache-2.0
"""Tasks for schedulers: in a module of their own, because worker processes import them."""

import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack_bench.metrics.score import FrameScore
from grasptrack_bench.schedule import TaskOutcome
from scores import random_run


def square(number: int) -> int:
    if number < 0:
        raise ValueError(f"{number} is\nnegative")
    return number * number


def threads(_: int) -> tuple[int, str]:
    import cv2

    return cv2.getNumThreads(), os.environ["OPENBLAS_NUM_THREADS"]


def square_or_die(task: tuple[int, str, int]) -> int:
    """Kill the process that runs this, as often as is still asked for."""
    number, folder, deaths = task
    before = len(list(Path(folder).glob(f"{number}-*")))
    if before < deaths:
        (Path(folder) / f"{number}-{before}").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    return number * number


def gated_square(task: tuple[int, str]) -> int:
    """Leave the process's number behind, and wait until a file says that one may go on."""
    number, folder = task
    (Path(folder) / f"{number}-{os.getpid()}").touch()
    if wait_for(Path(folder), "go") is None:
        raise TimeoutError("nobody opened the gate")
    return number * number


def wait_for(folder: Path, pattern: str) -> Path | None:
    """The first file of that kind, as soon as there is one; None after a minute."""
    for _ in range(6000):
        if found := next(folder.glob(pattern), None):
            return found
        time.sleep(0.01)
    return None


def scored(task: tuple[int, str]) -> dict[str, list[FrameScore]]:
    """A run made up from its seed; leaves a mark each time it is asked for; seed 3 fails."""
    seed, folder = task
    (Path(folder) / f"asked-{seed}-{time.monotonic_ns()}").touch()
    if seed == 3:
        raise ValueError("no grasp here")
    return {"auto": random_run(np.random.default_rng(seed), 20)}


def in_this_process(function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[TaskOutcome]:
    """A `Scheduler` that starts no process, for what is not about processes."""
    for index, task in enumerate(tasks):
        try:
            yield TaskOutcome(index, function(task), "")
        except ValueError as error:
            yield TaskOutcome(index, None, f"{type(error).__name__}: {error}")
