# SPDX-License-Identifier: Apache-2.0
"""The scene suite: parts x disturbances, every method on the same frames."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from grasptrack.bench.method import Start
from grasptrack.bench.methods import method_makers
from grasptrack.bench.metrics.score import FrameScore
from grasptrack.bench.metrics.truth import Truth
from grasptrack.bench.sequence import Shown, chosen_grasp, score_sequence
from grasptrack.bench.simulation import Scene, Shape, Texture
from grasptrack.bench.simulation.disturbances import DISTURBANCES, is_applicable
from grasptrack.tracking.numbers import DEFAULT_RISK


@dataclass(frozen=True)
class Part:
    """A part that is put on tables.

    Attributes:
        shape: its outline.
        surface: its own texture, as of a photo; None draws one by the seed.
    """

    shape: Shape
    surface: Texture | None = None


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

    part: Part
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
    parts: Sequence[Part],
    disturbances: Sequence[str],
    *,
    repeats: int = 1,
    frames: int = 100,
    size: tuple[int, int] = (640, 480),
    seed: int = 0,
    fingers: int = 2,
    friction: float = 0.5,
    risk: float = DEFAULT_RISK,
) -> list[SceneCase]:
    """All cases that make sense, part by part."""
    return [
        SceneCase(part, disturbance, repeat, frames, size, seed, fingers, friction, risk)
        for part in parts
        for disturbance in disturbances
        if is_applicable(part.shape, disturbance)
        for repeat in range(repeats)
    ]


def run_case(task: tuple[SceneCase, tuple[str, ...]]) -> dict[str, list[FrameScore]]:
    """Scored frames by method of one case.

    Args:
        task: the case, and names of methods.

    Raises:
        GraspError: there is no grasp to follow on this part.
    """
    case, methods = task
    scene = case.scene()
    outline = scene[0].outline
    contacts = chosen_grasp(outline, case.fingers, case.friction)
    return score_sequence(
        _frames_with_truth(scene), method_makers(methods, case.risk), Start(contacts, outline, case.size)
    )


def _frames_with_truth(scene: Scene) -> Iterator[Shown]:
    for frame in scene:
        yield Shown(frame.image, frame.time, Truth.of_scene(frame))
