# SPDX-License-Identifier: Apache-2.0
"""Parts that are followed together: whether each keeps its identity at rest, pushed, and on a belt.

Each case is a run of images at 640x480 of parts of one kind, each with a surface of its own or all with the same, or of
several kinds. At rest they lie before a camera that a hand holds; one of them is pushed among others at rest; a belt carries
a row that ends in view, or one that goes on beyond both borders, by the same step from the first image on, 5 to 80 % of
the pitch. Located: the worst
contact is off by less than 3 px and 4 % of sqrt(area). Switched: it lies where another instance is. Wrong: anywhere else.
With `--pictures DIR` the last image of each case is written with what is told of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path as File
from typing import Any, NamedTuple

import numpy as np

from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.scene import SceneResult, SceneTracker
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.simulation import SHAPES, Path, Pinhole, Scene
from grasptrack_bench.simulation.lookalikes import Distractor
from grasptrack_bench.simulation.textures import another_surface
from research.studies import common
from research.studies.trays import (
    KEPT_BACK,
    Kind,
    Lying,
    beside,
    contact_error,
    draw_conditions,
    draw_table,
    lies_well,
    teach,
)

DEVELOPED = "bracket,spanner,hook,key,hinge,hammer-head"
CAMERA = Pinhole(640, 480)
PX = 72.0
"""px of a table unit, the root of a part's area."""
STEPS = 0.05, 0.15, 0.3, 0.45, 0.55, 0.7, 0.8
"""Of the pitch, from one image to the next."""
MOTIONS = ("rest", "pushed", *(f"{row} {100 * s:.0f} %" for row in ("row", "belt") for s in STEPS))
SURFACES = ("equal", "own", "kinds")
IMAGES = 5
FIRST_ERROR = 4.0
"""px by which contacts of the first image are off at most, for a part to be known for the one that was found."""
BORDER = 30.0
"""px from the border, within which a part need not be located."""
PITCH = 1.05, 1.35
"""Widths of a part along the belt."""
MOST_BESIDE = 5
"""Parts before and behind the middle of a belt, most of them beyond the view."""
PUSH = 0.12
"""Table units an image."""


class Filmed(NamedTuple):
    """Images, and in each of them (N, 3, 3) from the plane of each part to the image; the parts' kinds."""

    images: list[Pixels]
    places: list[Floats]
    kinds: list[Kind]


class SceneTally(NamedTuple):
    """Of answers about parts in view: how many there were, were located, switched, wrong; and ms of each later image."""

    asked: int
    located: int
    switched: int
    wrong: int
    parts: int
    ms: list[float]


def draw_run(kinds: Sequence[Kind], level: float, motion: str, surfaces: str, seed: int) -> Filmed:
    """What a camera sees of parts that are moved so."""
    rng = np.random.default_rng((seed, 3))
    frames = np.arange(IMAGES)
    distance, tilt = float(CAMERA.matrix[0, 0] / PX), float(rng.uniform(0.0, 0.35))
    roll, azimuth = float(rng.uniform(-0.3, 0.3)), float(rng.uniform(0.0, 2.0 * math.pi))
    sway = 0.02 * np.cumsum(rng.normal(size=(IMAGES, 2)), axis=0) * (motion in ("rest", "pushed"))
    path = Path(sway, *(np.full(IMAGES, v) for v in (distance, roll, tilt, azimuth)))
    step = float(rng.choice([-1.0, 1.0])) * (float(motion.split()[1]) / 100.0 if "%" in motion else 0.0)
    if "%" in motion:
        turn = float(rng.uniform(0.0, 2.0 * math.pi))
        wide = max(float(np.ptp(kind.shape.moved(turn, (0.0, 0.0)).outer[:, 0])) for kind in kinds)
        pitch, ends = wide * float(rng.uniform(*PITCH)), motion.startswith("row")
        count = int(rng.integers(2, 4)) if ends else 2 * MOST_BESIDE + 1
        first = -pitch * (0.5 * (count - 1) + ends * 1.0 * IMAGES * 0.4 * step)
        places = [(first + pitch * k, 0.0, turn) for k in range(count)]
        slide = (step * pitch, 0.0)
    else:
        places, slide = scattered(kinds, rng), (0.0, 0.0)
    own = [kinds[k % len(kinds)] for k in range(len(places))]
    same = [another_surface(level, rng) for _ in kinds]
    worn = [another_surface(level, rng) if surfaces == "own" else same[k % len(kinds)] for k in range(len(places))]
    table, light = draw_table(beside(level, rng), rng), draw_conditions(rng)
    to_image, images, truth = path.table_to_image(CAMERA), list[Pixels](), list[Floats]()
    for k in frames.tolist():
        pushed = [PUSH * k * (motion == "pushed" and i == 0) for i in range(len(places))]
        at = [(x + slide[0] * k + p, y + 0.5 * p) for (x, y, _), p in zip(places, pushed, strict=True)]
        lying = [
            Distractor(kind.shape, surface, turn=turn, shift=shift)
            for kind, surface, (_, _, turn), shift in zip(own, worn, places, at, strict=True)
        ]
        scene = Scene(
            SHAPES["square"](), path, camera=CAMERA, table=table, distractors=lying, conditions=light, seed=seed,
            slide=slide, moves=np.tile([60.0, 60.0, 0.0], (IMAGES, 1)),
        )  # fmt: skip
        images.append(scene[k].image)
        truth.append(np.array([to_image[k] @ each.place(0.0) for each in lying]))
    return Filmed(images, truth, own)


def scattered(kinds: Sequence[Kind], rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """Places and turns of parts that lie apart in view."""
    found: list[tuple[float, float, float]] = []
    shapes: list[Any] = []
    for _ in range(60):
        (x, y), turn = rng.uniform((-3.4, -2.4), (3.4, 2.4)).tolist(), float(rng.uniform(0.0, 2.0 * math.pi))
        moved = kinds[len(found) % len(kinds)].shape.moved(turn, (x, y))
        if lies_well(moved, shapes, "apart"):
            found.append((x, y, turn))
            shapes.append(moved)
    return found[:8]


def judge(run: Filmed, told: Sequence[SceneResult]) -> SceneTally:
    """What became of the parts that were found in the first image, and of the places on them that were chosen there."""
    meant: dict[int, tuple[int, Floats]] = {}
    for number, result in told[0].results.items():
        if result.contacts is None:
            continue
        own = [k for k, kind in enumerate(run.kinds) if kind.part.name == result.part_id]
        errors = {k: contact_error(result, Lying(run.kinds[k], run.places[0][k], 0.0)) for k in own}
        part = min(errors, key=lambda each: errors[each])
        if errors[part] < FIRST_ERROR:
            meant[number] = part, apply_homography(np.linalg.inv(run.places[0][part]), result.contacts)
    asked = located = switched = wrong = 0
    for image, seen_in in enumerate(told[1:], 1):
        for number, (part, contacts) in meant.items():
            answer, seen = seen_in.results.get(number), apply_homography(run.places[image][part], contacts)
            held = bool(((seen > BORDER) & (seen < np.array([CAMERA.width, CAMERA.height]) - BORDER)).all())
            if not held and (answer is None or answer.contacts is None):
                continue
            asked += 1
            if answer is None or answer.contacts is None or answer.view is None:
                continue
            limit, found = max(3.0, 0.04 * math.sqrt(answer.view.outer.area)), answer.contacts
            off = [float(np.hypot(*(apply_homography(H, contacts) - found).T).max()) for H in run.places[image]]
            right, other = off[part] <= limit, min([*off[:part], *off[part + 1 :], math.inf]) <= limit
            located, switched = located + right, switched + (other and not right)
            wrong += not (right or other)
    return SceneTally(asked, located, switched, wrong, len(meant), [each.latency_ms for each in told[1:]])


def run_case(names: Sequence[str], motion: str, surfaces: str, seed: int, pictures: File | None) -> SceneTally | None:
    """One run, followed; None where nothing could be taught."""
    rng = np.random.default_rng(seed)
    level = float(rng.uniform(40.0, 75.0) if rng.uniform() < 0.5 else rng.uniform(165.0, 205.0))
    chosen = rng.choice(names, size=min(len(names), 3 if surfaces == "kinds" else 1), replace=False).tolist()
    kinds = [kind for name in chosen if (kind := teach(SHAPES[name](), level, seed)) is not None]
    if not kinds:
        return None
    run = draw_run(kinds, level, motion, surfaces, seed)
    tracker = SceneTracker([kind.part for kind in kinds])
    told = [tracker.update(image) for image in run.images]
    last: dict[int | None, View] = {
        number: r.view for each in told for number, r in each.results.items() if r.view is not None
    }
    if pictures is not None:
        import cv2

        from grasptrack.view.instances import draw_scene

        pictures.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(pictures / f"{motion} {surfaces} {seed}.png"), draw_scene(run.images[-1], told[-1], last))
    return judge(run, told)


def row_of(name: str, found: Sequence[SceneTally]) -> list[Any]:
    """A row of the table."""
    asked, ms = sum(each.asked for each in found), [ms for each in found for ms in each.ms]
    located, parts = sum(each.located for each in found), sum(each.parts for each in found)
    return [
        name, len(found), parts, asked, f"{100.0 * located / max(1, asked):.1f} %", sum(e.switched for e in found),
        sum(e.wrong for e in found), f"{float(np.median(ms or [math.nan])):.0f}",
    ]  # fmt: skip


def main() -> None:
    """Run the study."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--shapes", default=DEVELOPED, help="of which kinds are drawn, with commas, or kept-back")
    parser.add_argument("--motions", default=",".join(MOTIONS), help="how parts move, with commas")
    parser.add_argument("--surfaces", default=",".join(SURFACES), help="what they look like, with commas")
    parser.add_argument("--seeds", type=int, default=2, help="runs of each")
    parser.add_argument("--first", type=int, default=0, help="seed of the first run")
    parser.add_argument("--pictures", type=File, help="folder for a picture of each run")
    asked = parser.parse_args()
    names = (KEPT_BACK if asked.shapes == "kept-back" else asked.shapes).split(",")
    for given, known in ((names, SHAPES), (asked.motions.split(","), MOTIONS), (asked.surfaces.split(","), SURFACES)):
        for name in given:
            if name not in known:
                parser.error(f'unknown name "{name}"; choose from {", ".join(known)}')
    common.begin_section("Parts that are followed together")
    rows, every = [], list[SceneTally]()
    for motion in asked.motions.split(","):
        found = [
            told
            for surfaces in asked.surfaces.split(",")
            for seed in range(asked.first, asked.first + asked.seeds)
            if (told := run_case(names, motion, surfaces, seed, asked.pictures)) is not None
        ]
        every += found
        rows.append(row_of(motion, found))
    rows.append(row_of("all", every))
    common.add_table(
        ["motion", "runs", "parts", "answers asked", "located", "switched", "wrong", "median ms an image"], rows
    )
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
