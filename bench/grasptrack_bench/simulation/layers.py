# SPDX-License-Identifier: Apache-2.0
"""What is drawn into a scene beside table, parts and covers: reflections, shadows, rims, dirt, a cheap camera's work.

Each function that draws takes the image, what renders it, the moment and the box of the image that it is given, None being
all of it; it changes that image in place: (h, w) or (h, w, 3), float32 grey levels, or 8 bit at the stage "file".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import cv2
import numpy as np

from grasptrack.typing import Floats, Floats32
from grasptrack_bench.simulation.camera import RollingShutter
from grasptrack_bench.simulation.outlines import Shape
from grasptrack_bench.simulation.render import Box, Projection, Renderer, compress_jpeg
from grasptrack_bench.simulation.textures import TextureMap


@dataclass(frozen=True)
class Instant:
    """The camera and the part at one moment.

    Attributes:
        index: of the frame.
        plane: from the plane at a height above the table, in table units, to ideal px; below it mirror images lie.
        place: (3, 3) from the part's own plane to the table, or (K, 3, 3) at the knots of a rolling shutter.
        part: from the plane of the part's upper face to ideal px.
        eye: (3,) table units, the camera's centre, its height last.
    """

    index: int
    plane: Callable[[float], Projection]
    place: Floats
    part: Projection
    eye: Floats


@dataclass(frozen=True)
class Overlay:
    """Something that is drawn into every image.

    Attributes:
        stage: when: on the table, below all that lies there; on the part's upper face; on the grey levels that reach the
            sensor; or on the 8 bit image.
        draw: what draws it.
        hides: polygons (N, 2) px of the image that it hides for good.
    """

    stage: Literal["table", "face", "lens", "file"]
    draw: Callable[[Any, Renderer, Instant, Box | None], None]
    hides: tuple[Floats, ...] = ()


def draw_lamp(
    image: Any, view: Renderer, now: Instant, _: Box | None, *, ring: Floats, height: float, light: float, soft: float
) -> None:
    """A lamp in a glossy table: seen as far below the table as it hangs above it.

    Its outline `ring` (N, 2) and `height` are in table units; it adds `light` grey levels behind a blur of `soft` px.
    """
    view.apply_glare(image, view.project_outline(now.plane(-height), Shape("lamp", ring))[0], soft, light)


def draw_mirrored_sides(
    image: Any, view: Renderer, now: Instant, _: Box | None, *, thickness: float, strength: float
) -> None:
    """The sides of a part so many table units thick, mirrored in the table, from the table down; the part comes over them."""
    upper, lower = now.plane(0.0) @ now.place, now.plane(-thickness) @ now.place
    view.draw_part(image, upper, foot=lower, opacity=strength)


def draw_contact_shadow(
    image: Any, view: Renderer, now: Instant, _: Box | None, *, offset: Floats, softness: float, depth: float
) -> None:
    """The soft dark ramp beside a part that lies on a table.

    `offset` (2,) and `softness`, the standard deviation of its edge, are in table units; `depth` is the share of the light
    that is gone where it is darkest.
    """
    shift = np.eye(3)
    shift[:2, 2] = offset
    lies = now.plane(0.0) @ shift @ now.place
    middle = lies.homographies[len(lies.homographies) // 2] if isinstance(lies, RollingShutter) else lies
    soft = max(0.4, softness * math.sqrt(abs(float(np.linalg.det(middle / middle[2, 2])))))
    polygons = view.project_outline(lies)
    box = view.bounding_box(polygons, soft)
    if box is not None:
        left = 1.0 - np.float32(depth) * view.coverage_in_box(polygons, box, soft)
        image[box[1] : box[3], box[0] : box[2]] *= left[..., None] if view.colour else left


SLOPE = math.radians(45.0)
"""Of a bevel: the angle between its normal and that of the face."""
FIELD = 2048
"""px, side of the square in which a rim is laid out; it is kept at half of that."""


def draw_rim(
    image: Any, view: Renderer, now: Instant, box: Box | None, *, field: TextureMap, level: float, light: Floats,
    shine: float, sharpness: float,
) -> None:  # fmt: skip
    """A bevelled rim: each side of it is as bright as it faces the light, and shines where it mirrors the lamp.

    `field` has the rim's share, 0 to 255, then its outward direction (x, y) as 128 + 127 times it; `level` is the grey
    level where it faces the lamp, whose direction is `light` (3,); `shine` grey levels and an exponent make the highlight.
    """
    fields = view.warp_texture(field, now.part, box)
    share = fields[..., 0] * np.float32(1.0 / 255.0)
    away = (fields[..., 1:] - 128.0) / 127.0 * math.sin(SLOPE)
    half = light + now.eye / np.linalg.norm(now.eye)
    half /= np.linalg.norm(half)
    facing, mirror = (
        np.maximum(away @ way[:2].astype(np.float32) + np.float32(way[2] * math.cos(SLOPE)), 0.0)
        for way in (light, half)
    )
    tone = np.float32(level) * (0.5 + 0.5 * facing) + np.float32(shine) * mirror**sharpness
    if view.colour:
        share, tone = share[..., None], tone[..., None]
    image += share * (np.minimum(tone, 255.0) - image)


def bevel_layer(
    shape: Shape, width: float, level: float, rng: np.random.Generator, *, brightest: bool = False
) -> Overlay:
    """A rim of a shape, under a lamp from some side.

    Args:
        shape: the part.
        width: table units, of the rim; less where the shape is thin.
        level: grey level of the face; the rim is darker, or lighter by half or more.
        rng: for the rim's level, the lamp and the highlight.
        brightest: the rim is nearly white.
    """
    half = 1.08 * shape.radius()
    mask, scale = np.zeros((FIELD, FIELD), np.uint8), 0.5 * FIELD / half
    cv2.fillPoly(mask, [np.rint((ring + half) * scale * 16.0).astype(np.int32) for ring in shape.polygons], 1, shift=4)
    inner = cv2.distanceTransform(mask, cv2.DIST_L2, 5) / scale
    outer = cv2.distanceTransform(1 - mask, cv2.DIST_L2, 5) / scale
    thin = 0.4 * float(np.quantile(inner[mask > 0], 0.9))
    signed = cv2.GaussianBlur(np.asarray(outer - inner, dtype=np.float32), (0, 0), 2.0)
    share = np.clip(0.5 + (signed + min(width, thin)) * scale / 4.0, 0.0, 1.0)
    x, y = cv2.Sobel(signed, cv2.CV_32F, 1, 0, ksize=5), cv2.Sobel(signed, cv2.CV_32F, 0, 1, ksize=5)
    long = np.maximum(np.hypot(x, y), 1e-9)
    fields = cv2.merge([255.0 * share, 128.0 + 127.0 * x / long, 128.0 + 127.0 * y / long])
    small = cv2.resize(fields, (FIELD // 2, FIELD // 2), interpolation=cv2.INTER_AREA)
    lean, side = rng.uniform(math.radians(25.0), math.radians(60.0)), rng.uniform(0.0, 2.0 * math.pi)
    tone = min(level * float(rng.choice([0.6, 1.5, 1.9])), 250.0)
    rim = partial(
        draw_rim,
        field=TextureMap(np.asarray(cv2.convertScaleAbs(small), dtype=np.uint8), half),
        level=250.0 if brightest else tone,
        light=np.array([math.cos(side) * math.sin(lean), math.sin(side) * math.sin(lean), math.cos(lean)]),
        shine=float(rng.uniform(60.0, 200.0)),
        sharpness=float(rng.uniform(12.0, 60.0)),
    )
    return Overlay("face", rim)


def blur_lens(image: Any, _: Renderer, now: Instant, __: Box | None, *, sigma: Floats) -> None:
    """A focus that comes and goes: `sigma` (F,) px of blur on top of the usual one; below a tenth of a px nothing changes."""
    if sigma[now.index] > 0.1:
        cv2.GaussianBlur(image, (0, 0), float(sigma[now.index]), image, borderType=cv2.BORDER_REFLECT_101)


def draw_marks(image: Any, view: Renderer, _: Instant, __: Box | None, *, share: Floats32, level: float) -> None:
    """What stands still in the image, of one grey level: `share` (H, W) is how much of each pixel it hides."""
    image += (share[..., None] if view.colour else share) * (np.float32(level) - image)


FONT = cv2.FONT_HERSHEY_SIMPLEX


def caption_layer(text: str, corner: tuple[int, int], scale: float) -> Overlay:
    """A text that is burnt into the image, white with a black border, from its lower left end (x, y) px on.

    "{}" in it stands for the time in s; of scale 1 it is some 21 px high.
    """
    (wide, high), base = cv2.getTextSize(text.format("000.00"), FONT, scale, 3)
    x, y = corner
    box = np.array([[x, y - high], [x + wide, y - high], [x + wide, y + base], [x, y + base]], dtype=np.float64)
    return Overlay("file", partial(_write, text=text, corner=corner, scale=scale), (box,))


def _write(
    image: Any, _: Renderer, now: Instant, __: Box | None, *, text: str, corner: tuple[int, int], scale: float
) -> None:
    for level, wide in ((0, 3), (255, 1)):
        shown = text.format(f"{now.index / 30.0:06.2f}")
        cv2.putText(image, shown, corner, FONT, scale, (level,) * 3, wide, cv2.LINE_AA)


BALANCE = np.array([0.7, 1.0, 0.8], np.float32)
"""Sensitivity of blue, green and red pixels to grey light, which the camera corrects after it has mixed them."""


def process_cheaply(
    image: Any, _: Renderer, __: Instant, ___: Box | None, *, median: bool, strength: float, sharpen: float,
    radius: float, quality: int,
) -> None:  # fmt: skip
    """What a cheap camera does: one colour a pixel, noise reduction, sharpening, JPEG of a quality.

    Noise is reduced by a median or by a bilateral filter that takes `strength` grey levels for noise; `sharpen` times what
    a blur of `radius` px takes away is added.
    """
    seen = np.rint((image if image.ndim == 3 else cv2.merge([image] * 3)) * BALANCE)
    raw = np.empty(image.shape[:2], np.uint8)
    for y, x, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        raw[y::2, x::2] = seen[y::2, x::2, channel]
    made = cv2.convertScaleAbs(cv2.cvtColor(raw, cv2.COLOR_BayerRGGB2RGB) * (1.0 / BALANCE))
    made = cv2.medianBlur(made, 3) if median else cv2.bilateralFilter(made, 5, strength, 1.5)
    sharp = cv2.addWeighted(made, 1.0 + sharpen, cv2.GaussianBlur(made, (0, 0), radius), -sharpen, 0.0)
    done = compress_jpeg(np.asarray(sharp, dtype=np.uint8), quality)
    image[:] = done if image.ndim == 3 else cv2.cvtColor(done, cv2.COLOR_BGR2GRAY)
