# SPDX-License-Identifier: Apache-2.0
"""The flat objects in an image seen for the first time: many proposals, one choice, and what a person says of it.

Thresholds propose regions of one grey level, closed edges those of several, a segmenter what it knows. One worth
orders all (`grasptrack.segmentation.choice`), and the likeliest become sub-pixel contours.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.errors import InputError, ObservationError
from grasptrack.geometry.contours import View
from grasptrack.segmentation.background import background_maps
from grasptrack.segmentation.candidate import Candidate, contains_pixel, of_closed_edges, of_one_level
from grasptrack.segmentation.choice import choice_probabilities, load_numbers, measure_worth
from grasptrack.segmentation.closed_edges import ClosedEdgeSegmenter
from grasptrack.segmentation.hints import BESIDE, Hints, box_iou, make_hints
from grasptrack.segmentation.images import as_scene, to_bgr, to_grey, to_mask
from grasptrack.segmentation.normalized_gradient import Planes, lab_planes
from grasptrack.segmentation.proposals import GIVEN, THRESHOLD, Proposal, is_alike, propose_silhouettes
from grasptrack.segmentation.rating import NONE, SilhouetteScorer
from grasptrack.segmentation.segmenters import OneMask, Region, Segmenter, segmenter_for
from grasptrack.segmentation.several_frames import ask_more_frames
from grasptrack.segmentation.shadow import without_shadow
from grasptrack.segmentation.silhouettes import Silhouette, trace_silhouettes
from grasptrack.segmentation.snapping import outline_agreement, polygon_silhouette, snap_polygon
from grasptrack.segmentation.work import CONTOUR, CONTOUR_PX, GRADIENTS, PREPARED, Work, check_limit_ms
from grasptrack.typing import Floats

DEFAULT_SURE = 0.9
"""Probability from which the first look calls a candidate sure."""
MIN_EXTENT = 20
"""px across; a smaller object has no outline worth following."""
COMPARED = 40
"""Proposals that are compared, the best rated first, and as many of a segmenter's."""
LOOKED_AT = 8
"""Proposals that become contours, the likeliest first; after them only those that lie apart from all that was found."""
SHADOWS = 3
"""Objects that are looked at for a shadow, the likeliest first."""
MOST = 60
"""Proposals that become contours at all."""
WORTH = 0.02
"""Ratings below this are chance, ..."""
FAINT = 0.3
"""... and those below this share of the best are clutter beside it."""
CUT = 3
"""Regions cut by the image's border that are offered although their rating is faint for that, the best rated ones. They come
after what is whole: the ground is cut too."""
APART = 0.65
"""Overlap of boxes, and ratio of areas, below which regions are other ones."""
MOSTLY = 0.75
"""Share of an outline within another one that makes it a part of that."""
ROUGH = 3.0
"""px by which a segmenter's outline may be off: its map is coarser than the image."""
AGREEING, ALL_ROUND = 8.0, 0.97
"""px from a polygon that a person drew within which a proposal agrees with it, and the share of both outlines that must."""
DRAWN = 12.0
"""px by which such a polygon may be off where no proposal agrees, ..."""
MOVED = 8.0
"""... as a whole so many."""
FALLBACK_RECIPE = 2
"""Of `closed_edges.RECIPES`: looks for what no way of looking found by itself."""


def first_look(
    image: NDArray[Any],
    object_at: ArrayLike | None = None,
    *,
    not_at: ArrayLike | None = None,
    box: Sequence[float] | None = None,
    outline: ArrayLike | None = None,
    ignore: NDArray[Any] | None = None,
    mask: NDArray[Any] | None = None,
    segmenter: Any = None,
    background: NDArray[Any] | None = None,
    more: Iterable[NDArray[Any]] = (),
    sure: float = DEFAULT_SURE,
    first_look_ms: float | None = None,
) -> list[Candidate]:
    """What in an image may be the object that is meant, the likeliest first; nested ones stay, each region is there once.

    Args:
        image: 8 or 16 bit, grey, BGR or BGRA.
        object_at: (x, y) px of the object that is meant, or several such, all on it.
        not_at: (x, y) px, or several such, none on it.
        box: left, top, width and height of it, px.
        outline: (n, 2) px of a rough polygon round it. It is moved onto the edges beside it, and kept where there are none.
        ignore: (H, W) nonzero where nothing belongs to the scene.
        mask: (H, W) nonzero on objects: your own segmentation, which takes the image's place.
        segmenter: as `segmenter_for` takes it: "classical" (default), "onnx:FILE", a name, an object or a function.
        background: an image of the same bench without the object, from the same place up to a few px; the light may differ.
        more: images that follow, from a camera that moves: while nothing is sure and no person has said which object is meant,
            up to four are asked. What lies on the bench gains, reflections lose.
        sure: probability, 0 or more and below 1, from which a candidate is called sure: larger asks more often and errs
            less; 0 takes the first without a question.
        first_look_ms: work that the own search may do, ms on the machine of the benchmarks; None is no bound but that of the
            search itself. No clock is read: the same image gives the same answer. A segmenter's net is not counted.

    Returns:
        Candidates with `view`, `probability` and `sure`.

    Raises:
        ObservationError: no object, or none there.
        InputError: hints, a mask or a background that do not fit the image, a segmenter that cannot be had.
    """
    check_sure(sure)
    colours = to_bgr(image)
    hints = make_hints(colours.shape[:2], object_at, not_at, box, outline, ignore, background)
    hints = replace(hints, first_look_ms=check_limit_ms(first_look_ms))
    scene = colours
    if mask is not None:
        scene = as_scene(to_mask(mask, colours.shape[:2], "mask"))
        hints = replace(hints, masked=True)
    found = find_candidates(scene, hints, segmenter_for(segmenter), more, sure)
    return [c._replace(sure=c.probability >= sure) for c in found]


def segment_object(
    image: NDArray[Any],
    object_at: ArrayLike | None = None,
    ignore: NDArray[Any] | None = None,
    box: Sequence[float] | None = None,
) -> View:
    """Outline of the flat object that stands out in an image, or of the one under a pixel or in a box.

    Args and errors as of `first_look`.
    """
    return first_look(image, object_at, box=box, ignore=ignore)[0].view


def find_objects(
    image: NDArray[Any],
    object_at: ArrayLike | None = None,
    box: Sequence[float] | None = None,
    ignore: NDArray[Any] | None = None,
    mask: NDArray[Any] | None = None,
    *,
    not_at: ArrayLike | None = None,
    outline: ArrayLike | None = None,
    segmenter: Any = None,
    background: NDArray[Any] | None = None,
    number: int | None = None,
    first_look_ms: float | None = None,
) -> list[Candidate]:
    """All flat objects in an image, none within another: the one that is meant first, then the likeliest.

    Args and errors as of `first_look`; `number` as of `numbered_candidate`.
    """
    asked: dict[str, Any] = {
        "ignore": ignore,
        "mask": mask,
        "segmenter": segmenter_for(segmenter),
        "background": background,
        "first_look_ms": first_look_ms,
    }
    meant = first_look(image, object_at, not_at=not_at, box=box, outline=outline, **asked)
    if object_at is None and box is None and outline is None:
        return remove_nested([numbered_candidate(meant, number), *meant])
    try:
        others = first_look(image, **asked)
    except ObservationError:
        others = []
    return remove_nested([numbered_candidate(meant, number), *others])


def remove_nested(found: list[Candidate]) -> list[Candidate]:
    """Those that neither lie within a better one, as its parts do, nor round it."""
    kept: list[Candidate] = []
    for c in found:
        if not any(_share_within(c.view, o.view) + _share_within(o.view, c.view) > 0.5 for o in kept):
            kept.append(c)
    return kept


def distinct_candidates(found: Sequence[Candidate], most: int = 3) -> list[Candidate]:
    """The likeliest candidates that a person would tell apart."""
    kept: list[Candidate] = []
    for c in found:
        if len(kept) < most and not any(_is_same_region(c.view, o.view) for o in kept):
            kept.append(c)
    return kept


def numbered_candidate(found: Sequence[Candidate], number: int | None) -> Candidate:
    """Of the candidates that a person would tell apart the one with a number, 1 being the likeliest; the likeliest of None.

    Raises:
        InputError: there are fewer.
    """
    told_apart = distinct_candidates(found, number or 1)
    if len(told_apart) < (number or 1):
        raise InputError(f"there are {len(told_apart)} candidates, not {number}", number=number)
    return told_apart[-1]


def check_sure(sure: float, what: str = "sure") -> float:
    """The probability from which the choice of an object is sure.

    Raises:
        InputError: below 0, or 1 and more, which nothing reaches.
    """
    if not 0.0 <= sure < 1.0:
        raise InputError(f"{what} is a probability, 0 or more and below 1, not {sure:g}", sure=sure)
    return sure


def describe_candidate(candidate: Candidate, first: Candidate) -> str:
    """How a candidate lies to the first one, for a person: "round it, 3.1 times as large", "within it", "elsewhere"."""
    times = candidate.view.outer.area / first.view.outer.area
    cut = ", cut by the image's border" if candidate.view.is_clipped else ""
    if _share_within(first.view, candidate.view) > MOSTLY:
        return f"round it, {times:.1f} times as large{cut}"
    if _share_within(candidate.view, first.view) > MOSTLY:
        return f"within it, {100.0 * times:.0f} % of its area{cut}"
    return f"elsewhere{cut}"


def find_candidates(
    image: NDArray[Any],
    hints: Hints | None = None,
    segmenter: Segmenter | None = None,
    more: Iterable[NDArray[Any]] = (),
    sure: float = DEFAULT_SURE,
) -> list[Candidate]:
    """As `first_look`, of hints that were checked.

    Raises:
        ObservationError: no object, or none there.
        InputError: a segmenter's region of another size.
    """
    hints = Hints() if hints is None else hints
    look = _Look(to_bgr(image), hints, segmenter)
    found = look.candidates()
    if not found:
        raise _no_object_error(look.meant, hints)
    if hints.names_object or hints.masked or isinstance(segmenter, OneMask):
        return found
    later = replace(hints, not_at=(), background=None)  # they are of the first image
    return ask_more_frames(found, look.colours, more, lambda seen: find_candidates(seen, later, segmenter), sure)


class _Rated(NamedTuple):
    """A proposal, its probability, and of the first its lead as of `Candidate`."""

    proposal: Proposal
    probability: float
    lead: float = math.nan


class _Look:
    """One image: what is proposed in it, and what becomes of that."""

    def __init__(self, colours: NDArray[np.uint8], hints: Hints, segmenter: Segmenter | None) -> None:
        self.colours, self._hints = colours, hints
        self._grey = to_grey(colours)
        self._planes: Planes = lab_planes(colours)
        self._edges = ClosedEdgeSegmenter(self._planes, hints.hidden)
        self._alone = isinstance(segmenter, OneMask)
        maps = (
            [] if segmenter is None or hints.masked else _as_maps(segmenter.regions(colours, hints), self._grey.shape)
        )
        if hints.background is not None:
            if self._alone or hints.masked:
                raise InputError("a background and a mask both say where the object is: give one of them")
            maps += background_maps(colours, hints.background, hints.hidden)
        self._map = np.mean(maps, axis=0).astype(np.float32) if maps and not self._alone else None
        self._work = Work(hints.first_look_ms)
        reduced = self._edges.fields[0].strength.size
        self._work.spend((PREPARED * self._grey.size + GRADIENTS * reduced) / 1e6)
        self._strength = self._edges.fields[0].strength
        self._proposals = self._propose(maps)
        self.meant = [p for p in self._proposals if hints.allows(p.silhouette)]

    def candidates(self) -> list[Candidate]:
        """Contours of the likeliest proposals, the likeliest first."""
        drawn = self._drawn()
        if drawn is not None:
            return drawn
        return self._localized(self._rated())

    def _propose(self, maps: list[NDArray[np.float32]]) -> list[Proposal]:
        hints = self._hints
        if self._alone:
            rater = SilhouetteScorer(self._edges.fields[0], self._edges.shrink, self._grey.shape)
            shapes = [polygon for each in maps for polygon in _regions_of(each)]
            return [Proposal(s, rater.rate(s), 0, math.nan, 0.0, GIVEN) for s in shapes]
        return propose_silhouettes(self._grey, self._edges, hints.hidden, hints.masked, MIN_EXTENT, maps, self._work)

    def _rated(self) -> list[_Rated]:
        """The proposals that are meant, each region once, with probabilities, the likeliest first."""
        if self._alone:
            return [_Rated(p, 1.0) for p in self.meant[:COMPARED]]
        compared = self.compared()
        numbers = load_numbers(self._map is not None)
        if self._hints.background is not None:  # a person's word, as a box is
            numbers = numbers._replace(map_power=numbers.box_power)
        worth = measure_worth(compared, self._map, self._hints.box, numbers)
        meant = [k for k, p in enumerate(compared) if self._hints.allows(p.silhouette)]
        kept: list[int] = []
        for k in sorted(meant, key=lambda k: -worth[k]):
            if not any(is_alike(compared[k].silhouette, compared[j].silhouette) for j in kept):
                kept.append(k)
        if not kept:
            return []
        first = compared[kept[0]]
        rivals = [k for k in kept[1:] if _is_another(compared[k].silhouette, first.silhouette)]
        lead = float(worth[kept[0]] - worth[rivals].max(initial=-math.inf))
        share = choice_probabilities(worth[kept], lead, first.rating.score, numbers)
        leads = [lead, *[math.nan] * (len(kept) - 1)]
        return [_Rated(compared[k], float(p), a) for k, p, a in zip(kept, share, leads, strict=True)]

    def compared(self) -> list[Proposal]:
        """The best rated proposals of the image and of those that are meant, of a segmenter's as many."""
        large = [p for p in self._proposals if max(p.silhouette.box[2:]) >= MIN_EXTENT and p.rating is not NONE]
        found: dict[int, Proposal] = {}
        for p in sorted([p for p in large if _is_cut(p)], key=lambda p: -p.rating.score_in_view)[:CUT]:
            found[id(p)] = p
        for pool in (large, [p for p in large if self._hints.allows(p.silhouette)]):
            for own in (False, True):
                for p in [p for p in pool if (p.recipe == GIVEN) is own][:COMPARED]:
                    found[id(p)] = p
        return list(found.values())

    def _drawn(self) -> list[Candidate] | None:
        """What a rough polygon is: the best rated proposal that agrees with it all round, else the polygon moved onto the edges
        beside it. None where there is no polygon.

        Raises:
            ObservationError: it is too small.
        """
        polygon = self._hints.outline
        if polygon is None:
            return None
        for p in sorted(self._proposals, key=lambda p: -p.worth):
            if _is_beside(p.silhouette, polygon) and outline_agreement(p.silhouette, polygon, AGREEING) >= ALL_ROUND:
                found = self._localize(p, False, False)
                if found is not None:
                    return [found._replace(probability=1.0, rating=p.rating.score)]
        shape = None
        for moved in (MOVED, 0.0):
            snapped = snap_polygon(self._strength, self._edges.shrink, polygon, DRAWN, moved)
            shape = polygon_silhouette(snapped, self._grey.shape)
            if shape is not None:
                break
        if shape is None or max(shape.box[2:]) < MIN_EXTENT:
            raise ObservationError(f"the outline that was drawn is less than {MIN_EXTENT} px across")
        candidate = of_closed_edges(self.colours, self._planes, shape, self._hints.hidden)
        if candidate is None:
            raise ObservationError("the outline that was drawn lies beyond the image for the most part")
        return [self._findable(candidate._replace(probability=1.0), shape)]

    def _localized(self, rated: list[_Rated]) -> list[Candidate]:
        """The likeliest as contours, each region once."""
        found: list[Candidate] = []
        taken = np.zeros(self._grey.shape, np.uint8)
        looked = cut = 0
        own = max((r.proposal.rating.score for r in rated if r.proposal.recipe != GIVEN), default=0.0)
        least = 0.0 if self._alone else max(WORTH, FAINT * own)
        for p, probability, lead in rated:
            if looked >= MOST:
                break
            offered = False
            if p.recipe != GIVEN and p.rating.score < least:
                offered = cut < CUT and _is_cut(p) and p.rating.score_in_view >= least
                if not offered or not (found or self._hints.names_object):  # alone it is the ground of an empty image
                    continue
                cut += 1
            part = _overlaps_found(p.silhouette, taken, found)
            if part and looked >= LOOKED_AT and not offered:
                continue
            cost = CONTOUR + CONTOUR_PX * self._grey.size / 1e6
            if found and not self._work.allows(cost):
                break
            self._work.spend(cost)
            looked += 1
            candidate = self._localize(p, part, len(found) < SHADOWS and not part and not self._alone)
            if candidate is None or any(_is_same_region(candidate.view, other.view) for other in found):
                continue
            if self._hints.object_at and not all(_on_or_beside(candidate.view, *at) for at in self._hints.object_at):
                continue
            found.append(candidate._replace(probability=probability, rating=p.rating.score, lead=lead))
            cv2.drawContours(taken, [p.silhouette.outer.reshape(-1, 1, 2)], -1, (255,), cv2.FILLED)
        return found

    def _localize(self, p: Proposal, part: bool, shaded: bool) -> Candidate | None:
        """The sub-pixel contour of a proposal, without the shadow that its object casts."""
        hidden, cut = self._hints.hidden, False
        if p.recipe == GIVEN:
            snapped = snap_polygon(self._strength, self._edges.shrink, p.silhouette.outer.astype(np.float64), ROUGH)
            shape = polygon_silhouette(snapped, self._grey.shape)
            if shape is None:
                return None
            found = of_closed_edges(self.colours, None if part else self._planes, shape, hidden)
            return None if found is None else self._findable(found, shape)
        if shaded:
            p, cut = self._out_of_shadow(p)
        if p.recipe == THRESHOLD and not cut:
            found = of_one_level(self._grey, p.silhouette, p.polarity, hidden)
        else:
            found = of_closed_edges(self.colours, None if part else self._planes, p.silhouette, hidden)
        if found is None:
            return None
        return found._replace(level=p.level, recipe=p.recipe, grain=p.grain, shaded=cut)

    def _out_of_shadow(self, p: Proposal) -> tuple[Proposal, bool]:
        """A proposal without the shadow that its object casts, and whether it had to be cut out: where another proposal
        is the object alone, that one is taken."""
        alone = without_shadow(self.colours, p.silhouette)
        if alone is None:
            return p, False
        alike = [other for other in self._proposals if is_alike(other.silhouette, alone)]
        return (alike[0], False) if alike else (p._replace(silhouette=alone), True)

    def _findable(self, candidate: Candidate, shape: Silhouette) -> Candidate:
        """A given candidate with the way in which the own search finds nearly the same region, for later images."""
        own = [p for p in self._proposals if p.recipe != GIVEN]
        alike = next((p for p in own if is_alike(p.silhouette, shape)), None)
        if alike is not None and (alike.recipe != THRESHOLD or candidate.polarity == alike.polarity):
            return candidate._replace(level=alike.level, recipe=alike.recipe, grain=alike.grain)
        if candidate.polarity and candidate.inside != candidate.outside:
            return candidate._replace(level=0.5 * (candidate.inside + candidate.outside), recipe=THRESHOLD)
        field = self._edges.fields[0]
        return candidate._replace(recipe=FALLBACK_RECIPE, grain=field.unit)


def _is_beside(shape: Silhouette, polygon: Floats) -> bool:
    """Whether the boxes of a region and a polygon may agree."""
    x, y, w, h = shape.box
    (left, top), (right, bottom) = polygon.min(axis=0).tolist(), polygon.max(axis=0).tolist()
    return bool(max(abs(x - left), abs(y - top), abs(x + w - right), abs(y + h - bottom)) < 3.0 * AGREEING)


def _is_cut(p: Proposal) -> bool:
    """Whether the image's border cuts a region."""
    return 0.0 < p.rating.complete < 1.0


def _is_another(shape: Silhouette, first: Silhouette) -> bool:
    """Whether a region is plainly another one."""
    return box_iou(shape.box, first.box) < APART or not APART < shape.area / first.area < 1.0 / APART


def _as_maps(regions: Sequence[Region], size: tuple[int, ...]) -> list[NDArray[np.float32]]:
    """(H, W) each, 0 to 1.

    Raises:
        InputError: a mask of another size.
    """
    found = []
    for region in regions:
        mask = np.asarray(region.mask)
        if np.issubdtype(mask.dtype, np.floating):
            if mask.shape != tuple(size):
                raise InputError(
                    f"a segmenter's mask is {mask.shape}, but the image is {size[1]}x{size[0]} px", shape=mask.shape
                )
            plane = np.clip(np.nan_to_num(mask), 0.0, 1.0)
        else:
            plane = to_mask(mask, tuple(size), "segmenter's mask") / 255.0
        found.append((plane * float(np.clip(region.probability, 0.0, 1.0))).astype(np.float32))
    return found


def _regions_of(map_: NDArray[np.float32]) -> list[Silhouette]:
    return trace_silhouettes(np.where(map_ > 0.5, np.uint8(255), np.uint8(0)), 30.0, holes=False)


def _on_or_beside(view: View, x: float, y: float) -> bool:
    """Whether a pixel lies within the outer contour or just beside it."""
    outer = view.outer.points.astype(np.float32)
    return cv2.pointPolygonTest(outer, (float(x), float(y)), True) >= -BESIDE


def _overlaps_found(shape: Silhouette, taken: NDArray[np.uint8], found: list[Candidate]) -> bool:
    """Whether a silhouette lies within what was taken, or round it, at least for a good part."""
    if not found:
        return False
    column, row = shape.outer.T
    if taken[row.clip(0, taken.shape[0] - 1), column.clip(0, taken.shape[1] - 1)].mean() > 0.4 * 255.0:
        return True
    corners = (c.view.outer.points[k * len(c.view.outer) // 3] for c in found for k in range(3))
    return any(shape.contains(x, y) for x, y in (corner.tolist() for corner in corners))


def _no_object_error(meant: list[Proposal], hints: Hints) -> ObservationError:
    """Why there is no object."""
    where = hints.where()
    tiny = max((e for p in meant if (e := max(p.silhouette.box[2:])) < MIN_EXTENT), default=0)
    if tiny >= 5:
        return ObservationError(
            f"the object{where} is {tiny} px across; at least {MIN_EXTENT} px are needed", extent=tiny
        )
    return ObservationError(f"no object stands out{where or ' in the image'}", object_at=hints.object_at, box=hints.box)


def _is_same_region(one: View, other: View, share: float = 0.1) -> bool:
    """Whether two outlines are of the same region, found in different ways."""
    area, a = one.outer.area, other.outer.area
    apart_by = one.outer.points.mean(axis=0) - other.outer.points.mean(axis=0)
    return 1.0 - 2.0 * share < area / a < 1.0 / (1.0 - 2.0 * share) and math.hypot(
        *apart_by.tolist()
    ) < share * math.sqrt(a)


def _share_within(inner: View, outer: View) -> float:
    """Share of an outline's points, of some thirty, that lie within another."""
    points = inner.outer.points[:: max(1, len(inner.outer) // 30)].tolist()
    return sum(contains_pixel(outer, x, y) for x, y in points) / len(points)
