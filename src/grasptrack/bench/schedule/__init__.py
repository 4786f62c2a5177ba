# SPDX-License-Identifier: Apache-2.0
"""Thousands of independent tasks: on all cores of this machine, or on a Dask cluster, with the same results."""

from __future__ import annotations

from grasptrack.bench.schedule.local import on_cores
from grasptrack.bench.schedule.outcome import ATTEMPTS, Outcome, Scheduler

__all__ = ["ATTEMPTS", "Outcome", "Scheduler", "create_scheduler"]


def create_scheduler(address: str | None = None, workers: int | None = None) -> Scheduler:
    """Who does the work.

    Args:
        address: of a Dask scheduler, "tcp://host:8786"; None works on this machine.
        workers: processes on this machine; None takes as many as there are cores for this process.

    Raises:
        InputError: fewer than one worker, workers asked of a cluster, or a cluster without its extra installed.
    """
    if address is None:
        return on_cores(workers)
    from grasptrack.bench.schedule.cluster import on_cluster

    return on_cluster(address, workers)
