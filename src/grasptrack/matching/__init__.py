# SPDX-License-Identifier: Apache-2.0
"""Two outlines of one flat object matched without a prior: every way in which they fit, and which of them fit alike."""

from grasptrack.matching.hypotheses import (
    lay_several,
    match_outlines,
    match_several,
    may_match,
    refine_homographies,
    settle_homographies,
)
from grasptrack.matching.rating import Match, MatchOutcome, judge_hypotheses
from grasptrack.matching.samples import Sampled
from grasptrack.matching.symmetry import Symmetries, SymmetryTurn, find_symmetries

__all__ = [
    "Match", "MatchOutcome", "Sampled", "Symmetries", "SymmetryTurn", "find_symmetries", "judge_hypotheses",
    "lay_several", "match_outlines", "match_several", "may_match", "refine_homographies", "settle_homographies",
]  # fmt: skip
