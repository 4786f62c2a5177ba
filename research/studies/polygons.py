# SPDX-License-Identifier: Apache-2.0
"""Rough outlines snapped to the edges of photos: how many end right, and the fit of what `snapping.json` says.

Polygons with the corners of each mask's outline are drawn exactly, with each corner 6 px off, 6 px off as a whole, and 6 px too
large. `--fit` improves one number after the other on all photos; the figures beside it are those of kinds of object that were
left out.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np

from grasptrack.first_image import FirstImage
from grasptrack.segmentation.closed_edges import ClosedEdgeSegmenter, lab_planes
from grasptrack.segmentation.segmenters import segmenter_for
from grasptrack.segmentation.snapping import OutlineSnapper, SnapNumbers, snap_numbers
from grasptrack.typing import Bools, Floats
from grasptrack_bench.metrics.mask_agreement import ENOUGH_F, ENOUGH_IOU, boundary_f, intersection_over_union
from research.studies import common

CORNERS, OFF = 2.5, 6.0
"""px: a polygon has the corners that keep it so near the mask's outline, and is so far off."""
DRAWN = ("exact", "corners off", "corners off again", "moved", "grown")
CHOICES: dict[str, tuple[float, ...]] = {
    "bend": (0.4, 0.6, 1.0, 1.5, 2.0),
    "colour": (0.05, 0.1, 0.15, 0.2, 0.3),
    "map": (0.1, 0.2, 0.3, 0.4),
    "most": (3.0, 4.0, 6.0, 8.0),
    "spread": (4.0, 5.0, 7.0, 10.0),
    "reach": (8, 10, 12),
    "pool": (8, 12, 20, 30),
    "away": (0.0, 0.05, 0.1),
    "least": (0.5, 1.0, 1.5),
}
"""What each number may be, in the order in which they are fitted."""


class DrawnPolygons(NamedTuple):
    """Polygons drawn round one photo's object."""

    kind: str
    truth: Bools
    edges: ClosedEdgeSegmenter
    map: Any
    polygons: dict[str, Floats]


def mask_corners(truth: Bools) -> Floats:
    """(n, 2) px, corners of a polygon within `CORNERS` px of a mask's outline."""
    chains = cv2.findContours(truth.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    corners = cv2.approxPolyDP(max(chains, key=cv2.contourArea), CORNERS, True)
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2)


def move_corners(corners: Floats, seed: int) -> Floats:
    """Corners, each moved by `OFF` px in any direction."""
    angle = np.random.default_rng((len(corners), seed)).uniform(0.0, 2.0 * math.pi, len(corners))
    return np.asarray(corners + OFF * np.column_stack([np.cos(angle), np.sin(angle)]), dtype=np.float64)


def draw_polygons(truth: Bools) -> dict[str, Floats]:
    """Polygons as of DRAWN."""
    exact = mask_corners(truth)
    angle = np.random.default_rng(len(exact)).uniform(0.0, 2.0 * math.pi)
    size = 2 * round(OFF) + 1
    grown = cv2.dilate(truth.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))
    found = (
        exact,
        move_corners(exact, 0),
        move_corners(exact, 1),
        exact + OFF * np.array([math.cos(angle), math.sin(angle)]),
        mask_corners(grown > 0),
    )
    return dict(zip(DRAWN, found, strict=True))


def fill_polygon(polygon: Floats, shape: tuple[int, ...]) -> Bools:
    """(H, W) whether each pixel lies within the largest part of a polygon."""
    mask = np.zeros(shape, np.uint8)
    cv2.fillPoly(mask, [np.rint(polygon * 16.0).astype(np.int32)], (1,), cv2.LINE_8, 4)
    chains = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    mask[:] = 0
    if chains:
        cv2.drawContours(mask, [max(chains, key=cv2.contourArea)], -1, (1,), cv2.FILLED)
    return np.asarray(mask > 0, dtype=np.bool_)


def snapped_well(photos: Sequence[DrawnPolygons], numbers: SnapNumbers | None) -> tuple[Bools, Floats]:
    """(n, 5) whether each polygon ends right, and its boundary F; of polygons as drawn where there are no numbers."""
    right, near = [], []
    for photo in photos:
        snapper = None if numbers is None else OutlineSnapper(photo.edges, photo.map, numbers)
        for polygon in photo.polygons.values():
            mask = fill_polygon(polygon if snapper is None else snapper.snap(polygon), photo.truth.shape)
            near.append(boundary_f(photo.truth, mask))
            right.append(near[-1] >= ENOUGH_F and intersection_over_union(photo.truth, mask) >= ENOUGH_IOU)
    shape = (len(photos), len(DRAWN))
    return np.array(right).reshape(shape), np.array(near).reshape(shape)


def fit_numbers(photos: Sequence[DrawnPolygons], start: SnapNumbers) -> SnapNumbers:
    """Numbers that leave more polygons right, one changed after the other, once round."""

    def worth(numbers: SnapNumbers) -> float:
        right, near = snapped_well(photos, numbers)
        return float(right.mean() + 0.5 * near.mean())

    best = worth(start)
    for name, values in CHOICES.items():
        if name == "map" and photos[0].map is None:
            continue
        for value in values:
            tried = SnapNumbers(**{**start._asdict(), name: value})
            told = worth(tried)
            if told > best + 0.002:  # less is chance
                best, start = told, tried
    return start


def main() -> None:
    """Run the study."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--segmenter", help='as `track --segmenter`; "classical" if not given')
    parser.add_argument(
        "--fit", action="store_true", help="fit the numbers, and once without each kind of object: an hour"
    )
    args, listed = common.parse_with_photos(parser)
    segmenter = segmenter_for(args.segmenter)
    photos = []
    for photo in listed:
        maps = [] if segmenter is None else [r.mask for r in segmenter.regions(photo.image, FirstImage())]
        map_ = np.mean(maps, axis=0).astype(np.float32) if maps else None
        edges = ClosedEdgeSegmenter(lab_planes(photo.image))
        photos.append(DrawnPolygons(photo.kind, photo.truth, edges, map_, draw_polygons(photo.truth)))
    common.begin_section(f"Rough outlines, snapped: {len(photos)} photos, {args.segmenter or 'classical'}")
    used = snap_numbers(segmenter is not None)
    rows = []
    for name, (right, near) in (("as drawn", snapped_well(photos, None)), ("snapped", snapped_well(photos, used))):
        rows.append([name, *(100.0 * right.mean(axis=0)), float(near.mean())])
    if args.fit:
        left_out = np.zeros((len(photos), len(DRAWN)), dtype=np.bool_)
        each = np.array([photo.kind for photo in photos])
        kinds_seen = sorted(set(each.tolist()))
        for kind in kinds_seen if len(kinds_seen) > 1 else []:
            numbers = fit_numbers([p for p in photos if p.kind != kind], used)
            left_out[each == kind] = snapped_well([p for p in photos if p.kind == kind], numbers)[0]
        rows.append(["fitted to other kinds", *(100.0 * left_out.mean(axis=0)), math.nan])
        common.add_paragraph("Fitted to all: " + json.dumps(fit_numbers(photos, used)._asdict()))
    common.add_table(["right, %", *DRAWN, "mean F"], rows)
    common.write_sections(args.output)


if __name__ == "__main__":
    main()
