# SPDX-License-Identifier: Apache-2.0
"""One image of a flat part on a table, through a homography and a lens, as a camera would record it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats, Floats32
from grasptrack_bench.simulation.camera import Camera, RollingShutter
from grasptrack_bench.simulation.conditions import DAZZLE, SHARP, Conditions, Shadow, pooled_noise
from grasptrack_bench.simulation.occluders import Cover
from grasptrack_bench.simulation.outlines import Shape
from grasptrack_bench.simulation.textures import Texture

REACH = 4.0  # sigmas; beyond, coverage differs from 0 or 1 by less than 4e-5, a hundredth of a grey level
PIECE = 4.0  # px; long edges are cut so that each piece looks only at the pixels around itself

_GRID = np.linspace(-REACH, REACH, 2049)
_PHI = np.array([0.5 * (1.0 + math.erf(z / math.sqrt(2.0))) for z in _GRID])
_PHI[0], _PHI[-1] = 0.0, 1.0


def pixel_coverage(polygons: Sequence[Floats], width: int, height: int, sigma: float) -> NDArray[np.float32]:
    """(height, width) 0 to 1, how much of each pixel the polygons cover (holes by the even-odd rule).

    cv2.fillPoly also draws the pixels that the edge touches: an outline drawn with it lies half a sub-pixel too far out. Here
    the edge is where the polygon says it is: along a straight edge the coverage is Phi(d / sigma), the exact convolution of
    a half plane with the blur, and at corners its value 1/2 stays on the polygon.

    Args:
        polygons: (N, 2) px each, the outer one and its holes.
        width: px.
        height: px.
        sigma: px, of the blur of lens and pixel together; at least 0.4, below which pixels would alias.
    """
    if sigma < 0.4:
        raise ValueError(f"a blur of {sigma} px would alias; 0.4 px is the least")
    inside = inside_mask(polygons, width, height)
    field = inside.astype(np.float32)
    index, distance = edge_distance(polygons, width, height, REACH * sigma)
    signed = np.where(inside.ravel()[index], distance, -distance)
    field.ravel()[index] = np.interp(signed / sigma, _GRID, _PHI)
    return field


def inside_mask(polygons: Sequence[Floats], width: int, height: int) -> NDArray[np.bool_]:
    """(height, width) whether each pixel's centre lies inside, exactly, by the crossings of each row with the edges."""
    toggles = np.zeros((height, width + 1), dtype=np.uint8)
    for polygon in polygons:
        a, b = polygon, np.roll(polygon, -1, axis=0)
        low, high = np.minimum(a[:, 1], b[:, 1]), np.maximum(a[:, 1], b[:, 1])
        first = np.clip(np.ceil(low), 0, height).astype(np.int64)
        count = np.clip(np.ceil(high), 0, height).astype(np.int64) - first  # rows y with low <= y < high
        edge, step = _expand_counts(count)
        row = first[edge] + step
        slope = (b[edge, 0] - a[edge, 0]) / (b[edge, 1] - a[edge, 1])
        x = a[edge, 0] + (row - a[edge, 1]) * slope
        np.add.at(toggles, (row, np.clip(np.ceil(x), 0, width).astype(np.int64)), 1)
    return (np.cumsum(toggles[:, :-1], axis=1, dtype=np.uint8) & 1).astype(np.bool_)


def edge_distance(
    polygons: Sequence[Floats], width: int, height: int, reach: float
) -> tuple[NDArray[np.int64], Floats]:
    """The pixels within `reach` px of the edge: (M,) flat indices, and (M,) exact distances in px."""
    starts = np.concatenate(polygons)
    sides = np.concatenate([np.roll(p, -1, axis=0) - p for p in polygons])
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    edge, step = _expand_counts(np.maximum(1, np.ceil(lengths / PIECE)).astype(np.int64))
    share = 1.0 / np.maximum(1, np.ceil(lengths / PIECE))[edge]
    middle = starts[edge] + ((step + 0.5) * share)[:, None] * sides[edge]

    radius = math.ceil(reach + 0.5 * PIECE + 0.5)
    near = np.all((middle > -radius - 1) & (middle < np.array([width, height]) + radius), axis=1)
    edge, middle = edge[near], middle[near]
    window = np.arange(-radius, radius + 1)
    x = np.rint(middle[:, 0]).astype(np.int64)[:, None, None] + window
    y = np.rint(middle[:, 1]).astype(np.int64)[:, None, None] + window[:, None]
    dx, dy = x - starts[edge, 0, None, None], y - starts[edge, 1, None, None]
    sx, sy = sides[edge, 0, None, None], sides[edge, 1, None, None]
    along = np.clip((dx * sx + dy * sy) / np.maximum(lengths[edge] ** 2, 1e-300)[:, None, None], 0.0, 1.0)
    squared = (dx - along * sx) ** 2 + (dy - along * sy) ** 2

    use = (squared <= reach * reach) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    least = np.full(width * height, np.inf)
    np.minimum.at(least, (y * width + x)[use], squared[use])
    index = np.flatnonzero(np.isfinite(least))
    return index, np.sqrt(least[index])


def _expand_counts(count: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For counts (N,): which item each of their sum belongs to, and its number within the item."""
    item = np.repeat(np.arange(len(count)), count)
    return item, np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count)


FINER = 3
"""Sub-pixels along each axis. The sides' own outer edge carries no truth; the upper face's edge is drawn exactly."""
SUN = math.radians(-60.0)
"""Direction in the image from which the light falls that makes the sides differ."""


def side_faces(
    top: Sequence[Floats], foot: Sequence[Floats], width: int, height: int, sigma: float
) -> tuple[Floats32, Floats32] | None:
    """How much of each pixel the visible sides cover, and that share times their brightness; both (height, width).

    They are disjoint from the upper face, so that behind the same blur both shares add up to 1 where the two meet.

    Args:
        top: polygons (N, 2) px of the upper face, outer first.
        foot: those of the lower face, point by point.
        width: px.
        height: px.
        sigma: px, of the blur.

    Returns:
        None where no side is seen. The brightness is 1 on average and differs by the side's direction.
    """
    faces: list[tuple[float, float, Floats]] = []
    for upper, lower in zip(top, foot, strict=True):
        a, b = upper, np.roll(upper, -1, axis=0)
        c, d = np.roll(lower, -1, axis=0), lower
        diagonal, other = c - a, d - b
        seen = diagonal[:, 0] * other[:, 1] - diagonal[:, 1] * other[:, 0]  # twice the area; the near side is negative
        side = b - a
        lit = np.cos(np.arctan2(-side[:, 0], side[:, 1]) - SUN)
        for i in np.flatnonzero(seen < -1e-9):
            down = 0.5 * (c[i] + d[i] - a[i] - b[i])
            depth = float((a[i] + b[i]) @ down / max(1e-12, float(np.hypot(*down))))
            faces.append((depth, float(lit[i]), np.array([a[i], b[i], c[i], d[i]])))
    if not faces:
        return None
    shape = (height * FINER, width * FINER)
    bright = np.zeros(shape, np.uint8)
    for _, lit_by, face in sorted(faces, key=lambda f: f[0]):  # the nearer ones last
        corners = np.rint(((face + 0.5) * FINER - 0.5) * 16.0).astype(np.int32)
        cv2.fillPoly(bright, [corners], round(200.0 * (1.0 + 0.2 * lit_by)), shift=4)
    upper_face = inside_mask([(p + 0.5) * FINER - 0.5 for p in top], shape[1], shape[0])
    bright[upper_face] = 0
    drawn = np.where(bright > 0, np.uint8(255), np.uint8(0))  # no side is black
    return _downsample_field(drawn, width, height, sigma) / np.float32(255.0), _downsample_field(
        bright, width, height, sigma
    ) / np.float32(200.0)


def _downsample_field(field: NDArray[np.uint8], width: int, height: int, sigma: float) -> Floats32:
    small = cv2.resize(field.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)


Box = tuple[int, int, int, int]
Projection = Floats | RollingShutter
"""From a plane to ideal px: a homography (3, 3), or one for each row."""

TO_GREY = np.array([0.114, 0.587, 0.299], np.float32)
FINE = 0.02
"""Table units; through a lens straight sides bend, so they are cut into pieces no longer than this."""


class Renderer:
    """Renders a part on a table.

    Args:
        shape: its outline, in table units, lying at the origin.
        table: the texture below it.
        surface: its own texture.
        width: px.
        height: px.
        blur: px, see `Conditions`.
        colour: BGR images, else grey ones.
        camera: whose lens is used; None is a lens without distortion.
    """

    def __init__(
        self,
        shape: Shape,
        table: Texture,
        surface: Texture,
        *,
        width: int,
        height: int,
        blur: float,
        colour: bool,
        camera: Camera | None = None,
    ) -> None:
        self.shape = shape
        self.size = (width, height)
        self.blur = blur
        self.colour = colour
        self.camera = camera if camera is not None else Camera(width, height)
        self._table = self._match_channels(table)
        self._surface = self._match_channels(surface)
        self._fall: tuple[Conditions, Floats32] | None = None
        self._rays: Floats32 | None = None
        if self.camera.distorted:
            grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
            self._rays = self.camera.undistort(grid.reshape(-1, 2)).reshape(height, width, 2).astype(np.float32)

    def _match_channels(self, texture: Texture) -> Texture:
        return texture.coloured if self.colour else texture.grey

    def project_outline(self, H: Projection, shape: Shape | None = None) -> tuple[Floats, ...]:
        """The polygons in px of the part, or of another shape, under H, from its plane to ideal px."""
        polygons = (self.shape if shape is None else shape).polygons
        if self.camera.distorted or isinstance(H, RollingShutter):
            polygons = tuple(subdivide_polygon(p, FINE) for p in polygons)
        if isinstance(H, RollingShutter):
            return tuple(H.project(p, self.camera) for p in polygons)
        return tuple(self.camera.distort(apply_homography(H, p)) for p in polygons)

    def render_background(self, H: Projection, slide: Floats | None = None) -> Floats32:
        """(height, width) or (height, width, 3) grey levels of the table before light, cover and noise.

        Args:
            H: (3, 3) table to ideal px.
            slide: (2,) table units by which the table's texture has moved under the part.
        """
        moved = np.eye(3)
        if slide is not None:
            moved[:2, 2] = slide
        return self._warp_texture(self._table, H @ moved)

    def draw_part(
        self,
        image: Floats32,
        H: Projection,
        *,
        shape: Shape | None = None,
        surface: Texture | None = None,
        foot: Projection | None = None,
        shade: float = 0.6,
    ) -> None:
        """Draws the part over the image, in place.

        Args:
            image: what `render_background` gave.
            H: (3, 3) plane of the part's upper face to ideal px.
            shape: another one in its place.
            surface: its texture, else that of the part.
            foot: (3, 3) plane of its lower face to ideal px, of a thick part: its sides are drawn too.
            shade: brightness of those sides, as a share of the upper face's mean.
        """
        above = self._surface if surface is None else self._match_channels(surface)
        polygons = self.project_outline(H, shape)
        lower = self.project_outline(foot, shape) if foot is not None else ()
        box = self._bounding_box([*polygons, *lower])
        if box is None:
            return
        x0, y0, x1, y1 = box
        share = self._coverage_in_box(polygons, box)
        face = self._warp_texture(above, H, box)
        corner = np.array([x0, y0])
        sides = (
            side_faces([p - corner for p in polygons], [p - corner for p in lower], x1 - x0, y1 - y0, self.blur)
            if lower
            else None
        )
        if sides is None:
            self._blend_box(image, box, share, face)
            return
        beside, bright = (field[..., None] if self.colour else field for field in sides)
        if self.colour:
            share = share[..., None]
        part = image[y0:y1, x0:x1]
        level = np.float32(shade) * np.asarray(cv2.mean(above.image)[: 3 if self.colour else 1], np.float32)
        part *= np.maximum(1.0 - share - beside, 0.0)
        part += share * face + bright * level

    def draw_occluder(self, image: Floats32, cover: Cover, polygon: Floats) -> None:
        """Draws what lies in front over the image, in place."""
        box = self._bounding_box((polygon,))
        if box is None:
            return
        share = self._coverage_in_box((polygon,), box)
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

    def apply_glare(self, image: Floats32, ring: Floats, softness: float) -> None:
        """Adds the light of a glare, in place: as much as saturates within the ring, less and less around it."""
        corners = (ring.min(axis=0) - 4.0 * softness, ring.max(axis=0) + 4.0 * softness)
        x0, y0 = np.clip(np.floor(corners[0]), 0, self.size).astype(int).tolist()
        x1, y1 = np.clip(np.ceil(corners[1]), 0, self.size).astype(int).tolist()
        if x1 <= x0 or y1 <= y0:
            return
        field = pixel_coverage([ring - np.array([x0, y0])], x1 - x0, y1 - y0, max(0.4, softness)) * np.float32(DAZZLE)
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
        return _compress_jpeg(taken, conditions.jpeg) if conditions.jpeg > 0 else taken

    def _warp_texture(self, texture: Texture, H: Projection, box: Box | None = None) -> Floats32:
        """The texture's picture under H, in the whole image or in a box of it."""
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

    def _bounding_box(self, polygons: Sequence[Floats]) -> Box | None:
        """Columns and rows that polygons reach, blur included; None where that is nothing."""
        corners = np.concatenate(polygons)
        margin = 5.0 * self.blur + 2.0
        x0, y0 = np.clip(np.floor(corners.min(axis=0) - margin), 0, self.size).astype(int).tolist()
        x1, y1 = np.clip(np.ceil(corners.max(axis=0) + margin), 0, self.size).astype(int).tolist()
        return (x0, y0, x1, y1) if x1 > x0 and y1 > y0 else None

    def _coverage_in_box(self, polygons: Sequence[Floats], box: Box) -> Floats32:
        x0, y0, x1, y1 = box
        return pixel_coverage([p - np.array([x0, y0]) for p in polygons], x1 - x0, y1 - y0, self.blur)

    def _blend_box(self, image: Floats32, box: Box, share: Floats32, above: Floats32) -> None:
        x0, y0, x1, y1 = box
        part = image[y0:y1, x0:x1]
        part += (share[..., None] if self.colour else share) * (above - part)


def _compress_jpeg(image: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """What is left of an image after JPEG compression."""
    done, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_UNCHANGED), dtype=np.uint8)


def subdivide_polygon(polygon: Floats, step: float) -> Floats:
    """The same polygon with its sides cut into equal pieces no longer than `step`."""
    sides = np.roll(polygon, -1, axis=0) - polygon
    count = np.maximum(1, np.ceil(np.hypot(sides[:, 0], sides[:, 1]) / step)).astype(np.int64)
    side = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)) / count[side]
    return np.asarray(polygon[side] + share[:, None] * sides[side], dtype=np.float64)


def _coarse_blur(share: Floats32, sigma: float) -> Floats32:
    """A field blurred by `sigma` px, on a grid a quarter as fine."""
    height, width = share.shape
    small = cv2.resize(share, (max(1, width // 4), max(1, height // 4)), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma / 4.0, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
