# SPDX-License-Identifier: Apache-2.0
"""Scenes as on a bench: compression, gloss, rims, bodies, neighbours, hands. From a setting to a scene's arguments."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from grasptrack.typing import Floats
from grasptrack_bench.simulation import layers as drawn
from grasptrack_bench.simulation.camera import Pinhole
from grasptrack_bench.simulation.codec import Codec
from grasptrack_bench.simulation.conditions import GROWING
from grasptrack_bench.simulation.effects import EffectSetting, Parts, specular_highlight
from grasptrack_bench.simulation.frame import Hinge
from grasptrack_bench.simulation.layers import Overlay
from grasptrack_bench.simulation.lookalikes import Distractor, place_beside, scale_shape
from grasptrack_bench.simulation.occluders import BEHIND, SKINS, Drifting
from grasptrack_bench.simulation.outlines import Shape, circle_polygon, inside_polygons, stroke_outline
from grasptrack_bench.simulation.paths import Path, at_rest, hand_held, kept_in_view
from grasptrack_bench.simulation.shapes import SHAPES
from grasptrack_bench.simulation.tabletop import drawn_print, visible_at_first
from grasptrack_bench.simulation.textures import (
    TextureMap,
    adjust_grey_level,
    another_surface,
    plain_texture,
    printed_texture,
)


def _unit(s: EffectSetting, path: Path) -> float:
    """Table units of a px of a 640 px wide image, in the first frame."""
    return s.width / 640.0 * float(path.distance[0] / Pinhole(s.width, s.height).matrix[1, 1])


def _direction(s: EffectSetting) -> tuple[float, float]:
    angle = float(s.rng.uniform(0.0, 2.0 * math.pi))
    return math.cos(angle), math.sin(angle)


def _wave(s: EffectSetting, cycles: float) -> Floats:
    """(F,) a sine between -1 and 1, its phase drawn."""
    return np.asarray(np.sin(2.0 * math.pi * (cycles * np.arange(s.frames) / s.frames + s.rng.uniform())))


# --- what the camera does ------------------------------------------------------------------------


def h264(s: EffectSetting) -> Parts:
    """As network cameras send it."""
    return _coded(s, "libx264")


def h265(s: EffectSetting) -> Parts:
    """As newer ones do."""
    return _coded(s, "libx265")


def _coded(s: EffectSetting, name: str) -> Parts:
    path, preset = s.course(), str(s.rng.choice(["veryfast", "ultrafast"]))
    return {"path": path, "code": Codec(name, float(s.rng.uniform(26.0, 36.0)), preset)}


def cheap_camera(s: EffectSetting) -> Parts:
    """A sensor with a colour filter, and what its driver does to please the eye."""
    median = s.rng.uniform() >= 0.5
    strength, sharpen, radius = (float(v) for v in s.rng.uniform((15.0, 0.8, 1.0), (40.0, 2.0, 2.5)))
    quality, noise = int(s.rng.integers(60, 81)), float(s.rng.uniform(4.0, 9.0))
    work = partial(
        drawn.process_cheaply, median=median, strength=strength, sharpen=sharpen, radius=radius, quality=quality
    )
    return {"path": s.course(), "layers": (Overlay("file", work),), "light": {"noise": noise}}


def fixed_marks(s: EffectSetting) -> Parts:
    """Dirt always; bars or a bezel, and a text, mostly."""
    wide, high, rng = s.width, s.height, s.rng
    kind = str(rng.choice(["bars", "pillars", "bezel", "none"]))
    dx = round(rng.uniform(0.03, 0.09) * wide) if kind in ("pillars", "bezel") else 0
    dy = round(rng.uniform(0.03, 0.09) * high) if kind in ("bars", "bezel") else 0
    left, top, right, low = dx - 0.5, dy - 0.5, wide - dx - 0.5, high - dy - 0.5
    edge = np.zeros((high, wide), np.float32)
    if dx or dy:
        edge[:] = 1.0
        edge[dy : high - dy, dx : wide - dx] = 0.0
    layers: list[Overlay] = [_dirt(s)]
    out = [[-0.5, -0.5, left, high], [right, -0.5, wide, high], [-0.5, -0.5, wide, top], [-0.5, low, wide, high]]
    boxes = [b for b, there in zip(out, (dx, dx, dy, dy), strict=True) if there]
    hidden = tuple(np.array([[a, b], [c, b], [c, d], [a, d]]) for a, b, c, d in boxes)
    if hidden:
        layers.append(
            Overlay("lens", partial(drawn.draw_marks, share=edge, level=float(rng.uniform(0.0, 25.0))), hidden)
        )
    line = 0
    if rng.uniform() < 0.7:
        scale = float(rng.uniform(0.4, 0.7)) * wide / 640.0
        line = round(36.0 * scale)
        text = str(rng.choice(["CAM 02  2024-05-17 {}", "REC {}", "ACME VISION", "LINE 4  {} s"]))
        at_top = bool(rng.uniform() < 0.5)
        layers.append(drawn.caption_layer(text, (dx + 6, dy + line - 8 if at_top else high - dy - 10), scale))
    # The part stays inside what is left: an image as much smaller, with the same focal length.
    focal = float(Pinhole(wide, high).matrix[1, 1])
    path = s.course(Pinhole(wide - 2 * dx, high - 2 * (dy + line), focal=focal))
    return {"path": path, "layers": tuple(layers), "light": {"vignette": float(rng.uniform(0.1, 0.6))}}


def _dirt(s: EffectSetting) -> Overlay:
    """Specks and smears on the lens, out of focus."""
    share = np.zeros((s.height, s.width), np.float32)
    for _ in range(int(s.rng.integers(4, 14))):
        speck = np.zeros_like(share)
        at = (round(s.rng.uniform(0, s.width)), round(s.rng.uniform(0, s.height)))
        axes = np.maximum(1, np.rint(s.rng.uniform(2.0, 14.0, 2) * s.width / 640.0)).astype(int).tolist()
        cv2.ellipse(speck, at, axes, float(s.rng.uniform(0, 180)), 0, 360, float(s.rng.uniform(0.15, 0.6)), -1)
        cv2.GaussianBlur(speck, (0, 0), float(s.rng.uniform(1.5, 6.0)) * s.width / 640.0, speck)
        share += (1.0 - share) * speck
    return Overlay("lens", partial(drawn.draw_marks, share=share, level=float(s.rng.choice([20.0, 60.0, 200.0]))))


def overlay(s: EffectSetting) -> Parts:
    """What a viewer draws, an agency prints, or a ring of lamps round the lens leaves over the part."""
    rng, unit = s.rng, s.width / 640.0
    ink, (x, y) = np.zeros((s.height, s.width), np.uint8), (s.width // 2, s.height // 2)
    kind, level, opacity, soft = str(rng.choice(["crosshair", "watermark", "ring"])), rng.choice([0, 90, 255]), 1.0, 0.3
    if kind == "crosshair":
        gap, wide = round(float(rng.uniform(0.0, 20.0)) * unit), int(rng.integers(1, 4))
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            cv2.line(ink, (x + gap * dx, y + gap * dy), (x + s.width * dx, y + s.width * dy), (255,), wide, cv2.LINE_AA)
        for radius in rng.uniform(20.0, 150.0, int(rng.integers(0, 4))) * unit:
            cv2.circle(ink, (x, y), round(float(radius)), (255,), wide, cv2.LINE_AA)
    elif kind == "watermark":
        high, opacity = round(float(rng.uniform(50.0, 110.0)) * unit), float(rng.uniform(0.15, 0.5))
        for k in range(s.height // high + 2):
            cv2.putText(ink, "SAMPLE   " * 9, (-(k * high) % s.width - s.width, k * high), drawn.FONT, unit, (255,), 3)
    else:
        radius, number, level = float(rng.uniform(30.0, 110.0)) * unit, int(rng.choice([8, 12, 24])), 255
        opacity, soft = float(rng.uniform(0.3, 0.9)), float(rng.uniform(1.5, 5.0)) * unit
        for angle in np.arange(number) * 2.0 * math.pi / number:
            at = (round(x + radius * math.cos(angle)), round(y + radius * math.sin(angle)))
            cv2.circle(ink, at, max(2, round(1.6 * radius / number)), (255,), -1)
    share = np.asarray(cv2.GaussianBlur(ink.astype(np.float32) * (opacity / 255.0), (0, 0), soft), dtype=np.float32)
    return {
        "path": s.course(),
        "layers": (Overlay("lens", partial(drawn.draw_marks, share=share, level=float(level))),),
    }


def focus(s: EffectSetting) -> Parts:
    """The autofocus hunts: in focus, out, and back, one to three times."""
    times = int(s.rng.integers(1, 4))
    wave = 0.5 - 0.5 * np.cos(2.0 * math.pi * times * np.arange(s.frames) / max(1, s.frames - 1))
    sigma = s.width / 640.0 * float(s.rng.uniform(3.0, 5.0)) * wave ** float(s.rng.uniform(0.7, 3.0))
    layer = Overlay("lens", partial(drawn.blur_lens, sigma=sigma))
    return {"path": s.course(), "layers": (layer,), "light": {"blur": 0.7}}


def aspect(s: EffectSetting) -> Parts:
    """A frame grabber, or a stream that was scaled."""
    away = float(s.rng.uniform(0.04, 0.12) * s.rng.choice([-1.0, 1.0]))
    camera = Pinhole(s.width, s.height, aspect=1.0 + away)
    return {"path": s.course(camera), "camera": camera}


def hand_camera(s: EffectSetting) -> Parts:
    """The speeds of 280 sequences that were filmed by hand: the median, and how much faster the fastest are."""
    speed = float(s.rng.uniform(6.0, 17.0)) * s.width / 1280.0
    path = hand_held(
        s.shape, s.course(tilt=0.0, speed=1.0), Pinhole(s.width, s.height), speed=speed,
        tail=float(s.rng.uniform(2.2, 4.6)), seed=s.seed,
    )  # fmt: skip
    return {"path": path, "light": {"exposure": float(s.rng.uniform(0.15, 0.6))}}


def glare_first(s: EffectSetting) -> Parts:
    """The same highlight as `highlight`, but nobody has seen what it hides."""
    made = specular_highlight(s)
    return {**made, "light": {"glare": replace(made["light"]["glare"], start=-GROWING)}}


# --- what part and table are like ----------------------------------------------------------------


def glossy_table(s: EffectSetting) -> Parts:
    """One to three lamps and the part's own sides, mirrored."""
    path, rng = s.course(tilt=math.radians(20.0)), s.rng
    thickness = float(rng.uniform(0.02, 0.07))
    layers: list[Overlay] = []
    for _ in range(int(rng.integers(1, 4))):
        height = float(rng.uniform(2.0, 8.0))
        grow = 1.0 + height / float(path.distance[0])  # what lies deeper is seen smaller and nearer to the middle
        x, y = _direction(s)
        at = float(rng.uniform(0.2, 1.3)) * s.shape.radius() * np.array([x, y])
        size = rng.uniform(0.12, 0.35)
        if rng.uniform() < 0.4:
            ring = circle_polygon(0.0, 0.0, size)
        else:  # a tube or a window
            a, b = np.array([x, y]) * size * rng.uniform(1.0, 5.0), np.array([-y, x]) * size * rng.uniform(0.4, 1.0)
            ring = np.array([-a - b, a - b, a + b, -a + b])
        soft = float(rng.uniform(1.5, 8.0)) * s.width / 640.0
        light = float(rng.uniform(40.0, 250.0))
        lamp = partial(drawn.draw_lamp, ring=grow * (ring + at), height=height, light=light, soft=soft)
        layers.append(Overlay("table", lamp))
    sides = partial(drawn.draw_mirrored_sides, thickness=thickness, strength=float(rng.uniform(0.3, 0.6)))
    layers.append(Overlay("table", sides))
    return {"path": path, "layers": tuple(layers), "thickness": thickness, "shade": 0.6}


def contact_shadow(s: EffectSetting) -> Parts:
    """Light from one side: a ramp 3 to 15 px wide on the other."""
    path = s.course()
    width = float(s.rng.uniform(3.0, 15.0)) * _unit(s, path)
    offset, depth = 0.4 * width * np.array(_direction(s)), float(s.rng.uniform(0.4, 0.8))
    shadow = partial(drawn.draw_contact_shadow, offset=offset, softness=0.3 * width, depth=depth)
    return {"path": path, "layers": (Overlay("table", shadow),)}


def bevel(s: EffectSetting) -> Parts:
    """A milled or pressed edge, 2 to 6 px wide."""
    path = s.course(tilt=math.radians(25.0))
    width = float(s.rng.uniform(2.0, 6.0)) * _unit(s, path)
    return {"path": path, "layers": (drawn.bevel_layer(s.shape, width, s.level, s.rng),)}


def faint(s: EffectSetting) -> Parts:
    """A part hardly lighter or darker than the table, both of them worn."""
    apart = float(s.rng.uniform(8.0, 20.0) * s.rng.choice([-1.0, 1.0]))
    level = float(np.clip(s.table_level, 45.0, 200.0))
    made = [another_surface(level + apart, s.rng)]
    grey = plain_texture(int(s.rng.integers(8)), colour=(150.0, 150.0, 150.0), contrast=float(s.rng.uniform(0.5, 1.5)))
    made.append(adjust_grey_level(grey.grey, level, s.rng))
    surface, table = (_scratched(texture, s, count) for texture, count in zip(made, (40, 160), strict=True))
    return {"path": s.course(), "surface": surface, "table": table}


def _scratched(texture: TextureMap, s: EffectSetting, count: int) -> TextureMap:
    """The same with scratches, as much lighter or darker as part and table are apart."""
    size = texture.image.shape[0]
    lighter, darker = np.zeros((2, size, size), np.uint8)
    for _ in range(count):
        start, way = s.rng.uniform(0.0, size, 2), np.array(_direction(s)) * s.rng.uniform(0.05, 0.4) * size
        bend = 0.1 * s.rng.uniform(-1.0, 1.0) * np.array([-way[1], way[0]])
        u = np.linspace(0.0, 1.0, 12)[:, None]
        points = np.rint(start + u * way + 4.0 * u * (1.0 - u) * bend).astype(np.int32)
        layer = lighter if s.rng.uniform() < 0.5 else darker
        cv2.polylines(layer, [points], False, float(s.rng.uniform(5.0, 24.0)), 1, cv2.LINE_AA)
    change = lighter.astype(np.int16) - darker
    image = texture.image + (change if texture.image.ndim == 2 else change[..., None])
    return TextureMap(np.clip(image, 0, 255).astype(np.uint8), texture.extent, texture.middle)


def transparent(s: EffectSetting) -> Parts:
    """Acrylic or glass: 25 to 60 % of its own, a bright rim, and in half of the scenes holes."""
    path = s.course()
    shape = _with_holes(s) if s.rng.uniform() < 0.5 else s.shape
    width = float(s.rng.uniform(2.0, 5.0)) * _unit(s, path)
    rim = drawn.bevel_layer(shape, width, s.level, s.rng, brightest=True)
    return {"path": path, "shape": shape, "opacity": float(s.rng.uniform(0.25, 0.6)), "layers": (rim,)}


def _with_holes(s: EffectSetting) -> Shape:
    """The part with one to three round holes more, where there is room for them."""
    holes = list(s.shape.holes)
    for _ in range(40):
        at, radius = s.rng.uniform(-1.0, 1.0, 2) * s.shape.radius(), float(s.rng.uniform(0.05, 0.14))
        around = circle_polygon(float(at[0]), float(at[1]), radius + 0.06)
        if len(holes) >= len(s.shape.holes) + 3:
            break
        rings = [ring.astype(np.float32) for ring in (s.shape.outer, *holes)]
        apart = min(abs(float(cv2.pointPolygonTest(ring, at.tolist(), True))) for ring in rings)
        if inside_polygons([s.shape.outer, *holes], around).all() and apart > radius + 0.06:
            holes.append(circle_polygon(float(at[0]), float(at[1]), radius)[::-1])
    return Shape(s.shape.name, s.shape.outer, tuple(holes))


def block(s: EffectSetting) -> Parts:
    """A box, a cartridge, a book: 8 to 20 % thick, printed above and on its sides, and never seen straight from above."""
    rng = s.rng
    thickness = float(rng.uniform(0.08, 0.2))
    path = s.course(tilt=0.0)
    lean = math.radians(20.0) + math.radians(10.0) * _wave(s, float(rng.uniform(0.5, 1.2)))
    azimuth = float(rng.uniform(0.0, 2.0 * math.pi)) + 0.7 * _wave(s, 0.6)
    tilted = replace(path, tilt=lean, azimuth=azimuth)
    path = kept_in_view(scale_shape(s.shape, 1.0 + 1.5 * thickness), tilted, Pinhole(s.width, s.height), 1.02)
    print_on = printed_texture(int(rng.integers(4)), colour=(80.0, 80.0, 80.0)).grey.image.astype(np.float32)
    row = int(rng.integers(0, 500))
    relief = cv2.resize(print_on[row : row + 60], (160, 6), interpolation=cv2.INTER_AREA)
    surface = drawn_print(s, str(rng.choice(["words", "picture"])), int(rng.integers(4)))
    shade, relief = float(rng.choice([0.6, 0.8, 1.1])), np.asarray(relief / relief.mean(), dtype=np.float32)
    return {"path": path, "surface": surface, "thickness": thickness, "shade": shade, "relief": relief}


# --- what lies and acts beside it ----------------------------------------------------------------


def touching(s: EffectSetting) -> Parts:
    """One or two pieces that touch it, or a cable that runs under it."""
    s = replace(s, size=0.8 * s.size)
    path, rng = s.course(reach=0.25), s.rng
    made: list[Distractor] = []
    if rng.uniform() < 0.6:
        others = [str(n) for n in rng.permutation([n for n in SHAPES if n != s.shape.name])][: int(rng.integers(1, 3))]
        shapes = [scale_shape(SHAPES[n](), float(rng.uniform(0.5, 0.9))) for n in others]
        gaps = [(0.012, 0.012)] * len(shapes)  # the least: then it is pushed against the part
        for part in place_beside(s.shape, shapes, rng, gaps=gaps, fits=visible_at_first(s, path, 0.6)):
            x, y = part.shift
            closer = 1.0 - float(rng.uniform(0.03, 0.06)) / math.hypot(x, y)
            made.append(Distractor(shapes[part.number], _clutter(s), turn=part.turn, shift=(closer * x, closer * y)))
    if not made:
        made = [_cable(s)]
    return {"path": path, "distractors": tuple(made)}


def _clutter(s: EffectSetting) -> TextureMap:
    """As light as the part in half of the cases, else as far from the table on its other side."""
    level = s.level + float(s.rng.uniform(-12.0, 12.0)) if s.rng.uniform() < 0.5 else 2.0 * s.table_level - s.level
    return another_surface(float(np.clip(level, 25.0, 225.0)), s.rng)


def _cable(s: EffectSetting) -> Distractor:
    """It comes from outside, bends, and ends under the part."""
    x, y = _direction(s)
    u = np.linspace(0.0, 1.0, 120)[:, None]
    bend = float(s.rng.uniform(-0.6, 0.6)) * np.sin(2.0 * math.pi * float(s.rng.uniform(0.6, 1.4)) * u)
    line = 6.0 * u * np.array([x, y]) + bend * u * np.array([-y, x])
    ring = stroke_outline(line, float(s.rng.uniform(0.03, 0.09)))
    return Distractor(Shape("cable", ring), _clutter(s), flat=True)


def pushed(s: EffectSetting) -> Parts:
    """A finger comes, pushes the part aside and round, and goes."""
    rng, frames = s.rng, np.arange(s.frames, dtype=np.float64)
    out, touch, ends, gone = (max(1.0, t) for t in s.at(0.1, 0.25, 0.65, 0.8))
    way, turn = float(rng.uniform(0.2, 0.5)), math.radians(float(rng.uniform(10.0, 40.0) * rng.choice([-1.0, 1.0])))
    share = np.clip((frames - touch) / max(1e-9, ends - touch), 0.0, 1.0)
    share = share * share * (3.0 - 2.0 * share)
    x, y = _direction(s)
    moves = share[:, None] * np.array([way * x, way * y, turn])
    push = np.array([x, y])
    # The first point of the outline that a finger meets on its way past the middle.
    aside = float(rng.uniform(-0.1, 0.1))
    points = s.shape.samples(1500)
    across = np.abs(points @ np.array([-y, x]) - aside)
    met = points[across < max(0.03, float(across.min()) + 1e-6)]
    tip = met[np.argmin(met @ push)] + float(rng.uniform(0.0, 0.06)) * push
    half = float(rng.uniform(0.11, 0.17))
    u = np.linspace(0.0, 1.0, 40)
    thick = np.minimum(half * (1.0 + 2.0 * u), 0.4)
    ring = stroke_outline((-half - BEHIND * u)[:, None] * push, thick)
    room = scale_shape(s.shape, 1.0 + (way + 0.1) / s.shape.radius())
    path = kept_in_view(room, s.course(speed=2.0, reach=0.15), Pinhole(s.width, s.height), 1.02)
    coming = np.clip(np.maximum((touch - frames) / (touch - out + 1e-9), (frames - ends) / (gone - ends + 1e-9)), 0, 1)
    c, sn = np.cos(-moves[:, 2]), np.sin(-moves[:, 2])
    back = np.column_stack([c * x - sn * y, sn * x + c * y])  # the finger's direction, as the turned part sees it
    at = tip - (coming * coming * (3.0 - 2.0 * coming) * (s.view(path) + s.shape.radius()))[:, None] * back
    at[(frames <= out) | (frames >= gone)] = np.nan
    finger = Drifting(ring, at, turn=-moves[:, 2], colour=SKINS[int(rng.integers(len(SKINS)))], relief=0.35)
    return {"path": path, "moves": moves, "covers": (finger,)}


def equal_belt(s: EffectSetting) -> Parts:
    """Equal parts come by at equal distances; the first one leaves, and another is always near where it was."""
    rng, camera = s.rng, Pinhole(s.width, s.height)
    s = replace(s, size=float(rng.uniform(0.45, 0.7)) * s.size)
    path = at_rest(s.course(tilt=0.0))
    x, y = _direction(s)
    along = s.shape.outer @ np.array([x, y])
    pitch = float(along.max() - along.min()) + float(rng.uniform(0.15, 0.6))
    step = float(rng.uniform(0.1, 0.9)) * pitch
    # The part begins where it comes in, as far back as it is whole in view.
    inside, back = visible_at_first(s, path, 1.0), 0.0
    while inside(s.shape.moved(0.0, (-(back + 0.1) * x, -(back + 0.1) * y))) and back < 20.0:
        back += 0.1
    back = max(0.0, back - 0.05)
    gone = back - step * np.arange(s.frames)
    path = replace(path, target=path.target + gone[:, None] * np.array([x, y]))
    seen = (s.view(path) + s.shape.radius()) / pitch
    first, last = math.floor((gone.min() - 2.0 * back) / pitch - seen), math.ceil(2.0 * back / pitch + seen)
    others = tuple(Distractor(s.shape, shift=(k * pitch * x, k * pitch * y)) for k in range(first, last + 1) if k)
    made: Parts = {"path": path, "camera": camera, "distractors": others}
    contrast = 1.0 if rng.uniform() < 0.5 else 0.05
    pattern = (printed_texture if contrast == 1.0 else plain_texture)(
        int(rng.integers(4)), size=1024, extent=4.5, colour=(150.0, 150.0, 150.0), contrast=contrast
    )
    return made | {"table": adjust_grey_level(pattern.grey, s.table_level, rng)}


def two_bodies(s: EffectSetting) -> Parts:
    """Pliers or scissors: two pieces round a rivet that open by up to 15 degrees, and half of them close again."""
    (x, y), (w, h), angle = cv2.minAreaRect(s.shape.outer.astype(np.float32))
    long = math.radians(float(angle)) + (0.0 if w >= h else 0.5 * math.pi)
    way, axis = (-1.0, long) if s.rng.uniform() < 0.5 else (1.0, long + 0.5 * math.pi)  # which piece is the first
    middle, share = np.array([x, y]), s.rng.uniform(-0.2, 0.2, 12) * max(w, h)
    places = middle + share[:, None] * np.array([math.cos(long), math.sin(long)])
    held = np.flatnonzero(inside_polygons(s.shape.polygons, places))
    rivet = places[held[0]] if len(held) else np.zeros(2)
    u = np.clip((np.arange(s.frames) / max(1, s.frames) - 0.1) / 0.8, 0.0, 1.0)
    opened = 0.5 - 0.5 * np.cos(math.pi * u * (2.0 if s.rng.uniform() < 0.5 else 1.0))
    most = math.radians(float(s.rng.uniform(5.0, 15.0)))
    hinge = Hinge((float(rivet[0]), float(rivet[1])), axis, way * most * opened)
    wide = kept_in_view(scale_shape(s.shape, 1.15), s.course(), Pinhole(s.width, s.height), 1.02)
    return {"path": wide, "hinge": hinge}
