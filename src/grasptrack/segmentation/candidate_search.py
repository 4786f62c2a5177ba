# SPDX-License-Identifier: Apache-2.0
"""The candidates of one image: what is proposed in it, which of that is meant, and what becomes sub-pixel contours."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.errors import InputError, ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour, View
from grasptrack.images import PLAIN, Grey, with_room
from grasptrack.segmentation.background import background_maps
from grasptrack.segmentation.candidate import (
    SAME_EDGE,
    Candidate,
    alike_share,
    candidate_of_edges,
    candidate_of_one_level,
    contains_pixel,
    distance_of_contacts,
    is_plausible_object,
    is_same_region,
    two_toned,
    with_known_hole,
)
from grasptrack.segmentation.choice import Signs, choice_probabilities, drawn_probability, load_numbers, measure_worth
from grasptrack.segmentation.localization import (
    BORDER,
    LocalizedContour,
    enclosed_chains,
    holes_on_ground,
    is_near_hidden,
    localize_holes,
)
from grasptrack.segmentation.proposals import (
    GIVEN,
    MIN_ENCLOSED,
    MIN_EXTENT,
    THRESHOLD,
    UNRATED,
    OutlineProposal,
    PreparedImage,
    is_alike,
    propose_masks,
    propose_silhouettes,
)
from grasptrack.segmentation.seams import joined_parts
from grasptrack.segmentation.segmenters import OneMask, Region, Segmenter, asked_regions, region_maps
from grasptrack.segmentation.shadow import out_of_ramp, without_shadow
from grasptrack.segmentation.silhouettes import (
    Chain,
    Silhouette,
    box_iou,
    neck_width,
    picture_window,
    polygon_silhouette,
    thin_share,
    trace_silhouettes,
)
from grasptrack.segmentation.snapping import ALL_ROUND, OutlineSnapper, outline_agreement
from grasptrack.segmentation.work import CONTOUR, CONTOUR_AREA
from grasptrack.typing import Floats, Pixels

MAX_COMPARED = 40
"""Proposals that are compared, the best rated first, and as many of a segmenter's."""
MAX_CONTOURS, MAX_NESTED = 60, 8
"""Proposals that become contours at all, and among how many, the likeliest first, may lie parts of what was found."""
ROUGH_POINTS = 200
"""Points of the boundary of a region whose contour nobody has asked for."""
MAX_SHADOWS = 3
"""Objects that are looked at for a shadow, the likeliest first."""
MIN_RATING = 0.02
"""Ratings below this are chance, ..."""
CLUTTER = 0.3
"""... and those below this share of the best are clutter beside it."""
MAX_CUT = 3
"""Regions cut by the image's border that are offered although their rating is faint for that, the best rated ones. They come
after what is whole: the ground is cut too."""
APART = 0.65
"""Overlap of boxes, and ratio of areas, below which regions are other ones."""
ROUGH = 2.0
"""px of the working image by which a segmenter's outline may be off: its map is coarser than the image."""
AGREEING = 8.0
"""px from a polygon that a person drew within which a proposal agrees with it."""
BOX_AGREEING = 3.0 * AGREEING
"""px that the sides of both boxes may differ by before that is looked at."""
FALLBACK_RECIPE = 2
"""Of `closed_edges.RECIPES`: looks for what no way of looking found by itself."""
CLICK_MARGIN = 3.0
"""px: a click may lie so far beside a thin part."""
MIN_BOX_OVERLAP = 0.3
"""Intersection over union with a box that was drawn; a region of less is another one."""
PLAINLY_TWO = 0.2
"""How much more plainly a region is two things than the lesser of them is a share of it, from which on the other one alone is
meant: a handle of another look is a large part of its tool. A choice, by 60 regions of photos and of the suite."""
NESTED_SHARE = 0.4
"""Of an outline, within what was found, from which it counts as a part of that."""


class _Rated(NamedTuple):
    """A proposal, the logarithm of its worth, with the segmenter's maps and without, and whether it holds given contacts: of a
    contour, whether they lie on it as near as on any."""

    proposal: OutlineProposal
    worth: float
    unmapped: float
    held: bool = False


class RoughOutline:
    """A region that may be an object: its proposal, a view of whole px, and its sub-pixel contour where that is asked for."""

    def __init__(self, proposal: OutlineProposal, view: View, localize: Callable[[], Candidate | None]) -> None:
        self.proposal, self.view, self._localize = proposal, view, localize

    @cached_property
    def localized_candidate(self) -> Candidate | None:
        """Its contour; None where it has none."""
        return self._localize()


class CandidateSearch:
    """One image: what is proposed in it, what of that may be `meant` by what is said, and what becomes of it."""

    def __init__(self, colours: Pixels, said: FirstImage, segmenter: Segmenter | None, *, ranked: bool = True) -> None:
        self._masks_only = isinstance(segmenter, OneMask)
        regions = [] if segmenter is None or said.masked else asked_regions(segmenter, colours, said)
        # a frame round the picture is none of the scene, and has the strongest edges of all
        own = said.masked or self._masks_only
        left, top, right, bottom = window = (0, 0, 0, 0) if own else picture_window(PLAIN.to_grey(colours))
        self._corner = np.array([left, top], dtype=np.float64)
        if self._corner.any():
            regions = [r._replace(mask=r.as_map(colours.shape[:2])[top:bottom, left:right]) for r in regions]
            colours, said = np.ascontiguousarray(colours[top:bottom, left:right]), said.in_window(*window)
        self._scene, self._said = PreparedImage(colours, said), said
        if said.background is not None:
            if self._masks_only or said.masked:
                raise InputError("a background and a mask both say where the object is: give one of them")
            regions += [Region(m, is_vote=True) for m in background_maps(colours, said.background, said.hidden)]
        shown, self._maps = region_maps(regions, self._scene.grey.shape)
        self._voted = any(region.is_vote for region in regions)
        # without a map, which the outline may have come from, and with it
        self._unmapped_snapper = OutlineSnapper(self._scene.edges)
        guided = self._voted and not self._masks_only
        self._snapper = OutlineSnapper(self._scene.edges, self._maps[-1]) if guided else self._unmapped_snapper
        propose = propose_masks if self._masks_only else partial(propose_silhouettes, ranked=ranked)
        self._proposals = propose(self._scene, shown)
        self._contour_cost = CONTOUR + CONTOUR_AREA.of(self._scene.grey.size)
        self._rough: dict[int, RoughOutline] = {}
        self.meant = [p for p in self._proposals if is_allowed(p.silhouette, said)]

    def best_candidates(self) -> list[Candidate]:
        """Contours of the likeliest proposals, the likeliest first."""
        if self._said.outline is not None:
            found = [self._drawn_candidate(self._said.outline)]
        else:
            rated = self._rate_meant()
            found = self._with_probabilities(self._contacts_first(self._localize_all(rated)), rated)
        return self._in_whole_image(found)

    def rough_outlines(self) -> list[RoughOutline]:
        """All proposals that are not chance, each region once, the best rated first; those within others too.

        For whoever knows what to look for: nothing is said of which is meant. After `leave_out` of what is left only.
        """
        found: list[RoughOutline] = []
        for p in self._proposals:
            if p.rating is UNRATED or p.rating.score < MIN_RATING or p.silhouette.longer_side < MIN_EXTENT:
                continue
            if not is_plausible_object(p.silhouette, self._scene.grey.shape):
                continue
            if id(p) not in self._rough:
                self._rough[id(p)] = RoughOutline(p, self._rough_view(p.silhouette), partial(self._localized, p))
            rough = self._rough[id(p)]
            if not any(is_same_region(rough.view, other.view) for other in found):
                found.append(rough)
            if len(found) >= MAX_CONTOURS:
                break
        return found

    def _rough_view(self, shape: Silhouette) -> View:
        """The outer boundary of a region in the whole image."""
        ring = shape.boundary_points(ROUGH_POINTS)
        (height, width), hidden = self._scene.grey.shape, self._said.hidden
        x, y = ring.T
        cut = (np.minimum(x, width - 1 - x) <= BORDER) | (np.minimum(y, height - 1 - y) <= BORDER)
        if hidden is not None:
            cut |= is_near_hidden(ring, hidden)
        return View(Contour.trusted(ring + self._corner, clipped=cut if cut.any() else None))

    def _localized(self, p: OutlineProposal) -> Candidate | None:
        """The sub-pixel contour of a proposal in the whole image."""
        found = self._localize_proposal(p)
        return None if found is None else self._in_whole_image([found])[0]

    def leave_out(self, explained: Grey) -> None:
        """Leave of each proposal only what lies beside the places that are explained, (H, W) 255 there, else 0."""
        (left, top), (height, width) = self._corner.astype(int), self._scene.grey.shape
        hidden = with_room(np.ascontiguousarray(explained[top : top + height, left : left + width]))
        self._said = replace(self._said, hidden=hidden if self._said.hidden is None else hidden | self._said.hidden)
        left_over: list[OutlineProposal] = []
        for p in self._proposals:
            x, y, w, h = p.silhouette.box
            beside, taken = p.silhouette.material_mask(), hidden[y : y + h, x : x + w]
            if not (beside & taken).any():
                left_over.append(p)
                continue
            for shape in trace_silhouettes(beside & ~taken, MIN_ENCLOSED, (x, y)):
                if shape.longer_side >= MIN_EXTENT:
                    left_over.append(p._replace(silhouette=shape, rating=self._scene.scorer.rate_silhouette(shape)))
        self._proposals = sorted(left_over, key=lambda p: -p.comparison_order)

    def _in_whole_image(self, found: list[Candidate]) -> list[Candidate]:
        """The same, without what was taken off for a frame round the picture."""
        if not self._corner.any():
            return found
        back = np.eye(3)
        back[:2, 2] = self._corner
        return [c._replace(view=c.view.transformed(back)) for c in found]

    def compared_proposals(self) -> list[OutlineProposal]:
        """The best rated proposals of the image and of those that are meant, of a segmenter's as many."""
        large = [p for p in self._proposals if p.silhouette.longer_side >= MIN_EXTENT and p.rating is not UNRATED]
        cut = sorted((p for p in large if p.rating.is_cut), key=lambda p: -p.rating.score_in_view)[:MAX_CUT]
        found = {id(p): p for p in cut}
        for pool in (large, [p for p in large if is_allowed(p.silhouette, self._said)]):
            for given in (False, True):
                found.update((id(p), p) for p in [p for p in pool if (p.recipe == GIVEN) is given][:MAX_COMPARED])
        return list(found.values())

    def _rate_meant(self) -> list[_Rated]:
        """The proposals that are meant, each region once, the likeliest first, and first of all those with given contacts."""
        if self._masks_only:
            return [_Rated(p, 0.0, 0.0) for p in self.meant[:MAX_COMPARED]]
        compared, said = self.compared_proposals(), self._said
        worth, unmapped = self._measure_worth(compared)
        kept: list[_Rated] = []
        held = [self._scene.holds_contacts(p.silhouette) for p in compared]
        for k in sorted(range(len(compared)), key=lambda k: (not held[k], -worth[k])):
            shape = compared[k].silhouette
            if is_allowed(shape, said) and not any(is_alike(shape, r.proposal.silhouette) for r in kept):
                kept.append(_Rated(compared[k], float(worth[k]), float(unmapped[k]), held[k]))
        return kept

    def _measure_worth(self, compared: list[OutlineProposal]) -> tuple[Floats, Floats]:
        """(n,) logarithms of what proposals are worth, with the segmenter's maps and without."""
        numbers = load_numbers(bool(self._maps))
        if self._said.background is not None:  # a person's word, as a box is
            numbers = numbers._replace(map_power=numbers.box_power)
        with_maps, without = (measure_worth(compared, maps, self._said.box, numbers) for maps in (self._maps, []))
        return with_maps, without

    def _contacts_first(self, found: list[tuple[Candidate, _Rated]]) -> list[tuple[Candidate, _Rated]]:
        """Those first that given contacts lie nearest to, and no others but where there is none that they lie on."""
        if self._said.grasp is None or not found:
            return found
        away = [distance_of_contacts(c.view, self._said.grasp) for c, _ in found]
        lie_on = [far <= allowed for far, allowed in away]
        # a hole may be an object of its own, and its outline that of the part round it as well: the part is rated higher
        near = min(away)[0] + SAME_EDGE
        told = [(c, r._replace(held=far <= near)) for (c, r), (far, _) in zip(found, away, strict=True)]
        chosen = [each for each, on in zip(told, lie_on, strict=True) if on or not any(lie_on)]
        return sorted(chosen, key=lambda each: not each[1].held)

    def _with_probabilities(self, found: list[tuple[Candidate, _Rated]], rated: list[_Rated]) -> list[Candidate]:
        """Candidates with their probabilities."""
        if not found or self._masks_only:
            return [candidate._replace(probability=1.0) for candidate, _ in found]
        edges = self._scene.edges
        joined, *things = next(iter(joined_parts(found[0][1].proposal.silhouette, edges.planes, edges.shrink)), (0.0,))
        whole, found = found[0][1], self._with_parts(found, joined, things)
        first, own = found[0]
        others = rated if self._said.grasp is None else [r for _, r in found if r.held]
        rivals = [r for r in others if _is_another(r.proposal.silhouette, own.proposal.silhouette)]
        # what stands out for a net, as a person does, need not be what is meant: the outline alone has a say
        lead = min((min(own.worth - r.worth, own.unmapped - r.unmapped) for r in rivals), default=math.inf)
        returned = self._unmapped_snapper.return_share(first.view.outer.points)
        rating, shape = own.proposal.rating, own.proposal.silhouette
        thin, neck, cut = thin_share(shape, edges.shrink), neck_width(shape, edges.shrink), 1.0 - rating.complete
        within, around = two_toned(shape, edges.planes, edges.shrink)
        toned = max(within, joined if own is whole else 1.0 - joined)
        signs = Signs(rating.score, lead, returned, thin, neck, cut, toned, around)
        worth = np.array([r.worth for _, r in found])
        # the numbers with a map were fitted to votes: of alternatives the more cautious ones count
        at_contacts = self._said.grasp is not None
        asked = [load_numbers(mapped, at_contacts) for mapped in {bool(self._maps), self._voted and not at_contacts}]
        share = np.min([choice_probabilities(worth, signs, numbers) for numbers in asked], axis=0)
        judged = [
            c._replace(probability=float(p), alike=alike_share(r.proposal.silhouette, edges.planes, edges.shrink))
            for (c, r), p in zip(found, share, strict=True)
        ]
        return [judged[0]._replace(**{**signs._asdict(), "rating": judged[0].rating}), *judged[1:]]

    def _with_parts(
        self, found: list[tuple[Candidate, _Rated]], joined: float, things: list[Chain]
    ) -> list[tuple[Candidate, _Rated]]:
        """The same, after the first one also the things that it may be, which touch, in the order of their worth; before it
        the greater of these where it is so much more than the lesser one that this is print or a neighbour's tip."""
        first, said, more = found[0][1], self._said, list[tuple[Candidate, _Rated]]()
        sizes = [abs(cv2.contourArea(thing.reshape(-1, 1, 2))) for thing in things]
        plain = bool(things) and joined > min(sizes) / sum(sizes) + PLAINLY_TWO
        ahead = list[tuple[Candidate, _Rated]]()
        for size, thing in zip(sizes, things, strict=True):
            shape = polygon_silhouette(thing.astype(np.float64), self._scene.grey.shape)
            if shape is None or shape.longer_side < MIN_EXTENT or not is_allowed(shape, said):
                continue
            if not self._scene.work.allows(self._contour_cost):
                break
            self._scene.work.spend(self._contour_cost)
            rating = self._scene.scorer.rate_silhouette(shape)
            part = first.proposal._replace(silhouette=shape, rating=rating, recipe=GIVEN, likely=joined)
            candidate, leads = self._localize_proposal(part), plain and size == max(sizes)
            if candidate is None or (not leads and any(is_same_region(candidate.view, c.view) for c, _ in found)):
                continue
            if said.grasp is None or operator.le(*distance_of_contacts(candidate.view, said.grasp)):
                worth, unmapped = (float(each[0]) for each in self._measure_worth([part]))
                rated = _Rated(part, worth, unmapped, held=leads and said.grasp is not None)
                (ahead if leads else more).append((candidate._replace(rating=rating.score), rated))
        if ahead:
            more += [each for each in found[:1] if not is_same_region(each[0].view, ahead[0][0].view)]
        behind = sorted(found[1:] + more, key=lambda each: (not each[1].held, -each[1].worth))
        return [*(ahead or found[:1]), *behind]

    def _drawn_candidate(self, polygon: Floats) -> Candidate:
        """What a rough polygon is: the best rated proposal that agrees with it all round, or the polygon moved onto the edges
        beside it, whichever of both lies on its edges more firmly: print at the border bites into a proposal.
        """
        found: list[Candidate] = []
        for p in sorted(self._proposals, key=lambda p: -p.comparison_order):
            if _is_beside(p.silhouette, polygon) and outline_agreement(p.silhouette, polygon, AGREEING) >= ALL_ROUND:
                candidate = self._localize_proposal(p)
                if candidate is not None:
                    found = [candidate._replace(rating=p.rating.score)]
                    break
        shape = polygon_silhouette(self._snapper.snap(polygon), self._scene.grey.shape)
        if shape is not None and shape.longer_side >= MIN_EXTENT:
            candidate = candidate_of_edges(self._scene.colours, self._scene.planes, shape, self._said.hidden)
            found += [] if candidate is None else [self._with_recipe(candidate, shape)]
        elif not found:
            raise ObservationError(f"the outline that was drawn is less than {MIN_EXTENT} px across")
        if not found:
            raise ObservationError("the outline that was drawn lies beyond the image for the most part")
        returned = [self._unmapped_snapper.return_share(candidate.view.outer.points) for candidate in found]
        best = int(np.argmax(returned))
        return found[best]._replace(probability=drawn_probability(returned[best]), returned=returned[best])

    def _localize_all(self, rated: list[_Rated]) -> list[tuple[Candidate, _Rated]]:
        """The likeliest as contours, each region once."""
        found: list[tuple[Candidate, _Rated]] = []
        taken = np.zeros(self._scene.grey.shape, np.uint8)
        looked = cut = 0
        own = max((r.proposal.rating.score for r in rated if r.proposal.recipe != GIVEN), default=0.0)
        least = 0.0 if self._masks_only else max(MIN_RATING, CLUTTER * own)
        for each in rated:
            p = each.proposal
            if looked >= MAX_CONTOURS:
                break
            is_offered = False
            if p.recipe != GIVEN and p.rating.score < least:
                is_offered = cut < MAX_CUT and p.rating.is_cut and p.rating.score_in_view >= least
                # alone it is an empty image's ground
                if not is_offered or not (found or self._said.is_pointed_at):
                    continue
                cut += 1
            is_part = _overlaps_found(p.silhouette, taken, [c for c, _ in found])
            if is_part and looked >= MAX_NESTED and not is_offered:
                continue
            if found and not self._scene.work.allows(self._contour_cost):
                break
            self._scene.work.spend(self._contour_cost)
            looked += 1
            shaded = len(found) < MAX_SHADOWS and not is_part and not self._masks_only
            candidate = self._localize_proposal(p, whole=not is_part, shaded=shaded)
            if candidate is None or any(is_same_region(candidate.view, other.view) for other, _ in found):
                continue
            if not all(contains_pixel(candidate.view, *at, CLICK_MARGIN) for at in self._said.object_at):
                continue
            found.append((candidate._replace(rating=p.rating.score), each))
            cv2.drawContours(taken, [p.silhouette.outer.reshape(-1, 1, 2)], -1, (1,), cv2.FILLED)
        return found

    def _localize_proposal(self, p: OutlineProposal, whole: bool = True, shaded: bool = False) -> Candidate | None:
        """The sub-pixel contours of a proposal, as of `_localize_outline`, with the hole that given contacts lie on."""
        found = self._localize_outline(p, whole, shaded)
        region = self._scene.contact_region
        for chain in () if region is None else region.holes:
            snapped = np.rint(self._snapper.snap(chain.astype(np.float64), ROUGH)).astype(np.int32)
            if found is not None:
                found = with_known_hole(found, self._scene.colours, snapped, self._said.hidden)
        return found

    def _localize_outline(self, p: OutlineProposal, whole: bool, shaded: bool) -> Candidate | None:
        """The sub-pixel contour of a proposal: `whole` looks for holes by colour, `shaded` cuts out the shadow it casts."""
        colours, planes, hidden = self._scene.colours, self._scene.planes if whole else None, self._said.hidden
        if p.recipe == GIVEN:
            snapped = self._snapper.snap(p.silhouette.outer.astype(np.float64), ROUGH)
            shape = polygon_silhouette(snapped, self._scene.grey.shape)
            found = None if shape is None else candidate_of_edges(colours, planes, shape, hidden)
            return None if found is None or shape is None else self._with_recipe(found, shape)
        is_cut_out = False
        if shaded:
            p, is_cut_out = self._out_of_shadow(p)
        if p.recipe == THRESHOLD and not is_cut_out:
            found = candidate_of_one_level(self._scene.grey, p.silhouette, p.polarity, hidden)
        else:
            found = candidate_of_edges(colours, planes, p.silhouette, hidden)
        if found is None:
            return None
        holes = self._with_enclosed_holes(p.silhouette, found) if whole else found.view.contours[1:]
        if holes:
            found = found._replace(
                view=View([found.view.outer, *holes_on_ground(self._scene.planes, p.silhouette, holes)])
            )
        if shaded:
            found = found._replace(view=out_of_ramp(found.view, self._scene.edges.planes, self._scene.edges.shrink))
        return found._replace(level=p.level, recipe=p.recipe, grain=p.grain, shaded=is_cut_out)

    def _with_enclosed_holes(self, shape: Silhouette, found: Candidate) -> Sequence[Contour]:
        """The holes of a candidate, and those that closed edges enclose within its silhouette."""
        holes, enclosed = found.view.contours[1:], (p.silhouette for p in self._proposals if p.recipe >= 0)
        chains = enclosed_chains(shape, enclosed, holes, self._scene.grey.shape)
        outer = LocalizedContour(found.view.outer, found.inside, found.outside)
        grey = found.channel.to_grey(self._scene.colours)
        return [*holes, *localize_holes(grey, chains, outer, found.polarity, self._said.hidden)]

    def _out_of_shadow(self, p: OutlineProposal) -> tuple[OutlineProposal, bool]:
        """A proposal without the shadow that its object casts, and whether it had to be cut out: where another proposal
        is the object alone, that one is taken."""
        alone = without_shadow(self._scene.colours, p.silhouette)
        if alone is None:
            return p, False
        alike = next((other for other in self._proposals if is_alike(other.silhouette, alone)), None)
        return (p._replace(silhouette=alone), True) if alike is None else (alike, False)

    def _with_recipe(self, candidate: Candidate, shape: Silhouette) -> Candidate:
        """A given candidate with the way in which the own search finds nearly the same region, for later images."""
        own = (p for p in self._proposals if p.recipe != GIVEN)
        alike = next((p for p in own if is_alike(p.silhouette, shape)), None)
        if alike is not None and (alike.recipe != THRESHOLD or candidate.polarity == alike.polarity):
            return candidate._replace(level=alike.level, recipe=alike.recipe, grain=alike.grain)
        if candidate.polarity and candidate.inside != candidate.outside:
            return candidate._replace(level=0.5 * (candidate.inside + candidate.outside), recipe=THRESHOLD)
        return candidate._replace(recipe=FALLBACK_RECIPE, grain=self._scene.edges.fields[0].unit)


def is_allowed(shape: Silhouette, said: FirstImage) -> bool:
    """Whether a region covers all pixels on the object, none beside it, and fills a box at least in part."""
    if any(shape.depth_at(*at) < -CLICK_MARGIN for at in said.object_at):
        return False
    if any(shape.depth_at(*at) > 0.0 for at in said.not_at):
        return False
    return said.box is None or box_iou(shape.box, said.box) > MIN_BOX_OVERLAP


def _is_beside(shape: Silhouette, polygon: Floats) -> bool:
    """Whether the boxes of a region and a polygon may agree."""
    x, y, w, h = shape.box
    (left, top), (right, bottom) = polygon.min(axis=0).tolist(), polygon.max(axis=0).tolist()
    return bool(max(abs(x - left), abs(y - top), abs(x + w - right), abs(y + h - bottom)) < BOX_AGREEING)


def _is_another(shape: Silhouette, first: Silhouette) -> bool:
    """Whether a region is plainly another one."""
    return box_iou(shape.box, first.box) < APART or not APART < shape.area / first.area < 1.0 / APART


def _overlaps_found(shape: Silhouette, taken: Pixels, found: list[Candidate]) -> bool:
    """Whether a silhouette lies within what was taken, 1 in (H, W), or round it, at least for a good part."""
    if not found:
        return False
    column, row = shape.outer.T
    if taken[row.clip(0, taken.shape[0] - 1), column.clip(0, taken.shape[1] - 1)].mean() > NESTED_SHARE:
        return True
    corners = (c.view.outer.points[k * len(c.view.outer) // 3].tolist() for c in found for k in range(3))
    return any(shape.depth_at(x, y) >= 0.0 for x, y in corners)
