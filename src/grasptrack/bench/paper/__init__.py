# SPDX-License-Identifier: Apache-2.0
"""Section V rerun: Tables I to VII on three objects, ideal contours and rendered images, beside the printed values."""

from grasptrack.bench.paper.run import PaperRun, Series, run_paper

__all__ = ["PaperRun", "Series", "run_paper"]
