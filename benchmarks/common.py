# SPDX-License-Identifier: Apache-2.0
"""What the benchmarks share: one thread, medians, the machine, plain tables. Import it before NumPy."""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import gc
import platform
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np

cv2.setNumThreads(1)


def machine() -> str:
    """One line that says what the figures were measured on."""
    from grasptrack import kernels

    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        models = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        name = models[0] if models else name
    return (
        f"{name}, {os.cpu_count()} cores, one thread; {platform.system()}, Python {platform.python_version()}, "
        f"NumPy {np.__version__}, OpenCV {cv2.__version__}, kernels: {kernels.BACKEND}"
    )


def heading(title: str) -> None:
    """Title, machine, and the command that repeats the run."""
    print(f"\n{title}\n{machine()}\n$ python {' '.join(sys.argv)}\n")


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A plain table; figures to the right, words to the left."""
    listed = [[f"{c:.3g}" if isinstance(c, float) else str(c) for c in row] for row in rows]
    widths = [max(len(r[i]) for r in [list(head), *listed]) for i in range(len(head))]
    number = [all(_is_number(r[i]) for r in listed) for i in range(len(head))]
    for k, row in enumerate([list(head), *listed]):
        print("  ".join(c.rjust(w) if n else c.ljust(w) for c, w, n in zip(row, widths, number, strict=True)).rstrip())
        if k == 0:
            print("  ".join("-" * w for w in widths))
    print()


def _is_number(cell: str) -> bool:
    return not cell or cell[0] in "-+.0123456789n"


def each_once(call: Callable[..., object], pool: Iterable[tuple[object, ...]]) -> float:
    """Median s of a call over a pool of arguments, each used once, the collector at rest."""
    clock = time.perf_counter_ns
    taken = []
    gc.collect()
    gc.disable()
    try:
        for arguments in pool:
            start = clock()
            call(*arguments)
            taken.append(clock() - start)
    finally:
        gc.enable()
    return float(np.median(taken)) * 1e-9


def percentiles(seconds: Sequence[float]) -> tuple[float, float]:
    """Median and 99th percentile in ms."""
    return float(np.percentile(seconds, 50)) * 1e3, float(np.percentile(seconds, 99)) * 1e3
