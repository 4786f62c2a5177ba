# SPDX-License-Identifier: Apache-2.0
"""The first look where it errs most: ten kinds of first images, each drawn with some parts. Is it right, asked, or wrong?

Asked: the first outline is wrong, or there is none, and no answer would be taken for sure. Unsure: it is right, and is not told
as sure. With `--pictures DIR` each image is written whose first outline is not right.
"""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from grasptrack.errors import GraspTrackError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import View
from grasptrack.segmentation.candidate import distinct_candidates
from grasptrack.segmentation.first_look import look_for
from grasptrack.tracking.initialization import object_at_contacts
from grasptrack.typing import Bools
from grasptrack_bench.method import chosen_grasp
from grasptrack_bench.scenes import built_in
from grasptrack_bench.simulation import SHAPES, SceneFrame, Shape, effects, kinds, tabletop
from grasptrack_bench.simulation.coverage import inside_mask
from grasptrack_bench.simulation.disturbances import Disturbance
from grasptrack_bench.simulation.effects import EffectSetting, Parts
from grasptrack_bench.simulation.occluders import hand_over
from grasptrack_bench.simulation.outlines import inside_polygons
from grasptrack_bench.simulation.textures import TABLES, TextureMap, adjust_grey_level, blank_texture
from research.studies import common
from research.studies.common import is_found

HINTS = ("nothing", "pixel", "grasp")
OUTCOMES = ("right", "asked", "wrong", "unsure", "three")
CENTRE = 320
"""px, the middle of a surface that is drawn here, ..."""
UNIT = 200.0
"""... and px of it in a table unit."""


def planks(s: EffectSetting) -> Parts:
    """A table of boards: dark gaps in even distances run under the part."""
    table = _drawn_table(s)
    image, size = table.image.astype(np.float32), table.image.shape[0]
    step, wide = float(s.rng.uniform(50.0, 130.0)), float(s.rng.uniform(1.0, 2.5))
    to_seam = np.abs((np.arange(size) / step + s.rng.uniform()) % 1.0 - 0.5) * step
    image *= 1.0 - np.float32(s.rng.uniform(0.25, 0.6)) * np.exp(-0.5 * (to_seam / wide) ** 4)[:, None, None]
    return {"path": s.course(), "table": replace(table, image=image.astype(np.uint8))}


def bars(s: EffectSetting) -> Parts:
    """Black bars, pillars or a bezel."""
    made = kinds.fixed_marks(s)
    while len(made["layers"]) < 2 or len(made["layers"][1].hides) < 2:
        made = kinds.fixed_marks(s)
    return made


def printed_sheet(s: EffectSetting) -> Parts:
    """The part is a sheet or a book's cover with a picture, a frame or a word on it."""
    wide, high = s.rng.uniform(0.9, 1.4), s.rng.uniform(0.6, 0.9)
    sheet = Shape.of("sheet", np.array([(-wide, -high), (wide, -high), (wide, high), (-wide, high)]))
    wide, high = sheet.outer.max(axis=0)  # sheets have the area of other parts
    image = _blank(s, s.level)
    ink = float(np.clip(s.level + s.rng.choice([-1.0, 1.0]) * s.rng.uniform(70.0, 120.0), 5.0, 250.0))
    x, y = np.rint(UNIT * s.rng.uniform(0.4, 0.85, 2) * (wide, high)).astype(int).tolist()
    kind = str(s.rng.choice(["picture", "frame", "word"]))
    low, high_ = (CENTRE - x, CENTRE - y), (CENTRE + x, CENTRE + y)
    if kind == "word":
        text = str(s.rng.choice(["VISION", "ROBOT", "ATLAS"]))
        (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 1.0, 2)
        scale = 2.0 * x / width
        cv2.putText(
            image, text, (CENTRE - x, CENTRE + round(11 * scale)), cv2.FONT_HERSHEY_DUPLEX, scale, (ink,) * 3, 12
        )
    else:
        cv2.rectangle(image, low, high_, (ink,) * 3, -1 if kind == "picture" else 10)
    if kind == "picture":
        cv2.circle(image, (CENTRE, CENTRE), min(x, y) // 2, (s.level,) * 3, -1)
    return {"path": s.course(), "shape": sheet, "surface": TextureMap(image, CENTRE / UNIT)}


def letters(s: EffectSetting) -> Parts:
    """Print of nearly the table's own grey within the part: it looks like holes."""
    ink_level = s.table_level + float(s.rng.uniform(-0.2, 0.2)) * (s.level - s.table_level)
    image, inked = _blank(s, s.level), _blank(s, ink_level)
    ink = np.zeros(image.shape[:2], np.uint8)
    rings = [ring.astype(np.float32) for ring in s.shape.polygons]
    drawn = 0
    for _ in range(60):
        at, half = s.rng.uniform(-1.0, 1.0, 2) * s.shape.radius(), float(s.rng.uniform(0.07, 0.16))
        apart = min(abs(float(cv2.pointPolygonTest(ring, at.tolist(), True))) for ring in rings)
        if drawn < 6 and inside_polygons(s.shape.polygons, at[None]).all() and apart > 1.6 * half + 0.05:
            x, y = np.rint(CENTRE + UNIT * at).astype(int).tolist()
            px, scale = round(UNIT * half), UNIT * half / 13.0
            if s.rng.uniform() < 0.5:
                cv2.circle(ink, (x, y), px, (255,), -1, cv2.LINE_AA)
            else:
                letter = str(s.rng.choice(list("BDO8RE")))
                place = (x - round(10 * scale), y + round(11 * scale))
                cv2.putText(ink, letter, place, cv2.FONT_HERSHEY_DUPLEX, scale, (255,), round(5 * scale), cv2.LINE_AA)
            drawn += 1
    share = cv2.GaussianBlur(ink.astype(np.float32) / np.float32(255.0), (0, 0), 0.8)[..., None]
    image = np.clip(image + share * (inked.astype(np.float32) - image), 0, 255).astype(np.uint8)
    return {"path": s.course(), "surface": TextureMap(image, CENTRE / UNIT)}


def hand(s: EffectSetting) -> Parts:
    """A hand lies on a part of it."""
    path, side, share = s.course(), float(s.rng.uniform(0.0, 2.0 * math.pi)), float(s.rng.uniform(0.06, 0.2))
    rests = (-2.0, -1.0, 1e6, 1e6 + 1.0)
    over = hand_over(s.shape, rests, share=share, side=side, view=s.view(path), seed=int(s.rng.integers(1 << 20)))
    return {"path": path, "covers": (over,)}


def slotted_disc(s: EffectSetting) -> Parts:
    """A disc with a narrow slot to its middle, plain, printed, on gravel or with a shadow."""
    s = replace(s, shape=SHAPES["slotted-disc"]())
    how: list[Callable[[EffectSetting], Parts]] = [
        effects.clean_4dof, tabletop.printed_part, tabletop.gravel_table, kinds.contact_shadow, effects.defocus_blur
    ]  # fmt: skip
    return {"shape": s.shape, **how[int(s.rng.integers(len(how)))](s)}


def bottle_at_edge(s: EffectSetting) -> Parts:
    """A transparent part across the line where table and wall meet."""
    table, made = _drawn_table(s), kinds.transparent(s)
    image = table.image.astype(np.float32)
    at = round(image.shape[0] * (0.5 + float(s.rng.uniform(-0.04, 0.04))))
    other = float(np.clip(s.table_level + s.rng.choice([-1.0, 1.0]) * s.rng.uniform(40.0, 90.0), 15.0, 240.0))
    image[:at] *= np.float32(other / s.table_level)
    return {**made, "table": replace(table, image=np.clip(image, 0, 255).astype(np.uint8))}


def _drawn_table(s: EffectSetting) -> TextureMap:
    """A tinted table of some kind at the setting's level."""
    kind, contrast = str(s.rng.choice(list(TABLES))), float(s.rng.uniform(0.4, 1.0))
    made = TABLES[kind](int(s.rng.integers(99)), size=1024, colour=(150.0, 150.0, 150.0), contrast=contrast)
    return adjust_grey_level(made.grey, s.table_level, s.rng).coloured


def _blank(s: EffectSetting, level: float) -> Any:
    """(H, W, 3) px of a plain surface."""
    size = 2 * CENTRE
    return blank_texture(int(s.rng.integers(99)), size=size, colour=(level, level, level)).coloured.image.copy()


KINDS: dict[str, Callable[[EffectSetting], Parts]] = {
    "plank seams": planks,
    "black bars": bars,
    "print on a sheet": printed_sheet,
    "letters as holes": letters,
    "hand on it": hand,
    "lamps in a glossy table": kinds.glossy_table,
    "contact shadow": kinds.contact_shadow,
    "touching neighbour": kinds.touching,
    "slotted disc": slotted_disc,
    "transparent bottle": bottle_at_edge,
}


def draw_frame(kind: str, shape: Shape, seed: int) -> SceneFrame:
    """The first image of a kind; every second one is grey."""
    own = zlib.crc32(f"{kind} {shape.name} {seed}".encode())
    return Disturbance(kind, "", "image", KINDS[kind]).scene(shape, 2, own, colour=own % 2 == 0)[0]


def true_masks(frame: SceneFrame) -> list[Bools]:
    """(H, W) of the whole part, and of what is seen of it: either counts."""
    height, width = frame.image.shape[:2]
    whole = inside_mask(frame.outline, width, height)
    covered = inside_mask(frame.covers, width, height) if frame.covers else np.zeros_like(whole)
    return [whole, whole & ~covered]


def judge_look(frame: SceneFrame, hint: str) -> tuple[list[str], View | None]:
    """What becomes of one image, as of `OUTCOMES`, the first of these before others; and the first outline."""
    truths, told = true_masks(frame), FirstImage()
    if hint == "pixel":
        told = FirstImage.of(common.Photo("", "", "", frame.image, truths[1]).deepest())
    if hint == "grasp":
        told = FirstImage.of(grasp=chosen_grasp(frame.outline))
    try:
        found = look_for(frame.image, told)
        first = found[0] if told.grasp is None else object_at_contacts(found, told.grasp)
    except GraspTrackError:
        return ["asked"], None
    three = any(is_found(truth, c.view) for c in distinct_candidates(found) for truth in truths)
    right = any(is_found(truth, first.view) for truth in truths)
    told_as = [*(["three"] if three else []), *(["unsure"] if right and not first.sure else [])]
    return ["right" if right else "wrong" if first.sure else "asked", *told_as], first.view


def main() -> None:
    """Run the study."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--parts", default="bracket,hammer-head,star,bottle,washer", help="shapes, with commas")
    parser.add_argument("--kinds", default=",".join(KINDS), help="of images, with commas")
    parser.add_argument("--seeds", type=lambda text: [int(s) for s in text.split(",")], default=[1], help="with commas")
    parser.add_argument("--pictures", type=Path, help="folder for pictures of what was not right")
    asked = parser.parse_args()
    common.begin_section("First look: ten kinds of first images")
    rows, total = list[list[Any]](), {hint: Counter[str]() for hint in HINTS}
    parts = built_in(asked.parts.split(","))
    for kind in asked.kinds.split(","):
        cells = list[Any]()
        frames = [(f"{p.shape.name} {s}", draw_frame(kind, p.shape, s)) for s in asked.seeds for p in parts]
        for hint in HINTS:
            told = Counter[str]()
            for name, frame in frames:
                outcomes, view = judge_look(frame, hint)
                told.update(outcomes)
                if asked.pictures and outcomes[0] != "right":
                    write_picture(asked.pictures / f"{outcomes[0]} {kind} {name} {hint}.png", frame, view)
            total[hint].update(told)
            cells.append(", ".join(str(told[o]) for o in OUTCOMES))
        rows.append([kind, len(frames), *cells])
    rows.append(["all", sum(r[1] for r in rows), *(", ".join(str(total[h][o]) for o in OUTCOMES) for h in HINTS)])
    common.add_paragraph("Right, asked, wrong and sure; right and not sure; and how often one of three is right.")
    common.add_table(["kind", "images", *HINTS], rows)
    common.write_sections(asked.output)


def write_picture(path: Path, frame: SceneFrame, view: View | None) -> None:
    """The image with the outline in it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image = frame.image if frame.image.ndim == 3 else cv2.cvtColor(frame.image, cv2.COLOR_GRAY2BGR)
    image = image.copy()
    for contour in view.contours if view is not None else ():
        cv2.polylines(image, [np.rint(contour.points).astype(np.int32)], True, (0, 0, 255), 2)
    cv2.imwrite(str(path), image)


if __name__ == "__main__":
    main()
