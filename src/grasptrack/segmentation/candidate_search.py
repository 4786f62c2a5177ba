# SPDX-License-Identifier: Apache-2.0
"""The candidates of one image: what is proposed in it, which of that is meant, and what becomes sub-pixel contours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError, ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import View
from grasptrack.images import to_grey, to_mask
from grasptrack.segmentation.background import background_maps
from grasptrack.segmentation.candidate import Candidate, of_closed_edges, of_one_level
from grasptrack.segmentation.choice import Signs, choice_probabilities, drawn_probability, load_numbers, measure_worth
from grasptrack.segmentation.closed_edges import ClosedEdgeSegmenter
from grasptrack.segmentation.normalized_gradient import Planes, lab_planes
from grasptrack.segmentation.proposals import GIVEN, THRESHOLD, Proposal, is_alike, propose_silhouettes
from grasptrack.segmentation.quadrangles import find_quadrangles
from grasptrack.segmentation.rating import NONE, SilhouetteScorer
from grasptrack.segmentation.regions import Region, Segmenter
from grasptrack.segmentation.segmenters import OneMask
from grasptrack.segmentation.shadow import without_shadow
from grasptrack.segmentation.silhouettes import Silhouette, box_iou, trace_silhouettes
from grasptrack.segmentation.snapping import OutlineSnapper, outline_agreement, polygon_silhouette
from grasptrack.segmentation.work import CONTOUR, CONTOUR_PX, GRADIENTS, PREPARED, QUADRANGLES, Work
from grasptrack.typing import Box, Floats, Point

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
ROUGH = 2.0
"""px of the working image by which a segmenter's outline may be off: its map is coarser than the image."""
AGREEING, ALL_ROUND = 8.0, 0.97
"""px from a polygon that a person drew within which a proposal agrees with it, and the share of both outlines that must."""
FALLBACK_RECIPE = 2
"""Of `closed_edges.RECIPES`: looks for what no way of looking found by itself."""


BESIDE = 3.0
"""px: a click may lie so far beside a thin part."""
MIN_BOX_OVERLAP = 0.3
"""Intersection over union with a box that was drawn; a region of less is another one."""


class _Rated(NamedTuple):
    """A proposal and the logarithm of its worth, with the segmenter's maps and without."""

    proposal: Proposal
    worth: float
    unmapped: float


class CandidateSearch:
    """One image: what is proposed in it, and what becomes of that."""

    def __init__(self, colours: NDArray[np.uint8], hints: FirstImage, segmenter: Segmenter | None) -> None:
        self.colours, self._hints = colours, hints
        self._grey = to_grey(colours)
        self._planes: Planes = lab_planes(colours)
        self._edges = ClosedEdgeSegmenter(self._planes, hints.hidden)
        self._alone = isinstance(segmenter, OneMask)
        regions = [] if segmenter is None or hints.masked else list(segmenter.regions(colours, hints))
        if hints.background is not None:
            if self._alone or hints.masked:
                raise InputError("a background and a mask both say where the object is: give one of them")
            regions += [Region(m, is_vote=True) for m in background_maps(colours, hints.background, hints.hidden)]
        maps, self._maps = _as_maps(regions, self._grey.shape)
        self._voted = any(region.is_vote for region in regions)
        self._snapper = OutlineSnapper(self._edges, self._maps[-1] if self._voted and not self._alone else None)
        self._work = Work(hints.first_look_ms)
        reduced = self._edges.fields[0].strength.size
        self._work.spend((PREPARED * self._grey.size + GRADIENTS * reduced) / 1e6)
        self._proposals = self._propose(maps)
        self.meant = [p for p in self._proposals if is_allowed(p.silhouette, hints)]

    def candidates(self) -> list[Candidate]:
        """Contours of the likeliest proposals, the likeliest first."""
        drawn = self._drawn()
        if drawn is not None:
            return drawn
        rated = self._rated()
        return self._judged(self._localized(rated), rated)

    def _propose(self, maps: list[NDArray[np.float32]]) -> list[Proposal]:
        hints = self._hints
        if self._alone:
            rater = SilhouetteScorer(self._edges.fields[0], self._edges.shrink, self._grey.shape)
            shapes = [polygon for each in maps for polygon in _regions_of(each)]
            return [Proposal(s, rater.rate(s), 0, math.nan, 0.0, GIVEN) for s in shapes]
        return propose_silhouettes(
            self._grey, self._edges, hints.hidden, hints.masked, MIN_EXTENT, maps, self._quadrangles(), self._work
        )

    def _quadrangles(self) -> list[Silhouette]:
        """Quadrangles of straight edges where a person points."""
        hints, px = self._hints, self._edges.shrink
        at = hints.object_at[0] if hints.object_at else _box_middle(hints.box)
        if hints.masked or at is None or not self._work.allows(QUADRANGLES * self._grey.size / px**2 / 1e6):
            return []
        self._work.spend(QUADRANGLES * self._grey.size / px**2 / 1e6)
        found = find_quadrangles(self._edges.planes, ((at[0] - 0.5 * (px - 1)) / px, (at[1] - 0.5 * (px - 1)) / px))
        shapes = (polygon_silhouette(each * px + 0.5 * (px - 1), self._grey.shape) for each in found)
        return [shape for shape in shapes if shape is not None]

    def _rated(self) -> list[_Rated]:
        """The proposals that are meant, each region once, the likeliest first."""
        if self._alone:
            return [_Rated(p, 0.0, 0.0) for p in self.meant[:COMPARED]]
        compared = self.compared()
        numbers = load_numbers(bool(self._maps))
        if self._hints.background is not None:  # a person's word, as a box is
            numbers = numbers._replace(map_power=numbers.box_power)
        worth = measure_worth(compared, self._maps, self._hints.box, numbers)
        meant = [k for k, p in enumerate(compared) if is_allowed(p.silhouette, self._hints)]
        kept: list[int] = []
        for k in sorted(meant, key=lambda k: -worth[k]):
            if not any(is_alike(compared[k].silhouette, compared[j].silhouette) for j in kept):
                kept.append(k)
        unmapped = measure_worth(compared, [], self._hints.box, numbers)
        return [_Rated(compared[k], float(worth[k]), float(unmapped[k])) for k in kept]

    def _judged(self, found: list[tuple[Candidate, _Rated]], rated: list[_Rated]) -> list[Candidate]:
        """Candidates with their probabilities."""
        if not found or self._alone:
            return [candidate._replace(probability=1.0) for candidate, _ in found]
        first, own = found[0]
        rivals = [r for r in rated if _is_another(r.proposal.silhouette, own.proposal.silhouette)]
        # what stands out for a net, as a person does, need not be what is meant: the outline alone has a say
        leads = [min(own.worth - r.worth, own.unmapped - r.unmapped) for r in rivals]
        lead = min(leads, default=math.inf)
        # without the map, which the outline may have come from
        returned = OutlineSnapper(self._edges).return_share(first.view.outer.points)
        worth = np.array([r.worth for _, r in found])
        signs = Signs(own.proposal.rating.score, lead, returned)
        # the numbers with a map were fitted to votes: of alternatives the more cautious ones count
        asked = {bool(self._maps), self._voted}
        share = np.min([choice_probabilities(worth, signs, load_numbers(mapped)) for mapped in asked], axis=0)
        judged = [c._replace(probability=float(p)) for (c, _), p in zip(found, share, strict=True)]
        return [judged[0]._replace(lead=lead, returned=returned), *judged[1:]]

    def compared(self) -> list[Proposal]:
        """The best rated proposals of the image and of those that are meant, of a segmenter's as many."""
        large = [p for p in self._proposals if max(p.silhouette.box[2:]) >= MIN_EXTENT and p.rating is not NONE]
        found: dict[int, Proposal] = {}
        for p in sorted([p for p in large if _is_cut(p)], key=lambda p: -p.rating.score_in_view)[:CUT]:
            found[id(p)] = p
        for pool in (large, [p for p in large if is_allowed(p.silhouette, self._hints)]):
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
                    return [self._judged_drawn(found)._replace(rating=p.rating.score)]
        shape = polygon_silhouette(self._snapper.snap(polygon), self._grey.shape)
        if shape is None or max(shape.box[2:]) < MIN_EXTENT:
            raise ObservationError(f"the outline that was drawn is less than {MIN_EXTENT} px across")
        candidate = of_closed_edges(self.colours, self._planes, shape, self._hints.hidden)
        if candidate is None:
            raise ObservationError("the outline that was drawn lies beyond the image for the most part")
        return [self._judged_drawn(self._findable(candidate, shape))]

    def _judged_drawn(self, candidate: Candidate) -> Candidate:
        """What a person drew, with its probability to be right."""
        returned = OutlineSnapper(self._edges).return_share(candidate.view.outer.points)
        return candidate._replace(probability=drawn_probability(returned), returned=returned)

    def _localized(self, rated: list[_Rated]) -> list[tuple[Candidate, _Rated]]:
        """The likeliest as contours, each region once."""
        kept: list[tuple[Candidate, _Rated]] = []
        found: list[Candidate] = []
        taken = np.zeros(self._grey.shape, np.uint8)
        looked = cut = 0
        own = max((r.proposal.rating.score for r in rated if r.proposal.recipe != GIVEN), default=0.0)
        least = 0.0 if self._alone else max(WORTH, FAINT * own)
        for each in rated:
            p = each.proposal
            if looked >= MOST:
                break
            offered = False
            if p.recipe != GIVEN and p.rating.score < least:
                offered = cut < CUT and _is_cut(p) and p.rating.score_in_view >= least
                if not offered or not (found or self._hints.is_pointed_at):  # alone it is the ground of an empty image
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
            if candidate is None or any(is_same_region(candidate.view, other.view) for other in found):
                continue
            if self._hints.object_at and not all(_on_or_beside(candidate.view, *at) for at in self._hints.object_at):
                continue
            found.append(candidate._replace(rating=p.rating.score))
            kept.append((found[-1], each))
            cv2.drawContours(taken, [p.silhouette.outer.reshape(-1, 1, 2)], -1, (255,), cv2.FILLED)
        return kept

    def _localize(self, p: Proposal, part: bool, shaded: bool) -> Candidate | None:
        """The sub-pixel contour of a proposal, without the shadow that its object casts."""
        hidden, cut = self._hints.hidden, False
        if p.recipe == GIVEN:
            snapped = self._snapper.snap(p.silhouette.outer.astype(np.float64), ROUGH)
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


def is_allowed(shape: Silhouette, hints: FirstImage) -> bool:
    """Whether a region covers all pixels on the object, none beside it, and fills a box at least in part."""
    if any(shape.depth(*at) < -BESIDE for at in hints.object_at) or any(shape.depth(*at) > 0.0 for at in hints.not_at):
        return False
    return hints.box is None or box_iou(shape.box, hints.box) > MIN_BOX_OVERLAP


def _box_middle(box: Box | None) -> Point | None:
    return None if box is None else (box[0] + 0.5 * box[2], box[1] + 0.5 * box[3])


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


def _as_maps(
    regions: Sequence[Region], size: tuple[int, ...]
) -> tuple[list[NDArray[np.float32]], list[NDArray[np.float32]]]:
    """Maps (H, W), 0 to 1, in which regions are looked for, and those that a region may agree with: the mean of all votes, and
    each alternative times its probability.

    Raises:
        InputError: a mask of another size.
    """
    shown: list[NDArray[np.float32]] = []
    votes: list[NDArray[np.float32]] = []
    beliefs: list[NDArray[np.float32]] = []
    for region in regions:
        mask = np.asarray(region.mask)
        if np.issubdtype(mask.dtype, np.floating):
            if mask.shape != tuple(size):
                raise InputError(
                    f"a segmenter's mask is {mask.shape}, but the image is {size[1]}x{size[0]} px", shape=mask.shape
                )
            plane = np.clip(np.nan_to_num(mask), 0.0, 1.0).astype(np.float32)
        else:
            plane = (to_mask(mask, tuple(size), "segmenter's mask") / 255.0).astype(np.float32)
        shown.append(plane)
        believed = plane * np.float32(np.clip(region.probability, 0.0, 1.0))
        (votes if region.is_vote else beliefs).append(believed)
    if votes:
        mean = np.mean(votes, axis=0).astype(np.float32)
        beliefs.append(mean)
        if len(votes) > 1:
            shown.append(mean)
    return shown, beliefs


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


def is_same_region(one: View, other: View, share: float = 0.1) -> bool:
    """Whether two outlines are of the same region, found in different ways."""
    area, a = one.outer.area, other.outer.area
    apart_by = one.outer.points.mean(axis=0) - other.outer.points.mean(axis=0)
    return 1.0 - 2.0 * share < area / a < 1.0 / (1.0 - 2.0 * share) and math.hypot(
        *apart_by.tolist()
    ) < share * math.sqrt(a)
