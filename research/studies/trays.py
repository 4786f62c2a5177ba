# SPDX-License-Identifier: Apache-2.0
"""Trays of parts that were taught in another image: how many are found, how exactly, and what is taken for one that is none.

Each tray has 4 to 20 parts of 1 to 5 kinds on a table, each with a surface of its own. Scale, tilt, light and ground differ
from those of the image in which its kind was taught. Parts lie apart, touch, or cover up to 40 % of one another. Found: the
worst contact is off by less than 3 px and 4 % of sqrt(area), or would be by another turn in which the outline fits itself.
With `--pictures DIR` each tray is written with what was found in it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path as File
from typing import Any, NamedTuple

import cv2
import numpy as np

from grasptrack.errors import GraspTrackError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour
from grasptrack.geometry.homographies import apply_homography, rotation_about_z
from grasptrack.grasp.synthesis import synthesize
from grasptrack.images import to_bgr
from grasptrack.matching import find_symmetries
from grasptrack.segmentation.first_look import find_candidates
from grasptrack.tracking.instances import Instance, find
from grasptrack.tracking.parts import KnownPart
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.simulation import SHAPES, Conditions, Path, Pinhole, Scene, Shape
from grasptrack_bench.simulation.coverage import subdivide_polygon
from grasptrack_bench.simulation.lookalikes import Distractor
from grasptrack_bench.simulation.outlines import inside_polygons
from grasptrack_bench.simulation.textures import TABLES, TextureMap, adjust_grey_level, another_surface
from research.studies import common

DEVELOPED = (
    "bracket,spanner,gasket,hook,key,t-plate,hinge,puzzle-piece,notched-plate,hammer-head,bottle-opener,crescent,square"
)
KEPT_BACK = (
    "gear,washer,cross,star,arrow,u-clip,ring-wrench,fork,bean,s-blob,leaf,guitar,half-disc,slotted-disc,pencil,bottle"
)
TAUGHT, TRAY = Pinhole(640, 480), Pinhole(1280, 960, focal=1800.0)
LAID = ("apart", "touching", "covered")
SCALES = 0.45, 2.2
"""Scales against the image that taught a part at which it is drawn, ..."""
MOST_STRETCH = 1.42
"""... and the ratio of both magnifications: a tilt of 45 degrees."""
LEAST_CONTRAST, MOST_CONTRAST = 50.0, 90.0
"""Grey levels between parts and what they lie on."""
MOST_COVERED = 0.4
ROUNDS = 80
"""Places that are drawn for a part before it is left out."""
FULL_TURN = 720
"""Turns of a round part in which it is judged."""
GRID = 1500
"""Places of a part at which it is looked at what covers it."""


class Kind(NamedTuple):
    """A kind of parts: its shape, the part that an image taught, and (3, 3) from its plane to that part's image."""

    shape: Shape
    part: KnownPart
    H: Floats
    turns: list[float]


class Lying(NamedTuple):
    """A part in a tray: its kind, (3, 3) from its plane to the image, and the share of it that others cover."""

    kind: Kind
    H: Floats
    covered: float


class TrayTally(NamedTuple):
    """What became of some trays: parts in them, those found, errors in px, false answers, kinds mixed up, answers, s."""

    parts: int
    errors: list[float]
    false: int
    mixed: int
    refused: int
    seconds: list[float]


def draw_table(level: float, rng: np.random.Generator) -> TextureMap:
    """A table of some kind at a grey level."""
    kind, contrast = str(rng.choice(list(TABLES))), float(rng.uniform(0.3, 0.9))
    made = TABLES[kind](int(rng.integers(99)), size=1024, colour=(150.0, 150.0, 150.0), contrast=contrast)
    return adjust_grey_level(made.grey, level, rng)


def look_from(distance: float, tilt: float, rng: np.random.Generator) -> Path:
    """A pose of the camera, in table units and rad."""
    turn, azimuth = rng.uniform(0.0, 2.0 * math.pi, 2).tolist()
    return Path(np.zeros((1, 2)), *(np.array([v]) for v in (distance, turn, tilt, azimuth)))


def draw_conditions(rng: np.random.Generator) -> Conditions:
    """Lens, light and sensor."""
    slope = rng.uniform(-0.15, 0.15, 2).tolist()
    return Conditions(
        blur=float(rng.uniform(0.6, 1.1)), noise=float(rng.uniform(1.0, 3.0)), gradient=(slope[0], slope[1])
    )


def beside(level: float, rng: np.random.Generator) -> float:
    """A grey level that a part of this one stands out from, on the side where there is more room."""
    return level + (1.0 if level < 125.0 else -1.0) * float(rng.uniform(LEAST_CONTRAST, MOST_CONTRAST))


def teach(shape: Shape, level: float, seed: int) -> Kind | None:
    """A kind as an image of it alone teaches it; None where its first outline is wrong or no grasp suits it."""
    rng = np.random.default_rng((seed, 1))
    distance = float(shape.radius() * TAUGHT.matrix[0, 0] / (0.32 * TAUGHT.height))
    path = look_from(distance, float(rng.uniform(0.0, 0.15)), rng)
    table, surface = draw_table(beside(level, rng), rng), another_surface(level, rng)
    scene = Scene(
        shape, path, camera=TAUGHT, table=table, surface=surface, conditions=draw_conditions(rng), seed=seed
    )  # fmt: skip
    H, image = path.table_to_image(TAUGHT)[0], scene[0].image
    try:
        outline = subdivide_polygon(apply_homography(H, shape.outer), 4.0)
        view = find_candidates(to_bgr(image), FirstImage.of(outline=outline))[0].view
        grasps = synthesize(view, 2, top=1)
        part = KnownPart.of(image, view, grasps, name=shape.name)
    except GraspTrackError:
        return None
    moved = np.eye(3)
    moved[:2, 2] = part.view.outer.points[0] - view.outer.points[0]
    own = find_symmetries(Contour(subdivide_polygon(shape.outer * 100.0, 3.0)))
    every = np.linspace(0.0, 2.0 * math.pi, FULL_TURN, endpoint=False).tolist() if own.continuous else []
    return Kind(shape, part, moved @ H, [*every, *(turn.turn for turn in own.turns)])


def draw_tray(kinds: Sequence[Kind], levels: Sequence[float], laid: str, seed: int) -> tuple[Pixels, list[Lying]]:
    """An image of a tray, and what lies in it, the lowest first."""
    rng = np.random.default_rng((seed, 2))
    count = int(rng.integers(4, 21))
    path = look_from(float(TRAY.matrix[0, 0] / rng.uniform(75.0, 130.0)), float(rng.uniform(0.0, 0.7)), rng)
    H = path.table_to_image(TRAY)[0]
    wanted = [*range(len(kinds)), *rng.integers(len(kinds), size=max(0, count - len(kinds))).tolist()][:count]
    placed: list[tuple[int, float, tuple[float, float], Shape]] = []
    for k in wanted:
        for _ in range(ROUNDS):
            turn, (x, y) = float(rng.uniform(0.0, 2.0 * math.pi)), rng.uniform(-6.0, 6.0, 2).tolist()
            moved = kinds[k].shape.moved(turn, (x, y))
            if fits(moved, (x, y), H, kinds[k]) and lies_well(moved, [p[3] for p in placed], laid):
                placed.append((k, turn, (x, y), moved))
                break
    made = [
        Distractor(kinds[k].shape, another_surface(levels[k], rng), turn=turn, shift=at) for k, turn, at, _ in placed
    ]
    # the scene's own shape lies far out of view, before the camera
    away = next(at for at in ((60.0, 60.0), (-60.0, -60.0)) if float(H[2] @ (1.1 * at[0], 1.1 * at[1], 1.0)) > 0.0)
    scene = Scene(
        SHAPES["square"](), path, camera=TRAY, table=draw_table(beside(float(np.mean(levels)), rng), rng),
        distractors=made, conditions=draw_conditions(rng), seed=seed, moves=np.array([[*away, 0.0]]),
    )  # fmt: skip
    covered = [cover_of(p[3], [q[3] for q in placed[i + 1 :]]) for i, p in enumerate(placed)]
    lying = [Lying(kinds[p[0]], H @ d.place(0.0), c) for p, d, c in zip(placed, made, covered, strict=True)]
    return scene[0].image, lying


def fits(shape: Shape, at: tuple[float, float], H: Floats, kind: Kind) -> bool:
    """Whether a part is whole in view at its place, and of a scale and a tilt that are looked for."""
    seen = apply_homography(H, shape.samples(80))
    if not bool(((seen > 6.0) & (seen < np.array([TRAY.width, TRAY.height]) - 7.0)).all()):
        return False
    here = np.array([at, (at[0] + 1e-3, at[1]), (at[0], at[1] + 1e-3)])
    large, small = (np.linalg.svd((np.diff(apply_homography(H, here)[[0, 1, 0, 2]], axis=0)[::2]) / 1e-3)[1]).tolist()
    taught = math.sqrt(kind.part.view.outer.area / abs(area_of(kind.shape)))
    return large <= MOST_STRETCH * small and SCALES[0] <= math.sqrt(large * small) / taught <= SCALES[1]


def area_of(shape: Shape) -> float:
    """Of the outer polygon, table units."""
    return float(cv2.contourArea(shape.outer.astype(np.float32)))


def lies_well(shape: Shape, others: Sequence[Shape], laid: str) -> bool:
    """Whether a part lies as it should to those below it."""
    if laid == "covered":
        return all(cover_of(other, [*others[i + 1 :], shape]) <= MOST_COVERED for i, other in enumerate(others))
    gap, outline = {"apart": 0.12, "touching": 0.0}[laid], shape.samples(160)
    rings = [other.outer.astype(np.float32) for other in others]
    away = [max(cv2.pointPolygonTest(ring, p, True) for p in outline.tolist()) for ring in rings]
    away += [
        max(cv2.pointPolygonTest(shape.outer.astype(np.float32), p, True) for p in other.samples(160).tolist())
        for other in others
    ]
    return all(distance < -gap for distance in away)


def cover_of(shape: Shape, above: Sequence[Shape]) -> float:
    """Share of a part that lies under others."""
    low, high = shape.outer.min(axis=0), shape.outer.max(axis=0)
    points = low + (high - low) * np.random.default_rng(0).uniform(size=(GRID, 2))
    points = points[inside_polygons(shape.polygons, points)]
    hidden = np.zeros(len(points), dtype=bool)
    for other in above:
        if np.hypot(*(other.outer.mean(axis=0) - shape.outer.mean(axis=0))) < other.radius() + 9.0:
            hidden |= inside_polygons(other.polygons, points)
    return float(hidden.mean())


def contact_error(answer: Instance | TrackResult, lying: Lying) -> float:
    """px by which the worst contact is off, against the nearest of the turns in which the outline fits itself."""
    assert answer.contacts is not None
    contacts = apply_homography(np.linalg.inv(lying.kind.H), lying.kind.part.grasps[0].contacts)
    ways = [lying.H @ rotation_about_z(turn) for turn in (0.0, *lying.kind.turns)]
    return min(float(np.hypot(*(apply_homography(H, contacts) - answer.contacts).T).max()) for H in ways)


def judge(answers: Sequence[Instance], lying: Sequence[Lying], seconds: float) -> TrayTally:
    """What became of one tray."""
    errors, false, mixed = list[float](), 0, 0
    left = list(lying)
    for answer in (a for a in answers if a.found):
        limit = max(3.0, 0.04 * math.sqrt(answer.view.outer.area))
        own = [one for one in left if one.kind.part.name == answer.part]
        best = min(own, key=lambda one: contact_error(answer, one), default=None)
        if best is not None and contact_error(answer, best) <= limit:
            errors.append(contact_error(answer, best))
            left = [one for one in left if one is not best]
            continue
        false += 1
        inside = answer.view.outer.points.mean(axis=0)
        others = [one for one in lying if one.kind.part.name != answer.part]
        mixed += any(
            np.hypot(*(apply_homography(one.H, np.zeros((1, 2)))[0] - inside)) < 0.5 * math.sqrt(answer.view.outer.area)
            for one in others
        )
    return TrayTally(len(lying), errors, false, mixed, sum(not a.found for a in answers), [seconds])


def run_tray(names: Sequence[str], laid: str, seed: int, picture: File | None) -> TrayTally | None:
    """A tray drawn and looked at; None where nothing could be taught."""
    rng = np.random.default_rng(seed)
    chosen = rng.choice(names, size=min(len(names), int(rng.integers(1, 6))), replace=False).tolist()
    dark = bool(rng.uniform() < 0.5)
    levels = (rng.uniform(40.0, 75.0, 5) if dark else rng.uniform(165.0, 205.0, 5)).tolist()
    taught = [
        (kind, level) for n, level in zip(chosen, levels, strict=False) if (kind := teach(SHAPES[n](), level, seed))
    ]
    if not taught:
        return None
    image, lying = draw_tray([kind for kind, _ in taught], [level for _, level in taught], laid, seed)
    begun = time.perf_counter()
    answers = find(image, [kind.part for kind, _ in taught])
    told = judge(answers, lying, time.perf_counter() - begun)
    if picture is not None:
        from grasptrack.view.instances import draw_instances
        from grasptrack.view.style import write_picture

        picture.mkdir(parents=True, exist_ok=True)
        write_picture(picture / f"{laid} {seed}.png", draw_instances(image, answers))
    return told


def add_up(found: Sequence[TrayTally]) -> TrayTally:
    """What became of several trays."""
    parts, false, mixed = sum(t.parts for t in found), sum(t.false for t in found), sum(t.mixed for t in found)
    errors, seconds = [e for t in found for e in t.errors], [s for t in found for s in t.seconds]
    return TrayTally(parts, errors, false, mixed, sum(t.refused for t in found), seconds)


def row_of(name: str, told: TrayTally) -> list[Any]:
    """A row of the table."""
    found, answers = len(told.errors), max(1, len(told.errors) + told.false)
    errors, seconds = np.array(told.errors or [math.nan]), np.array(told.seconds or [math.nan])
    return [
        name, len(told.seconds), told.parts, f"{100.0 * found / max(1, told.parts):.1f} %", told.false,
        f"{1000.0 * told.false / answers:.1f}", told.mixed, told.refused, f"{np.median(errors):.2f}",
        f"{np.quantile(errors, 0.95):.2f}", f"{1000.0 * float(np.median(seconds)):.0f}",
    ]  # fmt: skip


def main() -> None:
    """Run the study."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--shapes", default=DEVELOPED, help="of which kinds are drawn, with commas, or kept-back")
    parser.add_argument("--laid", default=",".join(LAID), help="how parts lie, with commas")
    parser.add_argument("--seeds", type=int, default=12, help="trays of each")
    parser.add_argument("--first", type=int, default=0, help="seed of the first tray")
    parser.add_argument("--pictures", type=File, help="folder for a picture of each tray")
    asked = parser.parse_args()
    names = (KEPT_BACK if asked.shapes == "kept-back" else asked.shapes).split(",")
    common.begin_section("Trays of parts that another image taught")
    rows, every = [], list[TrayTally]()
    for laid in asked.laid.split(","):
        seeds = range(asked.first, asked.first + asked.seeds)
        told = [t for seed in seeds if (t := run_tray(names, laid, seed, asked.pictures)) is not None]
        every += told
        rows.append(row_of(laid, add_up(told)))
    rows.append(row_of("all", add_up(every)))
    common.add_table(
        ["parts lie", "trays", "parts", "found", "false", "false in 1,000 answers", "kinds mixed up", "refused",
         "median error, px", "95 %, px", "ms per image"], rows,
    )  # fmt: skip
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
