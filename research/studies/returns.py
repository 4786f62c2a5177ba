# SPDX-License-Identifier: Apache-2.0
"""Whether a part is found again: after a blur, a cover, a look away, a jump or missing images, and nothing in its place."""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

import grasptrack as gt
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.method import MethodFrame, MethodStart, chosen_grasp, score_sequence
from grasptrack_bench.methods import method_makers
from grasptrack_bench.metrics.score import Truth
from grasptrack_bench.scenes import SceneCase, built_in, make_scene_cases
from grasptrack_bench.simulation import Path, Scene, TextureMap
from grasptrack_bench.simulation.paths import in_view, kept_in_view
from grasptrack_bench.simulation.scene import Guest
from grasptrack_bench.simulation.textures import another_surface
from research.studies import common

BEFORE, AFTER = 24, 12
"""Images before it is lost, and after."""
SOON = 3
"""Images in which it ought to be found."""
EVENTS = ("blur", "cover", "away", "jump", "gap")
LONGEST = {"blur": 8, "cover": 60, "away": 60}
"""Images of an event; a gap has none, and up to so many intervals: """
LONGEST_GAP = 300
RATES = (5.0, 60.0)
"""Images a second, drawn by their logarithm between these."""
UNLIKE = 0.3
"""Correlation below which another surface looks different, but for what is wider than some px."""


class ReturnCase(NamedTuple):
    """One sequence.

    Attributes:
        case: what the scene is of.
        others: share of the sequences after whose event another surface lies in the part's place, or nothing.
    """

    case: SceneCase
    others: float


class ReturnOutcome(NamedTuple):
    """What came of it.

    Attributes:
        event: of EVENTS.
        other: what lies in its place afterwards: "", "surface" or "gone".
        followed: it was located before the event.
        after: images until it was located; -1 where it never was.
        wrong: images with a wrong answer.
        reason: why it was not located in the last of the first few images.
    """

    event: str
    other: str
    followed: bool
    after: int
    wrong: int
    reason: str


def follow_return(asked: ReturnCase) -> ReturnOutcome | None:
    """Show a sequence to the tracker; None where there is no grasp to follow."""
    case, rng = asked.case, np.random.default_rng(zlib.crc32(f"{asked.case.seed} {asked.case.name}".encode()))
    event, rate = str(rng.choice(EVENTS)), math.exp(rng.uniform(*np.log(RATES)))
    length = int(math.exp(rng.uniform(0.0, math.log(LONGEST[event])))) if event in LONGEST else 0
    gap = math.exp(rng.uniform(0.0, math.log(LONGEST_GAP))) if event == "gap" else 0.0
    back = BEFORE + length
    scene = replace(case, frames=back + AFTER).scene()
    path = _path_after(scene, back, rng) if event != "blur" else scene.path
    shown, other = copy(scene), ""
    if event == "away":
        aside = 1.3 * scene.camera.width * path.distance[:1] / scene.camera.matrix[0, 0]
        target = path.target.copy()
        target[BEFORE:back, 0] += aside
        path = replace(path, target=target)
    if event != "jump" and rng.uniform() < asked.others:
        other = str(rng.choice(["surface", "gone"]))
        surface = _unlike_surface(scene, rng)
        shown.guests = (Guest(BEFORE, 10**6, scene.shape if other == "surface" else None, surface),)
    shown.move_camera(path)
    try:
        outline = scene[0].outline
        start = MethodStart(chosen_grasp(outline), outline, (scene.camera.width, scene.camera.height))
    except gt.GraspError:
        return None

    def frames() -> Iterator[MethodFrame]:
        for i, frame in enumerate(shown):
            image = _hidden(frame.image, event, rng) if BEFORE <= i < back else frame.image
            yield MethodFrame(image, (i + gap * (i >= back)) / rate, Truth.of_scene(frame))

    rows = score_sequence(frames(), method_makers(["auto"], case.risk), start)["auto"]
    found = [i for i, row in enumerate(rows[back:]) if row.answered]
    return ReturnOutcome(
        event,
        other,
        rows[BEFORE - 1].answered,
        found[0] if found else -1,
        sum(row.is_false_accept for row in rows if not row.defining),
        rows[back + SOON - 1].reason,
    )


def _path_after(scene: Scene, back: int, rng: np.random.Generator) -> Path:
    """The camera's path that goes on nearer or farther, turned, and aside by up to half the image while the part is in view."""
    path, camera = scene.path, scene.camera
    after = np.arange(len(path)) >= back
    nearer = math.exp(rng.uniform(-math.log(2.0), math.log(2.0))) if rng.uniform() < 0.6 else 1.0
    roll = rng.uniform(-math.pi, math.pi) if rng.uniform() < 0.5 else 0.0
    far, angle = (
        rng.uniform(0.0, 0.5) * camera.width * path.distance[0] / camera.matrix[0, 0],
        rng.uniform(0.0, 2 * math.pi),
    )
    aside = far * np.array([math.cos(angle), math.sin(angle)])
    moved = replace(
        path, distance=np.where(after, nearer * path.distance, path.distance), roll=path.roll + roll * after
    )
    for share in (1.0, 0.8, 0.6, 0.4, 0.2):
        there = replace(moved, target=path.target + share * after[:, None] * aside)
        if in_view(scene.shape, there[back:], camera):
            return there
    tail = kept_in_view(scene.shape, moved[back:], camera, 1.03)
    return replace(moved, distance=np.concatenate([path.distance[:back], tail.distance]))


def _unlike_surface(scene: Scene, rng: np.random.Generator) -> TextureMap:
    """Another surface that looks different: of the few patterns there are the part's own may be drawn."""
    own = _texture_of(scene, scene)
    for _ in range(20):
        surface, other = another_surface(float(rng.uniform(60.0, 200.0)), rng), copy(scene)
        other.guests = (Guest(0, 1, scene.shape, surface),)
        if abs(float(np.corrcoef(own, _texture_of(other, scene))[0, 1])) < UNLIKE:
            break
    return surface


def _texture_of(scene: Scene, own: Scene) -> Floats:
    """(n,) grey levels in frame 0, where the part lies in its `own` scene, less what is wider than some px."""
    image = scene[0].image
    grey = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0)
    inside = np.zeros(image.shape[:2], np.uint8)
    cv2.fillPoly(inside, [np.round(own[0].outline[0]).astype(np.int32)], (1,))
    fine = grey - cv2.GaussianBlur(grey, (0, 0), 4.0)
    return np.asarray(fine[cv2.erode(inside, np.ones((9, 9), np.uint8)) > 0], dtype=np.float64).ravel()


def _hidden(image: Pixels, event: str, rng: np.random.Generator) -> Pixels:
    if event == "blur":
        length, angle = int(rng.integers(20, 61)), rng.uniform(0.0, math.pi)
        kernel, middle = np.zeros((length, length), np.float32), (length - 1) / 2.0
        x, y = middle * math.cos(angle), middle * math.sin(angle)
        ends = [(round(middle - s * x), round(middle - s * y)) for s in (-1.0, 1.0)]
        cv2.line(kernel, ends[0], ends[1], (1.0,))
        return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()), dtype=np.uint8)
    if event == "cover":
        return np.clip(rng.normal(rng.uniform(0.0, 200.0), 3.0, image.shape), 0, 255).astype(np.uint8)
    return image


def format_row(name: str, rows: list[ReturnOutcome]) -> list[str]:
    """Of returns of the part itself: how many, found soon, found at all, sequences with a wrong answer."""
    soon, ever = (sum(0 <= r.after < most for r in rows) / max(1, len(rows)) for most in (SOON, AFTER))
    return [name, str(len(rows)), f"{100 * soon:.1f}", f"{100 * ever:.1f}", str(sum(r.wrong > 0 for r in rows))]


def main() -> None:
    """Run and print."""
    parser = common.create_parser(
        __doc__,
        parts="bracket,half-disc,bottle,key,spanner",
        disturbances="clean-6dof,print,gravel,crowd,equals,thick",
        repeats=8,
        seed=7,
        workers=2,
    )
    parser.add_argument("--others", type=float, default=0.2, help="share after whose event something else lies there")
    asked = parser.parse_args()
    kinds = asked.disturbances.split(",")
    cases = make_scene_cases(built_in(asked.parts.split(",")), kinds, repeats=asked.repeats, seed=asked.seed)
    found = common.run_all(follow_return, [ReturnCase(case, asked.others) for case in cases], asked.workers)
    known = [(case, row) for case, row in zip(cases, found, strict=True) if row is not None and row.followed]
    own = [(case, row) for case, row in known if not row.other]
    common.begin_section("Returns")
    common.add_table(
        ["returns", "sequences", f"found within {SOON} images, %", f"within {AFTER}, %", "with a wrong answer"],
        [format_row("all", [row for _, row in own])]
        + [format_row(event, [row for _, row in own if row.event == event]) for event in EVENTS]
        + [format_row(kind, [row for case, row in own if case.disturbance == kind]) for kind in kinds],
    )
    others = [row for _, row in known if row.other]
    common.add_paragraph(
        f"Of {len(others)} sequences after whose event another surface, or nothing, lay in its place "
        f"{sum(row.wrong > 0 for row in others)} had a wrong answer."
    )
    why = Counter(row.reason.split(":")[0] for _, row in own if not 0 <= row.after < SOON)
    common.add_paragraph("Not found soon: " + "; ".join(f"{reason} {n}" for reason, n in why.most_common()) + ".")
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
