# SPDX-License-Identifier: Apache-2.0
"""A scene: a part on a table in front of a moving camera, frame by frame, each with its truth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats, Floats32
from grasptrack_bench.simulation.camera import KNOTS, Camera, RollingShutter
from grasptrack_bench.simulation.conditions import Conditions
from grasptrack_bench.simulation.lookalikes import Distractor
from grasptrack_bench.simulation.occluders import Cover
from grasptrack_bench.simulation.outlines import Shape, inside_polygons, polygon_moments
from grasptrack_bench.simulation.paths import Path
from grasptrack_bench.simulation.render import Projection, Renderer
from grasptrack_bench.simulation.shapes import l_bracket
from grasptrack_bench.simulation.textures import Texture, brushed_texture, wood_texture

PINHOLE = Camera()
STEP = 1.0
"""px between the points at which an outline is asked whether it is seen."""


@dataclass(frozen=True)
class SceneFrame:
    """One image and what is true of it.

    Attributes:
        index: from 0.
        time: s.
        image: (height, width) or (height, width, 3) 8 bit.
        name: for messages.
        H_current_reference: (3, 3) pixels of frame 0 to pixels of this frame, of the plane in which the contacts lie;
            exact. Where the lens distorts, pixels of the ideal image; where rows are exposed one after another, at the
            time of the middle row: see `carry`.
        outline: polygons in px of the image, outer first, where the tracked object is, seen or not. Empty when it is
            not on the table.
        covers: polygons in px of the image of what hides the part: what lies in front, and saturated glare.
        present: the tracked object itself is on the table; not while it is exchanged for another or taken away.
        camera: its intrinsics, with the lens.
        shutters: of a rolling shutter, from the plane of the contacts to frame 0 and to this frame; None where all rows
            are exposed at once.
    """

    index: int
    time: float | None
    image: NDArray[np.uint8]
    name: str
    H_current_reference: Floats
    outline: tuple[Floats, ...]
    covers: tuple[Floats, ...] = ()
    present: bool = True
    camera: Camera = PINHOLE
    shutters: tuple[RollingShutter, RollingShutter] | None = None

    def carry(self, points: ArrayLike) -> Floats:
        """(k, 2) px of this frame, of points (k, 2) px of frame 0 in the plane of the contacts; exact.

        Under a rolling shutter both are where the image shows the point: at the time of its own row.
        """
        if self.shutters is not None:
            return self._map_rolling_points(*self.shutters, points)
        return self._map_points(self.H_current_reference, points)

    def back(self, points: ArrayLike) -> Floats:
        """(k, 2) px of frame 0, of points (k, 2) px of this frame: the inverse of `carry`."""
        if self.shutters is not None:
            return self._map_rolling_points(*self.shutters[::-1], points)
        return self._map_points(np.asarray(np.linalg.inv(self.H_current_reference), dtype=np.float64), points)

    def contacts(self, reference: ArrayLike) -> Floats:
        """(k, 2) where contacts (k, 2) of frame 0 truly are in this frame."""
        return self.carry(reference)

    def _map_points(self, H: Floats, points: ArrayLike) -> Floats:
        if not self.camera.distorted:
            return apply_homography(H, points)
        return self.camera.distort(apply_homography(H, self.camera.undistort(points)))

    def _map_rolling_points(self, seen: RollingShutter, shown: RollingShutter, points: ArrayLike) -> Floats:
        px = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        return shown.project(seen.back(px, self.camera), self.camera)

    def visible(self, points: ArrayLike) -> NDArray[np.bool_]:
        """(k,) which points (k, 2) px of this frame can be seen: in the image, not covered, and the object present."""
        pts = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        height, width = self.image.shape[:2]
        seen = np.all((pts >= 0.0) & (pts <= np.array([width - 1, height - 1])), axis=1)
        for cover in self.covers:
            seen &= ~inside_polygons([cover], pts)
        return np.asarray(seen & self.present, dtype=np.bool_)

    @property
    def outline_visible(self) -> float:
        """Share of the outline's length that is in view and uncovered, 0 to 1; 0 when the object is not present."""
        if not self.present or not self.outline:
            return 0.0
        points, weights = sample_outline(self.outline, STEP)
        return float(weights[self.visible(points)].sum() / weights.sum())

    @property
    def area(self) -> float:
        """Area of the object's image in px^2, holes subtracted; 0 when it is not present."""
        return float(sum(polygon_moments(polygon)[0] for polygon in self.outline))


def sample_outline(polygons: Sequence[Floats], step: float) -> tuple[Floats, Floats]:
    """Points (N, 2) along all sides of polygons, at most `step` apart, and the length (N,) that each stands for."""
    starts = np.concatenate(polygons)
    sides = np.concatenate([np.roll(p, -1, axis=0) - p for p in polygons])
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    count = np.maximum(1, np.ceil(lengths / step)).astype(np.int64)
    side = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[side]
    return starts[side] + share[:, None] * sides[side], lengths[side] / count[side]


RIPPLE = 1.4
"""Blurs between two sub-exposures at most: farther apart they would be seen one by one."""
MAX_EXPOSURES = 24


@dataclass(frozen=True)
class Guest:
    """What lies in the object's place for some frames.

    Attributes:
        start, end: the first frame in which it does, and the first in which it does not any more.
        shape: its outline, in table units, in the place of the object's; None when the object is only taken away.
        surface: its texture; None is that of the object.
    """

    start: int
    end: int
    shape: Shape | None
    surface: Texture | None = None


class Scene:
    """Frames of one part on one table; iterate it, or take one frame by its index, with the same result.

    Args:
        shape: the part.
        path: the camera's, with one entry for each frame.
        camera: its intrinsics and lens.
        table: texture of the table; wood where None.
        surface: the part's own texture; brushed dark metal where None.
        conditions: lens, light and sensor.
        covers: what comes in front of the part.
        guests: what takes the object's place, and when.
        distractors: what else lies on the table, in the order in which it is drawn, all before the part.
        slide: (2,) table units a frame by which the table moves under the part, as a belt does.
        thickness: table units, of the part; the contacts and the outline are those of its upper face.
        shade: brightness of a thick part's sides, as a share of the mean of its upper face.
        colour: BGR images, else grey ones.
        fps: frames a second.
        seed: of textures, light and noise.
        name: for messages; that of the shape where None.
    """

    def __init__(
        self,
        shape: Shape,
        path: Path,
        *,
        camera: Camera | None = None,
        table: Texture | None = None,
        surface: Texture | None = None,
        conditions: Conditions | None = None,
        covers: Sequence[Cover] = (),
        guests: Sequence[Guest] = (),
        distractors: Sequence[Distractor] = (),
        slide: tuple[float, float] = (0.0, 0.0),
        thickness: float = 0.0,
        shade: float = 0.6,
        colour: bool = False,
        fps: float = 30.0,
        seed: int = 0,
        name: str | None = None,
    ) -> None:
        self.shape = shape
        self.path = path
        self.camera = camera if camera is not None else Camera()
        self.conditions = conditions if conditions is not None else Conditions()
        self.covers = tuple(covers)
        self.guests = tuple(guests)
        self.distractors = tuple(distractors)
        self.thickness = thickness
        self.fps = fps
        self.count = len(path)
        self.name = f"scene of a {shape.name}" if name is None else name
        self.seed = seed
        self._shade = shade
        self.slide = np.array(slide, dtype=np.float64)
        self.table = table if table is not None else wood_texture(seed)
        self.surface = surface if surface is not None else brushed_texture(seed)
        self._plane_to_image = path.table_to_image(self.camera, thickness)
        self._image_to_plane = np.linalg.inv(self._plane_to_image[0])
        self._renderer = Renderer(
            shape,
            self.table,
            self.surface,
            width=self.camera.width,
            height=self.camera.height,
            blur=self.conditions.blur,
            colour=colour,
            camera=self.camera,
        )

    def __len__(self) -> int:
        """Frames."""
        return self.count

    def __iter__(self) -> Iterator[SceneFrame]:
        """All frames in order."""
        return (self[i] for i in range(self.count))

    def homography(self, index: int) -> Floats:
        """(3, 3) H_current_reference of a frame: ideal px of frame 0 to its own, in the plane of the contacts."""
        H = self._plane_to_image[index] @ self._image_to_plane
        return np.asarray(H / H[2, 2], dtype=np.float64)

    def with_conditions(self, **changes: Any) -> Scene:
        """The same scene with other light or another sensor: fields of its conditions, all but the blur."""
        made = copy(self)
        made.conditions = replace(self.conditions, **changes)
        return made

    def guest(self, index: int) -> Guest | None:
        """What lies in the object's place in a frame; None when the object does."""
        return next((g for g in self.guests if g.start <= index < g.end), None)

    def __getitem__(self, index: int) -> SceneFrame:
        """One frame, the same whenever it is asked for."""
        if not 0 <= index < self.count:
            raise IndexError(f"frame {index} of {self.count}")
        view, rng = self._renderer, np.random.default_rng((self.seed, 17, index))
        H, guest, glare = self._plane_to_image[index], self.guest(index), self.conditions.glare
        shutter = self._shutter(index)
        image = self.exposed_light(index)
        if self.conditions.shadow is not None:
            view.apply_shadow(image, self.conditions.shadow, index)
        covers = []
        spot = glare.ring(index) if glare is not None else None
        if glare is not None and spot is not None:
            view.apply_glare(image, spot, glare.softness)
            covers.append(spot)
        for cover in self.covers:
            polygon = cover.polygon(index, H, self.camera)
            if polygon is not None:
                view.draw_occluder(image, cover, polygon)
                covers.append(polygon)
        phase = np.random.default_rng((self.seed, 18)).uniform(0.0, 2.0 * math.pi)
        gain = self.conditions.gain(index, self.count, phase)
        return SceneFrame(
            index=index,
            time=index / self.fps,
            image=view.expose_image(image, rng, self.conditions, gain=gain),
            name=f"{self.name}, frame {index}",
            H_current_reference=self.homography(index),
            outline=view.project_outline(H if shutter is None else shutter) if guest is None else (),
            covers=tuple(covers),
            present=guest is None,
            camera=self.camera,
            shutters=None if shutter is None else (self._shutter(0) or shutter, shutter),
        )

    def _shutter(self, index: int, offset: float = 0.0, *, table: bool = False) -> RollingShutter | None:
        """From the plane of the contacts, or the table, to a frame, `offset` frames later; None without a readout."""
        readout = self.conditions.readout
        if readout <= 0.0:
            return None
        poses = self.path.between(index, offset + readout * np.linspace(-0.5, 0.5, KNOTS))
        return RollingShutter(poses.table_to_image(self.camera, 0.0 if table else self.thickness), self.camera.height)

    def exposed_light(self, index: int) -> Floats32:
        """What falls on the sensor while it is exposed: the mean of the images from its beginning to its end."""
        exposure = self.conditions.exposure
        if exposure <= 0.0:
            return self._render_instant(index, self.path.pose(index), 0.0)
        ends = self.path.between(index, [-0.5 * exposure, 0.5 * exposure]).table_to_image(self.camera)
        start, end = (apply_homography(H, self.shape.outer) for H in ends)
        way = float(np.hypot(*(end - start).T).max())
        count = int(np.clip(math.ceil(way / (RIPPLE * self.conditions.blur)), 1, MAX_EXPOSURES))
        offsets = ((np.arange(count) + 0.5) / count - 0.5) * exposure
        poses = self.path.between(index, offsets)
        total = self._render_instant(index, poses.pose(0), offsets[0])
        for k in range(1, count):
            total += self._render_instant(index, poses.pose(k), offsets[k])
        total *= np.float32(1.0 / count)
        return total

    def _render_instant(self, index: int, pose: Path, offset: float) -> Floats32:
        """Table and part as the camera sees them from a pose, `offset` frames after the middle of frame `index`."""
        view, guest, time = self._renderer, self.guest(index), index + offset
        table: Projection = pose.table_to_image(self.camera)[0]
        rolling, slide = self._shutter(index, offset, table=True), self.slide * time
        if rolling is None:
            image = view.render_background(table, slide)
        else:
            table = rolling
            late = np.linspace(-0.5, 0.5, KNOTS) * self.conditions.readout
            moved = np.tile(np.eye(3), (KNOTS, 1, 1))
            moved[:, :2, 2] = slide + late[:, None] * self.slide
            image = view.render_background(rolling @ moved)
        thick = self.thickness > 0.0
        plane: Projection = table
        if thick:
            raised = self._shutter(index, offset)
            plane = pose.table_to_image(self.camera, self.thickness)[0] if raised is None else raised
        for item in self.distractors:
            place = item.place(time)
            tall = thick and not item.flat
            view.draw_part(
                image,
                (plane if tall else table) @ place,
                shape=item.shape,
                surface=item.surface,
                foot=table @ place if tall else None,
                shade=self._shade,
            )
        if guest is not None and guest.shape is None:
            return image
        view.draw_part(
            image,
            plane,
            shape=guest.shape if guest is not None else None,
            surface=guest.surface if guest is not None else None,
            foot=table if thick else None,
            shade=self._shade,
        )
        return image


def bracket_scene(
    frames: int = 120, seed: int = 3, *, width: int = 640, height: int = 480, colour: bool = True
) -> Scene:
    """A dark bracket on a light wooden table, under light that changes slowly: what the studies of time are shown.

    The camera comes closer, turns and shifts; a third of the way on it also tilts, up to 28 degrees; it ends frontal,
    near where it began.

    Args:
        frames: number of frames.
        seed: of path, textures and noise.
        width: px.
        height: px.
        colour: BGR images, else grey ones.
    """
    u = np.linspace(0.0, 1.0, frames)
    wave = 2.0 * math.pi * u
    lean = np.clip((u - 0.3) / 0.6, 0.0, 1.0)  # 4 DoF for a third of the way, then 6, and back
    path = Path(
        target=np.column_stack([0.22 * np.sin(wave), -0.16 * np.sin(2.0 * wave)]),
        distance=4.4 - 0.65 * np.sin(0.5 * wave) ** 2 + 0.12 * (1.0 - np.cos(2.0 * wave)),
        roll=math.radians(70.0) * np.sin(0.5 * wave) ** 2 - math.radians(14.0) * np.sin(wave),
        tilt=math.radians(28.0) * np.sin(math.pi * lean) ** 2,
        azimuth=0.7 + math.radians(240.0) * lean,
    )
    return Scene(
        l_bracket(),
        path,
        camera=Camera(width, height),
        table=wood_texture(seed),
        surface=brushed_texture(seed, mark="GT-08"),
        conditions=Conditions(blur=0.75 * width / 640, noise=2.0, drift=0.06, vignette=0.14),
        colour=colour,
        seed=seed,
    )
