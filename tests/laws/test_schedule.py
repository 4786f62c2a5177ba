# SPDX-License-Identifier: Apache-2.0
"""Every task is done once, wherever; a worker that dies costs time and nothing else."""

import os
import signal
import subprocess
import sys
import threading
import time
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

import scheduled
from grasptrack.errors import InputError
from grasptrack_bench import schedule
from grasptrack_bench.schedule import ATTEMPTS, create_scheduler


def test_all_tasks_are_done_in_any_order_and_one_that_fails_keeps_none_from_its_result() -> None:
    tasks = [3, -1, *range(8)]
    outcomes = {o.index: o for o in create_scheduler(workers=2)(scheduled.square, tasks)}
    assert sorted(outcomes) == list(range(len(tasks)))
    assert [outcomes[i].value for i, n in enumerate(tasks) if n >= 0] == [n * n for n in tasks if n >= 0]
    assert outcomes[1].error == "ValueError: -1 is negative"


def test_each_process_has_one_thread_and_the_caller_keeps_its_own_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert [o.value for o in create_scheduler(workers=1)(scheduled.threads, [0])] == [(1, "1")]
    assert os.environ["OPENBLAS_NUM_THREADS"] == "2"


def test_a_dead_worker_is_replaced_and_what_kills_workers_is_given_up(tmp_path: Path) -> None:
    deaths = [0, 1, 0, 0, ATTEMPTS, 0, 0]
    tasks = [(n, str(tmp_path), d) for n, d in enumerate(deaths)]
    outcomes = {o.index: o for o in create_scheduler(workers=2)(scheduled.square_or_die, tasks)}
    assert sorted(outcomes) == list(range(len(tasks)))
    assert "workers died" in outcomes[4].error
    assert [outcomes[n].value for n in range(len(tasks)) if n != 4] == [n * n for n in range(len(tasks)) if n != 4]


def is_running(process: int) -> bool:
    """Whether there is a process of that number that is more than a remainder."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
def test_workers_end_with_whoever_asked_even_where_that_is_killed(tmp_path: Path) -> None:
    code = f"import sys; sys.path[:0] = {sys.path!r}; import scheduled; from grasptrack_bench.schedule import *; "
    code += f"list(create_scheduler(workers=1)(scheduled.gated_square, [(3, {str(tmp_path)!r})]))"
    with subprocess.Popen([sys.executable, "-c", code]) as asker:
        mark = scheduled.wait_for(tmp_path, "3-*")
        assert mark is not None
        worker = int(mark.name.partition("-")[2])
        assert is_running(worker)
        asker.kill()
        asker.wait()
    end = time.monotonic() + 10.0
    while is_running(worker) and time.monotonic() < end:
        time.sleep(0.05)
    assert not is_running(worker)


def test_the_code_that_results_depend_on_is_the_kernels_too(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    kernels = tmp_path / "module.so"
    asked: list[str] = []

    def found(name: str) -> ModuleSpec:
        asked.append(name)
        return ModuleSpec(name, None, origin=str(kernels))

    monkeypatch.setattr(schedule, "find_spec", found)
    prints = set()
    for content in (b"one", b"other", b"one"):
        kernels.write_bytes(content)
        prints.add(schedule.code_fingerprint.__wrapped__())
    assert len(prints) == 2 and set(asked) == {"_grasptrack_native"}


def test_no_tasks_are_no_trouble() -> None:
    assert list(create_scheduler(workers=1)(scheduled.square, [])) == []


@pytest.mark.parametrize(("address", "workers", "told"), [(None, 0, "at least 1 worker"), ("tcp://x:1", 2, "cluster")])
def test_what_cannot_be_is_refused(address: str | None, workers: int, told: str) -> None:
    with pytest.raises(InputError, match=told):
        create_scheduler(address, workers)


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_still_does_every_task(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        tasks, killed = [(n, str(tmp_path)) for n in range(12)], []

        def kill_one_at_work() -> None:
            at_work = scheduled.wait_for(tmp_path, "*-*")
            if at_work is not None:
                killed.append(at_work.name.split("-"))
                os.kill(int(killed[0][1]), signal.SIGKILL)
            (tmp_path / "go").touch()

        killer = threading.Thread(target=kill_one_at_work)
        killer.start()
        outcomes = {o.index: o for o in create_scheduler(cluster.scheduler_address)(scheduled.gated_square, tasks)}
        killer.join()
    assert {i: (o.value, o.error) for i, o in outcomes.items()} == {n: (n * n, "") for n in range(12)}
    (number, _), *_ = killed
    assert len(list(tmp_path.glob(f"{number}-*"))) == 2, "its task was begun again by another"


def test_no_scheduler_at_the_address_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    monkeypatch.setattr("grasptrack_bench.schedule.TIMEOUT_S", 1)
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        list(create_scheduler("tcp://127.0.0.1:1")(scheduled.square, [1]))


def test_a_failing_task_on_a_cluster_is_an_outcome_too() -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=50
    ) as cluster:
        outcomes = {o.index: o for o in create_scheduler(cluster.scheduler_address)(scheduled.square, [2, -1])}
    assert outcomes[0].value == 4
    assert outcomes[1].error == "ValueError: -1 is negative"
