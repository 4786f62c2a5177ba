# SPDX-License-Identifier: Apache-2.0
"""How much more surprising an outline becomes from one answer to the next on real videos: for `evidence.EDGE_LOSS`."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from grasptrack.tracking import follower
from grasptrack.tracking.evidence import outline_surprisal
from grasptrack.tracking.learning import learn
from grasptrack_bench.method import score_sequence
from grasptrack_bench.methods import method_makers
from grasptrack_bench.real import RealCase, sequence_of, videos_of
from research.studies import common

JUMPS = (2.0, 5.0, 10.0, 20.0)
"""By how much more surprising, in minus logs of probabilities."""


def jumps_of(case: RealCase) -> list[float]:
    """Of each answer in a video by how much more surprising its outline is than usual, nothing being occluded."""
    found: list[float] = []

    def note(state: Any, levels: Any, decision: Any, estimate: Any, predictions: Any) -> None:
        if decision.is_accepted:
            found.append(outline_surprisal(estimate, state.numbers, hidden=False) - state.strange)
        learn(state, levels, decision, estimate, predictions)

    with patch.object(follower, "learn", note), sequence_of(case) as (start, shown, begin):
        score_sequence(shown, method_makers(["auto"], case.risk), start, begin)
    return found


def main() -> None:
    """Run the study."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--real", type=Path, required=True, help="folder of videos, as `evaluate real` takes it")
    asked = parser.parse_args()
    common.begin_section("Outlines that surprise at once")
    every: list[float] = []
    rows = []
    for case in videos_of(asked.real):
        found = jumps_of(case)
        every += found
        rows.append([case.name, len(found), *shares_of(found)])
    common.add_table(
        ["video", "answers", *(f"{jump:g} or more, %" for jump in JUMPS)],
        [*rows, ["all", len(every), *shares_of(every)]],
    )
    common.write_sections(asked.output)


def shares_of(found: list[float]) -> list[str]:
    """% of jumps at least as large as each of `JUMPS`."""
    return [f"{100.0 * float(np.mean(np.array(found) >= jump)):.2f}" if found else "-" for jump in JUMPS]


if __name__ == "__main__":
    main()
