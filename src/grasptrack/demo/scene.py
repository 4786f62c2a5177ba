# SPDX-License-Identifier: Apache-2.0
"""Rendered images to try the tracker on: a flat scene is drawn once, large, and every frame is a photograph of it.

Table units: the square root of the bracket's area; x right, y down, the bracket's centroid at the origin.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from grasptrack import kernels
from grasptrack.geometry.homographies import apply_homography, normalize_homography, rotation_about_z
from grasptrack.typing import Floats, Floats32, Pixels

SIDE, EXTENT = 3072, 3.75
"""px of the square drawing, and table units from its middle to its sides; the camera never sees beyond."""
GRAIN = 1280
"""px of the same square at which materials are made: in images they are about as fine as a pixel."""
SOFT, FINER = 1.1, 2
"""px of the drawing by which it is blurred, and sub-pixels of an image along each axis: edges do not alias."""
METAL, WOOD, LAMINATE = (66, 54, 47), (152, 190, 214), (188, 190, 190)
"""BGR."""
VIGNETTE, DRIFT = 0.14, 0.06
"""Shares of the light: lost in the corners; by which it slowly rises and falls."""

Part = tuple[Floats, ...]
"""Polygons (N, 2), the outer one first, then its holes in the other direction."""


@dataclass(frozen=True)
class DemoFrame:
    """One image and what is true of it.

    Attributes:
        index: from 0.
        time: s.
        image: (height, width, 3) BGR or (height, width) grey, 8 bit.
        name: for messages.
        H_current_reference: (3, 3) px of frame 0 to px of this frame, of the table's plane; exact.
        outline: polygons (N, 2) px where the part is, the outer one first, then its holes.
    """

    index: int
    time: float
    image: Pixels
    name: str
    H_current_reference: Floats
    outline: Part

    def true_contacts(self, reference: ArrayLike) -> Floats:
        """(k, 2) px where contacts (k, 2) px of frame 0 truly are in this frame."""
        return apply_homography(self.H_current_reference, reference)

    @property
    def area(self) -> float:
        """px^2 of the part in this frame, holes subtracted."""
        return _area_and_centroid(self.outline)[0]

    @property
    def outline_visible(self) -> float:
        """Share of the outline's length that is in the image, 0 to 1."""
        lengths = [math.ceil(cv2.arcLength(ring.astype(np.float32), closed=True)) for ring in self.outline]
        points = np.concatenate([kernels.resample(ring, n, 0.0) for ring, n in zip(self.outline, lengths, strict=True)])
        height, width = self.image.shape[:2]
        return float(np.mean(np.all((points >= 0.0) & (points <= (width - 1, height - 1)), axis=1)))


class DemoScene:
    """Frames of one flat part on a table; iterate it, or take one frame by its index, with the same result.

    Args:
        part: in table units.
        drawing: (SIDE, SIDE, 3) of the table with the part on it; BGR.
        table_to_image: (F, 3, 3) table units to px, for each frame.
        width, height: px.
        colour: BGR images, else grey ones.
        seed: of light and noise.
    """

    fps = 30.0
    name = "demo scene"

    def __init__(
        self, part: Part, drawing: Pixels, table_to_image: Floats, *, width: int, height: int, colour: bool, seed: int
    ) -> None:
        self.count = len(table_to_image)
        self._part, self._table_to_image, self._size, self._seed = part, table_to_image, (width, height), seed
        self._drawing = drawing if colour else np.asarray(cv2.cvtColor(drawing, cv2.COLOR_BGR2GRAY), np.uint8)
        self._phase = float(np.random.default_rng((seed, 18)).uniform(0.0, 2.0 * math.pi))

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[DemoFrame]:
        return (self[i] for i in range(self.count))

    def homography(self, index: int) -> Floats:
        """(3, 3) H_current_reference of a frame."""
        return normalize_homography(self._table_to_image[index] @ np.linalg.inv(self._table_to_image[0]))

    def __getitem__(self, index: int) -> DemoFrame:
        if not 0 <= index < self.count:
            raise IndexError(f"frame {index} of {self.count}")
        H, rng = self._table_to_image[index], np.random.default_rng((self._seed, 17, index))
        light = 1.0 + DRIFT * math.sin(self._phase + 2.6 * math.pi * index / self.count)
        return DemoFrame(
            index=index,
            time=index / self.fps,
            image=_take_photograph(self._drawing, H, self._size, rng, light=light, noise=2.0),
            name=f"{self.name}, frame {index}",
            H_current_reference=self.homography(index),
            outline=tuple(apply_homography(H, ring) for ring in self._part),
        )


def demo_scene(
    frames: int = 120, seed: int = 3, *, width: int = 640, height: int = 480, colour: bool = True
) -> DemoScene:
    """The scene of `grasptrack demo`: a dark bracket on a light wooden table, under light that changes slowly.

    The camera comes closer, turns and shifts; a third of the way on it also tilts, up to 28 degrees; it ends frontal,
    near where it began.

    Args:
        frames: number of frames; more make the same motion slower.
        seed: of materials, light and noise.
        width, height: px.
        colour: BGR images, else grey ones.
    """
    u = np.linspace(0.0, 1.0, frames)
    wave = 2.0 * math.pi * u
    lean = np.clip((u - 0.3) / 0.6, 0.0, 1.0)
    K = _intrinsic_matrix(width, height)
    # where the optical axis meets the table
    target = np.column_stack([0.22 * np.sin(wave), -0.16 * np.sin(2.0 * wave)])
    distance = 4.4 - 0.65 * np.sin(0.5 * wave) ** 2 + 0.12 * (1.0 - np.cos(2.0 * wave))
    roll = math.radians(70.0) * np.sin(0.5 * wave) ** 2 - math.radians(14.0) * np.sin(wave)
    tilt = math.radians(28.0) * np.sin(math.pi * lean) ** 2
    azimuth = 0.7 + math.radians(240.0) * lean  # of the axis that the camera tilts about, in the table
    table_to_image = np.empty((frames, 3, 3))
    for i in range(frames):
        turn, c, s = rotation_about_z(azimuth[i]), math.cos(tilt[i]), math.sin(tilt[i])
        leaning = turn @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) @ turn.T
        across = (rotation_about_z(roll[i]) @ leaning)[:, :2]
        shift = np.array([0.0, 0.0, distance[i]]) - across @ target[i]
        table_to_image[i] = normalize_homography(K @ np.column_stack([across, shift]))
    part, rng = _make_bracket(), np.random.default_rng((seed, 11))
    drawing = _draw_parts(_wood_texture(rng), [part], rng, mark="GT-08")
    return DemoScene(part, drawing, table_to_image, width=width, height=height, colour=colour, seed=seed)


LIE = (
    ("spanner", 1.0, -1.0, -0.7, 0.5),
    ("gasket", 1.0, 0.75, 0.8, 0.35),
    ("plate", 0.75, 1.55, -0.75, -0.3),
    ("disc", 0.6, -1.2, 0.95, 0.0),
)
"""Of each part of a still life: name, square root of its area, x and y in table units, turn in rad."""
STILL_DISTANCE = 5.415
"""Table units from the camera to a still life: 130 px a unit in an image 640 px wide."""


def still_life(seed: int = 3, *, width: int = 640, height: int = 480) -> Pixels:
    """(height, width, 3) BGR: a spanner, a gasket, a plate and a disc on a laminate, seen from above.

    Args:
        seed: of materials and noise.
        width, height: px.
    """
    shapes = {"spanner": _make_spanner(), "gasket": _make_gasket(), "disc": _part(_circle(0.0, 0.0, 1.0))}
    shapes["plate"] = _part(np.array([(-0.8, -0.5), (0.8, -0.5), (0.8, 0.5), (-0.8, 0.5)]))
    parts = []
    for name, size, x, y, turn in LIE:
        placed = size * rotation_about_z(turn)[:2, :2].T
        parts.append(tuple(ring @ placed + (x, y) for ring in shapes[name]))
    rng = np.random.default_rng((seed, 12))
    mottled = 1.0 + 0.012 * _smooth_noise(rng, GRAIN, 1.2, 1.2) + 0.02 * _smooth_noise(rng, GRAIN, 80.0, 80.0)
    drawing = _draw_parts(_enlarge_relief(mottled, LAMINATE), parts, rng)
    H = _intrinsic_matrix(width, height) @ np.diag([1.0, 1.0, STILL_DISTANCE])
    return _take_photograph(drawing, H, (width, height), rng, light=1.0, noise=1.0)


# --- outlines of parts ---------------------------------------------------------------------------


def _area_and_centroid(part: Part) -> tuple[float, Floats]:
    moments = kernels.polygon_moments(np.concatenate(part), np.cumsum([0, *(len(ring) for ring in part)]))
    return moments.area, np.array([moments.x, moments.y])


def _part(outer: Floats, *holes: Floats) -> Part:
    """Brought to area 1, with its centroid at the origin."""
    rings = (outer, *(hole[::-1] for hole in holes))
    area, centre = _area_and_centroid(rings)
    return tuple((ring - centre) / math.sqrt(area) for ring in rings)


def _circle(x: float, y: float, radius: float) -> Floats:
    angles = np.arange(120) * (2.0 * math.pi / 120)
    return np.array([x, y]) + radius * np.column_stack([np.cos(angles), np.sin(angles)])


def _rounded(corners: Sequence[tuple[float, float]], cuts: Sequence[float]) -> Floats:
    """A polygon whose corners are replaced by parabolas that begin and end `cuts` before and after them."""
    vertices, s = np.array(corners), np.linspace(0.0, 1.0, 13)[:, None]
    rings = []
    for i, cut in enumerate(cuts):
        corner = vertices[i]
        before, after = (v - corner for v in (vertices[i - 1], vertices[(i + 1) % len(vertices)]))
        a, b = cut / np.hypot(*before) * before, cut / np.hypot(*after) * after
        rings.append(corner + (1.0 - s) ** 2 * a + s**2 * b)
    return np.concatenate(rings)


def _make_bracket() -> Part:
    """An L with one chamfer and one hole: distinct axes, no symmetry, corners and round parts."""
    corners = [(0.0, 0.0), (1.5, 0.0), (1.75, 0.28), (1.75, 0.62), (0.72, 0.62), (0.66, 1.25), (0.08, 1.25)]
    return _part(_rounded(corners, [0.13, 0.02, 0.02, 0.24, 0.18, 0.26, 0.11]), _circle(0.37, 0.9, 0.13))


def _make_spanner() -> Part:
    """A narrow handle, a forked jaw, a round end with a hole."""
    angles = np.linspace(-math.pi + 0.5, math.pi - 0.5, 60)
    end = 0.36 * np.column_stack([np.cos(angles), np.sin(angles)])
    jaw = [(-1.9, 0.36), (-2.45, 0.28), (-2.75, 0.42), (-2.72, 0.16), (-2.3, 0.1)]
    jaw += [(-2.2, -0.12), (-2.55, -0.2), (-2.62, -0.44), (-2.25, -0.46), (-1.86, -0.22)]
    cuts = [0.15, 0.06, 0.05, 0.05, 0.08, 0.08, 0.05, 0.05, 0.1, 0.1]
    return _part(np.concatenate([end, _rounded(jaw, cuts)]), _circle(0.0, 0.0, 0.16))


def _make_gasket() -> Part:
    """A bore off the centre, three bolt holes and a lug."""
    corners = [(-0.9, -0.6), (0.55, -0.6), (0.95, -0.95), (1.25, -0.6), (0.9, 0.6), (-0.6, 0.75), (-1.1, 0.2)]
    holes = [(0.0, 0.0, 0.34), (-0.72, -0.32, 0.09), (0.62, 0.34, 0.09), (0.9, -0.62, 0.09)]
    return _part(_rounded(corners, [0.18, 0.07, 0.1, 0.1, 0.26, 0.22, 0.18]), *(_circle(*hole) for hole in holes))


# --- materials and the drawing -------------------------------------------------------------------


def _smooth_noise(rng: np.random.Generator, size: int, sx: float, sy: float) -> Floats32:
    """(size, size) noise of variance 1 with correlation lengths sx and sy px; slow waves are made small and enlarged."""
    fx, fy = max(1, int(sx / 3.0)), max(1, int(sy / 3.0))
    white = rng.standard_normal((-(-size // fy), -(-size // fx)), dtype=np.float32)
    small = cv2.GaussianBlur(white, (0, 0), sigmaX=sx / fx, sigmaY=sy / fy, borderType=cv2.BORDER_REFLECT_101)
    field = cv2.resize(small, (size, size), interpolation=cv2.INTER_CUBIC)
    return np.asarray(field / field.std(), np.float32)


def _enlarge_relief(relief: Floats | Floats32, colour: tuple[int, int, int]) -> Pixels:
    """(SIDE, SIDE, 3) BGR: a relief around 1 times a colour."""
    large = cv2.resize(np.asarray(relief, np.float32), (SIDE, SIDE), interpolation=cv2.INTER_CUBIC)
    return np.asarray(cv2.merge([cv2.convertScaleAbs(large, alpha=channel) for channel in colour]), np.uint8)


def _wood_texture(rng: np.random.Generator) -> Pixels:
    """(SIDE, SIDE, 3) BGR: planks with year rings, fibres and faint seams."""
    planks = 5
    across = np.arange(GRAIN) * planks / GRAIN
    plank = across.astype(np.int64)
    bend = _smooth_noise(rng, GRAIN, 170.0, 22.0)
    for i, slide in enumerate(rng.integers(0, GRAIN, planks)):
        bend[plank == i] = np.roll(bend[plank == i], int(slide), axis=1)
    wave = np.sin(
        2.0 * np.pi * ((np.arange(GRAIN) / 21.0 + rng.uniform(0.0, 7.0, planks)[plank])[:, None] + 1.35 * bend)
    )
    rings = np.sign(wave) * np.abs(wave) ** 1.6 * (0.55 + 0.45 * np.tanh(_smooth_noise(rng, GRAIN, 120.0, 30.0)))
    fine = 0.017 * _smooth_noise(rng, GRAIN, 22.0, 0.9) + 0.014 * _smooth_noise(rng, GRAIN, 160.0, 60.0)
    relief = 1.0 + 0.028 * rings + fine + rng.uniform(-0.035, 0.035, planks)[plank][:, None]
    to_seam = np.abs((across + 0.5) % 1.0 - 0.5) * GRAIN / planks
    return _enlarge_relief(relief * (1.0 - 0.14 * np.exp(-0.5 * (to_seam / 1.3) ** 2))[:, None], WOOD)


def _draw_parts(table: Pixels, parts: Sequence[Part], rng: np.random.Generator, mark: str = "") -> Pixels:
    """A table with parts of brushed metal on it; `mark` is a word printed on what lies in the middle."""
    relief = 1.0 + 0.045 * _smooth_noise(rng, GRAIN, 30.0, 0.7) + 0.05 * _smooth_noise(rng, GRAIN, 64.0, 64.0)
    metal = _enlarge_relief(relief, METAL)
    if mark:
        ink, font, scale, bold = np.zeros((SIDE, SIDE), np.uint8), cv2.FONT_HERSHEY_DUPLEX, 2.0, 4
        (width, height), _ = cv2.getTextSize(mark, font, scale, bold)
        cv2.putText(
            ink, mark, ((SIDE - width) // 2 - 130, (SIDE + height) // 2 - 70), font, scale, 255, bold, cv2.LINE_AA
        )
        metal = np.asarray(cv2.convertScaleAbs(metal * (1.0 + ink[..., None] / np.float32(600.0))), np.uint8)
    for part in parts:
        rings = [(ring / EXTENT + 1.0) * (0.5 * SIDE) - 0.5 for ring in part]
        (x0, y0), (x1, y1) = (
            np.floor(rings[0].min(axis=0) - 3).astype(int),
            np.ceil(rings[0].max(axis=0) + 4).astype(int),
        )
        share = _pixel_coverage([ring - (x0, y0) for ring in rings], x1 - x0, y1 - y0)[..., None]
        box = table[y0:y1, x0:x1]
        box[:] = np.rint(box + share * (metal[y0:y1, x0:x1] - box.astype(np.float32)))
    return np.asarray(cv2.GaussianBlur(table, (0, 0), SOFT), np.uint8)


def _pixel_coverage(rings: Sequence[Floats], width: int, height: int) -> Floats32:
    """(height, width) 0 to 1, how much of each px lies within the first polygon and not within the others.

    cv2.fillPoly alone also fills what the edge touches; here the px around an edge are filled by their distance from it.
    """
    filled = np.zeros((height, width), np.uint8)
    cv2.fillPoly(filled, [np.rint(256.0 * ring).astype(np.int32) for ring in rings], (1,), cv2.LINE_8, 8)
    share, around = filled.astype(np.float32), np.ones((5, 5), np.uint8)
    outer, *holes = [ring.astype(np.float32) for ring in rings]
    for y, x in np.argwhere(cv2.dilate(filled, around) != cv2.erode(filled, around)).tolist():
        within = cv2.pointPolygonTest(outer, (x, y), measureDist=True)
        share[y, x] = 0.5 + min([within, *(-cv2.pointPolygonTest(hole, (x, y), measureDist=True) for hole in holes)])
    return np.clip(share, 0.0, 1.0)


# --- the photograph ------------------------------------------------------------------------------


def _intrinsic_matrix(width: int, height: int) -> Floats:
    """(3, 3) of a camera with a field of view of 49 degrees; pixel centres lie at integer coordinates."""
    f = 1.1 * width
    return np.array([[f, 0.0, 0.5 * (width - 1)], [0.0, f, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])


def _take_photograph(
    drawing: Pixels, H: Floats, size: tuple[int, int], rng: np.random.Generator, *, light: float, noise: float
) -> Pixels:
    """What a camera records of a drawing (SIDE, SIDE) or (SIDE, SIDE, 3), H (3, 3) taking table units to px.

    `light` is a factor of the brightness, `noise` a standard deviation in grey levels.
    """
    width, height = size
    unit, middle, half = 2.0 * EXTENT / SIDE, 0.5 * (SIDE - 1), 0.5 * (FINER - 1)
    to_table = np.array([[unit, 0.0, -unit * middle], [0.0, unit, -unit * middle], [0.0, 0.0, 1.0]])
    to_finer = np.array([[FINER, 0.0, half], [0.0, FINER, half], [0.0, 0.0, 1.0]])
    fine = cv2.warpPerspective(
        drawing,
        to_finer @ H @ to_table,
        (FINER * width, FINER * height),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REFLECT_101,
    )
    sharp = cv2.resize(fine, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    sigma = 0.55 * width / 640  # with drawing and pixels themselves some 0.75 px
    image = np.asarray(cv2.GaussianBlur(sharp, (0, 0), sigma, borderType=cv2.BORDER_REFLECT_101), np.float32)
    x, y = np.linspace(-1.0, 1.0, width), np.linspace(-1.0, 1.0, height)[:, None]
    fall = np.asarray(light * (1.0 - 0.5 * VIGNETTE * (x**2 + y**2)), np.float32)
    image *= fall[..., None] if image.ndim == 3 else fall
    image += np.float32(noise) * rng.standard_normal(image.shape, dtype=np.float32)
    return np.asarray(cv2.convertScaleAbs(np.maximum(image, 0.0)), np.uint8)
