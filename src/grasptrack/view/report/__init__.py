# SPDX-License-Identifier: Apache-2.0
"""Reports as one HTML file that needs nothing else: text, tables, charts and pictures."""

from grasptrack.view.report.axis import Axis
from grasptrack.view.report.chart import Chart
from grasptrack.view.report.markup import DASH, format_number, format_percent
from grasptrack.view.report.page import Page
from grasptrack.view.report.palette import Series, series_palette
from grasptrack.view.report.parts import Card, Cell, Column, Line

__all__ = [
    "DASH",
    "Axis",
    "Card",
    "Cell",
    "Chart",
    "Column",
    "Line",
    "Page",
    "Series",
    "format_number",
    "format_percent",
    "series_palette",
]
