# SPDX-License-Identifier: Apache-2.0
"""Reports as one HTML file that needs nothing else: text, tables, charts and pictures."""

from grasptrack.view.report.chart import Axis, Chart
from grasptrack.view.report.page import Page
from grasptrack.view.report.palette import Series, series_palette
from grasptrack.view.report.parts import DASH, Card, Cell, Column, Line, format_number, format_percent

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
