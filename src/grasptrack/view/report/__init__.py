# SPDX-License-Identifier: Apache-2.0
"""Charts, numbers and pictures of reports; the pages themselves are templates of `bench.report`."""

from grasptrack.view.report.chart import Axis, Chart
from grasptrack.view.report.markup import DASH, format_number, format_percent
from grasptrack.view.report.palette import Series, series_palette

__all__ = [
    "DASH",
    "Axis",
    "Chart",
    "Series",
    "format_number",
    "format_percent",
    "series_palette",
]
