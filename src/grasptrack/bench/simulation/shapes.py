# SPDX-License-Identifier: Apache-2.0
"""Every built-in part by its name. Unit: square root of a part's own area; origin: its centroid."""

from __future__ import annotations

from collections.abc import Callable

from grasptrack.bench.simulation.outlines import Shape, circle, polygon_moments, rounded
from grasptrack.bench.simulation.shapes_plates import (
    arrow,
    blob,
    bracket,
    cross,
    disc,
    gasket,
    gear,
    half_disc,
    hex_nut,
    hinge,
    notched_plate,
    puzzle_piece,
    rectangle,
    slotted_disc,
    spanner,
    square,
    star,
    strip,
    t_plate,
    u_clip,
    washer,
)
from grasptrack.bench.simulation.shapes_smooth import bean, crescent, egg, ellipse, guitar, leaf, s_blob
from grasptrack.bench.simulation.shapes_tools import (
    bottle,
    bottle_opener,
    fork,
    hammer_head,
    hook,
    key,
    knife,
    pencil,
    ring_wrench,
    spoon,
)

__all__ = ["SHAPES", "Shape", "bracket", "circle", "polygon_moments", "rounded"]

SHAPES: dict[str, Callable[[], Shape]] = {
    "bracket": bracket,
    "spanner": spanner,
    "gasket": gasket,
    "notched-plate": notched_plate,
    "blob": blob,
    "rectangle": rectangle,
    "disc": disc,
    "square": square,
    "gear": gear,
    "hinge": hinge,
    "washer": washer,
    "t-plate": t_plate,
    "cross": cross,
    "star": star,
    "arrow": arrow,
    "hex-nut": hex_nut,
    "strip": strip,
    "u-clip": u_clip,
    "puzzle-piece": puzzle_piece,
    "hook": hook,
    "key": key,
    "ring-wrench": ring_wrench,
    "fork": fork,
    "spoon": spoon,
    "knife": knife,
    "bottle-opener": bottle_opener,
    "hammer-head": hammer_head,
    "ellipse": ellipse,
    "egg": egg,
    "bean": bean,
    "s-blob": s_blob,
    "crescent": crescent,
    "leaf": leaf,
    "guitar": guitar,
    "half-disc": half_disc,
    "slotted-disc": slotted_disc,
    "pencil": pencil,
    "bottle": bottle,
}
"""Every shape by its name."""
