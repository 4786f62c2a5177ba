# SPDX-License-Identifier: Apache-2.0
"""The same input gives the same bytes: in any process, with any seed of hashes, number of threads, and in a thread."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator

import cv2
import pytest

import repeatable

LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@pytest.fixture
def opencv_threads() -> Iterator[None]:
    """Restores how many threads OpenCV uses."""
    before = cv2.getNumThreads()
    yield
    cv2.setNumThreads(before)


@pytest.mark.usefixtures("opencv_threads")
def test_threads_change_nothing() -> None:
    found = []
    for threads in (1, 4):
        cv2.setNumThreads(threads)
        found.append(repeatable.digests(("answers",)))
    assert found[0] == found[1] == repeatable.digests_in_thread(("answers",))


@pytest.mark.slow
def test_processes_of_other_settings_give_the_same() -> None:
    found = {}
    for seed, threads, where in (("0", 1, "main"), ("1", 2, "main"), ("77", 3, "thread"), ("random", 1, "thread")):
        environment = {**os.environ, "PYTHONHASHSEED": seed, **dict.fromkeys(LIBRARIES, str(threads))}
        command = [sys.executable, repeatable.__file__, str(threads), where]
        done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
        found[seed] = json.loads(done.stdout)
    assert set(found["0"]) == set(repeatable.PARTS)
    assert all(digests == found["0"] for digests in found.values()), found
