# SPDX-License-Identifier: Apache-2.0
"""Two outlines of one flat object matched without a prior: every way in which they fit, and which of them fit alike."""

from grasptrack.matching.hypotheses import match
from grasptrack.matching.judgement import Judgement, judge
from grasptrack.matching.rating import Match
from grasptrack.matching.samples import Sampled
from grasptrack.matching.symmetry import Symmetries, Symmetry, symmetries

__all__ = ["Judgement", "Match", "Sampled", "Symmetries", "Symmetry", "judge", "match", "symmetries"]
