# SPDX-License-Identifier: Apache-2.0
"""`grasptrack evaluate scenes` on a cluster that loses a worker."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from grasptrack.cli.main import main
from test_cli_evaluate import scored


def test_a_cluster_that_loses_a_worker_gives_the_same_to_the_last_digit(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    given = ["evaluate", "scenes", "--shapes", "bracket", "--disturbances", "noise,belt,bar,clip", "--frames", "6"]
    given += ["--methods", "homography,klt", "--output"]
    assert main([*given, str(tmp_path / "here"), "--quiet"]) == 0
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        given[-1:] = ["--scheduler", cluster.scheduler_address, "--output", str(tmp_path / "there")]
        command = [sys.executable, "-m", "grasptrack.cli.main", *given, "--quiet"]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        cases = tmp_path / "there" / "cases"
        while not (cases.is_dir() and any(cases.glob("*.csv"))) and process.poll() is None:
            time.sleep(0.02)
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        _, told = process.communicate(timeout=120)
    assert process.returncode == 0, told
    assert told == ""
    assert scored(tmp_path / "here") == scored(tmp_path / "there")
