# SPDX-License-Identifier: Apache-2.0
"""Tasks on a Dask cluster. A worker that is lost costs the tasks it had, which are done again elsewhere."""

from __future__ import annotations

import concurrent.futures
import logging
import uuid
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from typing import Any

from grasptrack.bench.schedule.fingerprint import code_fingerprint
from grasptrack.bench.schedule.outcome import Outcome, Scheduler, in_one_line
from grasptrack.errors import GraspTrackError, InputError

TIMEOUT_S = 15
"""How long to wait for the scheduler's answer."""


def on_cluster(address: str, workers: int | None = None) -> Scheduler:
    """A scheduler on a cluster that is already there.

    Args:
        address: of its scheduler, as in "tcp://host:8786".
        workers: must be None; how many there are is the cluster's affair.

    Raises:
        InputError: a number of workers was given, Dask is not installed, or nothing answers at the address.
        GraspTrackError: on the way, when the scheduler is gone.
    """
    if workers is not None:
        raise InputError("--workers is for this machine; a cluster has its own: leave out one of the two")
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise InputError('a cluster needs Dask: pip install "grasptrack[cluster]"') from None

    def run(function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Outcome]:
        # what a lost worker had is done again, which is no cause for a warning
        logging.getLogger("distributed.client").setLevel(logging.ERROR)
        try:
            client = distributed.Client(address, timeout=TIMEOUT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f'no Dask scheduler answers at "{address}": {error}', address=address) from error
        with client:
            yield from _run_tasks(client, function, tasks)

    return run


def _run_tasks(client: Any, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Outcome]:
    distributed: Any = import_module("distributed")
    ours, run = code_fingerprint(), uuid.uuid4().hex[:12]
    futures = {
        client.submit(_run_checked_task, function, task, ours, pure=False, key=f"grasptrack-{run}-{i}"): i
        for i, task in enumerate(tasks)
    }
    try:
        for future in distributed.as_completed(list(futures), loop=client.loop):
            try:
                problem = future.exception()
                value = future.result() if problem is None else None
            except (distributed.client.FutureCancelledError, concurrent.futures.CancelledError, OSError):
                raise GraspTrackError(
                    "the connection to the Dask scheduler was lost; what was computed is kept, and the same command "
                    "goes on with it"
                ) from None
            if problem is None:
                yield Outcome(futures[future], value, "")
            elif isinstance(problem, distributed.scheduler.KilledWorker):
                yield Outcome(futures[future], None, f"given up: too many workers died at it ({in_one_line(problem)})")
            else:
                yield Outcome(futures[future], None, in_one_line(problem))
            future.release()
    finally:
        client.cancel([future for future in futures if not future.done()])


def _run_checked_task(function: Callable[[Any], Any], task: Any, wanted: str) -> Any:
    """On a worker: see that it runs the same code, then do the task."""
    if code_fingerprint() != wanted:
        raise RuntimeError("this worker runs another version of grasptrack, NumPy or OpenCV than the one that asks")
    import cv2

    cv2.setNumThreads(1)
    return function(task)
