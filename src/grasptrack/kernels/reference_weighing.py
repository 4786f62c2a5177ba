# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of what the edges found along a carried outline say for it and against it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_contradiction import attached, contradicted, levels_at

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Weighed = tuple[float, float, float, float, Floats, float, tuple[float, float], Bools]

HOPELESS = 0.5
"""Where more of the samples than this miss their edge, it is not worth while to ask why."""
BESIDE = 1.75
"""px from an edge, the material of a thin part begins and has not ended."""
LEAST = 8
"""Edges that must be found before their levels tell what ground and material look like."""
CLEAR = 3.0
"""The contrast must exceed so many times the levels' own spread, or they tell nothing apart."""
MATERIAL = 0.3
"""Across an edge of an object of several colours, grey changes at least by this share of what it does elsewhere: on
either side of a line on the ground it is the same."""


def weigh_edges(
    image: NDArray[np.uint8],
    points: Floats,
    normals: Floats,
    edges: Floats,
    inside: Bools,
    found: Bools,
    reference_inside: Floats,
    reference_outside: Floats,
    contacts: int,
    polarity: int,
    reach: float,
    size: float,
    beside: Bools,
    known: Bools,
    hidden: NDArray[np.uint8] | None,
) -> Weighed:
    """What the edges that `outline_support` found say.

    The first n samples go round the outline in its order; the others lie under the contacts, as many under each.

    Args:
        image: (H, W).
        points, normals, edges, inside, found: (m, 2), (m, 2), (m, 4), (m,) and (m,), of `outline_support`.
        reference_inside, reference_outside: (m,) grey levels on either side of each sample in the reference.
        contacts: how many.
        polarity: +1 object darker than its surroundings, -1 lighter, 0 where its parts differ.
        reach: px searched on either side.
        size: px, sqrt(area).
        beside: (n,) samples beyond which something of the object's colours ends in the reference already.
        known: (n,) samples that the reference contradicts already.
        hidden: (H, W) nonzero where nothing belongs to the scene; None where all does.

    Returns:
        share of the outline's samples in the image that have their edge, share of all that are in the image, rms and
        90th percentile of the edges' offsets in px (infinite without any), (k,) share of the samples under each contact
        that have their edge, share of those in the image that it contradicts, median grey levels on the inner and outer
        side of the edges, and (n,) which samples are contradicted. An edge without material on its inner side, a line
        on the ground for one, is none of the outline's.
    """
    m, n = len(points), len(beside)
    if not 0 < n <= m or contacts < 1 or (m - n) % contacts or len(known) != n:
        raise ValueError("samples round the outline are needed, and as many under each contact")
    if any(len(each) != m for each in (normals, edges, inside, found, reference_inside, reference_outside)):
        raise ValueError("each sample needs its normal, edge, flags and levels")
    ground, material = expected_levels(edges, found, reference_inside, reference_outside, polarity)
    offset = np.where(found, edges[:, 0], 0.0) - BESIDE
    within = levels_at(image, points + offset[:, None] * normals)
    lit = np.clip(edges[:, 3] / np.maximum(ground, 1.0), 0.0, 1.0)  # in shadow both sides are darker
    if polarity:
        found = found & ~(np.abs(within - lit * ground) < np.abs(within - lit * material))
    else:
        found = found & ~(np.abs(within - edges[:, 3]) < MATERIAL * lit * np.abs(material - ground))
    asked = int(np.count_nonzero(inside[:n]))
    hits = np.abs(edges[:n][found[:n], 0])
    against = np.zeros(n, dtype=np.bool_)
    missed = (inside & ~found)[:n]
    if np.count_nonzero(missed) <= HOPELESS * m:
        at, along, own, other = points[:n], normals[:n], material[:n], ground[:n]
        if missed.any():
            against = contradicted(image, at, along, missed, own, other, reach, size, hidden)
        if not polarity:
            more = attached(image, at, along, own, other, reach, size, hidden)
            against = against | (more & inside[:n] & ~beside)
        against &= ~known
    return (
        len(hits) / asked if asked else 0.0,
        asked / n,
        math.sqrt(float(hits @ hits) / len(hits)) if len(hits) else math.inf,
        float(np.sort(hits)[(9 * len(hits)) // 10]) if len(hits) else math.inf,
        found[n:].reshape(contacts, -1).mean(axis=1) if m > n else np.full(contacts, math.nan),
        float(np.count_nonzero(against)) / asked if asked else 0.0,
        (float(np.median(edges[found, 2])), float(np.median(edges[found, 3]))) if found.any() else (math.nan, math.nan),
        against,
    )


def expected_levels(
    edges: Floats, found: Bools, inside: Floats, outside: Floats, polarity: int
) -> tuple[Floats, Floats]:
    """(m,) grey levels of the ground and of the material to expect at each sample; NaN where they tell nothing.

    Args:
        edges: (m, 4) of `edge_search`.
        found: (m,) which of them count.
        inside, outside: (m,) grey levels on either side of each sample in the reference.
        polarity: as for `weigh_edges`.
    """
    if np.count_nonzero(found) < LEAST:
        nothing = np.full(len(edges), math.nan)
        return nothing, nothing
    beyond = edges[found, 3]
    light = float(np.median(beyond))
    spread = 1.4826 * float(np.median(np.abs(beyond - light)))
    if polarity:
        material = inside + float(np.median(edges[found, 2] - inside[found]))
    else:  # what is lighter and what is darker than the ground changes alike
        usual = float(np.median(outside[found]))
        then = inside[found] - usual
        # fmax passes over levels that are unknown, and of nothing but such it is unknown itself
        clear = np.abs(then) >= 0.5 * np.fmax.reduce(np.abs(then))
        with np.errstate(divide="ignore", invalid="ignore"):
            gains = (edges[found, 2] - light)[clear] / then[clear]
            gain = float(np.median(gains)) if len(gains) else math.nan
            material = light + gain * (inside - usual)
    return np.where(np.abs(light - material) > CLEAR * spread, light, math.nan), material
