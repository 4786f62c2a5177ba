# SPDX-License-Identifier: Apache-2.0
"""The flat objects in a first image: many proposals, one rating.

Thresholds propose silhouettes of one grey level, closed edges those of several colours. Each is rated along its outline,
and the best become contours.
"""

from __future__ import annotations

import math
from typing import Any, Protocol, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError, ObservationError
from grasptrack.geometry.contours import View
from grasptrack.plugins import load_plugin, plugin_names
from grasptrack.segmentation.candidate import Candidate, contains_pixel, of_closed_edges, of_one_level
from grasptrack.segmentation.closed_edges import ClosedEdgeSegmenter
from grasptrack.segmentation.images import Grey, as_scene, to_bgr, to_grey, to_mask
from grasptrack.segmentation.normalized_gradient import Planes, lab_planes
from grasptrack.segmentation.proposals import Box, Proposal, box_iou, is_alike, propose_silhouettes
from grasptrack.segmentation.shadow import without_shadow
from grasptrack.segmentation.silhouettes import Silhouette

MIN_EXTENT = 20
"""px across; a smaller object has no outline worth following."""
LOOKED_AT = 6
"""Proposals that become contours, the best first; after them only those apart from everything found so far."""
SHADOWS = 3
"""Objects that are checked for a shadow, the best first."""
MOST = 60
"""Largest number of proposals that become contours."""
WORTH = 0.02
"""Ratings below this are chance, ..."""
FAINT = 0.3
"""... and those below this share of the best are clutter beside it."""


class Segmenter(Protocol):
    """Your own segmentation instead of this one: a network, or a model of the object."""

    def segment(self, image: NDArray[Any]) -> NDArray[Any]:
        """(H, W) nonzero on objects, of an image (H, W) or (H, W, 3)."""
        ...


def segmenter_named(name: str) -> Segmenter:
    """A segmenter that a package registered by the entry point `grasptrack.segmenters`; a class is instantiated.

    Raises:
        InputError: none of that name, or it cannot be had.
    """
    found = load_plugin("grasptrack.segmenters", name)
    if found is None:
        known = ", ".join(plugin_names("grasptrack.segmenters")) or "none is installed"
        raise InputError(f'unknown segmenter "{name}"; packages register them ({known})', name=name)
    return cast(Segmenter, found() if isinstance(found, type) else found)


def segment_object(
    image: NDArray[Any],
    object_at: tuple[float, float] | None = None,
    ignore: NDArray[Any] | None = None,
    box: Box | None = None,
) -> View:
    """Outline of the flat object that stands out in an image, or of the one under a pixel or in a box.

    Args:
        image: 8 or 16 bit, grey, BGR or BGRA.
        object_at: (x, y) px of the object.
        ignore: (H, W) nonzero where pixels are ignored.
        box: left, top, width and height of the object, px.

    Raises:
        ObservationError: no object, or none there.
    """
    return find_objects(image, object_at, box, ignore)[0].view


def find_objects(
    image: NDArray[Any],
    object_at: tuple[float, float] | None = None,
    box: Box | None = None,
    ignore: NDArray[Any] | None = None,
    mask: NDArray[Any] | None = None,
) -> list[Candidate]:
    """All flat objects in an image, none within another: the chosen one first, then the most outstanding.

    Args:
        image: 8 or 16 bit, grey, BGR or BGRA.
        object_at: (x, y) px of the chosen object.
        box: left, top, width and height of it, px.
        ignore: (H, W) nonzero where pixels are ignored.
        mask: (H, W) nonzero on objects: your own segmentation, which replaces the image.

    Raises:
        ObservationError: no object, or none there.
        InputError: a mask of another size.
    """
    shape = image.shape[:2]
    hidden = None if ignore is None else dilate_mask(to_mask(ignore, shape, "ignore mask"))
    scene = image if mask is None else as_scene(to_mask(mask, shape, "mask"))
    return remove_nested(find_candidates(scene, object_at, hidden, masked=mask is not None, box=box, others=True))


def dilate_mask(hidden: Grey | None) -> Grey | None:
    """The ignored pixels and a margin of two, in which edges belong to them."""
    return None if hidden is None else np.asarray(cv2.dilate(hidden, np.ones((5, 5), np.uint8)), dtype=np.uint8)


def find_candidates(
    image: NDArray[Any],
    object_at: tuple[float, float] | None = None,
    hidden: Grey | None = None,
    *,
    masked: bool = False,
    box: Box | None = None,
    others: bool = False,
) -> list[Candidate]:
    """Objects in an image, the most outstanding first; also parts of objects, and what they lie on.

    Args:
        image: grey or colour.
        object_at: (x, y) px that the object covers.
        hidden: (H, W) nonzero where pixels are ignored.
        masked: the image is a softened mask with white objects.
        box: left, top, width and height of the object, px.
        others: append those that are not at `object_at` or in the box.

    Raises:
        ObservationError: none, or none there.
    """
    colours = to_bgr(image)
    grey = to_grey(colours)
    seen = lab_planes(colours)
    proposals = propose_silhouettes(grey, ClosedEdgeSegmenter(seen, hidden), hidden, masked, MIN_EXTENT)
    meant = [p for p in proposals if p.is_meant(object_at, box)]
    if box is not None:
        meant.sort(key=lambda p: -p.worth * box_iou(p.silhouette.box, box))
    found = _candidates_from_proposals(meant, colours, grey, seen, hidden)
    if object_at is not None:
        found = [c for c in found if contains_pixel(c.view, *object_at)]
    if not found:
        raise _no_object_error(meant, object_at, box)
    if others and (object_at is not None or box is not None):
        found = [found[0], *_candidates_from_proposals(proposals, colours, grey, seen, hidden)]
    return found


def remove_nested(found: list[Candidate]) -> list[Candidate]:
    """Candidates that neither lie within a better one, as its parts do, nor around it."""
    kept: list[Candidate] = []
    for c in found:
        if not any(_share_within(c.view, o.view) + _share_within(o.view, c.view) > 0.5 for o in kept):
            kept.append(c)
    return kept


def _candidates_from_proposals(
    proposals: list[Proposal], colours: NDArray[np.uint8], grey: Grey, seen: Planes, hidden: Grey | None
) -> list[Candidate]:
    """The best proposals as contours, each object once."""
    found: list[Candidate] = []
    taken = np.zeros(grey.shape, np.uint8)
    looked = 0
    least = max(WORTH, FAINT * max((p.rating.score for p in proposals), default=0.0))
    for p in proposals:
        if max(p.silhouette.box[2:]) < MIN_EXTENT or p.rating.score < least or looked >= MOST:
            continue
        part = _overlaps_found(p.silhouette, taken, found)
        if part and looked >= LOOKED_AT:
            continue
        looked += 1
        shaded = False
        if not part and len(found) < SHADOWS:
            p, shaded = _out_of_shadow(p, proposals, colours)
        if p.recipe < 0 and not shaded:
            candidate = of_one_level(grey, p.silhouette, p.polarity, hidden)
        else:
            candidate = of_closed_edges(colours, None if part else seen, p.silhouette, hidden)
        if candidate is not None and not any(_is_same_region(candidate.view, other.view) for other in found):
            rated = candidate._replace(score=p.worth, rating=p.rating)
            found.append(rated._replace(level=p.level, recipe=p.recipe, grain=p.grain, shaded=shaded))
            cv2.drawContours(taken, [p.silhouette.outer.reshape(-1, 1, 2)], -1, (255,), cv2.FILLED)
    return found


def _out_of_shadow(p: Proposal, proposals: list[Proposal], colours: NDArray[np.uint8]) -> tuple[Proposal, bool]:
    """A proposal without its object's shadow, and whether that had to be cut out.

    Where another proposal is the object alone, that one is taken.
    """
    alone = without_shadow(colours, p.silhouette)
    if alone is None:
        return p, False
    alike = [other for other in proposals if is_alike(other.silhouette, alone)]
    return (alike[0], False) if alike else (p._replace(silhouette=alone), True)


def _overlaps_found(shape: Silhouette, taken: NDArray[np.uint8], found: list[Candidate]) -> bool:
    """Whether a good part of a silhouette lies within the objects found, or around one of them."""
    if not found:
        return False
    column, row = shape.outer.T
    if taken[row.clip(0, taken.shape[0] - 1), column.clip(0, taken.shape[1] - 1)].mean() > 0.4 * 255.0:
        return True
    corners = (c.view.outer.points[k * len(c.view.outer) // 3] for c in found for k in range(3))
    return any(shape.contains(x, y) for x, y in (corner.tolist() for corner in corners))


def _no_object_error(meant: list[Proposal], object_at: tuple[float, float] | None, box: Box | None) -> ObservationError:
    """The error that says why there is no object."""
    where = "" if object_at is None else f" at {object_at[0]:g},{object_at[1]:g}"
    where = where if box is None else " in the box"
    tiny = max((e for p in meant if (e := max(p.silhouette.box[2:])) < MIN_EXTENT), default=0)
    if tiny >= 5:
        return ObservationError(
            f"the object{where} is {tiny} px across; at least {MIN_EXTENT} px are needed", extent=tiny
        )
    return ObservationError(f"no object stands out{where or ' in the image'}", object_at=object_at, box=box)


def _is_same_region(one: View, other: View) -> bool:
    """Whether two outlines are of the same region, found in different ways."""
    area, a = one.outer.area, other.outer.area
    apart_by = one.outer.points.mean(axis=0) - other.outer.points.mean(axis=0)
    return 0.8 < area / a < 1.25 and math.hypot(*apart_by.tolist()) < 0.1 * math.sqrt(a)


def _share_within(inner: View, outer: View) -> float:
    """Share of an outline's points, of some thirty, that lie within another."""
    points = inner.outer.points[:: max(1, len(inner.outer) // 30)].tolist()
    return sum(contains_pixel(outer, x, y) for x, y in points) / len(points)
