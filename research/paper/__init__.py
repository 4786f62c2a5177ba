# SPDX-License-Identifier: Apache-2.0
"""Section V rerun: the paper's tables, ours and the paper's transfers to the letter, beside the printed values."""

from research.paper.run import QUICK, Extent, PaperRun, run_paper

__all__ = ["QUICK", "Extent", "PaperRun", "run_paper"]
