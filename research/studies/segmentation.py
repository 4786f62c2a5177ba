# SPDX-License-Identifier: Apache-2.0
"""Segmentation of photos of tools against their masks, beside Otsu's threshold, an adaptive one and GrabCut of OpenCV."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from grasptrack.errors import ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.segmentation.first_look import find_objects
from grasptrack.typing import Bools, Pixels
from grasptrack_bench.metrics.mask_agreement import (
    ENOUGH_F,
    ENOUGH_IOU,
    band_iou,
    boundary_f,
    intersection_over_union,
    mask_of,
)
from research.studies import common
from research.studies.common import Photo

Hint = tuple[float, float] | None
"""(x, y) px that the object covers."""
Segmenter = Callable[[Pixels, Hint], Bools]
"""From an image (H, W, 3) BGR to the mask (H, W) of the object in it, empty where there is none."""

MARGIN, ITERATIONS, SHRINK, SEED = 0.1, 5, 2, 2
"""GrabCut: what it takes for background, of each side; its steps; how much smaller the image is, in which the whole one would
take 10 s; px there, radius of what it takes for the object around the hint."""
BLOCK, OFFSET, CLOSING = 51, 5, 7
"""Adaptive threshold: px of the neighbourhood, grey levels off its mean, px of the closing that joins what is left."""
WIDTH = 480
"""px of a picture of a failure."""
GREEN, RED, YELLOW = (60, 220, 60), (60, 60, 255), (0, 230, 255)


@dataclass(frozen=True)
class Judged:
    """What one method made of one photo."""

    photo: Photo
    method: str
    hint: Hint
    mask: Bools
    f: float
    iou: float
    ms: float

    @property
    def enough(self) -> bool:
        """Whether the object counts as found."""
        return self.f >= ENOUGH_F and self.iou >= ENOUGH_IOU


# --- methods -------------------------------------------------------------------------------------


def segment_first_look(image: Pixels, object_at: Hint = None) -> Bools:
    """Our first object."""
    try:
        return mask_of(find_objects(image, FirstImage.of(object_at))[0].view, (image.shape[0], image.shape[1]))
    except ObservationError:
        return np.zeros(image.shape[:2], dtype=np.bool_)


def segment_otsu(image: Pixels, object_at: Hint = None) -> Bools:
    """The region on either side of Otsu's threshold that `largest_outline` picks."""
    _, light = cv2.threshold(_soft_grey(image), 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    return largest_outline([np.asarray(light, np.uint8), np.asarray(cv2.bitwise_not(light), np.uint8)], object_at)


def segment_adaptive(image: Pixels, object_at: Hint = None) -> Bools:
    """The region darker than its neighbourhood, on a dark ground lighter, closed.

    One side only: on the other a halo round the object would win, being larger.
    """
    grey = _soft_grey(image)
    if np.median(grey) < 128:
        grey = np.asarray(cv2.bitwise_not(grey), np.uint8)
    dark = cv2.adaptiveThreshold(grey, 255, cv2.ADAPTIVE_THRESH_GAUSSIAN_C, cv2.THRESH_BINARY_INV, BLOCK, OFFSET)
    closed = cv2.morphologyEx(dark, cv2.MORPH_CLOSE, np.ones((CLOSING, CLOSING), np.uint8))
    return largest_outline([np.asarray(closed, np.uint8)], object_at)


def segment_grabcut(image: Pixels, object_at: Hint = None) -> Bools:
    """The region that GrabCut finds within the image's margin; with a hint, a small disc around it is given as the object.

    Sets OpenCV's random seed, to give the same every time.
    """
    cv2.setRNGSeed(0)
    small = cv2.resize(image, None, fx=1.0 / SHRINK, fy=1.0 / SHRINK, interpolation=cv2.INTER_AREA)
    height, width = small.shape[:2]
    top, left = round(MARGIN * height), round(MARGIN * width)
    labels = np.full((height, width), cv2.GC_BGD, dtype=np.uint8)
    labels[top : height - top, left : width - left] = cv2.GC_PR_FGD
    if object_at is not None:
        x, y = ((value + 0.5) / SHRINK - 0.5 for value in object_at)
        cv2.circle(labels, (round(x), round(y)), SEED, cv2.GC_FGD, -1)
    cv2.grabCut(small, labels, (0, 0, 0, 0), np.zeros((1, 65)), np.zeros((1, 65)), ITERATIONS, cv2.GC_INIT_WITH_MASK)
    found = np.where((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD), np.float32(1), np.float32(0))
    whole = cv2.resize(found, (image.shape[1], image.shape[0]), interpolation=cv2.INTER_LINEAR)
    return largest_outline([(whole > 0.5).astype(np.uint8)], object_at)


METHODS: dict[str, Segmenter] = {
    "ours": segment_first_look,
    "Otsu": segment_otsu,
    "adaptive": segment_adaptive,
    "GrabCut": segment_grabcut,
}


def largest_outline(regions: Sequence[Pixels], object_at: Hint = None) -> Bools:
    """The largest outline in some binary images, filled: clear of the border, and round the hint if there is one.

    At a hint an outline that touches the border serves where no other does.
    """
    height, width = regions[0].shape
    best: tuple[bool, float] = (False, 0.0)
    mask = np.zeros((height, width), dtype=np.uint8)
    for region in regions:
        outlines, _ = cv2.findContours(region, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        for outline in outlines:
            x, y, w, h = cv2.boundingRect(outline)
            clear = bool(x > 0 and y > 0 and x + w < width and y + h < height)
            rank = (clear, float(cv2.contourArea(outline)))
            if rank <= best or (object_at is None and not clear):
                continue
            if object_at is not None and cv2.pointPolygonTest(outline, object_at, False) < 0:
                continue
            best = rank
            mask[:] = 0
            cv2.drawContours(mask, [outline], -1, 1, -1)
    return mask > 0


def _soft_grey(image: Pixels) -> Pixels:
    return np.asarray(cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (5, 5), 0), np.uint8)


# --- scores --------------------------------------------------------------------------------------


def judge_method(photo: Photo, method: str, hint: Hint) -> Judged:
    """One method on one photo; its time does not include the scoring."""
    start = time.perf_counter()
    mask = METHODS[method](photo.image, hint)
    ms = 1e3 * (time.perf_counter() - start)
    return Judged(
        photo, method, hint, mask, boundary_f(photo.truth, mask), intersection_over_union(photo.truth, mask), ms
    )


def show_scores(photos: Sequence[Photo], rows: Sequence[Judged]) -> None:
    """Every method with and without a hint, by scene; then what the masks allow at best."""
    scenes = [*sorted({photo.scene for photo in photos}), "all"]
    lines: list[list[object]] = []
    for method in dict.fromkeys(row.method for row in rows):
        for hint in (False, True):
            for scene in scenes:
                some = [
                    r
                    for r in rows
                    if (r.method, r.hint is not None) == (method, hint) and scene in (r.photo.scene, "all")
                ]
                middle = np.median([(row.f, row.iou, row.ms) for row in some], axis=0).tolist()
                label = f"{method}, {'one pixel' if hint else 'no hint'}"
                lines.append([label, scene, len(some), 100.0 * sum(r.enough for r in some) / len(some), *middle])
    common.add_table(["method", "scene", "photos", "found %", "median F", "median IoU", "median ms"], lines)
    common.add_paragraph(
        f"Found: F >= {ENOUGH_F} within 4 px and IoU >= {ENOUGH_IOU}; without a hint only the first object counts."
    )
    for scene in scenes:
        bands = [band_iou(photo.truth) for photo in photos if scene in (photo.scene, "all")]
        smaller, larger = np.median(bands, axis=0)
        common.add_paragraph(
            f"{scene}: masks 2 px smaller have a median IoU of {smaller:.3f} with themselves, 2 px larger {larger:.3f}."
        )


def draw_comparison(row: Judged) -> Pixels:
    """The true outline green, the found one red, the hint as a cross; name, F and IoU above."""
    tile, scale = row.photo.image.copy(), WIDTH / row.photo.image.shape[1]
    for mask, colour in ((row.photo.truth, GREEN), (row.mask, RED)):
        outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(tile, outlines, -1, colour, 1, cv2.LINE_AA)
    if row.hint is not None:
        cv2.drawMarker(tile, (round(row.hint[0]), round(row.hint[1])), YELLOW, cv2.MARKER_CROSS, 14, 2)
    small = np.asarray(cv2.resize(tile, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    text = f"{row.photo.name}  {'pixel' if row.hint else 'no hint'}  F {row.f:.2f}  IoU {row.iou:.2f}"
    cv2.putText(small, text, (6, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, RED, 1, cv2.LINE_AA)
    return small


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--pictures", type=Path, help="folder for pictures of what ours did not find")
    args, photos = common.parse_with_photos(parser)
    common.begin_section("Segmentation: photos of one tool each against their masks")
    for segment in METHODS.values():
        segment(photos[0].image, None)  # what is loaded on first use is no part of what is timed
    rows = [
        judge_method(p, m, p.deepest() if hint else None) for m in METHODS for hint in (False, True) for p in photos
    ]
    show_scores(photos, rows)
    if args.pictures is not None:
        args.pictures.mkdir(parents=True, exist_ok=True)
        for row in rows:
            if row.method == "ours" and not row.enough:
                name = f"{row.photo.name}{'-pixel' if row.hint else ''}.png"
                cv2.imwrite(str(args.pictures / name), draw_comparison(row))
    common.write_sections(args.output)


if __name__ == "__main__":
    main()
