# SPDX-License-Identifier: Apache-2.0
"""Makes helpers and oracles importable, and the tests that others build upon; how much is tried and drawn."""

import os
import sys
from collections import defaultdict
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

# Before NumPy is loaded. Matrices here are small: with two processes on two cores, threads only wait for each other (x 4).
for library in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(library, "1")

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

FOLDERS = ("helpers", "oracle", "laws", "scenarios", "slow", "fuzz")
sys.path[:0] = [str(Path(__file__).parent / name) for name in FOLDERS]
sys.path.append(str(Path(__file__).parents[1]))  # of research

# Every worker and every process of the command line would compile all anew, in more time than its tests take.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# What CI says of a change must not hang on a draw that is another one each time; elsewhere each run draws anew.
SAME = "CI" in os.environ
settings.register_profile("small", max_examples=10, deadline=None, derandomize=SAME)
settings.register_profile("large", max_examples=40, deadline=None, derandomize=SAME)  # --hypothesis-profile large
settings.load_profile("small")

VIEW, ADVICE = "grasptrack.view", "grasptrack.trackability"


def sketch(path: Path, *_: object, **__: object) -> None:
    """A picture of nothing, in the place of one."""
    cv2.imwrite(os.fsencode(path), np.random.default_rng(0).integers(0, 256, (40, 60, 3), dtype=np.uint8))


def one_run(scene: Any, check: Any = lambda: None) -> Any:
    """A verdict from one drawn run instead of several."""
    return whole(ADVICE, "inspect_scene")(scene, runs=1, check=check)


SHORT = {
    (f"{VIEW}.summary", "write_summary"): sketch,
    (f"{VIEW}.grasps", "write_grasps"): sketch,
    (f"{VIEW}.inspect", "write_inspection"): sketch,
    (f"{VIEW}.pair", "write_pair"): sketch,
    (ADVICE, "inspect_scene"): one_run,
    ("grasptrack.live.advisor", "inspect_scene"): one_run,
}
"""What takes several times as long as the rest of a run: pictures by Matplotlib, and verdicts beside it."""


@cache
def whole(module: str, function: str) -> Any:
    """What SHORT stands for."""
    return getattr(import_module(module), function)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of a test marked `sampled(n)`, n of its cases, spread evenly, are for every run, and the others are slow."""
    cases = defaultdict(list)
    for item in items:
        if item.get_closest_marker("sampled") and not item.get_closest_marker("slow"):
            cases[item.nodeid.partition("[")[0]].append(item)
    for every in cases.values():
        mark = every[0].get_closest_marker("sampled")
        kept = set(np.linspace(0, len(every) - 1, mark.args[0]).round().astype(int).tolist()) if mark else set()
        for k, item in enumerate(every):
            if k not in kept:
                item.add_marker("slow")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """All is done where a test is marked `whole`, or what it names there, or is slow and not marked `brief`."""
    slow, named = (
        item.get_closest_marker("slow") and not item.get_closest_marker("brief"),
        item.get_closest_marker("whole"),
    )
    own = {what: whole(*what) for what in SHORT}  # before any of them is replaced
    for (module, function), short in SHORT.items():
        wanted = slow or (named and (not named.args or function in named.args))
        setattr(import_module(module), function, own[module, function] if wanted else short)
