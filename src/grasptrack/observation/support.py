# SPDX-License-Identifier: Apache-2.0
"""Does the image bear out a motion: edges where the reference outline, carried along by it, says that they are."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import Bools, View
from grasptrack.errors import ConditioningError
from grasptrack.kernels.reference_contradiction import attached
from grasptrack.kernels.reference_support import hidden_at
from grasptrack.kernels.reference_weighing import expected_levels
from grasptrack.observation.images import Grey
from grasptrack.observation.registration import BESIDE_HIDDEN
from grasptrack.observation.segmentation import clearance

Floats = NDArray[np.float64]

SAMPLES = 240
"""Points of the reference outline that are looked for in every image, ..."""
STEP, MOST_SAMPLES = 0.025, 480
"""... or as many as lie this fraction of sqrt(area) apart, if that is more, up to a bound: a tab must not fall between."""
PER_CONTACT = 5
"""More of them under each finger."""
REACH = 0.02
"""Edges are searched on either side within this fraction of sqrt(area), ..."""
MIN_REACH, MAX_REACH = 3.0, 12.0
"""... and within these px."""
MIN_STRENGTH = 2.0
"""Grey levels per px below which nothing counts as an edge."""
RELATIVE_STRENGTH = 0.3
"""An edge counts when it is so strong relative to the reference's, exposure and blur of the whole image allowed for."""
OTHER_GROUND = 0.3
"""An edge whose far side differs from the ground round the rest of the outline by this share of the contrast may be the
edge of something in front. It does not speak against the outline, but it fixes nothing."""
KNOWN_BESIDE = 3
"""Samples on either side of one that speaks against the outline in its own image, which tell nothing later either."""
LOOSE = 0.25
"""What the outline does not show of a motion may be as large as this fraction of sqrt(area)."""


class Support(NamedTuple):
    """What was found along the carried outline.

    Attributes:
        share: of the samples inside the image, how many have their edge within reach.
        visible: of all samples, how many lie inside the image.
        rms: px, of the edges' offsets from the carried outline; of what was found.
        spread: px, 90 % of those offsets are smaller.
        reach: px on either side in which edges were searched.
        shift: (k, 2) px, by how much a homography refined on these edges would still move each contact: what the
            transfer gets wrong, as far as the outline shows it.
        covariance: (k, 2, 2) px^2 of that shift: large where the outline in view leaves a motion open.
        seen: (k,) share of the samples under each finger that have their edge within reach.
        size: px, square root of the object's area as carried along.
        levels: median grey levels on the inner and the outer side of the edges that were found.
        contradicted: of the samples inside the image, how many show ground where material should be, or material that
            ends farther out: another shape. What is merely covered does not count.
    """

    share: float
    visible: float
    rms: float
    spread: float
    reach: float
    shift: Floats
    covariance: Floats
    seen: Floats
    size: float
    contradicted: float = 0.0
    levels: tuple[float, float] = (math.nan, math.nan)


class OutlineSamples:
    """Points along a reference outline, with their normals and edge strengths.

    Args:
        view: the reference outline.
        grey: the image it came from.
        contacts: (k, 2) px on the outline.
        width: px, of a finger.
        polarity: +1 object darker than its surroundings, -1 lighter, 0 where its parts differ: each sample then asks for an
            edge of its own direction.
        hidden: (H, W) nonzero where nothing belongs to the scene, in this image and in those that follow.

    Attributes:
        against, missed: (count,) samples that spoke against the outline, and that were in the image without their edge,
            when it was looked for last.
        ground, grain: median grey level of the ground beyond the outline, and its spread.
    """

    def __init__(
        self, view: View, grey: Grey, contacts: Floats, width: float, polarity: int, hidden: Grey | None = None
    ) -> None:
        total = sum(c.length for c in view.contours)
        area = kernels.inertia(view.points, view.offsets)[0]
        count = min(max(SAMPLES, round(total / (STEP * math.sqrt(area)))), MOST_SAMPLES)
        places = [
            np.column_stack(
                [np.full(n, float(i)), np.interp(np.arange(n) * (c.length / n), c.arc_length, np.arange(len(c) + 1.0))]
            )
            for i, c in enumerate(view.contours)
            if (n := max(4, round(count * c.length / total)))
        ]
        for contour, position, _ in kernels.locate(view.points, view.offsets, contacts).tolist():
            c = view.contours[int(contour)]
            here = float(np.interp(position, np.arange(len(c) + 1.0), c.arc_length))
            s = np.mod(here + width * np.linspace(-0.5, 0.5, PER_CONTACT), c.length)
            places.append(
                np.column_stack([np.full(PER_CONTACT, contour), np.interp(s, c.arc_length, np.arange(len(c) + 1.0))])
            )
        where = np.ascontiguousarray(np.concatenate(places))
        where[:, 1] = np.mod(where[:, 1], [len(view.contours[int(i)]) for i in where[:, 0]])
        points = kernels.point_at(view.points, view.offsets, where)
        frames = kernels.contact_frames(view.points, view.offsets, where, 6.0)
        edges = kernels.edge_search(grey, points, np.ascontiguousarray(-frames[:, :2]), 4.0, polarity)
        strength = np.abs(edges[:, 1])
        # where the reference itself shows no edge, none can be asked for
        strong = ~np.isnan(edges[:, 0]) & (strength >= MIN_STRENGTH)
        clear = clearance(hidden)
        if clear is not None:
            strong &= ~hidden_at(clear, points, BESIDE_HIDDEN)
        strong &= strength >= RELATIVE_STRENGTH * (float(np.median(strength[strong])) if strong.any() else 0.0)
        outline = np.arange(len(where)) < len(where) - PER_CONTACT * len(contacts)
        keep = strong | ~outline
        self.points: Floats = np.ascontiguousarray(points[keep])
        self.normals: Floats = np.ascontiguousarray(-frames[keep, :2])
        self.strength: Floats = np.where(strong, strength if polarity else edges[:, 1], np.inf)[keep]
        self.outline: Bools = outline[keep]
        self.inside: Floats = edges[keep, 2]
        self.outside: Floats = edges[keep, 3]
        self.polarity = polarity
        self._hidden, self._clear = hidden, clear
        self.contacts = len(contacts)
        self.count = int(np.count_nonzero(self.outline))
        self.area = area
        self.share = float(strong[outline].mean())
        beyond = self.outside[strong[keep]]
        self.ground = float(np.median(beyond)) if len(beyond) else math.nan
        self.grain = 1.4826 * float(np.median(np.abs(beyond - self.ground))) if len(beyond) else math.nan
        self._beside: Bools = np.zeros(self.count, dtype=np.bool_)
        if not polarity:
            # what lies at the object from the first tells nothing later
            ground, material = expected_levels(edges[keep], strong[keep], self.inside, self.outside, polarity)
            first = slice(self.count)
            self._beside = attached(
                grey,
                self.points[first],
                self.normals[first],
                material[first],
                ground[first],
                MIN_REACH,
                math.sqrt(self.area),
                hidden,
            )
        # nor does what already speaks against the outline where it was seen first, as print that reaches its edge may
        self._known: Bools = np.zeros(self.count, dtype=np.bool_)
        self.against: Bools = self._known
        self.missed: Bools = self._known
        self.support(grey, np.eye(3), contacts)
        shifts = range(-KNOWN_BESIDE, KNOWN_BESIDE + 1)
        self._known = np.logical_or.reduce([np.roll(self.against, shift) for shift in shifts])

    def support(self, grey: Grey, H: Floats, contacts: Floats) -> Support:
        """Look for the outline in an image under H (3, 3), reference to current, that puts the contacts at (k, 2).

        Raises:
            ConditioningError: H sends part of the outline to infinity.
        """
        size, reach, points, normals, edges, inside, found, shift, covariance = self._edges(grey, H, contacts)
        if not size > 0.0:
            raise ConditioningError("the homography sends part of the object to infinity")
        share, visible, rms, spread, seen, against, levels, self.against = kernels.weigh_edges(
            grey,
            points,
            normals,
            edges,
            inside,
            found,
            self.inside,
            self.outside,
            self.contacts,
            self.polarity,
            reach,
            size,
            self._beside,
            self._known,
            self._hidden,
        )
        self.missed = (inside & ~found)[self.outline]
        return Support(share, visible, rms, spread, reach, shift, covariance, seen, size, against, levels)

    def _edges(self, grey: Grey, H: Floats, contacts: Floats) -> tuple[Any, ...]:
        """What `kernels.outline_support` finds. Samples whose edge might be that of something hidden are not in view."""
        rules = REACH, MIN_REACH, MAX_REACH, MIN_STRENGTH, RELATIVE_STRENGTH, OTHER_GROUND, LOOSE
        blind = self._blind(H)
        if blind is None or blind.all():
            samples = self.points, self.normals, self.strength
            told = kernels.outline_support(grey, H, *samples, contacts, self.polarity, self.area, *rules)
            return told if blind is None else (*told[:5], told[5] & ~blind, told[6] & ~blind, *told[7:])
        seen = ~blind
        samples = self.points[seen], self.normals[seen], self.strength[seen]
        told = kernels.outline_support(grey, H, *samples, contacts, self.polarity, self.area, *rules)
        size, reach, *of_samples, shift, covariance = told
        carried = kernels.carry_normals(H, self.points, self.normals)
        points, normals = np.ascontiguousarray(carried[:, :2]), np.ascontiguousarray(carried[:, 2:4])
        edges = np.zeros((len(seen), 4))
        edges[:, 0] = np.nan
        inside, found = np.zeros((2, len(seen)), dtype=np.bool_)
        edges[seen], inside[seen], found[seen] = of_samples[2:]
        return size, reach, points, normals, edges, inside, found, shift, covariance

    def _blind(self, H: Floats) -> Bools | None:
        """(n,) samples that H puts within reach of what does not belong to the scene; None where it puts none there."""
        if self._clear is None:
            return None
        carried = kernels.carry_normals(H, self.points, self.normals)
        if not np.isfinite(carried).all():
            return None
        size = math.sqrt(self.area * abs(float(carried[:, 4].mean())))
        blind = hidden_at(self._clear, carried[:, :2], min(max(REACH * size, MIN_REACH), MAX_REACH))
        return blind if blind.any() else None
