# SPDX-License-Identifier: Apache-2.0
"""What becomes of an object whose first image shows a wrong outline: a highlight, a gap, a bridge or a shadow on it."""

from __future__ import annotations

import itertools
import math
import zlib

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.demo.run import accept_limit
from grasptrack.errors import GraspTrackError
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats
from grasptrack_bench.method import chosen_grasp
from grasptrack_bench.scenes import SceneCase, ScenePart
from grasptrack_bench.simulation import SHAPES, SceneFrame
from research.studies import common

Grey = NDArray[np.uint8]

KINDS = {
    "none": "nothing",
    "highlight": "a saturated disc, over 5 to 15 % of the outline",
    "gap": "a disc in which the object looks like the ground",
    "bridge": "a bar of the object's grey, from its outline outward",
    "shadow": "a soft shadow along one side",
}


def object_mask(frame: SceneFrame) -> Grey:
    """(H, W) 255 on the object."""
    mask: Grey = np.zeros(frame.image.shape[:2], np.uint8)
    cv2.fillPoly(mask, [np.round(p * 16.0).astype(np.int32) for p in frame.outline], (255,), cv2.LINE_AA, 4)
    return mask


def corrupt_outline(frame: SceneFrame, kind: str, rng: np.random.Generator) -> Grey:
    """The image with something on the outline that later images do not show."""
    image, mask, outline = frame.image.astype(np.float64), object_mask(frame), frame.outline[0]
    if kind == "none":
        return frame.image
    height, width = mask.shape
    sides = np.roll(outline, -1, axis=0) - outline
    along = np.cumsum(np.hypot(*sides.T))
    at, half = rng.uniform(0.0, along[-1]), rng.uniform(0.05, 0.15) * along[-1] / 2.0
    i = int(np.searchsorted(along, at))
    way = sides[i] / np.hypot(*sides[i])
    place, out = outline[i] + sides[i] - (along[i] - at) * way, np.array([way[1], -way[0]])
    x, y = np.round(place + 3.0 * out).astype(int).tolist()
    out = -out if mask[min(max(y, 0), height - 1), min(max(x, 0), width - 1)] > 127 else out
    Y, X = np.mgrid[:height, :width]
    inside = mask / 255.0

    def soften_edge(area: NDArray[np.bool_], blur: float) -> Floats:
        return np.asarray(cv2.GaussianBlur(area.astype(np.float32), (0, 0), blur), np.float64)

    if kind in ("highlight", "gap"):
        x, y = place + out * rng.uniform(-0.4, 0.2) * half
        disc = soften_edge(np.hypot(X - x, Y - y) < half, 1.2)
        if kind == "highlight":
            image += (255.0 - image) * disc
        else:
            around = (cv2.dilate(mask, np.ones((15, 15))) > 0) & (cv2.dilate(mask, np.ones((7, 7))) == 0)
            ground = np.median(image[around]) + rng.normal(0.0, 2.0, image.shape)
            image += (ground - image) * disc * inside
    elif kind == "bridge":
        beside, beyond = (
            (X - place[0]) * way[0] + (Y - place[1]) * way[1],
            (X - place[0]) * out[0] + (Y - place[1]) * out[1],
        )
        bar = (np.abs(beside) < half) & (beyond > -4.0) & (beyond < 0.35 * math.sqrt(frame.area))
        own = np.median(image[mask > 250]) + rng.normal(0.0, 2.0, image.shape)
        image += (own - image) * soften_edge(bar, 0.9) * (1.0 - inside)
    else:
        angle = rng.uniform(0.0, 2.0 * math.pi)
        dx, dy = 0.06 * math.sqrt(frame.area) * np.array([math.cos(angle), math.sin(angle)])
        moved = cv2.warpAffine(mask, np.array([[1.0, 0.0, dx], [0.0, 1.0, dy]]), (width, height))
        image *= 1.0 - 0.5 * cv2.GaussianBlur(np.asarray(moved / 255.0, np.float64), (0, 0), 1.5) * (1.0 - inside)
    return np.asarray(np.clip(np.round(image), 0, 255), np.uint8)


def run_sequence(name: str, kind: str, asked_seed: int, count: int, *, given: bool) -> dict[str, float]:
    """Counts of one sequence."""
    scene = SceneCase(ScenePart(SHAPES[name]()), "clean-6dof", frames=count, seed=asked_seed).scene()
    frames, rng = list(scene), np.random.default_rng((asked_seed, zlib.crc32(f"{name}{kind}".encode())))
    told = dict.fromkeys(("refused", "frames", "given", "wrong", "beside"), 0.0)
    first = corrupt_outline(frames[0], kind, rng)
    inside = cv2.distanceTransform((object_mask(frames[0]) > 127).astype(np.uint8), cv2.DIST_L2, 5)
    y, x = np.unravel_index(int(inside.argmax()), inside.shape)
    contacts = chosen_grasp(frames[0].outline)
    tracker = GraspTracker(grasp=contacts) if given else GraspTracker(object_at=(float(x), float(y)))
    try:
        begun = tracker.update(first, frames[0].time).contacts
    except GraspTrackError:
        begun = None
    if begun is None:
        return {**told, "refused": 1.0}
    edges = [np.asarray(p, np.float32) for p in frames[0].outline]
    off = max(min(abs(cv2.pointPolygonTest(p, (float(u), float(v)), True)) for p in edges) for u, v in begun)
    for frame in frames[1:]:
        result = tracker.update(frame.image, frame.time)
        told["frames"] += 1.0
        if result.contacts is not None:
            limit = accept_limit(frame.area)
            told["given"] += 1.0
            told["wrong"] += float(np.hypot(*(result.contacts - frame.carry(begun)).T).max()) > limit
            told["beside"] += off > limit
    return told


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__, shapes="bracket,half-disc,bottle,key,gear,s-blob", frames=40)
    parser.add_argument("--kinds", default=",".join(KINDS), help="of what is wrong")
    parser.add_argument("--seeds", default="702,3,1001,1002,1003", help="of the sequences, each one of all parts")
    asked = parser.parse_args()
    common.begin_section("Wrong first outlines")
    common.add_paragraph("Beside: contacts were given that lay beside the object from the first.")
    rows = []
    for kind, given in itertools.product(asked.kinds.split(","), (False, True)):
        drawn = itertools.product(asked.shapes.split(","), map(int, asked.seeds.split(",")))
        runs = [run_sequence(shape, kind, seed, asked.frames, given=given) for shape, seed in drawn]
        total = {key: round(sum(each[key] for each in runs)) for key in runs[0]}
        rows.append((kind, "contacts given" if given else "own grasp", len(runs), *total.values()))
    common.add_table(("first image", "start", "sequences", "refused", "frames", "answered", "wrong", "beside"), rows)
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
