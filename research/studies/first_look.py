# SPDX-License-Identifier: Apache-2.0
"""The first look on photos: is the object found first, or among three; is its probability true; and the fit of its numbers.

With `--segmenter u2netp` (see `grasptrack models`) the net's map takes part. `--parts` adds the first images of all scenes of
the suite with these parts, but those that show a part's sides. `--fit` fits what `choice.json` says of probabilities to hints
of a place, to contacts and to polygons, and leaves out each kind of object, or of scene, in turn for the figures beside it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np

from grasptrack.errors import ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.nets.salient import SalientNet
from grasptrack.segmentation.candidate import distinct_candidates
from grasptrack.segmentation.candidate_search import CandidateSearch
from grasptrack.segmentation.choice import Signs
from grasptrack.segmentation.first_look import look_for
from grasptrack.segmentation.proposals import GIVEN, THRESHOLD
from grasptrack.segmentation.segmenters import Region, Segmenter, segmenter_for
from grasptrack.typing import Bools, Floats, Pixels
from grasptrack_bench.scenes import built_in, make_scene_cases
from grasptrack_bench.simulation.coverage import inside_mask
from grasptrack_bench.simulation.disturbances import DISTURBANCES
from research.studies import common
from research.studies.common import Photo, is_found, is_mask_found
from research.studies.first_kinds import KINDS, draw_frame, true_masks
from research.studies.polygons import mask_corners, move_corners

HINTS = ("nothing", "pixel", "box", "polygon", "contacts")
BINS = (0.0, 0.25, 0.5, 0.7, 0.8, 0.9, 1.0)
FITTED = {"without map": ("nothing", "pixel", "box"), "at contacts": ("contacts",)}
"""Hints that numbers are fitted to: what lies round an outline counts at contacts alone."""
SURE = 0.9
SURE_HEADER = ["hint", "of", "looks", f"sure at {SURE:g}", "of these right"]
SIDES = ("aside", "bevel", "block", "thick", "thick-6")
"""Scenes that show a part's sides, which belong to its outline in the first image, and not to the truth."""
AROUND = 4
"""Of `Signs.terms`, that of what lies round an outline."""
BENCH = "suite"
PHOTO_WEIGHT = 4.0
"""Of a look at a photo beside one at a rendered image: there are fewer."""
RIDGE = 1.5
"""Of the logistic fit, on the weights of terms of unit variance: the terms are few and the photos, too."""


@dataclass(frozen=True)
class PhotoLook:
    """What the first look made of one photo with one hint."""

    kind: str
    scene: str
    hint: str
    first: bool
    three: bool
    probability: float
    signs: Signs
    ms: float


class Remembered:
    """A segmenter that knows nothing of hints, asked once for each image, however often the same image is looked at."""

    def __init__(self, segmenter: Segmenter) -> None:
        self._segmenter, self._of, self._found = segmenter, -1, list[Region]()

    def regions(self, image: Pixels, hints: FirstImage) -> Sequence[Region]:
        """See Segmenter."""
        if self._of != image.ctypes.data:
            self._of, self._found = image.ctypes.data, list(self._segmenter.regions(image, hints))
        return self._found


def evaluate_photo(photo: Photo, hint: str, segmenter: Any) -> PhotoLook:
    """One photo with one hint: the deepest pixel of the mask, its bounding box, a rough polygon, or contacts on it."""
    told: dict[str, Any] = {}
    if hint == "pixel":
        told["object_at"] = photo.deepest()
    if hint == "box":
        y, x = np.nonzero(photo.truth)
        told["box"] = float(x.min()), float(y.min()), float(np.ptp(x)) + 1.0, float(np.ptp(y)) + 1.0
    if hint == "polygon":
        told["outline"] = move_corners(mask_corners(photo.truth), 0)
    if hint == "contacts":
        told["grasp"] = photo.contacts()
    start = time.perf_counter()
    try:
        found = look_for(photo.image, FirstImage.of(**told), segmenter)
    except ObservationError:
        found = []
    ms = (time.perf_counter() - start) * 1e3
    right = [is_found(photo.truth, c.view) for c in distinct_candidates(found)]
    first = found[0] if found else None
    return PhotoLook(
        photo.kind,
        photo.scene,
        hint,
        bool(right and right[0]),
        any(right),
        first.probability if first else 0.0,
        Signs(
            float(np.nan_to_num(first.rating)),
            float(np.nan_to_num(first.lead, posinf=math.inf)),
            float(np.nan_to_num(first.returned)),
            float(np.nan_to_num(first.thin)),
            float(np.nan_to_num(first.neck, nan=1.0)),
            float(np.nan_to_num(first.cut)),
            float(np.nan_to_num(first.toned)),
            float(np.nan_to_num(first.around)),
        )
        if first
        else Signs(0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0),
        ms,
    )


def suite_images(parts: Sequence[str], seed: int) -> list[Photo]:
    """The first image of each scene of the suite, and of each kind of `first_kinds`, with these parts, as photos of kinds."""
    names = [name for name in DISTURBANCES if name not in SIDES]
    made = []
    for case in make_scene_cases(built_in(parts), names, frames=2, seed=seed):
        frame = case.scene()[0]
        truth = inside_mask(frame.outline, frame.image.shape[1], frame.image.shape[0])
        made.append(Photo(case.name, case.disturbance, BENCH, frame.image, truth, frame.outline))
    for kind in KINDS:
        for part in built_in(parts):
            drawn = draw_frame(kind, part.shape, seed)
            truth = true_masks(drawn)[-1]
            made.append(Photo(f"{part.shape.name}.{kind}", kind, BENCH, drawn.image, truth, drawn.outline))
    return made


def generator_rows(photos: Sequence[Photo], segmenter: Segmenter | None) -> list[list[Any]]:
    """For each source of proposals: of how many photos it holds a right one, given the pixel, and of how many no other does."""
    held: dict[str, list[bool]] = {}
    for photo in photos:
        hints = FirstImage.of(photo.deepest()).within(photo.image.shape)
        right = dict.fromkeys(("thresholds", "closed edges", "quadrangles and the segmenter"), False)
        for proposal in CandidateSearch(photo.image, hints, segmenter).meant:
            source = list(right)[2 if proposal.recipe == GIVEN else int(proposal.recipe != THRESHOLD)]
            mask = np.zeros(photo.truth.shape, np.uint8)
            cv2.drawContours(mask, [proposal.silhouette.outer.reshape(-1, 1, 2)], -1, (1,), cv2.FILLED)
            right[source] |= is_mask_found(photo.truth, mask > 0)
        for source, one in right.items():
            held.setdefault(source, []).append(one)
    table = np.array(list(held.values()))
    alone = table & (table.sum(axis=0) == 1)
    rows: list[list[Any]] = [
        [source, 100.0 * float(one.mean()), 100.0 * float(own.mean())]
        for source, one, own in zip(held, table, alone, strict=True)
    ]
    return [*rows, ["all together", 100.0 * float(table.any(axis=0).mean()), math.nan]]


def fit_logistic(terms: Floats, right: Bools, factor: Floats | float = 1.0, counts: Floats | float = 1.0) -> Floats:
    """(1 + k,) constant and weights of a logistic function of terms (n, k), with a ridge; what it is multiplied by is given,
    and how much each look counts. No weight is negative: what speaks for an outline never makes it less likely."""
    from scipy.optimize import minimize  # of the development extras

    middle, spread = terms.mean(axis=0), terms.std(axis=0) + 1e-9
    scaled = np.column_stack([np.ones(len(terms)), (terms - middle) / spread])

    def logistic_cost(weights: Floats) -> float:
        told = np.clip(factor / (1.0 + np.exp(-scaled @ weights)), 1e-9, 1.0 - 1e-9)
        return float(RIDGE * (weights[1:] ** 2).sum() - (counts * np.log(np.where(right, told, 1.0 - told))).sum())

    bounds = [(None, None)] + [(0.0, None)] * terms.shape[1]
    found = np.asarray(minimize(logistic_cost, np.zeros(scaled.shape[1]), bounds=bounds).x, dtype=np.float64)
    slopes = found[1:] / spread
    return np.concatenate([[found[0] - float(slopes @ middle)], slopes])


def fitted_terms(looked: Sequence[PhotoLook]) -> Floats:
    """(n, k) what a logistic function weighs of each look."""
    terms = np.array([r.signs.terms for r in looked])
    terms[:, AROUND] *= [r.hint == "contacts" for r in looked]
    return terms


def look_counts(looked: Sequence[PhotoLook]) -> Floats:
    """(n,) how much each look counts."""
    return np.array([1.0 if r.scene == BENCH else PHOTO_WEIGHT for r in looked])


def cross_validated(looked: Sequence[PhotoLook]) -> Floats:
    """(n,) probabilities of being right, those of each kind of object by a fit to the others."""
    terms, ties = fitted_terms(looked), np.array([r.signs.factor for r in looked])
    right, kinds = np.array([r.first for r in looked]), np.array([r.kind for r in looked])
    told, counts = np.zeros(len(looked)), look_counts(looked)
    for kind in set(kinds.tolist()):
        mine = kinds == kind
        weights = fit_logistic(terms[~mine], right[~mine], ties[~mine], counts[~mine])
        told[mine] = ties[mine] / (1.0 + np.exp(-weights[0] - terms[mine] @ weights[1:]))
    return told


def reliability_rows(told: Floats, right: Bools) -> list[list[Any]]:
    """For each bin of a probability: how many there are, how many are right as told, and how many are."""
    rows: list[list[Any]] = []
    for low, high in pairwise(BINS):
        mine = (told >= low) & (told < high + (high == 1.0))
        if mine.any():
            rows.append([f"{low:g} to {high:g}", int(mine.sum()), float(told[mine].sum()), int(right[mine].sum())])
    return rows


def report_fit(looked: Sequence[PhotoLook], name: str) -> None:
    """The numbers of probabilities fitted to some hints, and what they are worth on kinds that were left out."""
    fitted = [r for r in looked if r.hint in FITTED[name] and r.probability > 0.0]
    if not fitted:
        return
    right = np.array([r.first for r in fitted])
    ties = np.array([r.signs.factor for r in fitted])
    weights = fit_logistic(fitted_terms(fitted), right, ties, look_counts(fitted))
    wrong = [r for r in fitted if not r.first]
    among = float(np.mean([r.three for r in wrong])) if wrong else 0.0
    names = ("offset", "rating", "returned", "thin", "cut", "around", "neck")
    numbers = ", ".join(f'"{name}": {w:.2f}' for name, w in zip(names, weights.tolist(), strict=True))
    common.add_paragraph(f'"{name}", fitted to {len(fitted)} looks: {numbers}, "among": {among:.2f}')
    told = cross_validated(fitted)
    common.add_paragraph("Each kind of object, or of scene, by a fit to the others:")
    common.add_table(SURE_HEADER, sure_rows(fitted, told))
    common.add_table(["probability, these hints", "looks", "right as told", "right"], reliability_rows(told, right))


def report_drawn_fit(looked: Sequence[PhotoLook]) -> None:
    """The numbers of the probability of what was drawn."""
    drawn = [r for r in looked if r.hint == "polygon" and r.probability > 0.0 and r.scene != BENCH]
    terms = np.array([[r.signs.terms[1]] for r in drawn])
    offset, returned = fit_logistic(terms, np.array([r.first for r in drawn])).tolist()
    common.add_paragraph(f'Fitted to {len(drawn)} polygons: "offset": {offset:.2f}, "returned": {returned:.2f}')


def sure_rows(looked: Sequence[PhotoLook], told: Floats) -> list[list[Any]]:
    """By hint, of photos and of the suite: how many are sure by these probabilities, and how many of these are right."""
    right, rows = np.array([r.first for r in looked]), list[list[Any]]()
    for hint in (h for hints in FITTED.values() for h in hints):
        for name in ("photos", BENCH):
            mine = np.array([r.hint == hint and (r.scene == BENCH) is (name == BENCH) for r in looked])
            if mine.any():
                sure = mine & (told >= SURE)
                rows.append([hint, name, int(mine.sum()), int(sure.sum()), int(right[sure].sum())])
    return rows


def main() -> None:
    """Run the study."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--segmenter", help='as `track --segmenter`; "classical" if not given')
    parser.add_argument(
        "--parts", type=lambda text: text.split(","), default=[], help="shapes of the suite, with commas"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the suite's scenes")
    parser.add_argument("--hints", type=lambda text: text.split(","), default=HINTS, help="with commas")
    parser.add_argument("--fit", action="store_true", help="print numbers of probabilities fitted to these photos")
    args, photos = common.parse_with_photos(parser)
    photos += suite_images(args.parts, args.seed) if args.parts else []
    given = segmenter_for(args.segmenter)
    segmenter = Remembered(given) if isinstance(given, SalientNet) else given
    common.begin_section(f"First look: photos of one tool each, {args.segmenter or 'classical'}")
    looked = [evaluate_photo(photo, hint, segmenter) for photo in photos for hint in args.hints]
    rows = []
    for hint in args.hints:
        for scene in [*sorted({r.scene for r in looked}), "all"]:
            mine = [r for r in looked if r.hint == hint and scene in (r.scene, "all")]
            shares = [100.0 * float(np.mean([getattr(r, what) for r in mine])) for what in ("first", "three")]
            rows.append([hint, scene, len(mine), *shares, *np.percentile([r.ms for r in mine], (50, 99)).tolist()])
    common.add_table(["hint", "scene", "photos", "first %", "one of three %", "median ms", "99 % ms"], rows)
    common.add_paragraph(
        "The time of a net that maps salient objects is in the first hint's alone: it is asked once for each photo."
    )
    mine = [r for r in looked if r.hint == args.hints[0]]
    told, right = np.array([r.probability for r in mine]), np.array([r.first for r in mine])
    common.add_table(
        [f"probability, {args.hints[0]}", "photos", "right as told", "right"], reliability_rows(told, right)
    )
    common.add_table(SURE_HEADER, sure_rows(looked, np.array([r.probability for r in looked])))
    common.add_paragraph("Photos with a right region among all that are proposed, given the pixel:")
    common.add_table(["source", "holds one, %", "alone, %"], generator_rows(photos, segmenter))
    if args.fit:
        for name in FITTED:
            report_fit(looked, name)
        if "polygon" in args.hints:
            report_drawn_fit(looked)
    common.write_sections(args.output)


if __name__ == "__main__":
    main()
