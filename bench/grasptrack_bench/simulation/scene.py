# SPDX-License-Identifier: Apache-2.0
"""A scene: a part on a table in front of a moving camera, frame by frame, each with its truth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats, Floats32, Ints, Pixels
from grasptrack_bench.simulation.camera import KNOTS, Pinhole, RollingShutter
from grasptrack_bench.simulation.codec import Codec, coded_image
from grasptrack_bench.simulation.conditions import Conditions
from grasptrack_bench.simulation.frame import Hinge, SceneFrame
from grasptrack_bench.simulation.layers import Instant, Overlay
from grasptrack_bench.simulation.lookalikes import Distractor
from grasptrack_bench.simulation.occluders import Cover
from grasptrack_bench.simulation.outlines import Shape
from grasptrack_bench.simulation.paths import Path
from grasptrack_bench.simulation.render import Box, Projection, Renderer
from grasptrack_bench.simulation.shapes import l_bracket
from grasptrack_bench.simulation.textures import TextureMap, brushed_texture, wood_texture

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
    surface: TextureMap | None = None


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
        layers: what else is drawn, each at its own stage, in their order.
        moves: (F, 3) how the part lies on the table in each frame, apart from the camera: shift (x, y) in table units,
            and turn in rad about its origin; None is at rest.
        hinge: makes two pieces of the part; None is rigid. Not with thickness or a rolling shutter.
        opacity: of the part, 0 to 1; below 1 the table shines through.
        relief: (R, C) a print on a thick part's sides, see `coverage:side_faces`.
        code: the video codec that the images come through last; None is none.
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
        camera: Pinhole | None = None,
        table: TextureMap | None = None,
        surface: TextureMap | None = None,
        conditions: Conditions | None = None,
        covers: Sequence[Cover] = (),
        guests: Sequence[Guest] = (),
        distractors: Sequence[Distractor] = (),
        slide: tuple[float, float] = (0.0, 0.0),
        layers: Sequence[Overlay] = (),
        moves: Floats | None = None,
        hinge: Hinge | None = None,
        opacity: float = 1.0,
        relief: Floats32 | None = None,
        code: Codec | None = None,
        thickness: float = 0.0,
        shade: float = 0.6,
        colour: bool = False,
        fps: float = 30.0,
        seed: int = 0,
        name: str | None = None,
    ) -> None:
        self.shape = shape
        self.path = path
        self.camera = camera if camera is not None else Pinhole()
        self.conditions = conditions if conditions is not None else Conditions()
        self.covers = tuple(covers)
        self.guests = tuple(guests)
        self.distractors = tuple(distractors)
        self.layers = tuple(layers)
        self.moves = moves
        self.hinge = hinge
        self.opacity = opacity
        self.relief = relief
        self.code = code
        self.thickness = thickness
        self.fps = fps
        self.count = len(path)
        self.name = f"scene of a {shape.name}" if name is None else name
        self.seed = seed
        self._shade = shade
        self.slide = np.array(slide, dtype=np.float64)
        self.table = table if table is not None else wood_texture(seed)
        self.surface = surface if surface is not None else brushed_texture(seed)
        self.move_camera(path)
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
        return self.count

    def __iter__(self) -> Iterator[SceneFrame]:
        return (self[i] for i in range(self.count))

    def homography(self, index: int) -> Floats:
        """(3, 3) H_current_reference of a frame: ideal px of frame 0 to its own, in the plane of the contacts."""
        H = self._plane_to_image[index] @ self._image_to_plane
        return np.asarray(H / H[2, 2], dtype=np.float64)

    def move_camera(self, path: Path) -> None:
        """Film it from another path of as many frames."""
        self.path = path
        self._plane_to_image = path.table_to_image(self.camera, self.thickness) @ self._place(np.arange(self.count))
        self._image_to_plane = np.linalg.inv(self._plane_to_image[0])

    def with_conditions(self, **changes: Any) -> Scene:
        """The same scene with other light or another sensor: fields of its conditions, all but the blur."""
        made = copy(self)
        made.conditions = replace(self.conditions, **changes)
        return made

    def _place(self, times: Floats | Ints) -> Floats:
        """(K, 3, 3) from the part's own plane to the table at times (K,) in frames."""
        made = np.tile(np.eye(3), (len(times), 1, 1))
        if self.moves is not None:
            x, y, turn = (np.interp(times, np.arange(len(self.moves)), column) for column in self.moves.T)
            made[:, 0, 0] = made[:, 1, 1] = np.cos(turn)
            made[:, 1, 0], made[:, 0, 1] = np.sin(turn), -np.sin(turn)
            made[:, 0, 2], made[:, 1, 2] = x, y
        return made

    def guest(self, index: int) -> Guest | None:
        """What lies in the object's place in a frame; None when the object does."""
        return next((g for g in self.guests if g.start <= index < g.end), None)

    def __getitem__(self, index: int) -> SceneFrame:
        if not 0 <= index < self.count:
            raise IndexError(f"frame {index} of {self.count}")
        frame = self._taken(index)
        return (
            frame if self.code is None else replace(frame, image=coded_image(self.image, self.count, self.code, index))
        )

    def _outline(self, index: int, H: Projection) -> tuple[Floats, ...]:
        """Its polygons in px of a frame, each piece where it is."""
        if self.hinge is None:
            return self._renderer.project_outline(H)
        turn, rings = self.hinge.turn(index), []
        for ring in self.shape.polygons:
            rings.append(np.where(self.hinge.holds(ring)[:, None], apply_homography(turn, ring), ring))
        return self._renderer.project_outline(H, Shape(self.shape.name, rings[0], tuple(rings[1:])))

    def _swing(self, index: int) -> tuple[Hinge, Floats, Floats] | None:
        if self.hinge is None:
            return None
        turned = self._plane_to_image[index] @ self.hinge.turn(index)
        seen = turned @ np.linalg.inv(self.hinge.turn(0)) @ self._image_to_plane
        return self.hinge, self._image_to_plane, seen / seen[2, 2]

    def image(self, index: int) -> Pixels:
        """What the camera takes in a frame, before any video codec."""
        return self._taken(index).image

    def _taken(self, index: int) -> SceneFrame:
        view, rng = self._renderer, np.random.default_rng((self.seed, 17, index))
        H, guest, glare = self._plane_to_image[index], self.guest(index), self.conditions.glare
        shutter = self._part_shutter(index)
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
        now = self._instant(index, self.path.pose(index), 0.0)
        for layer in self.layers:
            covers += layer.hides
            if layer.stage == "lens":
                layer.draw(image, view, now, None)
        phase = np.random.default_rng((self.seed, 18)).uniform(0.0, 2.0 * math.pi)
        gain = self.conditions.gain(index, self.count, phase)
        taken = view.expose_image(image, rng, self.conditions, gain=gain)
        for layer in self.layers:
            if layer.stage == "file":
                layer.draw(taken, view, now, None)
        return SceneFrame(
            index=index,
            time=index / self.fps,
            image=taken,
            name=f"{self.name}, frame {index}",
            H_current_reference=self.homography(index),
            outline=self._outline(index, H if shutter is None else shutter) if guest is None else (),
            covers=tuple(covers),
            present=guest is None,
            camera=self.camera,
            shutters=None if shutter is None else (self._part_shutter(0) or shutter, shutter),
            swing=self._swing(index),
        )

    def _late(self) -> Floats:
        """(KNOTS,) frames after the middle row at which the rows of the knots are exposed."""
        return self.conditions.readout * np.linspace(-0.5, 0.5, KNOTS)

    def _part_shutter(self, index: int) -> RollingShutter | None:
        """From the plane of the contacts to a frame; None without a readout."""
        seen = self._shutter(index, 0.0, self.thickness)
        return None if seen is None else seen @ self._place(index + self._late())

    def _shutter(self, index: int, offset: float, height: float) -> RollingShutter | None:
        """From a plane `height` above the table to a frame, `offset` frames later; None without a readout."""
        if self.conditions.readout <= 0.0:
            return None
        poses = self.path.between(index, offset + self._late())
        return RollingShutter(poses.table_to_image(self.camera, height), self.camera.height)

    def _instant(self, index: int, pose: Path, offset: float) -> Instant:
        """What layers are told of a pose, `offset` frames after the middle of frame `index`."""

        def plane(height: float) -> Projection:
            rolling = self._shutter(index, offset, height)
            return pose.table_to_image(self.camera, height)[0] if rolling is None else rolling

        rolls = self.conditions.readout > 0.0
        place = self._place(index + offset + self._late()) if rolls else self._place(np.array([index + offset]))[0]
        return Instant(index, plane, place, plane(self.thickness) @ place, pose.eye()[0])

    def exposed_light(self, index: int) -> Floats32:
        """What falls on the sensor while it is exposed: the mean of the images from its beginning to its end."""
        exposure = self.conditions.exposure
        if exposure <= 0.0:
            return self._render_instant(index, self.path.pose(index), 0.0)
        span = np.array([-0.5 * exposure, 0.5 * exposure])
        ends = self.path.between(index, span).table_to_image(self.camera) @ self._place(index + span)
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
        now = self._instant(index, pose, offset)
        table, slide = now.plane(0.0), self.slide * time
        if isinstance(table, RollingShutter):
            moved = np.tile(np.eye(3), (KNOTS, 1, 1))
            moved[:, :2, 2] = slide + self._late()[:, None] * self.slide
            image = view.render_background(table @ moved)
        else:
            image = view.render_background(table, slide)
        thick = self.thickness > 0.0
        for layer in self.layers:
            if layer.stage == "table":
                layer.draw(image, view, now, None)
        for item in self.distractors:
            place = item.place(time)
            tall = thick and not item.flat
            view.draw_part(
                image,
                (now.plane(self.thickness) if tall else table) @ place,
                shape=item.shape,
                surface=item.surface,
                foot=table @ place if tall else None,
                shade=self._shade,
            )
        if guest is not None and guest.shape is None:
            return image

        def finish(face: Floats32, box: Box) -> None:
            for layer in self.layers:
                if layer.stage == "face":
                    layer.draw(face, view, now, box)

        options: dict[str, Any] = {"opacity": self.opacity, "finish": finish}
        if self.hinge is not None:
            first, second = self.hinge.pieces(2.0 * self.shape.radius())
            view.draw_part(image, now.part @ self.hinge.turn(time), within=second, **options)
            options["within"] = first
        view.draw_part(
            image,
            now.part,
            shape=guest.shape if guest is not None else None,
            surface=guest.surface if guest is not None else None,
            foot=table @ now.place if thick else None,
            shade=self._shade,
            relief=self.relief,
            **options,
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
        width, height: px.
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
        camera=Pinhole(width, height),
        table=wood_texture(seed),
        surface=brushed_texture(seed, mark="GT-08"),
        conditions=Conditions(blur=0.75 * width / 640, noise=2.0, drift=0.06, vignette=0.14),
        colour=colour,
        seed=seed,
    )
