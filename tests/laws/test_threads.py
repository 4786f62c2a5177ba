# SPDX-License-Identifier: Apache-2.0
"""Trackers in threads: each gives what it gives alone, and one that two threads call at once says so."""

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from grasptrack import GraspTracker, InputError, TrackResult
from grasptrack_bench.simulation import SHAPES
from stages import photo, pose

PARTS = [SHAPES[name]() for name in ("bracket", "gasket", "notched-plate")]
SEQUENCES = [[photo([(part, pose(150.0 + 4 * k, 115.0 + 2 * k, 4.0 * k))], seed=k) for k in range(8)] for part in PARTS]


def track(images: list[np.ndarray]) -> list[TrackResult]:
    tracker = GraspTracker()
    return [tracker.update(image, time=0.1 * k) for k, image in enumerate(images)]


def test_trackers_in_threads_give_what_each_gives_alone() -> None:
    alone = [track(images) for images in SEQUENCES]
    assert all(any(r.located for r in results[1:]) for results in alone)
    with ThreadPoolExecutor(len(SEQUENCES)) as pool:
        assert list(pool.map(track, SEQUENCES)) == alone


def test_one_tracker_in_two_threads_is_refused_and_unharmed() -> None:
    within, go_on = threading.Event(), threading.Event()

    def segment(image: np.ndarray) -> np.ndarray:
        within.set()
        assert go_on.wait(30.0)
        return np.asarray(image < 120)

    tracker = GraspTracker(segmenter=segment)
    image = SEQUENCES[0][0]
    with ThreadPoolExecutor(1) as pool:
        first: Any = pool.submit(tracker.update, image)
        assert within.wait(30.0)
        with pytest.raises(InputError, match="one thread at a time"):
            tracker.update(image)
        go_on.set()
        assert first.result().frame == 0
    assert tracker.update(image).frame == 1
