# SPDX-License-Identifier: Apache-2.0
"""Every built-in part by its name. Unit: square root of a part's own area; origin: its centroid."""

from __future__ import annotations

from collections.abc import Callable

from grasptrack.bench.simulation.outlines import Shape, circle_polygon, polygon_moments, round_corners
from grasptrack.bench.simulation.shapes_plates import (
    block_arrow,
    eccentric_washer,
    five_pointed_star,
    flange_gasket,
    full_disc,
    greek_cross,
    half_disc,
    hex_nut,
    hinge_leaf,
    l_bracket,
    notched_plate,
    open_end_spanner,
    puzzle_piece,
    rectangular_plate,
    ruler_strip,
    slotted_disc,
    smooth_blob,
    spur_gear,
    square_plate,
    t_plate,
    u_clip,
)
from grasptrack.bench.simulation.shapes_smooth import (
    crescent_moon,
    egg_shape,
    ellipse_shape,
    guitar_body,
    kidney_bean,
    s_blob,
    stemmed_leaf,
)
from grasptrack.bench.simulation.shapes_tools import (
    bottle_opener,
    capped_bottle,
    crane_hook,
    door_key,
    hammer_head,
    kitchen_knife,
    ring_wrench,
    sharpened_pencil,
    table_fork,
    table_spoon,
)

__all__ = ["SHAPES", "Shape", "circle_polygon", "l_bracket", "polygon_moments", "round_corners"]

SHAPES: dict[str, Callable[[], Shape]] = {
    "bracket": l_bracket,
    "spanner": open_end_spanner,
    "gasket": flange_gasket,
    "notched-plate": notched_plate,
    "blob": smooth_blob,
    "rectangle": rectangular_plate,
    "disc": full_disc,
    "square": square_plate,
    "gear": spur_gear,
    "hinge": hinge_leaf,
    "washer": eccentric_washer,
    "t-plate": t_plate,
    "cross": greek_cross,
    "star": five_pointed_star,
    "arrow": block_arrow,
    "hex-nut": hex_nut,
    "strip": ruler_strip,
    "u-clip": u_clip,
    "puzzle-piece": puzzle_piece,
    "hook": crane_hook,
    "key": door_key,
    "ring-wrench": ring_wrench,
    "fork": table_fork,
    "spoon": table_spoon,
    "knife": kitchen_knife,
    "bottle-opener": bottle_opener,
    "hammer-head": hammer_head,
    "ellipse": ellipse_shape,
    "egg": egg_shape,
    "bean": kidney_bean,
    "s-blob": s_blob,
    "crescent": crescent_moon,
    "leaf": stemmed_leaf,
    "guitar": guitar_body,
    "half-disc": half_disc,
    "slotted-disc": slotted_disc,
    "pencil": sharpened_pencil,
    "bottle": capped_bottle,
}
"""Every shape by its name."""
