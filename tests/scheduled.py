# SPDX-License-Identifier: Apache-2.0
"""Tasks for schedulers: in a module of their own, because worker processes import them."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


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


def slow_square(task: tuple[int, str]) -> int:
    """Leave the process's number behind, and take a while."""
    number, folder = task
    (Path(folder) / f"{number}-{os.getpid()}").touch()
    time.sleep(0.3)
    return number * number
