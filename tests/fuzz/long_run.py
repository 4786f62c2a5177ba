# SPDX-License-Identifier: Apache-2.0
"""Many thousand updates of mixed sequences: memory and latency have to stay what they are.

    python tests/fuzz/long_run.py --updates 20000 --seed 1

The object is tracked, gone for some images, back elsewhere, covered; images of another size and of a wrong type are refused;
now and then the tracker is copied, pickled, or replaced by a new one.
"""

import copy
import gc
import pickle
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))

from grasptrack import GraspTracker
from grasptrack.demo import demo_scene
from grasptrack.errors import InputError
from harness import options
from research.studies.loop import resident_mb

FRAMES = 60
SAMPLES = 40
"""How often memory is looked at in a run."""
WARM = 0.2
"""Share of a run within which all that is made once has been made."""


CHANGES: dict[str, Callable[[GraspTracker], GraspTracker]] = {
    "copied": copy.deepcopy,
    "pickled": lambda tracker: pickle.loads(pickle.dumps(tracker)),
    "new": lambda tracker: GraspTracker(),
}


class LongRun(NamedTuple):
    """What was measured.

    Attributes:
        counts: of statuses, refusals and changes of the tracker.
        memory: (SAMPLES,) MB of resident memory, at equal intervals.
        latency: (4,) median ms of the processor's for an update that tracked as in the image before, by quarter of the run.
        aged: median ms of the tracker that the run ends with, and of a new one that is shown the same images, in turn.
    """

    counts: Counter[str]
    memory: np.ndarray
    latency: np.ndarray
    aged: tuple[float, float]

    @property
    def growth(self) -> float:
        """As of `growth_of`."""
        return growth_of(self.memory)


def growth_of(memory: np.ndarray) -> float:
    """MB from the median of the first half of the samples after the warm-up to that of the last."""
    halves = np.array_split(memory[int(WARM * len(memory)) :], 2)
    return float(np.median(halves[1]) - np.median(halves[0]))


def sequence(images: list[np.ndarray], rng: np.random.Generator) -> Iterator[Any]:
    """Images without end, and what is none: the camera goes to and fro, and something happens in between."""
    at, step = 0, 1
    blank = np.full_like(images[0], 128)
    while True:
        for _ in range(int(rng.integers(10, 60))):
            at += step
            if not 0 <= at < len(images):
                step = -step
                at += 2 * step
            yield images[at]
        match int(rng.integers(0, 6)):
            case 0:
                yield from [blank] * int(rng.integers(1, 12))
            case 1:  # it is found again elsewhere
                yield from [blank] * 3
                at = int(rng.integers(len(images)))
            case 2:
                covered = images[at].copy()
                left = int(rng.integers(0, covered.shape[1] - 40))
                covered[:, left : left + int(rng.integers(20, 300))] = 90
                yield from [covered] * int(rng.integers(1, 8))
            case 3:
                yield images[at][: int(rng.integers(1, 400))]
            case 4:
                yield [images[at].astype(np.complex64), None, "image", images[at][..., None, None]][rng.integers(4)]
            case _:
                yield rng.integers(0, 256, images[at].shape, dtype=np.uint8)


def run(updates: int, seed: int) -> LongRun:
    """Update a tracker so often.

    Args:
        updates: how often.
        seed: of what happens.
    """
    rng = np.random.default_rng(seed)
    images = [frame.image for frame in demo_scene(FRAMES)]
    counts: Counter[str] = Counter()
    memory, quarters = [], [[] for _ in range(4)]
    tracker, clock, before = GraspTracker(), 0.0, ""
    shown = sequence(images, rng)
    for k, image in zip(range(updates), shown, strict=False):
        clock += 0.033
        status, spent = update(tracker, image, clock)
        if status == before == "tracked":
            quarters[4 * k // updates].append(spent)
        counts[status] += 1
        before = status
        if rng.random() < 0.002:
            # in the second half it stays the same one, to be compared with a new one at the end
            way = ["copied", "pickled", "new"][rng.integers(3 if 2 * k < updates else 2)]
            counts[way] += 1
            tracker = CHANGES[way](tracker)
        if (k + 1) % max(updates // SAMPLES, 1) == 0:
            gc.collect()
            memory.append(resident_mb())
    medians = np.array([np.median(q) if q else np.nan for q in quarters])
    return LongRun(counts, np.array(memory), medians, compare(tracker, shown, clock, updates // 10))


def update(tracker: GraspTracker, image: Any, clock: float) -> tuple[str, float]:
    """The status of an update, or "refused", and ms of the processor's."""
    began = time.process_time()
    try:
        status = tracker.update(image, time=clock).status
    except InputError:
        status = "refused"
    return status, 1e3 * (time.process_time() - began)


def compare(old: GraspTracker, shown: Iterator[Any], clock: float, count: int) -> tuple[float, float]:
    """Median ms of a tracker and of a new one that see the same images in turn, where both track."""
    new, spent = GraspTracker(), []
    for k, image in zip(range(count), shown, strict=False):
        clock += 0.033
        pair = [old, new] if k % 2 else [new, old]  # what comes second finds the image in the cache
        done = [update(tracker, image, clock) for tracker in pair]
        if k > count // 10 and done[0][0] == done[1][0] == "tracked":
            spent.append([ms for _, ms in (done if k % 2 else done[::-1])])
    one, other = np.median(spent, axis=0).tolist() if spent else (np.nan, np.nan)
    return one, other


def main() -> int:
    """Run, and print what was measured."""
    asked = options(__doc__, updates=(20000, "how many"))
    found = run(asked.updates, asked.seed)
    print(f"{asked.updates} updates: " + ", ".join(f"{count} {name}" for name, count in sorted(found.counts.items())))
    print("resident MB: " + " ".join(f"{m:.0f}" for m in found.memory) + f"; growth {found.growth:+.1f}")
    print("processor's ms of an update, median by quarter: " + ", ".join(f"{ms:.2f}" for ms in found.latency))
    print(f"the tracker at the end {found.aged[0]:.2f} ms, a new one on the same images {found.aged[1]:.2f} ms")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
