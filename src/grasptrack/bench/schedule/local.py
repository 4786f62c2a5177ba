# SPDX-License-Identifier: Apache-2.0
"""Tasks on the cores of this machine, one process for each, each with one thread."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from grasptrack.bench.schedule.outcome import ATTEMPTS, Outcome, Scheduler, in_one_line
from grasptrack.errors import InputError

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Read by numerical libraries when they are loaded: as many threads as processes would only wait for each other."""


def available_cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def on_cores(workers: int | None = None) -> Scheduler:
    """A scheduler with so many processes; None takes one for each core.

    Raises:
        InputError: fewer than one.
    """
    if workers is not None and workers < 1:
        raise InputError(f"at least 1 worker is needed, not {workers}", workers=workers)
    count = available_cores() if workers is None else workers

    def run(function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Outcome]:
        return _run_tasks(function, tasks, min(count, max(1, len(tasks))))

    return run


def _run_tasks(function: Callable[[Any], Any], tasks: Sequence[Any], workers: int) -> Iterator[Outcome]:
    waiting, deaths = deque(range(len(tasks))), [0] * len(tasks)
    with _one_thread():
        pool = _create_pool(workers)
        running: dict[Future[Any], int] = {}
        try:
            while waiting or running:
                # What was at work when a worker died runs alone, so that it is known whose fault a second death is.
                while waiting and len(running) < workers and not any(deaths[i] for i in running.values()):
                    if deaths[waiting[0]] and running:
                        break
                    try:
                        future = pool.submit(function, tasks[waiting[0]])
                    except BrokenProcessPool:  # a worker died with nothing to do
                        pool = _renew_pool(pool, workers)
                        continue
                    running[future] = waiting.popleft()
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                broken = False
                for future in done:
                    index = running.pop(future)
                    problem = future.exception()
                    if isinstance(problem, BrokenProcessPool):
                        broken = True
                        yield from _after_death(index, deaths, waiting)
                    else:
                        yield _future_outcome(index, future, problem)
                if broken:
                    for future, index in list(running.items()):
                        problem = future.exception()
                        if isinstance(problem, BrokenProcessPool):
                            yield from _after_death(index, deaths, waiting)
                        else:
                            yield _future_outcome(index, future, problem)
                    running.clear()
                    pool = _renew_pool(pool, workers)
        finally:
            for future in running:
                future.cancel()
            for process in list((getattr(pool, "_processes", None) or {}).values()):
                process.terminate()  # whoever interrupts does not want to wait for the tasks at hand
            pool.shutdown(wait=True, cancel_futures=True)


def _future_outcome(index: int, future: Future[Any], problem: BaseException | None) -> Outcome:
    if problem is not None:
        return Outcome(index, None, in_one_line(problem))
    return Outcome(index, future.result(), "")


def _after_death(index: int, deaths: list[int], waiting: deque[int]) -> Iterator[Outcome]:
    """Put a task back whose worker may have died of it, or give it up."""
    deaths[index] += 1
    if deaths[index] < ATTEMPTS:
        waiting.append(index)
    else:
        yield Outcome(index, None, f"given up: {ATTEMPTS} workers died at it")


def _renew_pool(pool: ProcessPoolExecutor, workers: int) -> ProcessPoolExecutor:
    pool.shutdown(wait=False, cancel_futures=True)
    return _create_pool(workers)


def _create_pool(workers: int) -> ProcessPoolExecutor:
    # Not forked: a child would inherit locks that threads of OpenCV may hold.
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare_worker)


def _prepare_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    import cv2

    cv2.setNumThreads(1)


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Children started meanwhile load their numerical libraries with one thread."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
