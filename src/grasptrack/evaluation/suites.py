# SPDX-License-Identifier: Apache-2.0
"""From what a user asks for to the jobs of a run, and back to one of its frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError
from grasptrack.evaluation import parts
from grasptrack.evaluation import peers as others
from grasptrack.evaluation.fill import Job
from grasptrack.evaluation.methods import OURS, makers
from grasptrack.evaluation.real import RealCase, run_video, videos_of
from grasptrack.evaluation.scenes import SceneCase, run_case, suite
from grasptrack.evaluation.score import FrameScore
from grasptrack.io.sources import open_source
from grasptrack.simulation.disturbances import DISTURBANCES

Floats = NDArray[np.float64]

Seen = tuple[NDArray[Any], tuple[Floats, ...] | None]
"""An image, and the object's true polygons in px where they are known."""


@dataclass(frozen=True)
class Work:
    """What is to be scored, and how one of its frames looks.

    Attributes:
        kind: "scenes" or "real".
        jobs: one for each sequence.
        function: of a job's task.
        picture: of a case's name and a frame's number.
    """

    kind: str
    jobs: list[Job]
    function: Callable[[Any], dict[str, list[FrameScore]]]
    picture: Callable[[str, int], Seen]


def methods(names: Sequence[str] = (), *, peers: bool = False) -> tuple[str, ...]:
    """Names of methods to measure: those given, or the tracker's strategies, and with `peers` all peers that are here.

    Raises:
        InputError: as `makers`.
    """
    wanted = list(names or OURS)
    if peers:
        wanted += [name for name in others.available() if name not in wanted]
    makers(wanted)
    return tuple(wanted)


def scene_suite(
    *,
    shapes: Sequence[str],
    silhouettes: str | None,
    photos: str | None,
    masks: str | None,
    disturbances: Sequence[str],
    methods: Sequence[str],
    frames: int,
    repeats: int,
    seed: int,
    fingers: int,
    friction: float,
    size: tuple[int, int] = (640, 480),
) -> Work:
    """Every part under every disturbance.

    Args:
        shapes: names of built-in outlines; all of them where no part of any kind is named.
        silhouettes: folder or pattern of silhouettes.
        photos, masks: folders or patterns of photos and their masks.
        disturbances: names; all of them where none is given.
        methods: names.
        frames, repeats, seed, fingers, friction, size: as in `scenes:suite`.

    Raises:
        InputError: unknown names, or images that are no parts.
    """
    for name in disturbances:
        if name not in DISTURBANCES:
            raise InputError(f'unknown disturbance "{name}"; choose from {", ".join(DISTURBANCES)}', name=name)
    chosen = parts.silhouettes(silhouettes) if silhouettes is not None else []
    chosen += parts.photos(photos, masks) if photos is not None and masks is not None else []
    chosen = [*(parts.built_in(shapes) if shapes or not chosen else []), *chosen]
    cases = suite(
        chosen,
        disturbances or list(DISTURBANCES),
        repeats=repeats,
        frames=frames,
        size=size,
        seed=seed,
        fingers=fingers,
        friction=friction,
    )
    by_name = {case.name: case for case in cases}
    if len(by_name) < len(cases):
        raise InputError("two parts have the same name; rename one")
    jobs = [Job(case.name, frames, _about(case), (case, tuple(methods))) for case in cases]

    def picture(name: str, frame: int) -> Seen:
        shown = by_name[name].scene()[frame]
        return shown.image, shown.outline

    return Work("scenes", jobs, run_case, picture)


def real_suite(*, folder: str, methods: Sequence[str], fingers: int, friction: float) -> Work:
    """Every video of a folder that has a table of homographies.

    Raises:
        InputError: no folder, or no such video in it.
    """
    cases = {case.name: case for case in videos_of(Path(folder), fingers, friction)}
    jobs = [
        Job(name, _length(case), {"video": case.video.name}, (case, tuple(methods))) for name, case in cases.items()
    ]

    def picture(name: str, frame: int) -> Seen:
        with open_source(cases[name].video) as source:
            return next(f.image for f in source if f.index == frame), None

    return Work("real", jobs, run_video, picture)


def _about(case: SceneCase) -> dict[str, Any]:
    disturbance = DISTURBANCES[case.disturbance]
    return {
        "shape": case.part.shape.name,
        "disturbance": case.disturbance,
        "group": disturbance.group,
        "about": disturbance.about,
        "repeat": case.repeat,
    }


def _length(case: RealCase) -> int:
    with open_source(case.video) as source:
        return source.count or 0
