# SPDX-License-Identifier: Apache-2.0
"""Plates and other machined parts, from lines and arcs."""

from __future__ import annotations

import math

import numpy as np

from grasptrack.bench.simulation.outlines import Shape, arc_points, circle_polygon, round_corners, stroke_outline


def l_bracket() -> Shape:
    """An L-plate with one chamfer and one hole: distinct axes, no symmetry, corners and round parts."""
    outer = round_corners(
        [(0, 0), (1.5, 0), (1.75, 0.28), (1.75, 0.62), (0.72, 0.62), (0.66, 1.25), (0.08, 1.25)],
        [0.12, 0.05, 0.05, 0.2, 0.16, 0.22, 0.1],
    )
    return Shape.of("bracket", outer, [circle_polygon(0.37, 0.9, 0.13)])


def open_end_spanner() -> Shape:
    """An open-ended spanner: a narrow handle, a forked jaw, a round end with a hole."""
    jaw = [(-1.9, 0.36), (-2.45, 0.28), (-2.75, 0.42), (-2.72, 0.16), (-2.3, 0.1)]
    jaw += [(-2.2, -0.12), (-2.55, -0.2), (-2.62, -0.44), (-2.25, -0.46), (-1.86, -0.22)]
    end = circle_polygon(0.0, 0.0, 0.36, 60)
    end = end[np.abs(np.arctan2(end[:, 1], -end[:, 0])) > 0.5]
    order = np.argsort(np.arctan2(end[:, 1], end[:, 0]))
    outer = np.concatenate([end[order], round_corners(jaw, [0.2, 0.2, 0.04, 0.04, 0.1, 0.1, 0.04, 0.04, 0.2, 0.25])])
    return Shape.of("spanner", outer, [circle_polygon(0.0, 0.0, 0.16, 60)])


def flange_gasket() -> Shape:
    """A flange gasket: a bore off the centre, three bolt holes and a lug."""
    outer = round_corners(
        [(-0.9, -0.6), (0.55, -0.6), (0.95, -0.95), (1.25, -0.6), (0.9, 0.6), (-0.6, 0.75), (-1.1, 0.2)],
        [0.2, 0.15, 0.12, 0.12, 0.3, 0.3, 0.2],
    )
    holes = [
        circle_polygon(0.0, 0.0, 0.34),
        circle_polygon(-0.72, -0.32, 0.09, 48),
        circle_polygon(0.62, 0.34, 0.09, 48),
    ]
    return Shape.of("gasket", outer, [*holes, circle_polygon(0.9, -0.62, 0.09, 48)])


def notched_plate() -> Shape:
    """A rounded plate with a notch in one side, none of its sides parallel to another."""
    outer = round_corners(
        [(-0.8, -0.5), (0.1, -0.5), (0.16, -0.28), (0.4, -0.28), (0.46, -0.5), (0.8, -0.5), (0.74, 0.5), (-0.7, 0.42)],
        [0.14, 0.03, 0.04, 0.04, 0.03, 0.14, 0.05, 0.2],
    )
    return Shape.of("notched-plate", outer)


def smooth_blob() -> Shape:
    """A smooth outline without corners: an ellipse-like curve with a few harmonics."""
    angles = np.arange(240) * (2.0 * math.pi / 240)
    radius = 1.0 + 0.28 * np.cos(2 * angles - 0.4) + 0.13 * np.cos(3 * angles + 0.9) + 0.05 * np.cos(5 * angles - 1.7)
    return Shape.of("blob", np.column_stack([radius * np.cos(angles), radius * np.sin(angles)]))


def rectangular_plate() -> Shape:
    """Maps to itself by a half turn: the direction of its axes is open."""
    return Shape.of("rectangle", [(-0.8, -0.5), (0.8, -0.5), (0.8, 0.5), (-0.8, 0.5)])


def full_disc() -> Shape:
    """No axes at all, and a homography that its outline leaves partly free."""
    return Shape.of("disc", circle_polygon(0.0, 0.0, 1.0, 180))


def square_plate() -> Shape:
    """Maps to itself by a quarter turn."""
    return Shape.of("square", [(0, 0), (1, 0), (1, 1), (0, 1)])


def spur_gear() -> Shape:
    """A spur gear of 14 teeth with a keyed bore: repeats itself but for the key."""
    ring = []
    for tooth in range(14):
        middle = tooth * 360.0 / 14
        for offset, radius in ((-8.6, 1.0), (-4.4, 1.22), (4.4, 1.22), (8.6, 1.0)):
            a = math.radians(middle + offset)
            ring.append((radius * math.cos(a), radius * math.sin(a)))
    bore = np.concatenate([arc_points(0, 0, 0.34, 20, 340), [(0.44, -0.11), (0.44, 0.11)]])
    return Shape.of("gear", ring, [bore])


def hinge_leaf() -> Shape:
    """The leaf of a hinge: knuckles along one side, three screw holes."""
    ring = [(0, 0), (1.5, 0), (1.5, 0.62), (1.2, 0.62), (1.2, 0.84), (0.9, 0.84), (0.9, 0.62), (0.6, 0.62)]
    ring += [(0.6, 0.84), (0.3, 0.84), (0.3, 0.62), (0, 0.62)]
    radii = [0.12, 0.12, 0.03, 0.03, 0.05, 0.05, 0.03, 0.03, 0.05, 0.05, 0.03, 0.03]
    holes = [
        circle_polygon(0.25, 0.2, 0.07, 40),
        circle_polygon(0.75, 0.36, 0.07, 40),
        circle_polygon(1.25, 0.2, 0.07, 40),
    ]
    return Shape.of("hinge", round_corners(ring, radii), holes)


def eccentric_washer() -> Shape:
    """An eccentric disc: round outside, its hole off the centre."""
    return Shape.of("washer", circle_polygon(0, 0, 1.0, 144), [circle_polygon(0.36, 0.1, 0.42, 90)])


def t_plate() -> Shape:
    """A mending plate in the form of a T, with four holes."""
    ring = [(-0.9, 0), (0.9, 0), (0.9, 0.42), (0.21, 0.42), (0.21, 1.5), (-0.21, 1.5), (-0.21, 0.42), (-0.9, 0.42)]
    radii = [0.14, 0.14, 0.14, 0.08, 0.14, 0.14, 0.08, 0.14]
    holes = [
        circle_polygon(-0.65, 0.21, 0.08, 40),
        circle_polygon(0.65, 0.21, 0.08, 40),
        circle_polygon(0, 0.75, 0.08, 40),
    ]
    return Shape.of("t-plate", round_corners(ring, radii), [*holes, circle_polygon(0, 1.25, 0.08, 40)])


def greek_cross() -> Shape:
    """A Greek cross: maps to itself by a quarter turn, and has concave corners."""
    quarter = [(1.0, -0.32), (1.0, 0.32), (0.32, 0.32)]
    ring = [(c * x - s * y, s * x + c * y) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1)) for x, y in quarter]
    return Shape.of("cross", round_corners(ring, 0.03))


def five_pointed_star() -> Shape:
    """A star of five sharp points."""
    a = -math.pi / 2 + np.arange(10) * math.pi / 5
    r = np.where(np.arange(10) % 2 == 0, 1.0, 0.45)
    return Shape.of("star", np.column_stack([r * np.cos(a), r * np.sin(a)]))


def block_arrow() -> Shape:
    """A block arrow: mirror-symmetric, its corners sharp."""
    return Shape.of("arrow", [(-1, -0.3), (0.1, -0.3), (0.1, -0.75), (1.1, 0), (0.1, 0.75), (0.1, 0.3), (-1, 0.3)])


def hex_nut() -> Shape:
    """A hexagon with a round bore: six turns look alike."""
    a = np.arange(6) * math.pi / 3
    return Shape.of("hex-nut", round_corners(np.column_stack([np.cos(a), np.sin(a)]), 0.1), [circle_polygon(0, 0, 0.5)])


def ruler_strip() -> Shape:
    """A ruler: six times as long as wide, one end cut square, the other round with a hole to hang it by."""
    ring = np.concatenate([[(-3.0, -0.5), (-3.0, 0.5)], arc_points(2.5, 0.0, 0.5, 90, -90)])
    return Shape.of("strip", ring, [circle_polygon(2.55, 0.0, 0.16, 48)])


def u_clip() -> Shape:
    """A spring clip: a U of even width, one leg longer and bent outwards."""
    legs = np.array([(0.5, -0.8), (0.5, 0.45)]), np.array([(-0.5, 0.45), (-0.5, -0.8), (-0.6, -1.0), (-0.78, -1.2)])
    line = np.concatenate([legs[0], arc_points(0.0, 0.5, 0.5, 0, 180), legs[1]])
    return Shape.of("u-clip", stroke_outline(line, 0.17))


def puzzle_piece() -> Shape:
    """A jigsaw piece: two knobs, one socket, one straight side."""

    def side(out: float, at: float) -> list[tuple[float, float]]:
        """From (0, 0) to (1, 0), the knob to negative y when out > 0."""
        knob = arc_points(at, -0.145, 0.15, 130, 410)
        neck = ((at - 0.096, 0.0), *knob.tolist(), (at + 0.096, 0.0))
        return [(0.0, 0.0), *((x, out * y) for x, y in neck)]

    ring: list[tuple[float, float]] = []
    for turn, (out, at) in enumerate(((1.0, 0.5), (-1.0, 0.46), (1.0, 0.55), (0.0, 0.0))):
        c, s = round(math.cos(turn * math.pi / 2)), round(math.sin(turn * math.pi / 2))
        for x, y in side(out, at) if out else [(0.0, 0.0)]:
            u, v = x - 0.5, y - 0.5
            ring.append((c * u - s * v, s * u + c * v))
    return Shape.of("puzzle-piece", ring)


def half_disc() -> Shape:
    """A half disc, a D: one round and one straight side, which a family of homographies nearly maps to itself."""
    return Shape.of("half-disc", arc_points(0.0, 0.0, 1.0, 0, 180))


def slotted_disc() -> Shape:
    """A disc with a slot from its rim to the middle: round but for one place that fixes its turn."""
    half = math.degrees(math.asin(0.11))
    slot = [(0.11, 0.0), (-0.11, 0.0)]
    return Shape.of("slotted-disc", np.concatenate([arc_points(0.0, 0.0, 1.0, 90 + half, 450 - half), slot]))
