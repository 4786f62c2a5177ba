# SPDX-License-Identifier: Apache-2.0
"""From a silhouette to a candidate object: its sub-pixel contours, the mixture of colours that shows them, and what tells
candidates apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.equality import compared_by_value
from grasptrack.errors import ContourError, InputError
from grasptrack.geometry.contours import Contour, View
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import ON_OUTLINE
from grasptrack.images import PLAIN, Channel, Grey
from grasptrack.presentation import png_of, to_dict
from grasptrack.segmentation.closed_edges import Planes
from grasptrack.segmentation.localization import background_within, localize_contour, localize_holes
from grasptrack.segmentation.silhouettes import Chain, Silhouette
from grasptrack.typing import Floats, Pixels

MAX_SHARE = 0.9
"""A region that fills a larger share of the image is the background."""
MAX_SIDES = 2
"""Sides of the image that an object may touch; the background touches more."""
MIN_STEP = 1.0
"""px; an object differs from the background by at least as much as its edge rises over this distance. The grain of a
table has gradients too, but the same grey on both sides."""
CLOSED_EDGE_REACH = 1.5
"""px; closed edges lie on the edge itself, and farther away may be the other side of a thin part."""
ONE_SIGN = 0.9
"""Where at least this share of an outline rises outward, or falls, the object is dark, or light; otherwise it is mixed."""
SIGN_REACH = 2.0
"""px to either side of an outline in which its rise is looked for."""
MIN_LENGTH = 1e-9

PLAIN_WEIGHTS = (0.114, 0.587, 0.299)
"""Of blue, green and red in plain grey."""
BETTER = 1.5
"""A mixture of colours replaces plain grey when its contrast over noise is this many times as high."""
CLEAR = 2.0
"""The two sides of a clear edge differ by this many times the rms noise."""
FAINT = 0.3
"""An edge fainter than this share of the median is not required."""
MIN_SHOWN = 0.95
"""A mixture shows at least this share of the outline that plain grey shows."""
SIDE_DEPTH = 4.0
"""px of the working image on either side of an outline at which colours are compared."""
SIDE_SAMPLES, SIDE_MEAN, MIN_TONE = 128, 5, 8
"""Points of an outline, some, at which they are; of how many of them a mean is taken; how many a part of it has at least."""
SIDE_NOISE, BEYOND_SEAM = 3.0, 8.0
"""Standard deviations of such means along an outline within which its sides are alike; and px outside it, beyond a seam, at
which that is looked at."""
COLOR_DISTANCE = 2.5
"""px on either side of the outline at which colours are compared."""
COLOR_SAMPLES = 200
"""Points of the outline at which colours are compared."""

SAME_REGION = 0.1
"""Share of sqrt(area) by which mean points of one region may differ; areas by twice as much of each other."""
MOSTLY_ALIKE = 0.5
"""Share of an outline with the same on both sides that makes it one of seams, as between planks."""
MOSTLY = 0.75
"""Share of an outline within another one that makes it a part of that."""
SAME_EDGE = 1.5
"""px by which two outlines may differ on the same edge."""
ENCLOSURE_SAMPLES = 30
"""Points of an outline, some, that are looked up in another one."""


@compared_by_value
class Candidate(NamedTuple):
    """A candidate object.

    Attributes:
        view: its outline.
        polarity: +1 darker than its surroundings, -1 lighter, 0 where its parts differ.
        inside, outside: median grey levels on either side of the outer contour.
        probability: that it is the object that is meant.
        sure: the probability is as large as was asked for.
        rating: of its outline, 0 to 1; NaN of what was given.
        lead: logarithm of its worth over that of the best region that is plainly another one; NaN of all but the first.
        returned: share of its outline that comes back when it is displaced; NaN of all but the first.
        thin: share of its outline on parts too thin for an object's; NaN of all but the first.
        alike: share of its outline with the same on both sides; NaN of what was drawn.
        neck: width of its narrowest neck, a share of the size of the lesser part beyond it; NaN of all but the first.
        cut: what the image's border takes from its rating, 0 to 1; NaN of all but the first.
        toned: how plainly it is two things of different looks, 0 to 1; NaN of all but the first.
        around: the same of what lies round it, as of a hand on it; NaN of all but the first.
        level: grey level of the threshold that separated it from the ground; NaN where closed edges did.
        recipe: which closing of edges finds it; -1 for a threshold.
        channel: the mixture of colours that shows it; grey levels are levels of that.
        grain: Lab units per px of the image's own slopes, as that closing saw them.
        shaded: its shadow was cut out of the silhouette, and has to be again in every image.
    """

    view: View
    polarity: int
    inside: float
    outside: float
    probability: float = 0.0
    sure: bool = False
    rating: float = math.nan
    lead: float = math.nan
    returned: float = math.nan
    thin: float = math.nan
    alike: float = math.nan
    neck: float = math.nan
    cut: float = math.nan
    toned: float = math.nan
    around: float = math.nan
    level: float = math.nan
    recipe: int = -1
    channel: Channel = PLAIN
    grain: float = math.nan
    shaded: bool = False

    def _repr_png_(self) -> bytes:
        return png_of(self)

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        return to_dict(self)

    def __repr__(self) -> str:
        look = {1: "dark", -1: "light"}.get(self.polarity, "mixed")
        return f"Candidate({self.view!r}, {look}, probability {self.probability:.3f}{', sure' if self.sure else ''})"


def is_plausible_object(shape: Silhouette, size: tuple[int, ...]) -> bool:
    """Whether a silhouette is not the background: neither nearly the whole image nor along three of its sides."""
    x, y, w, h = shape.box
    touched = (x <= 0) + (y <= 0) + (x + w >= size[1]) + (y + h >= size[0])
    return shape.area <= MAX_SHARE * size[0] * size[1] and touched <= MAX_SIDES


def candidate_of_one_level(grey: Grey, shape: Silhouette, polarity: int, hidden: Grey | None) -> Candidate | None:
    """The contours of a silhouette found by a threshold, or None if it cannot be an object."""
    if not is_plausible_object(shape, grey.shape):
        return None
    try:
        edge = localize_contour(grey, shape.outer, hole=False, polarity=polarity, hidden=hidden)
    except ContourError:
        return None
    outer = edge.contour
    if _is_mostly_cut(outer) or outer.strength is None:
        return None
    strength = outer.strength if outer.clipped is None else outer.strength[~outer.clipped]
    slope, step = float(np.median(strength)), (edge.outside - edge.inside) * polarity
    if not (slope > 0.0 and step >= MIN_STEP * slope):
        return None
    holes = localize_holes(grey, list(shape.holes), edge, polarity, hidden)
    return Candidate(View([outer, *holes]), polarity, edge.inside, edge.outside)


def candidate_of_edges(
    image: Pixels, planes: Planes | None, shape: Silhouette, hidden: Grey | None
) -> Candidate | None:
    """The contours of a silhouette found by closed edges, in the mixture of colours of (H, W) or (H, W, 3) that shows it best.

    None where it looks like no object, has no contour in the image, or is mostly cut by the border. Holes are found in the
    image's planes, if given; pixels are ignored where `hidden` (H, W) is nonzero.
    """
    if not is_plausible_object(shape, image.shape):
        return None

    localized = partial(localize_contour, chain=shape.outer, hole=False, hidden=hidden, reach=CLOSED_EDGE_REACH)
    grey = PLAIN.to_grey(image)
    try:
        edge = localized(grey, polarity=0)
        channel = best_color_projection(image, edge.contour)
        if channel is not PLAIN:
            grey = channel.to_grey(image)
            edge = localized(grey, polarity=0)
        polarity = polarity_of(grey, edge.contour)
        if polarity:
            edge = localized(grey, polarity=polarity)
    except ContourError:
        return None
    if _is_mostly_cut(edge.contour):
        return None
    chains = [] if planes is None else background_within(planes, shape)
    view = View([edge.contour, *localize_holes(grey, chains, edge, polarity, hidden)])
    return Candidate(view, polarity, edge.inside, edge.outside, channel=channel)


def with_known_hole(candidate: Candidate, image: Pixels, chain: Chain, hidden: Grey | None) -> Candidate:
    """A candidate with the hole that a pixel chain (n, 2) runs round, if that lies within it and was not found."""
    outer, *found = candidate.view.contours
    within = all(contains_pixel(candidate.view, *at) for at in chain.tolist())
    grey = candidate.channel.to_grey(image)
    try:
        hole = localize_contour(grey, chain, hole=True, polarity=0, hidden=hidden, reach=CLOSED_EDGE_REACH).contour
    except ContourError:
        return candidate
    if not within or any(_is_same_contour(hole, other) for other in found):
        return candidate
    return candidate._replace(view=View([outer, hole, *found]))


def _is_mostly_cut(outline: Contour) -> bool:
    """Whether the border of the image, or what is hidden, makes more than half of an outline."""
    return outline.clipped is not None and bool(outline.clipped.mean() > 0.5)


def polarity_of(grey: Grey, outline: Contour) -> int:
    """+1 where nearly all of an outline rises outward, -1 where it falls, 0 where it is mixed."""
    normals = np.ascontiguousarray(outward_normals(outline.points, 1))
    rise = kernels.search_along_normals(grey, outline.points, normals, SIGN_REACH, 0)[:, 1]
    total = float(np.abs(rise).sum())
    share = float(rise[rise > 0.0].sum()) / total if total > 0.0 else 0.5
    return 1 if share >= ONE_SIGN else -1 if share <= 1.0 - ONE_SIGN else 0


# --- colours -------------------------------------------------------------------------------------


def alike_share(shape: Silhouette, planes: Planes, px: int) -> float:
    """Share of a region's outline with the same on both sides, as along a seam; how much colours vary along it is measured.

    The planes (h, w, C) are of the image reduced by `px`.
    """
    inside, outside = map(_mean_along, _side_colors(shape, planes, px, BEYOND_SEAM))
    along = np.linalg.norm(inside - np.roll(inside, SIDE_MEAN, axis=0), axis=1)
    return float((np.linalg.norm(outside - inside, axis=1) <= SIDE_NOISE * np.median(along)).mean())


def two_toned(shape: Silhouette, planes: Planes, px: int) -> tuple[float, float]:
    """How plainly a region's outline has two parts of different colours, 0 to 1: within it, as of two things, and round it.

    It is cut into two parts so that these explain most of how the colours on one side vary. That share counts as much as the
    parts differ beside the region's own contrast. The planes (h, w, C) are of the image reduced by `px`.
    """
    sides = tuple(map(_mean_along, _side_colors(shape, planes, px, SIDE_DEPTH)))
    contrast = float(np.median(np.linalg.norm(sides[0] - sides[1], axis=1)))
    return _parted_share(sides[0], contrast), _parted_share(sides[1], contrast)


def _parted_share(colours: Floats, contrast: float) -> float:
    """How plainly colours (n, C) along an outline of some contrast are those of two parts, 0 to 1."""
    n, centred = len(colours), colours - colours.mean(axis=0)
    sums = np.vstack([np.zeros((1, centred.shape[1])), np.cumsum(centred, axis=0)])
    count = np.arange(n + 1) - np.arange(n + 1)[:, None]
    cuts = (count >= MIN_TONE) & (count <= n - MIN_TONE)
    between = np.where(cuts, ((sums - sums[:, None]) ** 2).sum(axis=2) * n / np.maximum(count * (n - count), 1), 0.0)
    if not between.any():
        return 0.0
    best = np.unravel_index(int(np.argmax(between)), between.shape)
    explained, share = float(between[best]) / max(float((centred**2).sum()), MIN_LENGTH), float(count[best]) / n
    apart = math.sqrt(float(between[best]) / (n * share * (1.0 - share)))
    return (explained * min(1.0, apart / max(contrast, MIN_LENGTH))) ** 2


def _mean_along(colours: Floats) -> Floats:
    """Running means of colours (n, C) along an outline."""
    means = cv2.blur(colours, (1, SIDE_MEAN), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(means, dtype=np.float64).reshape(colours.shape)


def _side_colors(shape: Silhouette, planes: Planes, px: int, beyond: float) -> tuple[Floats, Floats]:
    """(n, C) colours SIDE_DEPTH px within a region's outline, and some px outside it."""
    points = (shape.boundary_points(SIDE_SAMPLES) - 0.5 * (px - 1)) / px
    normals = outward_normals(points, 2)
    return _sample_colors(planes, points - SIDE_DEPTH * normals), _sample_colors(planes, points + beyond * normals)


def outward_normals(points: Floats, step: int) -> Floats:
    """(n, 2) unit normals of a closed curve, of the chord from `step` points before each to as many after it."""
    ahead = np.roll(points, -step, axis=0) - np.roll(points, step, axis=0)
    lengths = np.maximum(np.hypot(*ahead.T), MIN_LENGTH)
    return np.asarray(np.column_stack([ahead[:, 1], -ahead[:, 0]]) / lengths[:, None])


def _sample_colors(image: Pixels | Planes, points: Floats) -> Floats:
    """(n, C) colours at points (n, 2) px, clamped to the image (H, W, C)."""
    column, row = np.rint(points).astype(np.intp).T
    return np.asarray(image[row.clip(0, image.shape[0] - 1), column.clip(0, image.shape[1] - 1)], dtype=np.float64)


def best_color_projection(image: Pixels, outline: Contour) -> Channel:
    """The mixture of colours that shows an outline best, if it is much better than plain grey.

    The colours differ across the outline by d at each point. The mixture w maximises the sum of (w d)^2 over the same sum
    for differences within the background: an eigenvector.
    """
    if image.ndim == 2:
        return PLAIN
    step = max(1, len(outline) // COLOR_SAMPLES)
    points, normals = outline.points[::step], outward_normals(outline.points, 2)[::step]
    within, beyond, farther = (_sample_colors(image, points + k * COLOR_DISTANCE * normals) for k in (-1.0, 1.0, 2.0))
    across, grain = beyond - within, beyond - farther
    between = across.T @ across / len(across)
    noise = grain.T @ grain / len(grain) + np.eye(3)
    root = np.linalg.inv(np.linalg.cholesky(noise))
    values, vectors = np.linalg.eigh(root @ between @ root.T)
    best, plain = root.T @ vectors[:, -1], np.array(PLAIN_WEIGHTS)
    if values[-1] < BETTER**2 * float(plain @ between @ plain) / float(plain @ noise @ plain):
        return PLAIN
    # strong edges on one part of the outline do not compensate for missing ones on another
    if _distinct_share(across, noise, best) < MIN_SHOWN * _distinct_share(across, noise, plain):
        return PLAIN
    best /= np.abs(best).sum()
    best = best if best.sum() >= 0.0 else -best
    b, g, r = np.round(best, 6).tolist()
    return Channel((b, g, r))


def _distinct_share(across: Floats, noise: Floats, weights: Floats) -> float:
    """Share of the outline's points with a clear difference."""
    difference = np.abs(across @ weights)
    grain = float(np.sqrt(weights @ noise @ weights))
    return float((difference >= max(CLEAR * grain, FAINT * float(np.median(difference)))).mean())


# --- several candidates --------------------------------------------------------------------------


def contains_pixel(view: View, x: float, y: float, margin: float = 0.0) -> bool:
    """Whether a pixel lies within the outer contour, or no more than a margin in px beside it."""
    return cv2.pointPolygonTest(view.outer.points.astype(np.float32), (float(x), float(y)), True) >= -margin


def distance_of_contacts(view: View, grasp: Grasp) -> tuple[float, float]:
    """px from an outline to the farthest of given contacts, and how far at most they lie on it."""
    return float(grasp.on(view)[:, 2].max()), ON_OUTLINE * math.sqrt(view.outer.area)


def is_same_region(one: View, other: View, share: float = SAME_REGION) -> bool:
    """Whether two outlines are of the same region, found in different ways."""
    return _is_same_contour(one.outer, other.outer, share)


def _is_same_contour(one: Contour, other: Contour, share: float = SAME_REGION) -> bool:
    ratio = one.area / other.area
    if not 1.0 - 2.0 * share < ratio < 1.0 / (1.0 - 2.0 * share):
        return False
    apart_by = one.points.mean(axis=0) - other.points.mean(axis=0)
    return math.hypot(*apart_by.tolist()) < share * math.sqrt(other.area)


def remove_nested(found: Sequence[Candidate]) -> list[Candidate]:
    """Those that neither lie within a better one, as its parts do, nor round it; nor, but for the first, a piece of ground that
    seams enclose, with the same on both sides of its outline."""
    kept: list[Candidate] = []
    for c in found:
        is_ground = bool(kept) and c.alike > MOSTLY_ALIKE
        if not is_ground and not any(_share_within(c.view, o.view) + _share_within(o.view, c.view) > 0.5 for o in kept):
            kept.append(c)
    return kept


def distinct_candidates(found: Sequence[Candidate], most: int = 3) -> list[Candidate]:
    """The likeliest candidates that a person would tell apart."""
    kept: list[Candidate] = []
    for c in found:
        if len(kept) < most and not any(is_same_region(c.view, o.view) for o in kept):
            kept.append(c)
    return kept


def numbered_candidate(found: Sequence[Candidate], number: int | None) -> Candidate:
    """Of the candidates that a person would tell apart the one with a number, 1 being the likeliest; the likeliest of None."""
    distinct = distinct_candidates(found, number or 1)
    if len(distinct) < (number or 1):
        raise InputError(f"there are {len(distinct)} candidates, not {number}", number=number)
    return distinct[-1]


def describe_candidate(candidate: Candidate, first: Candidate) -> str:
    """How a candidate lies to the first one, for a person: "round it, 3.1 times as large", "within it", "elsewhere"."""
    times = candidate.view.outer.area / first.view.outer.area
    cut = ", cut by the image's border" if candidate.view.is_clipped else ""
    if _share_within(first.view, candidate.view, SAME_EDGE) > MOSTLY:
        return f"round it, {times:.1f} times as large{cut}"
    if _share_within(candidate.view, first.view, SAME_EDGE) > MOSTLY:
        return f"within it, {100 * times:.0f} % of its area{cut}"
    return f"elsewhere{cut}"


def _share_within(inner: View, outer: View, margin: float = 0.0) -> float:
    """Share of an outline's points, of some thirty, that lie within another, or no more than a margin in px beside it."""
    points = inner.outer.points[:: max(1, len(inner.outer) // ENCLOSURE_SAMPLES)].tolist()
    return sum(contains_pixel(outer, x, y, margin) for x, y in points) / len(points)
