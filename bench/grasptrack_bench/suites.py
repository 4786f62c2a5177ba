# SPDX-License-Identifier: Apache-2.0
"""From what a user asks for to the jobs of a run, and back to one of its frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from grasptrack.errors import InputError
from grasptrack.io.sources import open_source
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.typing import Floats
from grasptrack_bench.baselines import available_baselines
from grasptrack_bench.methods import OURS, method_makers
from grasptrack_bench.metrics.score import FrameScore, Truth
from grasptrack_bench.real import RealCase, first_frame, run_video
from grasptrack_bench.records import read_records
from grasptrack_bench.report.run import Shown
from grasptrack_bench.run_folder import Job, case_file
from grasptrack_bench.scenes import (
    SceneCase,
    built_in,
    make_scene_cases,
    parts_from_photos,
    parts_from_silhouettes,
    run_case,
)
from grasptrack_bench.simulation.disturbances import DISTURBANCES

Seen = tuple[NDArray[Any], tuple[Floats, ...], Truth | None]
"""An image, the object's true polygons in px where they are known, and what else is true of it."""


@dataclass(frozen=True)
class Work:
    """What is to be scored, and how one of its frames looks.

    Attributes:
        kind: "scenes" or "real".
        jobs: one for each sequence.
        function: of a job's task.
        look: at a frame of a case, by its name and number.
    """

    kind: str
    jobs: list[Job]
    function: Callable[[Any], dict[str, list[FrameScore]]]
    look: Callable[[str, int], Seen]

    def picture(self, folder: Path) -> Callable[[str, str, int], Shown | None]:
        """What a report shows of a frame: of a case, a method and a frame's number in the run of a folder."""
        scores = lru_cache(maxsize=4)(lambda case: read_records(case_file(folder, case)))

        def show_frame(case: str, method: str, frame: int) -> Shown | None:
            image, outline, truth = self.look(case, frame)
            first = next((f for f in scores(case).get(method, ()) if f.defining), None)
            if truth is None or first is None or first.contacts is None:
                return image, None, outline
            start = self.look(case, first.frame)[2]
            return image, None if start is None else truth.carry_points(start.back(first.contacts)), outline

        return show_frame


def method_names(names: Sequence[str] = (), *, peers: bool = False) -> tuple[str, ...]:
    """Names of methods to measure: those given, or the tracker's strategies, and with `peers` all peers that are here."""
    wanted = list(names or OURS)
    if peers:
        wanted += [name for name in available_baselines() if name not in wanted]
    method_makers(wanted)
    return tuple(wanted)


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """What is asked of a suite of scenes.

    Attributes:
        shapes: names of built-in outlines; all of them where no part of any kind is named.
        silhouettes: folder or pattern of silhouettes.
        photos, masks: folders or patterns of photos and their masks.
        disturbances: names; all of them where none is given.
        methods: names.
        frames, repeats, seed, fingers, friction, risk: as in `scenes:SceneCase`.
    """

    shapes: Sequence[str] = ()
    silhouettes: str | None = None
    photos: str | None = None
    masks: str | None = None
    disturbances: Sequence[str] = ()
    methods: Sequence[str] = OURS
    frames: int = 100
    repeats: int = 1
    seed: int = 0
    fingers: int = 2
    friction: float = 0.5
    risk: float = DEFAULT_RISK


def scene_suite(asked: SceneOptions) -> Work:
    """Every part under every disturbance."""
    for name in asked.disturbances:
        if name not in DISTURBANCES:
            raise InputError(f'unknown disturbance "{name}"; choose from {", ".join(DISTURBANCES)}', name=name)
    chosen = parts_from_silhouettes(asked.silhouettes) if asked.silhouettes is not None else []
    chosen += (
        parts_from_photos(asked.photos, asked.masks) if asked.photos is not None and asked.masks is not None else []
    )
    chosen = [*(built_in(asked.shapes) if asked.shapes or not chosen else []), *chosen]
    cases = make_scene_cases(
        chosen,
        asked.disturbances or list(DISTURBANCES),
        repeats=asked.repeats,
        frames=asked.frames,
        seed=asked.seed,
        fingers=asked.fingers,
        friction=asked.friction,
        risk=asked.risk,
    )
    by_name = {case.name: case for case in cases}
    if len(by_name) < len(cases):
        raise InputError("two parts have the same name; rename one")
    jobs = [Job(case.name, asked.frames, _case_details(case), (case, tuple(asked.methods))) for case in cases]

    def look_up_frame(name: str, frame: int) -> Seen:
        shown = by_name[name].scene()[frame]
        return shown.image, shown.outline, Truth.of_scene(shown)

    return Work("scenes", jobs, run_case, look_up_frame)


def video_suite(listed: Sequence[RealCase], methods: Sequence[str]) -> Work:
    """Real videos, each with what is true of it."""
    cases = {case.name: case for case in listed}
    jobs = [
        Job(name, _frame_count(case), {"video": case.video.name, "given": case.given}, (case, tuple(methods)))
        for name, case in cases.items()
    ]

    def look_up_frame(name: str, frame: int) -> Seen:
        case = cases[name]
        index = first_frame(case.homographies(), case.known) % case.every + frame * case.every
        with open_source(case.video) as source:
            image = next(islice(source, index, None)).image
        truths = case.truths((image.shape[1], image.shape[0]))
        return image, truths.outline(index), truths.of(index)

    return Work("real", jobs, run_video, look_up_frame)


def _case_details(case: SceneCase) -> dict[str, Any]:
    disturbance = DISTURBANCES[case.disturbance]
    return {
        "shape": case.part.shape.name,
        "disturbance": case.disturbance,
        "group": disturbance.group,
        "about": disturbance.about,
        "repeat": case.repeat,
    }


def _frame_count(case: RealCase) -> int:
    """Frames that are looked at; 0 where that is not known, or there is no such video."""
    if not case.table.is_file():
        return 0
    with open_source(case.video) as source:
        return len(range(first_frame(case.homographies(), case.known), source.count or 0, case.every))
