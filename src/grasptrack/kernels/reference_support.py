# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of the check of a carried outline against the edges of an image."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_edges import edge_search
from grasptrack.kernels.reference_evidence import carry_normals, projective_step

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Found = tuple[float, float, Floats, Floats, Floats, Bools, Bools, Floats, Floats]


def outline_support(
    image: NDArray[np.uint8],
    H: Floats,
    points: Floats,
    normals: Floats,
    strength: Floats,
    contacts: Floats,
    polarity: int,
    area: float,
    reach_share: float,
    least_reach: float,
    most_reach: float,
    least_strength: float,
    relative_strength: float,
    other_ground: float,
    loose: float,
) -> Found:
    """Edges where a reference outline, carried by a homography, says that they are.

    Args:
        image: (H, W).
        H: (3, 3) reference to current.
        points, normals, strength: (m, 2) px, (m, 2) unit and (m,) grey levels per px of the reference's samples; an
            infinite strength asks for none in particular. Where the polarity is 0, its sign is the edge's: positive for
            grey that rises outward.
        contacts: (k, 2) px in the image.
        polarity: +1 object darker than its surroundings, -1 lighter, 0 where its parts differ.
        area: px^2 of the object in the reference.
        reach_share, least_reach, most_reach: px searched on either side: a share of sqrt(area), within bounds.
        least_strength: grey levels per px of an edge.
        relative_strength: of an edge, relative to the reference's and to the gain of most.
        other_ground: share of the contrast by which the level beyond an edge may differ from that beyond most.
        loose: of `projective_step`, as a share of sqrt(area).

    Returns:
        size (px, sqrt(area) as carried; 0 where H sends the outline to infinity, and the rest is void), reach (px),
        (m, 2) points, (m, 2) normals, (m, 4) edges, (m,) inside the image, (m,) found, and the (k, 2) shift and
        (k, 2, 2) covariance of `projective_step`.
    """
    m, k = len(points), len(contacts)
    moved = carry_normals(H, points, normals)
    at, along = np.ascontiguousarray(moved[:, :2]), np.ascontiguousarray(moved[:, 2:4])
    size = math.sqrt(area * abs(float(moved[:, 4].mean()))) if np.isfinite(moved).all() else 0.0
    if not size > 0.0:
        none = np.zeros(m, dtype=np.bool_)
        return 0.0, 0.0, at, along, np.zeros((m, 4)), none, none, np.zeros((k, 2)), np.zeros((k, 2, 2))
    reach = min(max(reach_share * size, least_reach), most_reach)
    edges = search_edges(image, at, along, reach + 2.0, polarity, strength)
    last = (image.shape[1] - 2.0, image.shape[0] - 2.0)
    inside: Bools = np.all((at >= 1.0) & (at <= last), axis=1)
    offset, size_of = np.abs(edges[:, 0]), np.abs(edges[:, 1])
    found = inside & (offset <= reach) & (size_of >= least_strength)
    if found.any():
        gain = float(np.median((size_of / np.abs(strength))[found]))
        found &= size_of >= relative_strength * gain * np.where(np.isinf(strength), 0.0, np.abs(strength))
    sure = found & _on_the_ground(edges, found, other_ground)
    centre = at.mean(axis=0)
    radius = math.sqrt(float(np.einsum("ni,ni->", at - centre, at - centre)) / m)
    shift, covariance = projective_step(at[sure], along[sure], edges[sure, 0], contacts, radius, loose * size)
    return size, reach, at, along, edges, inside, found, shift, covariance


def search_edges(
    image: NDArray[np.uint8], at: Floats, along: Floats, reach: float, polarity: int, strength: Floats
) -> Floats:
    """(m, 4) `edge_search` with the polarity, or where that is 0 in the direction of each sample's own strength."""
    if polarity:
        return edge_search(image, at, along, reach, polarity)
    edges = np.empty((len(at), 4))
    direction = np.where(np.isinf(strength), 0.0, np.where(strength > 0.0, 1.0, -1.0))
    for each in (-1, 0, 1):
        which = direction == each
        edges[which] = edge_search(image, at[which], along[which], reach, each)
    return edges


def hidden_at(clear: NDArray[np.uint8], at: Floats, by: float = 0.0) -> Bools:
    """(m,) whether the pixel at a place (m, 2) is hidden, or within so many px of it.

    Args:
        clear: (H, W) px from each pixel to what is hidden, 0 in it.
        at: places.
        by: px.
    """
    last = np.array(clear.shape[::-1]) - 1.0
    x, y = np.floor(at.clip(0.0, last) + 0.5).astype(np.intp).T
    return np.asarray(clear[y, x] <= by)


def in_hidden(clear: NDArray[np.uint8] | None, at: Floats, along: Floats, offsets: Floats) -> Bools:
    """(m,) samples that are hidden, or whose edge is: beside what is hidden its own edges are found in their place.

    Args:
        clear: as for `hidden_at`; None where nothing is hidden.
        at, along: (m, 2) samples and their normals.
        offsets: (m,) px of the edges, NaN without one.
    """
    if clear is None:
        return np.zeros(len(at), dtype=np.bool_)
    there = at + np.where(np.isfinite(offsets), offsets, 0.0)[:, None] * along
    return hidden_at(clear, at) | hidden_at(clear, there)


def _on_the_ground(edges: Floats, found: Bools, other_ground: float) -> Bools:
    """(m,) edges with the same ground beyond them as most: the same level, or as much lighter as the object is there."""
    if not found.any():
        return found
    within, beyond = edges[:, 2], edges[:, 3]
    dark, light = float(np.median(within[found])), float(np.median(beyond[found]))
    spread = 1.4826 * float(np.median(np.abs(beyond[found] - light)))
    tolerance = max(other_ground * abs(light - dark), 4.0 * spread)
    lit = light * within / max(dark, 1.0)
    return np.asarray((np.abs(beyond - light) <= tolerance) | (np.abs(beyond - lit) <= tolerance))
