# SPDX-License-Identifier: Apache-2.0
"""A scene: a part on a table in front of a moving camera, frame by frame, each with its truth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.projective import apply_homography
from grasptrack.simulation.camera import Camera, Path
from grasptrack.simulation.coverage import inside_polygons
from grasptrack.simulation.render import Bar, Conditions, Renderer
from grasptrack.simulation.shapes import Shape, bracket, polygon_moments
from grasptrack.simulation.texture import Texture, brushed, wood

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SceneFrame:
    """One image and what is true of it.

    Attributes:
        index: from 0.
        time: s.
        image: (height, width) or (height, width, 3) 8 bit.
        name: for messages.
        H_current_reference: (3, 3) pixels of frame 0 to pixels of this frame, exact.
        outline: the part's polygons in px, outer first, wherever they fall.
        occluder: (4, 2) px of the bar in front of the part, or None.
    """

    index: int
    time: float | None
    image: NDArray[np.uint8]
    name: str
    H_current_reference: Floats
    outline: tuple[Floats, ...]
    occluder: Floats | None = None
    present: bool = True

    def carry(self, points: ArrayLike) -> Floats:
        """(k, 2) px of frame 0 to px of this frame."""
        return apply_homography(self.H_current_reference, points)

    def back(self, points: ArrayLike) -> Floats:
        """(k, 2) px of this frame to px of frame 0."""
        return apply_homography(np.linalg.inv(self.H_current_reference), points)

    def contacts(self, reference: ArrayLike) -> Floats:
        """(k, 2) where contacts (k, 2) of frame 0 truly are in this frame."""
        return apply_homography(self.H_current_reference, reference)

    def visible(self, points: ArrayLike) -> NDArray[np.bool_]:
        """(k,) which points (k, 2) px of this frame lie in the image and not behind the occluder."""
        pts = np.asarray(points, dtype=np.float64)
        height, width = self.image.shape[:2]
        seen = np.all((pts >= 0.0) & (pts <= np.array([width - 1, height - 1])), axis=1)
        if self.occluder is not None:
            seen &= ~inside_polygons([self.occluder], pts)
        return np.asarray(seen, dtype=np.bool_)

    @property
    def outline_visible(self) -> float:
        """Share of the outline's length that can be seen, 0 to 1."""
        shown = total = 0.0
        for polygon in self.outline:
            sides = np.roll(polygon, -1, axis=0) - polygon
            for part in (np.arange(8) + 0.5) / 8.0:
                lengths = np.hypot(sides[:, 0], sides[:, 1]) / 8.0
                shown += float(lengths[self.visible(polygon + part * sides)].sum())
                total += float(lengths.sum())
        return shown / total

    @property
    def area(self) -> float:
        """Area of the part's image in px^2, holes subtracted."""
        return float(sum(polygon_moments(polygon)[0] for polygon in self.outline))


class Scene:
    """Frames of one part on one table; iterate it, or take one frame by its index, with the same result.

    Args:
        shape: the part.
        path: the camera's, with one entry for each frame.
        camera: its intrinsics.
        table: texture of the table; wood where None.
        surface: the part's own texture; brushed dark metal where None.
        conditions: lens, light and sensor.
        bar: an occluder that crosses the image.
        slide: (2,) table units a frame by which the table moves under the part, as a belt does.
        colour: BGR images, else grey ones.
        fps: frames a second.
        seed: of textures, light and noise.
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
        bar: Bar | None = None,
        slide: tuple[float, float] = (0.0, 0.0),
        colour: bool = False,
        fps: float = 30.0,
        seed: int = 0,
    ) -> None:
        self.shape = shape
        self.camera = camera if camera is not None else Camera()
        self.conditions = conditions if conditions is not None else Conditions()
        self.bar = bar
        self.fps = fps
        self.count = len(path)
        self.name = f"scene of a {shape.name}"
        self.seed = seed
        self._slide = np.array(slide, dtype=np.float64)
        self._table_to_image = path.table_to_image(self.camera)
        self._image_to_table = np.linalg.inv(self._table_to_image[0])
        self._renderer = Renderer(
            shape,
            table if table is not None else wood(seed),
            surface if surface is not None else brushed(seed),
            width=self.camera.width,
            height=self.camera.height,
            blur=self.conditions.blur,
            colour=colour,
        )

    def __len__(self) -> int:
        """Frames."""
        return self.count

    def __iter__(self) -> Iterator[SceneFrame]:
        """The frames in order."""
        return (self[i] for i in range(self.count))

    def homography(self, index: int) -> Floats:
        """(3, 3) H_current_reference of a frame: pixels of frame 0 to its pixels."""
        H = self._table_to_image[index] @ self._image_to_table
        return np.asarray(H / H[2, 2], dtype=np.float64)

    def __getitem__(self, index: int) -> SceneFrame:
        """One frame, the same whenever it is asked for."""
        if not 0 <= index < self.count:
            raise IndexError(f"frame {index} of {self.count}")
        view, rng = self._renderer, np.random.default_rng((self.seed, 17, index))
        H = self._table_to_image[index]
        image = view.light(H, slide=self._slide * index)
        cover = self.bar.polygon(index, *view.size) if self.bar is not None else None
        if self.bar is not None and cover is not None:
            view.occlude(image, self.bar, cover)
        phase = np.random.default_rng((self.seed, 18)).uniform(0.0, 2.0 * math.pi)
        gain = 1.0 + self.conditions.drift * math.sin(phase + 2.0 * math.pi * 1.3 * index / max(1, self.count))
        return SceneFrame(
            index=index,
            time=index / self.fps,
            image=view.expose(image, rng, gain=gain, noise=self.conditions.noise, vignette=self.conditions.vignette),
            name=f"{self.name}, frame {index}",
            H_current_reference=self.homography(index),
            outline=view.outline(H),
            occluder=cover,
        )


def demo_scene(frames: int = 120, seed: int = 3, *, width: int = 640, height: int = 480, colour: bool = True) -> Scene:
    """The scene of `grasptrack demo`: a dark bracket on a light wooden table, under light that changes slowly.

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
        bracket(),
        path,
        camera=Camera(width, height),
        table=wood(seed),
        surface=brushed(seed, mark="GT-08"),
        conditions=Conditions(blur=0.75 * width / 640, noise=2.0, drift=0.06, vignette=0.14),
        colour=colour,
        seed=seed,
    )
