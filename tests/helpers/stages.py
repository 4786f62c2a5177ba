# SPDX-License-Identifier: Apache-2.0
"""Rendered scenes in which things happen to an object: others beside it, covers over it, twins in its place."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from grasptrack import GraspTracker
from grasptrack.geometry.homographies import apply_homography, rotation_about_z
from grasptrack.tracking.result import TrackResult
from grasptrack_bench.simulation import (
    SHAPES,
    Renderer,
    Shape,
    TextureMap,
    brushed_texture,
    plain_texture,
    wood_texture,
)
from grasptrack_bench.simulation.outlines import polygon_moments

Colour = tuple[float, float, float]
WIDTH, HEIGHT = 320, 240
SCALE = 75.0
"""px per table unit, so sqrt(area) of a part seen from above."""
GROUND, METAL = wood_texture(1), brushed_texture(1, extent=4.0)
EVEN = plain_texture(2)
DARK = 55.0
"""Grey level of METAL, near enough."""


def pose(
    x: float = 160.0, y: float = 120.0, degrees: float = 0.0, scale: float = SCALE, tilt: float = 0.0
) -> np.ndarray:
    """(3, 3) from table units to px: the part's centroid at (x, y), turned, and tilted by degrees about a slanted axis."""
    c, s, f = math.cos(math.radians(tilt)), math.sin(math.radians(tilt)), 350.0
    lean = rotation_about_z(0.6) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ rotation_about_z(-0.6)
    R = lean @ rotation_about_z(math.radians(degrees))
    H = np.array([[f, 0, x], [0, f, y], [0, 0, 1.0]]) @ np.column_stack([R[:, 0], R[:, 1], [0, 0, f / scale]])
    return H / H[2, 2]


class Flat(NamedTuple):
    """The look of a bar."""

    colour: Colour
    relief: float = 0.0


def photo(
    parts: Iterable[tuple[Shape, np.ndarray]],
    bars: Sequence[tuple[np.ndarray, float | Colour]] = (),
    *,
    ground: TextureMap = GROUND,
    surface: TextureMap = METAL,
    noise: float = 2.0,
    light: float | Colour = 1.0,
    colour: bool = False,
    seed: int = 0,
    table: np.ndarray | None = None,
) -> np.ndarray:
    """(HEIGHT, WIDTH) or (HEIGHT, WIDTH, 3) image of parts on a table at a pose, with bars (polygon, level or BGR) in front."""
    view = Renderer(SHAPES["disc"](), ground, surface, width=WIDTH, height=HEIGHT, blur=0.7, colour=colour)
    image = view.render_background(pose(scale=60.0) if table is None else table)
    for shape, H in parts:
        view.draw_part(image, H, shape=shape)
    for polygon, level in bars:
        paint = level if isinstance(level, tuple) else (level, level, level)
        view.draw_occluder(image, Flat(paint), polygon)
    image *= np.float32(light)
    image += np.float32(noise) * np.random.default_rng((seed, 3)).standard_normal(image.shape, dtype=np.float32)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def bar(x: float, width: float, degrees: float = 15.0) -> np.ndarray:
    """(4, 2) px: a bar from the upper to the lower border whose middle is at x."""
    a = math.radians(degrees)
    along, across = np.array([math.cos(a), math.sin(a)]), np.array([-math.sin(a), math.cos(a)])
    middle = np.array([x, HEIGHT / 2])
    return np.array(
        [middle + u * width / 2 * along + v * 400.0 * across for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    )


def twin(shape: Shape, share: float, out: float) -> Shape:
    """The shape with a tab (out > 0) or a notch (out < 0) over a share of its outline, where this is straightest."""
    p, n = shape.outer, 800
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*(np.roll(p, -1, axis=0) - p).T))])
    q = np.column_stack([np.interp(np.arange(n) * s[-1] / n, s, np.append(p[:, k], p[0, k])) for k in (0, 1)])
    w = int(share * n)
    chord = np.hypot(*(np.roll(q, -int(1.4 * w), axis=0) - q).T)
    at = int(np.argmax(np.round(chord, 6))) + int(0.2 * w)
    a, b = q[at % n], q[(at + w) % n]
    side = (b - a) / np.hypot(*(b - a))
    normal = np.array([side[1], -side[0]]) * (abs(out) * np.hypot(*(b - a)))
    rest = q[(at + w + np.arange(n - w)) % n]

    def made(sign: float) -> np.ndarray:
        return np.vstack([rest, a, a + sign * normal, b + sign * normal])

    larger = polygon_moments(made(1.0))[0] > polygon_moments(q)[0]
    return Shape(f"{shape.name}-twin", made(1.0 if larger == (out > 0) else -1.0), shape.holes)


def mirrored(shape: Shape) -> Shape:
    return Shape.of(f"{shape.name}-mirrored", shape.outer * [-1, 1], [h * [-1, 1] for h in shape.holes])


def regular(corners: int) -> Shape:
    a = 0.2 + np.arange(corners) * 2 * math.pi / corners
    return Shape.of(f"{corners}-gon", np.column_stack([np.cos(a), np.sin(a)]))


class Run:
    """A tracker with the truth: the contacts that it chose first, carried by the true poses.

    Attributes:
        results: of every image.
        wrong: frames with contacts farther from the truth than 3 px and 4 % of sqrt(area), or without an object.
        right: frames with contacts, not wrong.
        shown: in how many images the object was.
    """

    def __init__(self, **options: object) -> None:
        self.tracker = GraspTracker(**options)  # type: ignore[arg-type]
        self.results: list[TrackResult] = []
        self.wrong: list[int] = []
        self.right: list[int] = []
        self.shown = 0
        self._chosen: dict[int | None, np.ndarray] = {}

    def see(self, image: np.ndarray, H: np.ndarray | None, **given: object) -> TrackResult:
        """The next image, with the true pose of the object; None where it is gone or another one."""
        result = self.tracker.update(image, **given)  # type: ignore[arg-type]
        self.results.append(result)
        self.shown += H is not None
        if result.contacts is not None:
            if H is not None and result.grasp_id not in self._chosen:
                self._chosen[result.grasp_id] = apply_homography(np.linalg.inv(H), result.contacts)
            good = False
            if H is not None:
                off = np.hypot(*(result.contacts - apply_homography(H, self._chosen[result.grasp_id])).T).max()
                size = math.sqrt(abs(polygon_moments(apply_homography(H, regular(4).outer))[0]))
                good = bool(off <= max(3.0, 0.04 * size))
            (self.right if good else self.wrong).append(result.frame)
        return result

    def check(self, least: int | None = None) -> None:
        """No wrong contacts were given, and right ones in so many images; None is in all in which the object was."""
        assert self.wrong == []
        assert len(self.right) >= (self.shown if least is None else least), self.right

    @property
    def statuses(self) -> list[str]:
        return [r.status for r in self.results]
