# SPDX-License-Identifier: Apache-2.0
"""The scene suite: parts (built in, of silhouettes, of photos) x disturbances, every method on the same frames."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from grasptrack.errors import InputError
from grasptrack.images import to_bgr
from grasptrack.io.images import images_in, images_matching, read_image
from grasptrack.io.masks import open_masks, read_mask
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack_bench.method import MethodFrame, MethodStart, chosen_grasp, score_sequence
from grasptrack_bench.methods import method_makers
from grasptrack_bench.metrics.score import FrameScore, Truth
from grasptrack_bench.simulation import SHAPES, Scene, Shape, TextureMap, part_of_photo, shape_from_mask
from grasptrack_bench.simulation.disturbances import DISTURBANCES, is_applicable


@dataclass(frozen=True)
class ScenePart:
    """A part that is put on tables; its own texture, as of a photo, is None where the seed draws one."""

    shape: Shape
    surface: TextureMap | None = None


@dataclass(frozen=True)
class SceneCase:
    """One sequence of the suite; all of it follows from these values, anywhere.

    Attributes:
        part: what lies on the table.
        disturbance: by its name.
        repeat: number of this scene among those of this part and disturbance, from 0.
        frames: of the sequence.
        size: width and height of the images in px.
        seed: of the suite.
        fingers: of the grasp that is followed.
        friction: for choosing it.
        risk: probability below which answers of the tracker may be wrong.
    """

    part: ScenePart
    disturbance: str
    repeat: int = 0
    frames: int = 100
    size: tuple[int, int] = (640, 480)
    seed: int = 0
    fingers: int = 2
    friction: float = 0.5
    risk: float = DEFAULT_RISK

    @property
    def name(self) -> str:
        """As in tables and names of files."""
        again = f".{self.repeat}" if self.repeat else ""
        return f"{self.part.shape.name}.{self.disturbance}{again}"

    def scene(self) -> Scene:
        """The scene, with a seed of its own."""
        seed = zlib.crc32(f"{self.seed} {self.name} {self.repeat}".encode())
        return DISTURBANCES[self.disturbance].scene(
            self.part.shape, self.frames, seed, size=self.size, surface=self.part.surface
        )


def make_scene_cases(
    parts: Sequence[ScenePart],
    disturbances: Sequence[str],
    *,
    repeats: int = 1,
    frames: int = 100,
    seed: int = 0,
    fingers: int = 2,
    friction: float = 0.5,
    risk: float = DEFAULT_RISK,
) -> list[SceneCase]:
    """All cases that make sense, part by part."""
    return [
        SceneCase(part, disturbance, repeat, frames, seed=seed, fingers=fingers, friction=friction, risk=risk)
        for part in parts
        for disturbance in disturbances
        if is_applicable(part.shape, disturbance)
        for repeat in range(repeats)
    ]


def run_case(task: tuple[SceneCase, tuple[str, ...]]) -> dict[str, list[FrameScore]]:
    """Scored frames by method of one case."""
    case, methods = task
    start, shown = show_scene(case.scene(), case.fingers, case.friction)
    return score_sequence(shown, method_makers(methods, case.risk), start)


def show_scene(scene: Scene, fingers: int = 2, friction: float = 0.5) -> tuple[MethodStart, Iterator[MethodFrame]]:
    """What all methods are told of a scene, and its frames with their truth."""
    outline = scene[0].outline
    start = MethodStart(chosen_grasp(outline, fingers, friction), outline, (scene.camera.width, scene.camera.height))
    return start, (MethodFrame(frame.image, frame.time, Truth.of_scene(frame)) for frame in scene)


def built_in(names: Sequence[str] = ()) -> list[ScenePart]:
    """Parts by the names of their outlines; all of them where none is named."""
    for name in names:
        if name not in SHAPES:
            raise InputError(f'unknown shape "{name}"; choose from {", ".join(SHAPES)}', name=name)
    return [ScenePart(SHAPES[name]()) for name in names or SHAPES]


def parts_from_silhouettes(spec: str | os.PathLike[str]) -> list[ScenePart]:
    """A part for each image of a folder or pattern: what is not black is material."""
    parts = []
    for path in open_masks(spec):
        try:
            parts.append(ScenePart(shape_from_mask(read_mask(path) > 0, path.stem)))
        except ValueError as error:
            raise InputError(f'"{path}" is no silhouette: {error}', path=str(path)) from error
    return _check_distinct_names(parts, spec)


def parts_from_photos(spec: str | os.PathLike[str], masks: str | os.PathLike[str]) -> list[ScenePart]:
    """A part for each photo of a folder or pattern, with the texture that it has there.

    Masks have the photos' names, whatever their suffix.
    """
    of = {path.stem: path for path in open_masks(masks)}
    parts = []
    for path in images_in(Path(spec)) if Path(spec).is_dir() else images_matching(os.fspath(spec)):
        if path.stem not in of:
            raise InputError(
                f'masks "{masks}": none for photo "{path.name}"; give one of the same name', path=str(path)
            )
        image, mask = to_bgr(read_image(path)), read_mask(of[path.stem]) > 0
        if mask.shape != image.shape[:2]:
            raise InputError(f'mask "{of[path.stem].name}" has another size than its photo', path=str(path))
        try:
            parts.append(ScenePart(*part_of_photo(image, mask, path.stem)))
        except ValueError as error:
            raise InputError(f'the mask of "{path.name}" shows no object: {error}', path=str(path)) from error
    return _check_distinct_names(parts, spec)


def _check_distinct_names(parts: list[ScenePart], spec: object) -> list[ScenePart]:
    names = [part.shape.name for part in parts]
    again = next((name for name in names if names.count(name) > 1), None)
    if again is not None:
        raise InputError(f'"{spec}" has more than one part named "{again}"; parts need names of their own', name=again)
    return parts
