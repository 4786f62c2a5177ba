# SPDX-License-Identifier: Apache-2.0
"""Silhouettes that may be objects, by several ways of looking; one rating judges all alike."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.first_image import FirstImage
from grasptrack.grasp.force_closure import ON_OUTLINE
from grasptrack.images import PLAIN, Grey
from grasptrack.segmentation.closed_edges import (
    RECIPES,
    ClosedEdgeSegmenter,
    NormalizedGradient,
    lab_planes,
    to_full_resolution,
)
from grasptrack.segmentation.contact_cut import reduction_of, region_at_contacts
from grasptrack.segmentation.localization import ALIKE as GROUND_ALIKE
from grasptrack.segmentation.localization import HOLE_CONTRAST
from grasptrack.segmentation.quadrangles import find_quadrangles
from grasptrack.segmentation.seams import parts_with_contacts
from grasptrack.segmentation.silhouettes import (
    Silhouette,
    candidate_thresholds,
    polygon_silhouette,
    threshold_mask,
    to_binary,
    trace_silhouettes,
)
from grasptrack.segmentation.snapping import ALL_ROUND, outline_agreement
from grasptrack.segmentation.work import (
    CLOSING,
    CUT,
    GRADIENTS,
    PREPARED,
    QUADRANGLES,
    RATED,
    SEARCH_SHARE,
    THRESHOLDED,
    WorkBudget,
)
from grasptrack.typing import Floats32, Pixels, Point

MIN_EXTENT = 20
"""px across; a smaller object has no outline worth following."""
MIN_ENCLOSED = 150.0
"""px^2, least area enclosed by closed edges, or in a segmenter's map."""
PER_THRESHOLD, PER_MAP_LEVEL = 8, 4
"""Silhouettes that are examined closely, the largest first."""
MAP_LEVELS = (0.06, 0.15, 0.3, 0.5, 0.7, 0.85)
"""Levels at which a segmenter's map is cut: thin parts of an object fade in it."""
LESS_LIKELY = 0.9
"""Factor on the rating of thresholds, which leave out parts of another grey: closed edges are preferred if both rate
alike; ..."""
ALIKE = 0.06
"""... but where box and area differ by less than this share of the size, both are the same region, and a threshold is
simpler; ..."""
GROUND_SHARE = 0.5
"""... and where most of what closed edges add looks like the ground in a hole does, they bridged a gap, as between tines: then
the factor is theirs."""
CUT_LIKELY = 0.8
"""Factor on the rating of a cut between contacts, which sees a blurred image: what edges show as well is preferred."""
MOST_CUT = 3
"""Regions that are cut where they may be two things, the best rated."""
GAP_MARGIN = 10
"""px of the reduced image around a region in which the ground's colour is measured."""
GAP_DEPTH, MIN_GAP, OUTSIDE = 4, 8, 0.05
"""px of the reduced image beside a region that are looked at; px of them that show a colour; and the share of a region that may
lie beyond another one that holds it."""
SAME_OUTLINE = 3.0
"""px between outlines of one region that are the same."""
MIN_SIZE = 20.0
"""px, square root of the area, that regions are compared by at least."""
THRESHOLD, GIVEN = -1, -2
"""In the place of a recipe: a threshold found it; a segmenter or a person did."""

# --- rating --------------------------------------------------------------------------------------

ENOUGH = 4.0
"""Units of noise; a stronger edge is no better. Otherwise a sharp part would win over the whole object."""
NOTHING = 1.0
"""Units of noise; noise alone reaches this."""
CLOSED = 2.0
"""Units of noise from which an edge counts as present."""
COMPACT = 8.0
"""An outline is smooth enough up to this many times a circle's length^2 / area."""
CIRCLE = 4.0 * math.pi
"""length^2 / area of a circle."""
TOUCHING = 0.5
"""Factor for each image side that the silhouette reaches."""
BRIDGED, BRIDGED_GAP = 0.8, 16.0
"""Factor for a closing that bridges gaps of so many px."""
RATED_PIXELS = 200
"""Pixels of an outline that are sampled."""
RATED_SOFTENING = 0.7
"""px, Gaussian blur of the edges' strength."""


class Rating(NamedTuple):
    """How much an outline looks like that of an object, in terms between 0 and 1.

    Attributes:
        closed: share of the outline on an edge.
        contrast: mean strength of the edge along it, capped at ENOUGH.
        complete: not cut by the image's border.
        smooth: short for the area it encloses.
        exact: found without bridging wide gaps.
        size: square root of the convex hull's length over the image's width and height; large outlines are less likely
            to arise by chance.
        in_view: `closed` times `contrast` of the part of the outline that is not at the image's border.
    """

    closed: float
    contrast: float
    complete: float
    smooth: float
    exact: float
    size: float
    in_view: float = 0.0

    @property
    def score(self) -> float:
        """The product of the first six."""
        return self.closed * self.contrast * self.complete * self.smooth * self.exact * self.size

    @property
    def score_in_view(self) -> float:
        """The same of the part in view, however much the image's border cuts."""
        return self.in_view * self.smooth * self.exact * self.size

    @property
    def is_cut(self) -> bool:
        """Whether the image's border cuts the region."""
        return 0.0 < self.complete < 1.0


UNRATED = Rating(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""The rating of a silhouette that was not examined."""
TINY_SCORE = 1e-9


class SilhouetteScorer:
    """Rates silhouettes by the edges of one image of (height, width), the field having one px for `shrink` of its."""

    def __init__(self, field: NormalizedGradient, shrink: int, size: tuple[int, ...]) -> None:
        soft = cv2.GaussianBlur(field.gradient_magnitude, (0, 0), RATED_SOFTENING)
        self._strength = np.asarray(cv2.dilate(soft, np.ones((3, 3), np.uint8)), dtype=np.float32)
        self._shrink, self._size = shrink, size

    def rate_silhouette(self, shape: Silhouette, bridge: float = 0.0) -> Rating:
        """Rate a silhouette; `bridge` px is the widest gap that a closing bridged for it."""
        chain = shape.outer[:: max(1, len(shape.outer) // RATED_PIXELS)]
        height, width = self._strength.shape
        column, row = np.minimum(chain // self._shrink, (width - 1, height - 1)).T
        strength = self._strength[row.clip(0), column.clip(0)]
        ring = shape.outer.reshape(-1, 1, 2)
        length, around = cv2.arcLength(ring, True), cv2.arcLength(cv2.convexHull(ring), True)
        compact = CIRCLE * shape.area / max(length, 1.0) ** 2
        # a closing shrinks back from the border by its radius
        near, (x, y), (high, wide) = 0.5 * bridge + 2.0 * self._shrink, chain.T, self._size
        sides = np.stack([x <= near, y <= near, x >= wide - 1 - near, y >= high - 1 - near])
        outside = sides.any(axis=0)
        shown = strength[~outside]
        return Rating(
            _edge_share(strength),
            max(_edge_contrast(strength), 0.0),
            (1.0 - float(outside.mean())) ** 2 * TOUCHING ** int(sides.any(axis=1).sum()),
            math.sqrt(min(1.0, COMPACT * compact)),
            BRIDGED ** (bridge / (BRIDGED_GAP * self._shrink)),
            min(1.0, math.sqrt(around / sum(self._size))),
            _edge_share(shown) * max(_edge_contrast(shown), 0.0) if len(shown) else 0.0,
        )


def _edge_share(strength: Floats32) -> float:
    return float((strength > CLOSED).mean())


def _edge_contrast(strength: Floats32) -> float:
    return float((np.minimum(strength, ENOUGH) - NOTHING).mean()) / (ENOUGH - NOTHING)


# --- proposals -----------------------------------------------------------------------------------


class OutlineProposal(NamedTuple):
    """A silhouette that may be an object.

    Attributes:
        silhouette: the region.
        rating: of its outline.
        polarity: +1 darker than its surroundings, -1 lighter, 0 unknown.
        level: grey level of the threshold that found it; NaN for all else.
        recipe: which closing of edges found it; THRESHOLD or GIVEN.
        grain: Lab units per px of the image's own slopes, as that closing saw them.
        likely: factor on its rating, of how its way of looking errs.
    """

    silhouette: Silhouette
    rating: Rating
    polarity: int = 0
    level: float = math.nan
    recipe: int = GIVEN
    grain: float = math.nan
    likely: float = 1.0

    @property
    def comparison_order(self) -> float:
        """What proposals are ordered by before they are compared closely."""
        return self.rating.score * self.likely

    @property
    def simplicity(self) -> int:
        """Of the same region what a threshold found is the simplest to find again, then what a closing did."""
        return 2 if self.recipe == THRESHOLD else int(self.recipe != GIVEN)


class PreparedImage:
    """A first image as all who propose outlines see it, prepared once.

    Args:
        colours: (H, W) or BGR (H, W, 3), 8 bit.
        said: what a person says of it.

    Attributes:
        grey: (H, W).
        planes: (H, W, C) lightness and chroma.
        edges: of the image, reduced where it is large.
        scorer: rates outlines in it.
        work: bound of the search.
    """

    def __init__(self, colours: Pixels, said: FirstImage) -> None:
        self.colours, self.said = colours, said
        self.grey: Grey = PLAIN.to_grey(colours)
        self.planes = lab_planes(colours)
        self.edges = ClosedEdgeSegmenter(self.planes, said.hidden)
        self.scorer = SilhouetteScorer(self.edges.fields[0], self.edges.shrink, self.grey.shape)
        self.work = WorkBudget(said.first_look_ms)
        self.work.spend(PREPARED.of(self.grey.size) + GRADIENTS.of(self.reduced_size))

    @property
    def reduced_size(self) -> int:
        """Pixels of the reduced image."""
        height, width = self.edges.planes.shape[:2]
        return int(height * width)

    @cached_property
    def contact_region(self) -> Silhouette | None:
        """What the contacts that a person gave lie on, as of `contact_cut.region_at_contacts`, if the work is allowed."""
        cost = CUT.of(self.reduced_size / reduction_of(self.edges.planes) ** 2)
        if self.said.masked or self.said.grasp is None or not self.work.allows(cost):
            return None
        self.work.spend(cost)
        px = self.edges.shrink
        contacts = np.array([self.to_reduced((x, y)) for x, y in self.said.grasp.contacts.tolist()])
        found = region_at_contacts(self.edges.planes, contacts, MIN_ENCLOSED / px**2)
        return None if found is None else to_full_resolution(found, px)

    def holds_contacts(self, shape: Silhouette) -> bool:
        """Whether the contacts that a person gave, if any, lie on a region's outline or, as there may be a hole, inside."""
        given = () if self.said.grasp is None else self.said.grasp.contacts.tolist()
        near = max(ON_OUTLINE * math.sqrt(shape.area), SAME_OUTLINE)
        return bool(given) and all(shape.depth_at(x, y) >= -near for x, y in given)

    def to_reduced(self, at: Point) -> Point:
        """A point (x, y) px of the image in px of the reduced one."""
        px = self.edges.shrink
        return (at[0] - 0.5 * (px - 1)) / px, (at[1] - 0.5 * (px - 1)) / px


def propose_thresholds(scene: PreparedImage) -> Iterator[OutlineProposal]:
    """Objects of one grey level: by Otsu's thresholds; of a mask what is light."""
    grey, said = scene.grey, scene.said
    soft = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0), dtype=np.uint8)
    for level in candidate_thresholds(soft if said.hidden is None else soft[said.hidden == 0]):
        for polarity in (-1,) if said.masked else (1, -1):
            scene.work.spend(THRESHOLDED.of(grey.size) + RATED * PER_THRESHOLD)
            mask = threshold_mask(grey, level, polarity, said.hidden)
            for shape in trace_silhouettes(mask)[:PER_THRESHOLD]:
                rating = scene.scorer.rate_silhouette(shape) if shape.longer_side >= MIN_EXTENT else UNRATED
                yield OutlineProposal(shape, rating, polarity, level, THRESHOLD, likely=LESS_LIKELY)


def propose_closed_edges(scene: PreparedImage) -> Iterator[OutlineProposal]:
    """Objects of any colours: what closed edges enclose, by each recipe, as far as the work is allowed; of a mask nothing."""
    cost = CLOSING.of(scene.reduced_size)
    for index, recipe in enumerate(() if scene.said.masked else RECIPES):
        if not scene.work.allows(cost, SEARCH_SHARE):
            break
        bridge, unit = 2.0 * recipe.radius * scene.edges.shrink, scene.edges.fields[recipe.softening].unit
        for shape in scene.edges.enclosed_regions(recipe, MIN_ENCLOSED, MIN_EXTENT):
            scene.work.spend(RATED)
            yield OutlineProposal(shape, scene.scorer.rate_silhouette(shape, bridge), recipe=index, grain=unit)
        scene.work.spend(cost)


def propose_quadrangles(scene: PreparedImage) -> Iterator[OutlineProposal]:
    """Sheets and boxes: quadrangles of straight edges where a person points."""
    said, px = scene.said, scene.edges.shrink
    at, cost = said.object_at[0] if said.object_at else None, QUADRANGLES.of(scene.grey.size / px**2)
    if at is None and said.box is not None:
        x, y, width, height = said.box
        at = x + 0.5 * width, y + 0.5 * height
    if said.masked or at is None or not scene.work.allows(cost):
        return
    scene.work.spend(cost)
    for corners in find_quadrangles(scene.edges.planes, scene.to_reduced(at)):
        shape = polygon_silhouette(corners * px + 0.5 * (px - 1), scene.grey.shape)
        if shape is not None:
            yield OutlineProposal(shape, scene.scorer.rate_silhouette(shape))


def propose_at_contacts(scene: PreparedImage) -> Iterator[OutlineProposal]:
    """What the contacts that a person gave lie on."""
    if scene.contact_region is not None:
        rating = scene.scorer.rate_silhouette(scene.contact_region)
        yield OutlineProposal(scene.contact_region, rating, likely=CUT_LIKELY)


def propose_at_seams(scene: PreparedImage, found: Sequence[OutlineProposal]) -> Iterator[OutlineProposal]:
    """What regions with given contacts that reach the image's border are without what reaches it, as a cable: cut at a neck.

    The narrower a cut the likelier it is one.
    """
    if scene.said.grasp is None or scene.said.masked:
        return
    held = [p for p in found if p.rating is not UNRATED and p.rating.is_cut and scene.holds_contacts(p.silhouette)]
    for p in sorted(held, key=lambda p: -p.comparison_order)[:MOST_CUT]:
        near = max(ON_OUTLINE * math.sqrt(p.silhouette.area), SAME_OUTLINE)
        for part in parts_with_contacts(p.silhouette, scene.said.grasp.contacts, near):
            shape = polygon_silhouette(part.outer.astype(np.float64), scene.grey.shape)
            scene.work.spend(RATED)
            if shape is not None:
                rating = scene.scorer.rate_silhouette(shape)
                if not rating.is_cut:
                    yield OutlineProposal(shape, rating, likely=p.likely * (1.0 - part.narrow))


def propose_from_maps(scene: PreparedImage, maps: Sequence[Floats32]) -> Iterator[OutlineProposal]:
    """What a segmenter's maps (H, W), 0 to 1, show at several levels."""
    for each in maps:
        for level in MAP_LEVELS:
            for shape in trace_silhouettes(to_binary(each > level), MIN_ENCLOSED, holes=False)[:PER_MAP_LEVEL]:
                if shape.longer_side >= MIN_EXTENT:
                    yield OutlineProposal(shape, scene.scorer.rate_silhouette(shape))


def propose_masks(scene: PreparedImage, maps: Sequence[Floats32]) -> list[OutlineProposal]:
    """The regions of a user's own segmentation, and nothing else, in their order."""
    shapes = chain.from_iterable(trace_silhouettes(to_binary(each > 0.5), holes=False) for each in maps)
    return [OutlineProposal(shape, scene.scorer.rate_silhouette(shape)) for shape in shapes]


def propose_silhouettes(
    scene: PreparedImage, maps: Sequence[Floats32] = (), *, ranked: bool = True
) -> list[OutlineProposal]:
    """All silhouettes of an image, the best rated first, each once; not `ranked`, the order is rough."""
    pointed_at = [*propose_quadrangles(scene), *propose_at_contacts(scene)]  # before all else, while the work allows it
    found = [*propose_thresholds(scene), *propose_closed_edges(scene), *propose_from_maps(scene, maps), *pointed_at]
    found += propose_at_seams(scene, found)
    if ranked:
        _doubt_bridged_gaps(found, scene)
    return _remove_duplicates(sorted(found, key=lambda p: -p.comparison_order), scene)


def _doubt_bridged_gaps(found: list[OutlineProposal], scene: PreparedImage) -> None:
    """Where closed edges add only ground to a threshold's region that rates alike, the factor is theirs; in place."""
    closed = [k for k, p in enumerate(found) if p.recipe >= 0]
    for i, p in enumerate(found):
        for k in closed if p.recipe == THRESHOLD and p.rating is not UNRATED else ():
            of_both = p.rating.score / max(found[k].rating.score, TINY_SCORE)
            is_known = found[i].likely > found[k].likely or not LESS_LIKELY < of_both < 1.0 / LESS_LIKELY
            part, whole = p.silhouette, found[k].silhouette
            if is_known or not _is_box_within(part, whole) or is_alike(part, whole):
                continue
            if _adds_ground(part, whole, scene):
                found[i], found[k] = p._replace(likely=1.0), found[k]._replace(likely=LESS_LIKELY)


def _is_box_within(part: Silhouette, whole: Silhouette) -> bool:
    """Whether the box of a region lies in that of another one, but for what their edges may be off."""
    (x, y, w, h), (u, v, p, q) = part.box, whole.box
    return max(u - x, v - y, x + w - u - p, y + h - v - q) < ALIKE * max(math.sqrt(part.area), MIN_SIZE)


def _adds_ground(part: Silhouette, whole: Silhouette, scene: PreparedImage) -> bool:
    """Whether what a region has beside another one, which it holds, looks like the ground around it."""
    px = scene.edges.shrink
    left, top, right, bottom = window = part.box_window(GAP_MARGIN * px, scene.grey.shape)
    colours = scene.planes[top:bottom:px, left:right:px]
    a, b = (np.ascontiguousarray(shape.filled_window(window)[::px, ::px]) for shape in (part, whole))
    near, three = np.ones((2 * GAP_DEPTH + 1,) * 2, np.uint8), np.ones((3, 3), np.uint8)
    if np.count_nonzero(cv2.dilate(b, three)[a > 0] == 0) > OUTSIDE * np.count_nonzero(a):  # a rim is none of it
        return False
    more = (cv2.erode(b, three) > 0) & (cv2.dilate(a, near) > 0) & (cv2.dilate(a, three) == 0)
    inside, around = cv2.erode(a, three) > 0, cv2.dilate(b, np.ones((5, 5), np.uint8)) == 0
    if np.count_nonzero(more) < MIN_GAP or not inside.any() or not around.any():
        return False
    ground = np.median(colours[around], axis=0)
    contrast = float(np.linalg.norm(np.median(colours[inside], axis=0) - ground))
    away = np.linalg.norm(colours - ground, axis=2)
    near_ground = min(HOLE_CONTRAST * contrast, GROUND_ALIKE * max(float(np.median(away[around])), 1.0))
    return float(np.mean(away[more] < near_ground)) > GROUND_SHARE


def is_alike(one: Silhouette, other: Silhouette) -> bool:
    """Whether two silhouettes are nearly the same region."""
    (x, y, w, h), (u, v, p, q) = one.box, other.box
    tolerance = 0.5 * ALIKE * (size := math.sqrt(other.area))
    corners = max(abs(x - u), abs(y - v), abs(x + w - u - p), abs(y + h - v - q))
    return corners < tolerance and abs(math.sqrt(one.area) - size) < 0.5 * tolerance


def _is_simpler(p: OutlineProposal, other: OutlineProposal, scene: PreparedImage) -> bool:
    """Whether a proposal shows nearly the same region as another in a simpler way, with no piece bitten out of it.

    Print at the border bites into a threshold's region, whose edges are no stronger then. Ground that is missing is no
    bite. What was given may have sides that the image does not show.
    """
    if p.simplicity <= other.simplicity or other.recipe == GIVEN:
        return p.simplicity > other.simplicity
    if p.rating.closed * p.rating.contrast > other.rating.closed * other.rating.contrast:
        return True
    outline = other.silhouette.outer.astype(np.float64)
    agree = outline_agreement(p.silhouette, outline, SAME_OUTLINE) >= ALL_ROUND
    return agree or _adds_ground(p.silhouette, other.silhouette, scene)


def _remove_duplicates(found: list[OutlineProposal], scene: PreparedImage) -> list[OutlineProposal]:
    """Of those that are the same region the first, or the first that shows it in a simpler way."""
    kept: list[OutlineProposal] = []
    places = np.zeros((len(found), 6))
    for p in found:
        x, y, w, h = p.silhouette.box
        size = math.sqrt(p.silhouette.area)
        place = np.array([x, y, x + w, y + h, 2.0 * size, sum(scene.grey.shape) * scene.holds_contacts(p.silhouette)])
        away = np.abs(places[: len(kept)] - place).max(axis=1, initial=0.0)
        same = np.flatnonzero(away < ALIKE * max(size, MIN_SIZE))
        if not len(same):
            places[len(kept)] = place
            kept.append(p)
        elif _is_simpler(p, kept[same[0]], scene):
            kept[same[0]] = p
    return sorted(kept, key=lambda p: -p.comparison_order)
