# SPDX-License-Identifier: Apache-2.0
"""One image of a flat part on a table, through a homography and a lens, as a camera would record it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats, Floats32
from grasptrack_bench.simulation.camera import Pinhole, RollingShutter
from grasptrack_bench.simulation.conditions import DAZZLE, SHARP, Conditions, Shadow, pooled_noise
from grasptrack_bench.simulation.coverage import pixel_coverage, side_faces, subdivide_polygon
from grasptrack_bench.simulation.occluders import Cover
from grasptrack_bench.simulation.outlines import Shape
from grasptrack_bench.simulation.textures import TextureMap

Box = tuple[int, int, int, int]
Projection = Floats | RollingShutter
"""From a plane to ideal px: a homography (3, 3), or one for each row."""

TO_GREY = np.array([0.114, 0.587, 0.299], np.float32)
Finish = Callable[[Floats32, Box], None]
"""What changes the upper face (h, w) or (h, w, 3) in grey levels, in place, given the box of the image that it fills."""
PRINTED = 0.02
"""Table units; a print on the sides is drawn in pieces this long."""
FINE = 0.02
"""Table units; through a lens straight sides bend, so they are cut into pieces no longer than this."""


class Renderer:
    """Renders a part on a table.

    Args:
        shape: its outline, in table units, lying at the origin.
        table: the texture below it.
        surface: its own texture.
        width, height: px.
        blur: px, see `Conditions`.
        colour: BGR images, else grey ones.
        camera: whose lens is used; None is a lens without distortion.
    """

    def __init__(
        self,
        shape: Shape,
        table: TextureMap,
        surface: TextureMap,
        *,
        width: int,
        height: int,
        blur: float,
        colour: bool,
        camera: Pinhole | None = None,
    ) -> None:
        self.shape = shape
        self.size = (width, height)
        self.blur = blur
        self.colour = colour
        self.camera = camera if camera is not None else Pinhole(width, height)
        self._table = self._match_channels(table)
        self._surface = self._match_channels(surface)
        self._fall: tuple[Conditions, Floats32] | None = None
        self._rays: Floats32 | None = None
        if self.camera.distorted:
            grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
            self._rays = self.camera.undistort(grid.reshape(-1, 2)).reshape(height, width, 2).astype(np.float32)

    def _match_channels(self, texture: TextureMap) -> TextureMap:
        return texture.coloured if self.colour else texture.grey

    def project_outline(
        self, H: Projection, shape: Shape | None = None, step: float | None = None
    ) -> tuple[Floats, ...]:
        """The polygons in px of the part, or of another shape, under H, from its plane to ideal px.

        Sides are cut into pieces no longer than `step` table units; where that is None, only where they are seen bent.
        """
        polygons = (self.shape if shape is None else shape).polygons
        if step is not None or self.camera.distorted or isinstance(H, RollingShutter):
            polygons = tuple(subdivide_polygon(p, FINE if step is None else step) for p in polygons)
        if isinstance(H, RollingShutter):
            return tuple(H.project(p, self.camera) for p in polygons)
        return tuple(self.camera.distort(apply_homography(H, p)) for p in polygons)

    def render_background(self, H: Projection, slide: Floats | None = None) -> Floats32:
        """(height, width) or (height, width, 3) grey levels of the table before light, cover and noise, H (3, 3) to ideal px.

        `slide` (2,) is table units by which the table's texture has moved under the part.
        """
        moved = np.eye(3)
        if slide is not None:
            moved[:2, 2] = slide
        return self.warp_texture(self._table, H @ moved)

    def draw_part(
        self,
        image: Floats32,
        H: Projection,
        *,
        shape: Shape | None = None,
        surface: TextureMap | None = None,
        foot: Projection | None = None,
        shade: float = 0.6,
        opacity: float = 1.0,
        within: Sequence[Floats] = (),
        finish: Finish | None = None,
        relief: Floats32 | None = None,
    ) -> None:
        """Draws the part over the image, in place.

        Args:
            image: what `render_background` gave.
            H: (3, 3) plane of the part's upper face to ideal px.
            shape: another one in its place.
            surface: its texture, else that of the part.
            foot: (3, 3) plane of its lower face to ideal px, of a thick part: its sides are drawn too.
            shade: brightness of those sides, as a share of the upper face's mean.
            opacity: share of what lies below that the part hides.
            within: polygons (N, 2) in the part's plane; only what lies in them is drawn. () draws all.
            finish: changes the upper face, in place, before it is drawn.
            relief: a print on the sides, see `side_faces`.
        """
        above = self._surface if surface is None else self._match_channels(surface)
        step = None if relief is None else PRINTED
        polygons = self.project_outline(H, shape, step)
        lower = self.project_outline(foot, shape, step) if foot is not None else ()
        box = self.bounding_box([*polygons, *lower])
        if box is None:
            return
        x0, y0, x1, y1 = box
        share = self.coverage_in_box(polygons, box)
        face = self.warp_texture(above, H, box)
        if within:
            share *= self.coverage_in_box(self.project_outline(H, Shape("", within[0], tuple(within[1:]))), box)
        if finish is not None:
            finish(face, box)
        if opacity < 1.0:
            share *= np.float32(opacity)
        corner = np.array([x0, y0])
        sides = (
            side_faces([p - corner for p in polygons], [p - corner for p in lower], x1 - x0, y1 - y0, self.blur, relief)
            if lower
            else None
        )
        if sides is None:
            self._blend_box(image, box, share, face)
            return
        beside, bright = (np.float32(opacity) * (field[..., None] if self.colour else field) for field in sides)
        if self.colour:
            share = share[..., None]
        part = image[y0:y1, x0:x1]
        level = np.float32(shade) * np.asarray(cv2.mean(above.image)[: 3 if self.colour else 1], np.float32)
        part *= np.maximum(1.0 - share - beside, 0.0)
        part += share * face + bright * level

    def draw_occluder(self, image: Floats32, cover: Cover, polygon: Floats) -> None:
        """Draws what lies in front over the image, in place."""
        box = self.bounding_box((polygon,))
        if box is None:
            return
        share = self.coverage_in_box((polygon,), box)
        colour = np.array(cover.colour, np.float32)
        level = colour if self.colour else np.float32(colour @ TO_GREY)
        above = np.broadcast_to(level, (*share.shape, 3) if self.colour else share.shape)
        if cover.relief > 0.0:
            round_off = np.float32(cover.relief) * (1.0 - _coarse_blur(share, 0.02 * self.size[0]))
            above = above * (1.0 - (round_off[..., None] if self.colour else round_off))
        self._blend_box(image, box, share, np.asarray(above, dtype=np.float32))

    def apply_shadow(self, image: Floats32, shadow: Shadow, index: int) -> None:
        """Takes the light of a shadow away, in place."""
        light = shadow.light(index, *self.size)
        if light is not None:
            image *= light[..., None] if self.colour else light

    def apply_glare(self, image: Floats32, ring: Floats, softness: float, light: float = DAZZLE) -> None:
        """Adds `light` grey levels within a ring (N, 2) px, in place, and less and less around it."""
        corners = (ring.min(axis=0) - 4.0 * softness, ring.max(axis=0) + 4.0 * softness)
        x0, y0 = np.clip(np.floor(corners[0]), 0, self.size).astype(int).tolist()
        x1, y1 = np.clip(np.ceil(corners[1]), 0, self.size).astype(int).tolist()
        if x1 <= x0 or y1 <= y0:
            return
        field = pixel_coverage([ring - np.array([x0, y0])], x1 - x0, y1 - y0, max(0.4, softness)) * np.float32(light)
        image[y0:y1, x0:x1] += field[..., None] if self.colour else field

    def expose_image(
        self, image: Floats32, rng: np.random.Generator, conditions: Conditions, *, gain: float = 1.0
    ) -> NDArray[np.uint8]:
        """8 bit from grey levels: uneven light, gain, noise, compression."""
        uneven = conditions.vignette > 0.0 or conditions.gradient != (0.0, 0.0)
        if uneven:
            if self._fall is None or self._fall[0] != conditions:
                self._fall = (conditions, conditions.fall(*self.size))
            fall = np.float32(gain) * self._fall[1]
            image *= fall[..., None] if self.colour else fall
        elif gain != 1.0:
            image *= np.float32(gain)
        if conditions.noise > 0.0 and conditions.pooled:
            height, width = image.shape[:2]
            drawn = [pooled_noise(rng, height, width) for _ in range(3 if self.colour else 1)]
            grain = drawn[0] if len(drawn) == 1 else np.asarray(cv2.merge(drawn), dtype=np.float32)
            cv2.scaleAdd(grain, conditions.noise, image, image)
        elif conditions.noise > 0.0:
            image += np.float32(conditions.noise) * rng.standard_normal(image.shape, dtype=np.float32)
        np.maximum(image, 0.0, out=image)
        taken = np.asarray(cv2.convertScaleAbs(image), dtype=np.uint8)
        return compress_jpeg(taken, conditions.jpeg) if conditions.jpeg > 0 else taken

    def warp_texture(self, texture: TextureMap, H: Projection, box: Box | None = None) -> Floats32:
        """(h, w) or (h, w, c) the texture's picture under H, in the whole image or in a box of it."""
        x0, y0, x1, y1 = box if box is not None else (0, 0, *self.size)
        to_box = np.array([[1.0, 0.0, -x0], [0.0, 1.0, -y0], [0.0, 0.0, 1.0]])
        to_image = H @ texture.to_table
        if isinstance(to_image, RollingShutter):
            rays = None if self._rays is None else self._rays[y0:y1, x0:x1]
            x, y = to_image.back_map(x0, y0, x1, y1, rays)
            warped = cv2.remap(texture.image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        elif self._rays is None:
            warped = cv2.warpPerspective(
                texture.image,
                to_box @ to_image,
                (x1 - x0, y1 - y0),
                flags=cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REFLECT_101,
            )
        else:
            at = cv2.perspectiveTransform(self._rays[y0:y1, x0:x1], np.linalg.inv(to_image))
            x_y = cv2.split(at)
            warped = cv2.remap(texture.image, x_y[0], x_y[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        if self.blur > SHARP:
            warped = cv2.GaussianBlur(warped, (0, 0), math.sqrt(self.blur**2 - 0.5), borderType=cv2.BORDER_REFLECT_101)
        return np.asarray(warped, dtype=np.float32)

    def bounding_box(self, polygons: Sequence[Floats], blur: float | None = None) -> Box | None:
        """Columns and rows that polygons reach, blur in px (the lens's where None) included; None where that is nothing."""
        corners = np.concatenate(polygons)
        margin = 5.0 * (self.blur if blur is None else blur) + 2.0
        x0, y0 = np.clip(np.floor(corners.min(axis=0) - margin), 0, self.size).astype(int).tolist()
        x1, y1 = np.clip(np.ceil(corners.max(axis=0) + margin), 0, self.size).astype(int).tolist()
        return (x0, y0, x1, y1) if x1 > x0 and y1 > y0 else None

    def coverage_in_box(self, polygons: Sequence[Floats], box: Box, blur: float | None = None) -> Floats32:
        """Share of each pixel of a box that polygons in px cover, behind a blur in px: the lens's where None."""
        x0, y0, x1, y1 = box
        return pixel_coverage(
            [p - np.array([x0, y0]) for p in polygons], x1 - x0, y1 - y0, self.blur if blur is None else blur
        )

    def _blend_box(self, image: Floats32, box: Box, share: Floats32, above: Floats32) -> None:
        x0, y0, x1, y1 = box
        part = image[y0:y1, x0:x1]
        part += (share[..., None] if self.colour else share) * (above - part)


def compress_jpeg(image: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """What is left of an image after JPEG compression."""
    done, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_UNCHANGED), dtype=np.uint8)


def _coarse_blur(share: Floats32, sigma: float) -> Floats32:
    """A field blurred by `sigma` px, on a grid a quarter as fine."""
    height, width = share.shape
    small = cv2.resize(share, (max(1, width // 4), max(1, height // 4)), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma / 4.0, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
