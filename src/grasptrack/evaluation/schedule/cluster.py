# SPDX-License-Identifier: Apache-2.0
"""Tasks on a Dask cluster. A worker that is lost costs the tasks it had, which are done again elsewhere."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from grasptrack.errors import InputError
from grasptrack.evaluation.schedule.fingerprint import fingerprint
from grasptrack.evaluation.schedule.outcome import ATTEMPTS, Outcome, Scheduler, in_one_line

TIMEOUT_S = 15
"""How long to wait for the scheduler's answer."""


def on_cluster(address: str, workers: int | None = None) -> Scheduler:
    """A scheduler on a cluster that is already there.

    Args:
        address: of its scheduler, as in "tcp://host:8786".
        workers: must be None; how many there are is the cluster's affair.

    Raises:
        InputError: a number of workers was given, Dask is not installed, or nothing answers at the address.
    """
    if workers is not None:
        raise InputError("--workers is for this machine; a cluster has its own: leave out one of the two")
    try:
        import distributed
    except ImportError:
        raise InputError('a cluster needs Dask: pip install "grasptrack[cluster]"') from None

    def run(function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Outcome]:
        try:
            client = distributed.Client(address, timeout=TIMEOUT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f'no Dask scheduler answers at "{address}": {error}', address=address) from error
        with client:
            yield from _run(client, function, tasks)

    return run


def _run(client: Any, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Outcome]:
    import distributed

    ours, run = fingerprint(), uuid.uuid4().hex[:12]
    futures = {
        client.submit(_checked, function, task, ours, pure=False, key=f"grasptrack-{run}-{i}"): i
        for i, task in enumerate(tasks)
    }
    deaths = [0] * len(tasks)
    try:
        going = distributed.as_completed(list(futures), loop=client.loop)
        for future in going:
            index = futures[future]
            problem = future.exception()
            if problem is None:
                yield Outcome(index, future.result(), "")
            elif isinstance(problem, distributed.scheduler.KilledWorker):
                yield Outcome(index, None, f"given up: too many workers died at it ({in_one_line(problem)})")
            elif isinstance(problem, (distributed.client.FutureCancelledError, OSError)) and deaths[index] < ATTEMPTS:
                deaths[index] += 1  # the connection broke, not the task
                future.retry()
                going.add(future)
                continue
            else:
                yield Outcome(index, None, in_one_line(problem))
            future.release()
    finally:
        client.cancel([future for future in futures if not future.done()])


def _checked(function: Callable[[Any], Any], task: Any, wanted: str) -> Any:
    """On a worker: see that it runs the same code, then do the task."""
    if fingerprint() != wanted:
        raise RuntimeError("this worker runs another version of grasptrack, NumPy or OpenCV than the one that asks")
    import cv2

    cv2.setNumThreads(1)
    return function(task)
