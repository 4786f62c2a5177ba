# SPDX-License-Identifier: Apache-2.0
"""The paper's three transfers to the letter, to be held against our own, with each improvement as a switch of its own.

What the text leaves open is taken in the paper's favour and said where it is: the scale of curvature, the sizes of the
window and the neighbourhood, and the direction of an inertia axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.errors import AmbiguousError, ConditioningError, CrossingError, PeaksError, StrategyError
from grasptrack.geometry.contours import Contour, Outline
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer import TransferStrategy
from grasptrack.transfer import homography as ours
from grasptrack.transfer.alignment import find_alignments
from grasptrack.transfer.base import Transfer
from grasptrack.transfer.rrp import INTERPOLATED
from grasptrack.typing import Floats, Ints


class NearestSamples(NamedTuple):
    """RRP coordinates as whole numbers: contour and point p = 6 ref + interp of each contact; points of each contour."""

    contour: Ints
    point: Ints
    counts: Ints

    @property
    def coordinates(self) -> list[tuple[int, int, int]]:
        """(c, ref, interp) of each contact."""
        return [(c, *divmod(p, INTERPOLATED)) for c, p in zip(self.contour.tolist(), self.point.tolist(), strict=True)]


class LiteralRRP:
    """Sections III-A and IV-A: a contact is a sample of the tracked contour, named by two whole numbers."""

    def describe(self, grasp: Grasp, view: Outline) -> NearestSamples:
        """The sample nearest to each contact."""
        apart = np.linalg.norm(view.points[None] - grasp.contacts[:, None], axis=2).argmin(axis=1)
        contour = np.searchsorted(view.offsets, apart, side="right") - 1
        return NearestSamples(contour, apart - view.offsets[contour], np.diff(view.offsets))

    def apply(self, description: NearestSamples, view: Outline, prior: Floats | None = None) -> Transfer:
        """The same samples of another contour."""
        if not np.array_equal(description.counts, np.diff(view.offsets)):
            raise StrategyError("RRP needs contours whose points correspond one to one")
        contacts = view.points[view.offsets[description.contour] + description.point]
        return Transfer(Grasp.of(contacts), None, None, math.nan)


class LineOverArea(NamedTuple):
    """Grasp-line coordinates as printed, and the direction of I_min that alpha_m was measured from.

    Attributes:
        d_c, d_1, d_2: distances over the area, 1/px; over its root, without unit, where the switch says so.
        alpha_m: rad.
        area, centroid, theta: of the first silhouette: px^2, px, rad.
    """

    d_c: float
    alpha_m: float
    d_1: float
    d_2: float
    area: float
    centroid: tuple[float, float]
    theta: float


@dataclass(frozen=True)
class LiteralGraspLine:
    """Sections III-B and IV-B.

    Of the axis' two directions that one is taken which turns less from where it was last, or, without a prior, from the
    first view: the text is silent on it, and any other rule would lose more.

    Attributes:
        invariant: divide distances by the root of the area, which is our improvement, instead of the area.
    """

    invariant: bool = False

    def describe(self, grasp: Grasp, view: Outline) -> LineOverArea:
        """Grasp-line coordinates."""
        if len(grasp.contacts) != 2:
            raise StrategyError(f"grasp-line coordinates carry two fingers, not {len(grasp)}", fingers=len(grasp))
        line = kernels.grasp_line(view.points, view.offsets, grasp.contacts)
        over = self._scale(line.area)
        return LineOverArea(
            line.d_c * over, line.alpha_m, line.d_1 * over, line.d_2 * over, line.area, line.centroid, line.angle
        )

    def apply(self, description: LineOverArea, view: Outline, prior: Floats | None = None) -> Transfer:
        """The crossings of the outline nearest to where the coordinates put the contacts."""
        d = description
        turn = 0.0
        if prior is not None:
            a, b = apply_homography(prior, np.array([d.centroid, np.add(d.centroid, _unit(d.theta))]))
            turn = math.atan2(*(b - a)[::-1].tolist()) - d.theta
        over = self._scale(kernels.polygon_moments(view.points, view.offsets).area)
        line = d.d_c / over, d.alpha_m, d.d_1 / over, d.d_2 / over
        reference = d.area, *d.centroid, d.theta
        ahead = _unit(d.theta + turn)
        found = kernels.carry_grasp_line(view.points, view.offsets, line, reference, ahead)
        if not (math.isfinite(found.residual) and np.isfinite(found.contacts).all()):
            raise CrossingError("the grasp line does not meet the outline twice")
        return Transfer(Grasp.of(found.contacts), found.H, None, found.residual)

    def _scale(self, area: float) -> float:
        """What turns distances over the root of the area into this description's."""
        return 1.0 if self.invariant else 1.0 / math.sqrt(area)


def _unit(angle: float) -> tuple[float, float]:
    return math.cos(angle), math.sin(angle)


class Peaks(NamedTuple):
    """What is kept of the first contour: contacts (k, 2) px, the contour, its curvature vector, four samples."""

    contacts: Floats
    outline: Contour
    curvature: Floats
    samples: list[int]


@dataclass(frozen=True)
class LiteralHomography:
    """Section IV-C: the four highest peaks of curvature, eq. (3) in a window about an index, whole samples, Fig. 11.

    Lengths are counted in samples, as on chains of pixels. Without a switch the prior is not looked at: where frames are
    consecutive, the transfer goes from each to the next. The radii of window and neighbourhood, of which the text tells no
    value, and the scale of curvature are those that our own strategy takes.

    Attributes:
        scale_free: compare curvature times length instead of curvature per px.
        chosen: choose well-separated peaks whose quadrilateral fixes a homography well, instead of the four highest.
        aligned: centre the window where the prior puts the point, or else the alignment of both outlines, instead of the
            index kappa i.
        between: search the least error of eq. (3) between samples, too.
        refined: move the contacts onto the outline along their line (Fig. 11); the paper does.
    """

    scale_free: bool = False
    chosen: bool = False
    aligned: bool = False
    between: bool = False
    refined: bool = True

    def describe(self, grasp: Grasp, view: Outline) -> Peaks:
        """Select the four points."""
        if len(grasp.contacts) != 2:
            raise StrategyError(f"the refinement of Fig. 11 is for two fingers, not {len(grasp)}", fingers=len(grasp))
        if self.chosen:
            description = ours.describe(grasp, view)
            samples = description.peaks[:4]
        else:
            samples = highest_peaks(kernels.curvature_vector(view.contours[0].points, None, ours.SMOOTHING).curvature)
        return Peaks(grasp.contacts, view.contours[0], self._curvature(view.contours[0]), samples)

    def apply(self, description: Peaks, view: Outline, prior: Floats | None = None) -> Transfer:
        """The four steps of Fig. 9."""
        return self.applied(description, view, self.homography(description, view.contours[0], prior))

    def applied(self, description: Peaks, view: Outline, H: Floats) -> Transfer:
        """Steps 3 and 4: the contacts through H (3, 3), and moved onto the outline."""
        applied = apply_homography(H, description.contacts)
        if not np.isfinite(applied).all():
            raise ConditioningError("the homography sends a contact to infinity")
        if not self.refined:
            return Transfer(Grasp.of(applied), H, None, 0.0)
        found = kernels.refine_contacts(H, description.contacts, None, view.points, view.offsets)
        if not math.isfinite(found.residual):
            raise CrossingError("the line through the transferred contacts does not meet the outline twice")
        return Transfer(Grasp.of(found.contacts), H, None, found.residual)

    def homography(self, description: Peaks, current: Contour, prior: Floats | None) -> Floats:
        """(3, 3) of the four correspondences (steps 1 and 2)."""
        _, there, _ = self.matches(description, current, prior)
        points = np.column_stack([np.interp(there, np.arange(len(current) + 1), c) for c in _closed(current.points).T])
        try:
            H = kernels.fit_homography(description.outline.points, description.samples, points, [0, 1, 2, 3]).H
        except ValueError:
            raise ConditioningError("the four correspondences give no homography") from None
        if not np.isfinite(H).all():
            raise ConditioningError("the four correspondences give no homography")
        return H

    def matches(self, description: Peaks, current: Contour, prior: Floats | None) -> tuple[Floats, Floats, Floats]:
        """(N,) the current contour's curvature, (4,) places in it that match the samples, (4,) the errors of eq. (3)."""
        kappa = len(current) / len(description.outline)
        v = self._curvature(current)
        centres = self._centres(description, current, kappa, prior)
        return v, *match_by_samples(description.curvature, description.samples, v, centres, kappa, self.between)

    def _curvature(self, contour: Contour) -> Floats:
        """(N,) in 1/px, or times the contour's length."""
        arc, scaled = kernels.curvature_vector(contour.points, None, ours.SMOOTHING)
        return scaled if self.scale_free else scaled / arc[-1]

    def _centres(self, description: Peaks, current: Contour, kappa: float, prior: Floats | None) -> Floats:
        """(4,) index in the current contour about which each search is centred."""
        first, samples = description.outline, description.samples
        if not self.aligned:
            return kappa * np.asarray(samples, dtype=np.float64)
        if prior is not None:
            ahead = apply_homography(prior, first.points[samples])
            return np.asarray(kernels.project_to_contour(current.points, current.offsets, ahead)[:, 1])
        # of several that fit alike the one that turns least, as between consecutive frames
        ways = find_alignments(first, current)
        if not ways:
            raise AmbiguousError("the outline fits itself in every turn: nothing tells how far it turned")
        shift = min(ways, key=lambda a: abs(math.sin(0.5 * a.angle))).shift
        there = np.mod(first.arc_length[samples] / first.length + shift, 1.0) * current.length
        return np.asarray(np.interp(there, current.arc_length, np.arange(len(current) + 1.0)))


def highest_peaks(curvature: Floats) -> list[int]:
    """The four samples of a closed contour where its curvature (N,) is highest among its neighbours, in order.

    Of equal neighbours the last is the peak, and of equal peaks the first is the higher.

    Raises:
        PeaksError: there are fewer than four.
    """
    v = np.abs(curvature)
    equal = ROUNDING * float(v.max())
    crest = np.flatnonzero((v >= np.roll(v, 1) - equal) & (v > np.roll(v, -1) + equal))
    if len(crest) < 4:
        raise PeaksError(f"the outline has {len(crest)} peaks of curvature; a homography needs four")
    falling = crest[np.argsort(-v[crest])]
    level = np.cumsum(np.diff(v[falling], prepend=v[falling[0]]) < -equal)
    return sorted(falling[np.lexsort((falling, level))[:4]].tolist())


FINENESS = 16
"""Places between two samples at which eq. (3) is worked out where whole samples are not enough."""
ROUNDING = 1e-10
"""Errors of eq. (3) that lie closer together are equal, as a share of what they were if the highest curvature stood all along
the neighbourhood. Rounding moves them by less than 1e-12 of it; what is not equal lies more than 1e-8 apart."""
STEP_ROUNDING = 1e-9
"""A place this near to a whole sample is that sample."""


def match_by_samples(
    v1: Floats, samples: list[int], v2: Floats, centres: Floats, kappa: float, between: bool = False
) -> tuple[Floats, Floats]:
    """Eq. (3) as it is written, all lengths in samples. Of several places that are equally low, as on straight sides, which the
    text leaves open, the first in the window is taken.

    Args:
        v1, v2: (N,), (N') curvature of both contours.
        samples: i of the first.
        centres: index in the second about which each search is centred.
        kappa: scale factor of the second contour.
        between: refine the least error to fractions of a sample.

    Returns:
        (len(samples),) places j in the second contour, in [0, N'), and the least errors.
    """
    radius, reach = round(ours.NEIGHBOURHOOD * len(v1)), round(ours.SEARCH * len(v1))
    k = np.arange(-radius, radius + 1)
    closed = np.append(v2, v2[0])
    n = len(v2)

    def errors_at(i: int, places: Floats) -> Floats:
        at = np.mod(places[:, None] + kappa * k, n)
        low = at.astype(np.int64)
        found = closed[low] + (at - low) * (closed[low + 1] - closed[low])
        return np.asarray(np.abs(v1[(i + k) % len(v1)] - found).sum(axis=1))

    matched, least = np.empty(len(samples)), np.empty(len(samples))
    equal = ROUNDING * len(k) * float(np.abs(v1).max())
    for row, (i, centre) in enumerate(zip(samples, centres.tolist(), strict=True)):
        begin, end = centre - kappa * reach - STEP_ROUNDING, centre + kappa * reach + STEP_ROUNDING
        window = np.arange(math.ceil(begin), math.floor(end) + 1, dtype=np.float64)
        best, least[row] = _first_least(window, errors_at(i, window), equal)
        if between:
            window = best + np.arange(-FINENESS, FINENESS + 1) / FINENESS
            best, least[row] = _first_least(window, errors_at(i, window), equal)
        matched[row] = best % n
    return matched, least


def _first_least(places: Floats, errors: Floats, equal: float) -> tuple[float, float]:
    """The first place whose error exceeds the least by no more than `equal`, and the least."""
    least = float(errors.min())
    return float(places[int(np.argmax(errors <= least + equal))]), least


def _closed(points: Floats) -> Floats:
    """(N + 1, 2) with the first point again at the end."""
    return np.concatenate([points, points[:1]])


PAPER: dict[str, TransferStrategy] = {
    "paper-rrp": LiteralRRP(),
    "paper-grasp-line": LiteralGraspLine(),
    "paper-homography": LiteralHomography(),
}
"""The paper's strategies to the letter, by name."""
