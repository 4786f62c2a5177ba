# SPDX-License-Identifier: Apache-2.0
"""What an update costs that does not find the object, and one that finds it again, and where that time goes."""

from __future__ import annotations

import common

# isort: split
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np

from grasptrack import GraspTracker, kernels
from grasptrack.bench.parts import built_in
from grasptrack.bench.scenes import make_scene_cases
from grasptrack.bench.sequence import chosen_grasp
from grasptrack.tracking import follower, redetection
from grasptrack.tracking.estimator import Solutions
from grasptrack.tracking.redetection import Keypoints, Outlines, Redetection

SHAPES = ("bracket", "gasket", "spanner", "hook", "puzzle-piece", "u-clip")
DISTURBANCES = ("leave", "exchange", "twin", "hand", "clip")
MOST_MS = 15.0
GONE, RETURNED = 0.3, 0.98  # of the outline in view
STEPS: tuple[tuple[str, object, str], ...] = (
    ("pyramid of the image", follower, "build_pyramid"),
    ("where it is expected", follower, "predict_hypotheses"),
    ("which hypotheses promise", Redetection, "promising"),
    ("pose estimates", Solutions, "add"),
    ("decisions", follower, "decide_pose"),
    ("the last look, laid anew", redetection, "shifted_looks"),
    ("keypoints", Keypoints, "find"),
    ("outlines anywhere", Outlines, "find"),
)
NAMES = tuple(dict.fromkeys(name for name, _, _ in STEPS))


class Shares:
    """s that the steps of one update take, from clocks round their functions."""

    def __init__(self) -> None:
        self.taken: dict[str, float] = defaultdict(float)

    def watch(self) -> None:
        """From now on, all trackers are clocked."""
        for name, owner, function in STEPS:
            setattr(owner, function, self._clocked(name, getattr(owner, function)))

    def _clocked(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def clocked(*args: Any, **options: Any) -> Any:
            start = time.perf_counter()
            try:
                return call(*args, **options)
            finally:
                self.taken[name] += time.perf_counter() - start

        return clocked


class Absence:
    """Counts the frames from the one that shows an object wholly again to the one in which it is found."""

    def __init__(self) -> None:
        self.waits: list[int] = []
        self._gone, self._seen = False, 0

    def look(self, visible: float, located: bool) -> None:
        """A frame that shows so much of the outline, and whether the tracker gave contacts."""
        self._gone = self._gone or visible < GONE
        if not self._gone or visible < GONE:
            return
        if located:
            self.waits.append(self._seen)
            self._gone, self._seen = False, 0
        self._seen += visible >= RETURNED and not located

    @property
    def waiting(self) -> bool:
        """Whether it is back and not found yet."""
        return self._gone and self._seen > 0


def main() -> None:
    parser = common.parser(__doc__)
    parser.add_argument("--frames", type=int, default=60)
    args = parser.parse_args()
    shares = Shares()
    shares.watch()
    kinds: dict[str, list[float]] = {"followed": [], "lost": [], "found again": []}
    parts: dict[str, list[float]] = {name: [] for name in (*NAMES, "the rest")}
    waits: list[int] = []
    never = 0
    for case in make_scene_cases(built_in(SHAPES), DISTURBANCES, frames=args.frames):
        scene = case.scene()
        tracker = GraspTracker(grasp=chosen_grasp(scene[0].outline))
        before, absence = True, Absence()
        for frame in scene:
            shares.taken.clear()
            start = time.perf_counter()
            located = tracker.update(frame.image, time=frame.time).located
            taken = 1e3 * (time.perf_counter() - start)
            if frame.index == 0:
                if not located:
                    break
                continue
            kinds["lost" if not located else "followed" if before else "found again"].append(taken)
            if not located:
                for name in NAMES:
                    parts[name].append(1e3 * shares.taken[name])
                parts["the rest"].append(taken - 1e3 * sum(shares.taken.values()))
            before = located
            absence.look(frame.outline_visible, located)
        waits += absence.waits
        never += absence.waiting
    common.heading("Lost and found again")
    common.say(
        f"`auto` on {len(SHAPES)} parts, {args.frames} frames of 640x480 px of each of {', '.join(DISTURBANCES)}; kernels: "
        f"{kernels.BACKEND}. At most {MOST_MS:g} ms."
    )
    rows = [
        [
            name,
            len(ms),
            *(np.percentile(ms, [50, 90, 99, 100]).tolist()),
            "yes" if np.percentile(ms, 99) <= MOST_MS else "NO",
        ]
        for name, ms in kinds.items()
        if ms
    ]
    common.table(["update", "frames", "median ms", "90 %", "99 %", "max ms", "99 % met"], rows)
    common.say("Where the time of a lost frame goes, ms.")
    common.table(
        ["step", "mean", "99 %", "share %"],
        [
            [name, float(np.mean(ms)), float(np.percentile(ms, 99)), 100.0 * sum(ms) / max(sum(kinds["lost"]), 1e-9)]
            for name, ms in parts.items()
            if ms
        ],
    )
    late = sum(wait > 2 for wait in waits)
    common.say(
        f"Of {len(waits) + never} returns, wholly in view, {len(waits) - late} were found within 2 frames, {late} later, "
        f"{never} never."
    )
    common.finish(args.output)


if __name__ == "__main__":
    main()
