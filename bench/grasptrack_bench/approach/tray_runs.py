# SPDX-License-Identifier: Apache-2.0
"""What is written of trays that are emptied: picks.csv, run.json, and a picture of each tray."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack.files import hold_folder, whole_file, write_json
from grasptrack_bench.approach.picking import LOOK_S, run_tray
from grasptrack_bench.approach.runs import kind_of, write_trial_rows
from grasptrack_bench.approach.trays import Emptied, PickRow, TrayCase
from grasptrack_bench.metrics.statistics import wilson_interval
from grasptrack_bench.physics.tray import SPEED
from grasptrack_bench.run_folder import index_head
from grasptrack_bench.schedule import Scheduler
from grasptrack_bench.simulation.outlines import Shape

TABLE, INDEX = "picks.csv", "run.json"


@dataclass
class Trays:
    """What several trays came to.

    Attributes:
        told: of each tray, in their order.
        broken: reason by name of a tray that did not run to its end.
        unknown: parts in those.
    """

    told: list[Emptied] = field(default_factory=list)
    broken: dict[str, str] = field(default_factory=dict)
    unknown: int = 0

    @property
    def picks(self) -> list[PickRow]:
        """All tries."""
        return [pick for tray in self.told for pick in tray.picks]

    def index_figures(self) -> dict[str, Any]:
        """For the index."""
        lifted, parts = sum(tray.lifted for tray in self.told), self.unknown + sum(tray.count for tray in self.told)
        seconds, picks = sum(tray.seconds for tray in self.told), self.picks
        return {
            "trays": len(self.told) + len(self.broken),
            "refused": {tray.name: tray.refused for tray in self.told if tray.refused},
            "broken": self.broken,
            "emptied": sum(not tray.left and not tray.refused for tray in self.told),
            "parts": parts,
            "lifted": lifted,
            "lifted_95": list(wilson_interval(lifted, parts)),
            "picks": len(picks),
            "closed": sum(pick.tries for pick in picks),
            "closed_wrong": sum(pick.closed_wrong for pick in picks),
            "empty": sum(pick.empty for pick in picks),
            "picks_an_hour": 3600.0 * lifted / seconds if seconds else 0.0,
            "left": dict(Counter(kind_of(why) for tray in self.told for why in tray.left.values()).most_common()),
            "failed": dict(Counter(kind_of(pick.reason) for pick in picks if pick.reason).most_common()),
        }


def draw_tray_cases(
    shapes: Sequence[Shape], trays: int, *, seed: int, count: int, snatched: bool, risk: float
) -> list[TrayCase]:
    """Trays with shapes in an order that the seed decides, each as often as the others, give or take one."""
    rng = np.random.default_rng((seed, 79))
    order: list[int] = []
    while len(order) < trays:
        order += rng.permutation(len(shapes)).tolist()
    return [TrayCase(shapes[i], 100_000 * seed + k, count, snatched, risk) for k, i in enumerate(order[:trays])]


def run_trays(
    output: Path,
    cases: Sequence[TrayCase],
    schedule: Scheduler,
    *,
    options: dict[str, Any],
    progress: Callable[[str, int, int], None] | None = None,
) -> Trays:
    """Empty every tray; write picks.csv, run.json and a picture of each, all of them anew after each tray.

    Args:
        output: folder, made when missing; what an earlier run left in it is replaced.
        cases: with distinct names.
        schedule: who does the work.
        options: what was asked for, for the index.
        progress: called with a step's name, trays done, and all of them.
    """
    head = index_head("trays", {**options, "speed_m_s": SPEED, "look_s": LOOK_S})
    found, trays = dict[int, Emptied](), Trays()
    with hold_folder(output):
        for old in output.glob("tray-*.png"):
            old.unlink()
        write_trial_rows(output / TABLE, [], PickRow)
        write_json(output / INDEX, {**head, "ended": "running"})
        for outcome in schedule(run_tray, cases):
            name = cases[outcome.index].name
            if outcome.error:
                trays.broken[name] = outcome.error
                trays.unknown += cases[outcome.index].count
            else:
                found[outcome.index] = outcome.value
            if not outcome.error and outcome.value.picture:
                with whole_file(output / f"tray-{name}.png") as part:
                    part.write_bytes(outcome.value.picture)
            trays.told = [found[i] for i in sorted(found)]
            write_trial_rows(output / TABLE, trays.picks, PickRow)
            done = len(found) + len(trays.broken)
            left = {tray.name: list(tray.left.values()) for tray in trays.told if tray.left}
            ended = "finished" if done == len(cases) else "running"
            write_json(output / INDEX, {**head, "ended": ended, "figures": trays.index_figures(), "left": left})
            if progress is not None:
                progress("trays", done, len(cases))
    return trays
