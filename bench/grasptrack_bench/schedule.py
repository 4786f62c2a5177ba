# SPDX-License-Identifier: Apache-2.0
"""Thousands of independent tasks: on all cores of this machine, or on a Dask cluster, with the same results.

Both are told of through futures, and everything but how these come about is one path. On this machine a task runs in a
process with one thread; a task in which the process dies is tried again in a new one. A cluster does that by itself.
"""

from __future__ import annotations

import hashlib
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Protocol
from weakref import WeakSet

import numpy as np

import grasptrack
from grasptrack.errors import GraspTrackError, InputError, install_hint

ATTEMPTS = 3
"""A task during which so many workers died is given up: it may well be what kills them."""
TIMEOUT_S = 15
"""How long to wait for the answer of a cluster's scheduler."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Read by numerical libraries when they are loaded: as many threads as processes would only wait for each other."""


@dataclass(frozen=True, slots=True)
class TaskOutcome:
    """What became of one task.

    Attributes:
        index: of the task, in the order in which they were given.
        value: what the function returned; None where it failed.
        error: empty, or what went wrong in one line.
    """

    index: int
    value: Any
    error: str


class Scheduler(Protocol):
    """Calls a function once for each task, anywhere, in any order."""

    def __call__(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[TaskOutcome]:
        """Outcomes as they come. A task that raises is an outcome with an error; the others go on.

        The function is importable by name, as pickle wants it; tasks pickle.
        """
        ...


@dataclass(frozen=True)
class _Workers:
    """Where tasks are done.

    Attributes:
        submit: a function and its task; gives a future, of `concurrent.futures` or of Dask.
        explain: what a future's exception means, in one line.
    """

    submit: Callable[[Callable[[Any], Any], Any], Any]
    explain: Callable[[BaseException], str]


def create_scheduler(address: str | None = None, workers: int | None = None) -> Scheduler:
    """Processes on this machine, by default one for each core for this process; or a Dask scheduler's, "tcp://host:8786"."""
    if address is None:
        if workers is not None and workers < 1:
            raise InputError(f"at least 1 worker is needed, not {workers}", workers=workers)
        return partial(_run_tasks, partial(_process_workers, workers or available_cores()))
    if workers is not None:
        raise InputError("--workers is for this machine; a cluster has its own: leave out one of the two")
    try:
        import_module("distributed")
    except ImportError:
        raise InputError(f"a cluster needs Dask: {install_hint('cluster')}") from None
    return partial(_run_tasks, partial(_cluster_workers, address))


def available_cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@lru_cache
def code_fingerprint() -> str:
    """What a result depends on besides its task; results of different code are never mixed.

    A hexadecimal digest of this package's sources, its compiled kernels, and the versions of NumPy and OpenCV.
    """
    import cv2

    digest = hashlib.sha256(f"{np.__version__} {cv2.__version__}".encode())
    root = Path(grasptrack.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    native = find_spec("_grasptrack_native")
    if native is not None and native.origin is not None:
        digest.update(Path(native.origin).read_bytes())
    return digest.hexdigest()


def _run_tasks(
    opened: Callable[[int], AbstractContextManager[_Workers]], function: Callable[[Any], Any], tasks: Sequence[Any]
) -> Iterator[TaskOutcome]:
    """The one path: all tasks are handed in, and told of as they are done."""
    done: SimpleQueue[int] = SimpleQueue()
    with opened(len(tasks)) as workers:
        futures = {i: workers.submit(function, task) for i, task in enumerate(tasks)}
        for i, future in futures.items():
            future.add_done_callback(lambda _, i=i: done.put(i))
        while futures:
            i = done.get()
            future = futures.pop(i)
            try:
                problem = future.exception()
                value = future.result() if problem is None else None
            except (CancelledError, OSError):
                raise GraspTrackError(
                    "the connection to the Dask scheduler was lost; what was computed is kept, and the same command "
                    "goes on with it"
                ) from None
            yield TaskOutcome(i, value, "" if problem is None else workers.explain(problem))


@contextmanager
def _process_workers(workers: int, tasks: int) -> Iterator[_Workers]:
    """Processes on this machine, each with one thread and one task at a time, so that it is known who kills them."""
    with _one_thread():
        pools = [_create_pool() for _ in range(min(workers, max(1, tasks)))]
        idle, stopped = SimpleQueue[int](), threading.Event()
        for slot in range(len(pools)):
            idle.put(slot)

        def retry_task(function: Callable[[Any], Any], task: Any) -> Any:
            for _ in range(ATTEMPTS):
                slot = idle.get()
                try:
                    return pools[slot].submit(function, task).result()
                except BrokenProcessPool:
                    if stopped.is_set():
                        break
                    pools[slot] = _create_pool()
                finally:
                    idle.put(slot)
            raise BrokenProcessPool(f"{ATTEMPTS} workers died at it")

        def explain_failure(problem: BaseException) -> str:
            return f"given up: {problem}" if isinstance(problem, BrokenProcessPool) else _in_one_line(problem)

        threads = ThreadPoolExecutor(len(pools))
        try:
            yield _Workers(lambda function, task: threads.submit(retry_task, function, task), explain_failure)
        finally:
            stopped.set()
            threads.shutdown(wait=False, cancel_futures=True)
            for pool in pools:
                for process in list((getattr(pool, "_processes", None) or {}).values()):
                    process.terminate()  # whoever interrupts does not want to wait for the tasks at hand
                pool.shutdown(wait=True, cancel_futures=True)
            threads.shutdown(wait=True)


@contextmanager
def _cluster_workers(address: str, tasks: int) -> Iterator[_Workers]:
    """A Dask cluster that is already there. A worker that is lost costs the tasks it had, which are done again elsewhere."""
    distributed: Any = import_module("distributed")
    # what a lost worker had is done again, which is no cause for a warning
    logging.getLogger("distributed.client").setLevel(logging.ERROR)
    try:
        client = distributed.Client(address, timeout=TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f'no Dask scheduler answers at "{address}": {error}', address=address) from error

    def explain_failure(problem: BaseException) -> str:
        told = _in_one_line(problem)
        killed = isinstance(problem, distributed.scheduler.KilledWorker)
        return f"given up: too many workers died at it ({told})" if killed else told

    with client:
        handed_in: WeakSet[Any] = WeakSet()

        def submit_task(function: Callable[[Any], Any], task: Any) -> Any:
            future = client.submit(_run_checked_task, function, task, code_fingerprint(), pure=False)
            handed_in.add(future)
            return future

        try:
            yield _Workers(submit_task, explain_failure)
        finally:
            client.cancel([future for future in handed_in if not future.done()])


def _run_checked_task(function: Callable[[Any], Any], task: Any, wanted: str) -> Any:
    """On a cluster's worker: see that it runs the same code, then do the task."""
    if code_fingerprint() != wanted:
        raise RuntimeError("this worker runs another version of grasptrack, NumPy or OpenCV than the one that asks")
    import cv2

    cv2.setNumThreads(1)
    return function(task)


def _create_pool() -> ProcessPoolExecutor:
    # Not forked: a child would inherit locks that threads of OpenCV may hold.
    return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare_process)


def _prepare_process() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import cv2

    cv2.setNumThreads(1)


def _end_with_parent() -> None:
    """End this process when the one that asked is gone, killed perhaps: nobody else would tell it."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
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


def _in_one_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
