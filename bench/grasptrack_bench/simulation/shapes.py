# SPDX-License-Identifier: Apache-2.0
"""Every built-in part by its name. Unit: square root of a part's own area; origin: its centroid."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from grasptrack.typing import Floats
from grasptrack_bench.simulation.outlines import Shape, arc_points, circle_polygon, round_corners, stroke_outline


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
    holes = [circle_polygon(x, y, 0.07, 40) for x, y in ((0.25, 0.2), (0.75, 0.36), (1.25, 0.2))]
    return Shape.of("hinge", round_corners(ring, radii), holes)


def eccentric_washer() -> Shape:
    """An eccentric disc: round outside, its hole off the centre."""
    return Shape.of("washer", circle_polygon(0, 0, 1.0, 144), [circle_polygon(0.36, 0.1, 0.42, 90)])


def t_plate() -> Shape:
    """A mending plate in the form of a T, with four holes."""
    ring = [(-0.9, 0), (0.9, 0), (0.9, 0.42), (0.21, 0.42), (0.21, 1.5), (-0.21, 1.5), (-0.21, 0.42), (-0.9, 0.42)]
    radii = [0.14, 0.14, 0.14, 0.08, 0.14, 0.14, 0.08, 0.14]
    holes = [circle_polygon(x, y, 0.08, 40) for x, y in ((-0.65, 0.21), (0.65, 0.21), (0, 0.75))]
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

    def draw_side(out: float, at: float) -> list[tuple[float, float]]:
        """From (0, 0) to (1, 0), the knob to negative y when out > 0."""
        knob = arc_points(at, -0.145, 0.15, 130, 410)
        neck = ((at - 0.096, 0.0), *knob.tolist(), (at + 0.096, 0.0))
        return [(0.0, 0.0), *((x, out * y) for x, y in neck)]

    ring: list[tuple[float, float]] = []
    for turn, (out, at) in enumerate(((1.0, 0.5), (-1.0, 0.46), (1.0, 0.55), (0.0, 0.0))):
        c, s = round(math.cos(turn * math.pi / 2)), round(math.sin(turn * math.pi / 2))
        for x, y in draw_side(out, at) if out else [(0.0, 0.0)]:
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


def _polar_curve(radius: Floats) -> Floats:
    angles = np.arange(len(radius)) * (2.0 * math.pi / len(radius))
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])


def ellipse_shape() -> Shape:
    """Smooth, maps to itself by a half turn and by two mirrors."""
    return Shape.of("ellipse", circle_polygon(0.0, 0.0, 1.0, 160) * [1.0, 0.62])


def egg_shape() -> Shape:
    """Smooth and convex, blunt at one end: one mirror, no corner."""
    a = np.arange(200) * (2.0 * math.pi / 200)
    x, y = np.cos(a), np.sin(a)
    return Shape.of("egg", np.column_stack([1.25 * x, 0.92 * y * (1.0 - 0.18 * x)]))


def kidney_bean() -> Shape:
    """A kidney: smooth, with one hollow."""
    line = arc_points(0.0, 0.0, 1.0, 200, 345)
    half = np.interp(np.linspace(0.0, 1.0, len(line)), [0.0, 0.35, 1.0], [0.52, 0.46, 0.4])
    return Shape.of("bean", stroke_outline(line, half))


def s_blob() -> Shape:
    """A fat S with round ends, one larger: smooth, deep hollows on both sides."""
    upper, lower = arc_points(0.0, -0.5, 0.5, -20, -270), arc_points(0.0, 0.5, 0.5, -90, 150)
    line = np.concatenate([upper, lower[1:]])
    return Shape.of("s-blob", stroke_outline(line, np.linspace(0.24, 0.18, len(line))))


def crescent_moon() -> Shape:
    """A sickle moon: two arcs that meet in sharp horns."""
    outer = arc_points(0.0, 0.0, 1.0, 40, 320)
    inner = arc_points(0.42, 0.0, math.hypot(math.cos(math.radians(40)) - 0.42, math.sin(math.radians(40))), -60, -300)
    tip = math.degrees(math.atan2(math.sin(math.radians(40)), math.cos(math.radians(40)) - 0.42))
    inner = arc_points(0.42, 0.0, float(np.hypot(*(outer[0] - [0.42, 0.0]))), 360.0 - tip, tip)
    return Shape.of("crescent", np.concatenate([outer, inner[1:-1]]))


def stemmed_leaf() -> Shape:
    """A leaf: two bows of different curvature, a point, and a short stem."""
    u = np.linspace(0.0, 1.0, 60)
    upper = np.column_stack([2.2 * u, -0.62 * np.sin(math.pi * u**0.8) ** 1.1])
    lower = np.column_stack([2.2 * u, 0.48 * np.sin(math.pi * u**1.1) ** 1.1])
    stem = np.array([(-0.5, 0.12), (-0.5, 0.02)])
    return Shape.of("leaf", np.concatenate([upper[3:], lower[::-1][1:-3], stem]))


def guitar_body() -> Shape:
    """The body of a guitar without its cutaway, lopsided: smooth, with a round hole."""
    a = np.arange(220) * (2.0 * math.pi / 220)
    radius = 1.0 + 0.33 * np.cos(2 * a) - 0.12 * np.cos(a) + 0.05 * np.sin(3 * a + 0.5)
    return Shape.of("guitar", _polar_curve(radius), [circle_polygon(0.18, 0.02, 0.26)])


def crane_hook() -> Shape:
    """A crane hook: an eye, a shank, and a bow that narrows to its tip."""
    bow = arc_points(0.0, 0.0, 0.62, 0, 195)
    line = np.concatenate([np.linspace((0.62, -1.7), (0.62, -0.05), 34), bow])
    run = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    half = np.interp(run, [0.0, 0.15, 0.55, 0.9, 2.0, 2.8, run[-1]], [0.27, 0.27, 0.17, 0.17, 0.25, 0.24, 0.07])
    return Shape.of("hook", stroke_outline(line, half), [circle_polygon(0.62, -1.68, 0.13, 48)])


def door_key() -> Shape:
    """A door key: a round bow with a hole, a shank, a bit with two notches."""
    shank = [(2.2, -0.11), (2.2, 0.11), (2.08, 0.11), (2.08, 0.48), (1.9, 0.48), (1.9, 0.27), (1.78, 0.27), (1.78, 0.4)]
    shank += [(1.66, 0.4), (1.66, 0.11)]
    ring = np.concatenate([arc_points(0.0, 0.0, 0.55, 11.5, 348.5), shank])
    return Shape.of("key", ring, [circle_polygon(-0.14, 0.0, 0.22, 60)])


def ring_wrench() -> Shape:
    """A dog-bone wrench: a hexagon of another size at each end."""

    def hexagon_points(x: float, radius: float) -> list[tuple[float, float]]:
        a = [math.radians(60 * k + 15) for k in range(6)]
        return [(x + radius * math.cos(t), radius * math.sin(t)) for t in a]

    left, right = arc_points(-1.1, 0.0, 0.5, 28, 332), arc_points(1.1, 0.0, 0.42, -148, 148)
    waist = round_corners([(0.55, 0.14), (-0.45, 0.14)], 0.0)
    ring = np.concatenate([left, waist[::-1] * [1, -1], right, waist])
    return Shape.of("ring-wrench", ring, [hexagon_points(-1.1, 0.3), hexagon_points(1.1, 0.24)])


def table_fork() -> Shape:
    """A table fork: four tines, a neck, a handle that widens."""
    tines: list[tuple[float, float]] = []
    for k in range(4):
        y = -0.33 + 0.22 * k
        tines += [(-2.0, y - 0.055), (-2.0, y + 0.055)]
        if k < 3:
            tines += [(-1.35, y + 0.06), (-1.35, y + 0.16)]
    body = [(-0.95, 0.36), (-0.55, 0.1), (0.6, 0.09), (1.6, 0.2), (1.85, 0.0)]
    body += [(1.6, -0.2), (0.6, -0.09), (-0.55, -0.1), (-0.95, -0.36)]
    radii = [0.04, 0.04, 0.045, 0.045] * 3 + [0.04, 0.04] + [0.25, 0.3, 2.0, 0.15, 0.12, 0.15, 2.0, 0.3, 0.25]
    return Shape.of("fork", round_corners([*tines, *body], radii))


def table_spoon() -> Shape:
    """A spoon: smooth all round, a bowl and a long handle."""
    x = 3.2 * np.linspace(0.0, 1.0, 150) ** 1.8
    bowl = 0.42 * np.sqrt(np.clip(1.0 - ((x - 0.62) / 0.62) ** 2, 0.0, 1.0)) * (1.0 - 0.15 * (x - 0.62))
    neck = 0.075 + 0.075 / (1.0 + np.exp(-8.0 * (x - 2.5)))
    half = np.sqrt(bowl**2 + (neck / (1.0 + np.exp(-9.0 * (x - 0.8)))) ** 2)
    even = np.linspace(0.0, 3.2, 161)
    soft = np.convolve(np.pad(np.interp(even, x, half), 4, mode="edge"), np.full(9, 1 / 9), mode="valid")
    half = np.where(x < 0.8, half, np.interp(x, even, soft))
    return Shape.of("spoon", stroke_outline(np.column_stack([x, np.zeros_like(x)]), half))


def kitchen_knife() -> Shape:
    """A kitchen knife: a pointed blade with a curved edge, a heel, a handle with two rivets' holes."""
    edge = arc_points(-0.2, -1.5, 1.95, 76.5, 134)
    blade = np.concatenate([edge, [(-1.62, -0.2), (0.3, -0.14)]])
    handle = round_corners(
        [(0.3, -0.14), (1.6, -0.14), (1.6, 0.2), (1.0, 0.12), (0.26, 0.14)], [0.0, 0.14, 0.12, 0.3, 0.0]
    )
    rivets = [circle_polygon(0.65, 0.0, 0.045, 30), circle_polygon(1.25, 0.0, 0.045, 30)]
    return Shape.of("knife", np.concatenate([blade, handle[1:]]), rivets)


def bottle_opener() -> Shape:
    """A flat opener: a head with an opening that has a lip, a waist, a handle with a hole."""
    ring = [(-1.5, -0.42), (-0.75, -0.42), (-0.35, -0.2), (1.1, -0.28), (1.35, 0.0), (1.1, 0.28), (-0.35, 0.2)]
    ring += [(-0.75, 0.42), (-1.5, 0.42)]
    radii = [0.3, 0.25, 0.4, 0.2, 0.2, 0.2, 0.4, 0.25, 0.3]
    mouth = round_corners([(-1.3, -0.24), (-0.85, -0.24), (-0.85, -0.07), (-0.72, 0.0), (-0.85, 0.07), (-0.85, 0.24),
                     (-1.3, 0.24)], [0.16, 0.06, 0.03, 0.04, 0.03, 0.06, 0.16])  # fmt: skip
    return Shape.of("bottle-opener", round_corners(ring, radii), [mouth, circle_polygon(1.05, 0.0, 0.11, 40)])


def hammer_head() -> Shape:
    """The side view of a hammer's head: a square face, a neck, an eye, a peen that narrows."""
    ring = [(-1.2, -0.36), (-0.9, -0.36), (-0.84, -0.24), (-0.55, -0.24), (-0.4, -0.4), (0.3, -0.4)]
    ring += [(1.35, -0.12), (1.35, 0.04), (0.3, 0.3), (-0.4, 0.4), (-0.55, 0.24), (-0.84, 0.24), (-0.9, 0.36)]
    ring += [(-1.2, 0.36)]
    radii = [0.06, 0.05, 0.04, 0.06, 0.1, 0.3, 0.05, 0.05, 0.3, 0.1, 0.06, 0.04, 0.05, 0.06]
    eye = circle_polygon(0.0, 0.0, 1.0, 60) * [0.22, 0.15] + [-0.05, 0.0]
    return Shape.of("hammer-head", round_corners(ring, radii), [eye])


def sharpened_pencil() -> Shape:
    """A sharpened pencil: twelve times as long as wide, a blunt tip at one end, a rubber with round corners at the other."""
    ring = [(-6.0, -0.5), (-6.0, 0.5), (4.5, 0.5), (6.0, 0.07), (6.0, -0.07), (4.5, -0.5)]
    return Shape.of("pencil", round_corners(ring, [0.15, 0.15, 0.3, 0.05, 0.05, 0.3]))


def capped_bottle() -> Shape:
    """A bottle seen from the side: a body, sloping shoulders, a neck, the rim of its cap."""
    side = [(-1.5, 0.55), (0.55, 0.55), (1.05, 0.2), (1.5, 0.2), (1.5, 0.25), (1.78, 0.25)]
    radii = [0.1, 0.3, 0.25, 0.02, 0.02, 0.04]
    ring = [(x, -y) for x, y in reversed(side)]
    return Shape.of("bottle", round_corners([*side, *ring], [*radii, *reversed(radii)]))


SHAPES: dict[str, Callable[[], Shape]] = {
    "bracket": l_bracket, "spanner": open_end_spanner, "gasket": flange_gasket, "notched-plate": notched_plate,
    "blob": smooth_blob, "rectangle": rectangular_plate, "disc": full_disc, "square": square_plate,
    "gear": spur_gear, "hinge": hinge_leaf, "washer": eccentric_washer, "t-plate": t_plate, "cross": greek_cross,
    "star": five_pointed_star, "arrow": block_arrow, "hex-nut": hex_nut, "strip": ruler_strip, "u-clip": u_clip,
    "puzzle-piece": puzzle_piece, "hook": crane_hook, "key": door_key, "ring-wrench": ring_wrench,
    "fork": table_fork, "spoon": table_spoon, "knife": kitchen_knife, "bottle-opener": bottle_opener,
    "hammer-head": hammer_head, "ellipse": ellipse_shape, "egg": egg_shape, "bean": kidney_bean, "s-blob": s_blob,
    "crescent": crescent_moon, "leaf": stemmed_leaf, "guitar": guitar_body, "half-disc": half_disc,
    "slotted-disc": slotted_disc, "pencil": sharpened_pencil, "bottle": capped_bottle,
}  # fmt: skip
"""Every shape by its name."""
