# SPDX-License-Identifier: Apache-2.0
"""Charts, numbers and pictures of reports; the pages themselves are templates of `grasptrack_bench.report`."""

from grasptrack_bench.charts.chart import Axis, Chart
from grasptrack_bench.charts.palette import DASH, Series, format_number, format_percent, series_palette

__all__ = [
    "DASH", "Axis", "Chart", "Series", "format_number", "format_percent", "series_palette",
]  # fmt: skip
