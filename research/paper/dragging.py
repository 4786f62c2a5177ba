# SPDX-License-Identifier: Apache-2.0
"""What the page `docs/transfers.md` lets its reader drag: five outlines, each with a grasp, and the constants of eq. (3).

python -m research.paper.dragging    writes docs/transfers-data.js
"""

from __future__ import annotations

import json
from pathlib import Path as File
from typing import Any

import numpy as np

from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.synthesis import synthesize
from grasptrack.transfer.homography import NEIGHBOURHOOD, SEARCH, SMOOTHING
from grasptrack.typing import Floats
from grasptrack.view.style import STRATEGY_RGB, hex_colour
from grasptrack_bench.simulation import SHAPES, Path, Pinhole
from research.paper.footage import DISTANCE, LEAST_POINTS, POINTS, sample_view

DRAGGED = ("bracket", "spanner", "notched-plate", "hook", "leaf")
"""A bracket, a tool, a plate, a hook, and a part whose corners are too few or too close for a homography."""
HEAD = "// SPDX-License-Identifier: Apache-2.0\n// Written by python -m research.paper.dragging."
DIGITS = 7
"""Decimals of a place in table units, some 130 px each, on the page."""


def dragged_view(tilt: float = 0.0, azimuth: float = 0.0, turn: float = 0.0, scale: float = 1.0) -> Floats:
    """(3, 3) from table to image px: a camera over the table's origin, angles in degrees, nearer by a scale."""
    pose = [np.array([v]) for v in (DISTANCE / scale, *np.radians([turn, tilt, azimuth]))]
    return np.asarray(Path(np.zeros((1, 2)), *pose).table_to_image(Pinhole())[0])


def dragged_part(name: str) -> tuple[list[Floats], Floats]:
    """Closed polygons (N, 2), the outer one first, and (2, 2) the contacts of the best grasp, in table units as on the page."""
    curves = [np.round(polygon, DIGITS) for polygon in SHAPES[name]().polygons]
    to_image = dragged_view()
    best = synthesize(sample_view(tuple(apply_homography(to_image, curve) for curve in curves)), top=1)[0]
    return curves, np.round(apply_homography(np.linalg.inv(to_image), best.contacts), DIGITS)


def data_of_page() -> str:
    """The script that the page reads its outlines from."""
    camera = Pinhole()
    parts = {name: dragged_part(name) for name in DRAGGED}
    data: dict[str, Any] = {
        "camera": {"matrix": camera.matrix.tolist(), "size": [camera.width, camera.height], "distance": DISTANCE},
        "points": POINTS,
        "leastPoints": LEAST_POINTS,
        "smoothing": SMOOTHING,
        "search": SEARCH,
        "neighbourhood": NEIGHBOURHOOD,
        "colours": {name: hex_colour(rgb) for name, rgb in STRATEGY_RGB.items()},
        "parts": {n: {"curves": [c.tolist() for c in p], "contacts": g.tolist()} for n, (p, g) in parts.items()},
    }
    lines = ",\n".join(f"{key}: {json.dumps(value, separators=(',', ':'))}" for key, value in data.items())
    return f"{HEAD}\nconst TRANSFERS = {{\n{lines}\n}};\n"


if __name__ == "__main__":
    File(__file__).resolve().parents[2].joinpath("docs", "transfers-data.js").write_text(
        data_of_page(), encoding="utf-8"
    )
