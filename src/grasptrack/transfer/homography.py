# SPDX-License-Identifier: Apache-2.0
"""Homography from four matched curvature peaks (Sections III-C and IV-C, Figs. 9 to 11)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.errors import ClippedError, ConditioningError, CrossingError, PeaksError
from grasptrack.geometry.contours import Contour, Outline
from grasptrack.geometry.homographies import apply_homography, check_in_front, judge_distortion
from grasptrack.grasp.contacts import Grasp
from grasptrack.kernels.results import CurvatureVector, MatchWindow
from grasptrack.matching import settle_homographies
from grasptrack.statistics import median_of_few, robust_sd
from grasptrack.transfer.alignment import alignments_of_points, as_similarity, choose_alignment, find_alignments
from grasptrack.transfer.base import Transfer
from grasptrack.typing import Floats

SMOOTHING = 0.012
"""Scale of the curvature as a fraction of the outline's length: a corner's peak is twice as wide."""
SEPARATION = 0.03
"""Least distance of two peaks along the outline, as a fraction of its length."""
PROMINENCE = 4.0
"""Least rise of a peak over its surroundings in curvature times length; a circle has 2 pi throughout."""
MIN_TRIANGLE = 0.015
"""Three of the four points span at least this fraction of the object's area, or they are three in a row."""
SEARCH = 0.04
"""xi of eq. (3) as a fraction of the outline's length."""
RADIUS = 12
"""n of eq. (3)."""
NEIGHBOURHOOD = 0.03
"""Half of eq. (3)'s neighbourhood as a fraction of the outline's length."""
MAX_ERROR = 0.5
"""A match whose mean curvature difference exceeds this share of the peak's own curvature, or of a circle's if that is
more, is none."""
GATE = 3.0
"""Standard deviations by which a match may miss its prediction, as far as the outline shows how good that is."""
PROBES = 20
"""Points of the outline that show it."""
MAX_REFINEMENT = 0.05
"""The outline must lie within this fraction of sqrt(area) of where the homography puts a contact."""


class HomographyDescription(NamedTuple):
    """What the strategy keeps of the reference view.

    Attributes:
        contacts: (k, 2) px.
        normals: (k, 2) unit normals of the outline at the contacts; None for two, which move along their line.
        view: the reference view; its outer contour is `outline`.
        arc: (N + 1,) its arc length, px.
        curvature: (N,) its curvature times its length.
        peaks: indices of the outer contour's peaks: the four selected points first, then what may take the place of one
            that a view does not show.
    """

    contacts: Floats
    normals: Floats | None
    view: Outline
    arc: Floats
    curvature: Floats
    peaks: list[int]

    @property
    def outline(self) -> Contour:
        """The outer contour."""
        return self.view.contours[0]


def describe(grasp: Grasp, view: Outline) -> HomographyDescription:
    """Select the four points (step 1 of Fig. 9, first contour).

    Raises:
        PeaksError: fewer than four peaks of curvature, or three of any four in a row.
    """
    outline = view.contours[0]
    arc, curvature = kernels.curvature_vector(outline.points, outline.clipped, SMOOTHING)
    length = arc.item(-1)
    peaks, triangle = kernels.select_points(outline.points, arc, curvature, SEPARATION * length, PROMINENCE)
    if len(peaks) < 4:
        raise PeaksError(f"the outline has {len(peaks)} peaks of curvature; a homography needs four", peaks=peaks)
    if triangle < MIN_TRIANGLE * outline.area:
        raise PeaksError("three of the outline's curvature peaks lie in a row; a homography needs four that do not")
    normals = None
    if len(grasp.contacts) != 2:
        places = kernels.project_to_contour(view.points, view.offsets, grasp.contacts)
        normals = kernels.contact_frames(view.points, view.offsets, places, 0.02 * length)[:, :2]
    return HomographyDescription(grasp.contacts, normals, view, arc, curvature, peaks)


def apply(description: HomographyDescription, view: Outline, prior: Floats | None = None) -> Transfer:
    """Steps 1 to 4 of Fig. 9 on the second contour.

    With a prior, the first contour is carried to the prediction before its curvature is compared, so that the
    comparison is always one of near views, as Section IV-C.1 asks, while the correspondences stay those of the
    reference. The prediction is laid on the second contour first, as what four points got wrong would feed on itself
    where the last answer is the prior.

    Raises:
        ClippedError: the border cuts the object and there is no prior, or hardly anything is left.
        PeaksError: fewer than four peaks have a match.
        AmbiguousError: several alignments of the outlines fit alike, and there is no prior.
        ConditioningError: the four correspondences give no plausible homography.
        CrossingError: the outline is not where the homography puts a contact.
    """
    current = view.contours[0]
    reference = description.outline
    selected, matched = _match_peaks(description, view, prior)  # step 1, eq. (3)
    try:  # step 2, eq. (1)
        H, *worst = kernels.fit_homography(reference.points, selected, current.points, matched)
    except ValueError:
        raise ConditioningError("the four correspondences give no homography: three lie in a row") from None
    judge_distortion(H, *worst)
    # steps 3 and 4, eq. (2) and Fig. 11: two contacts move along their line onto the outline, more along their normals
    found = kernels.refine_contacts(H, description.contacts, description.normals, view.points, view.offsets)
    check_in_front(H, found.in_front)
    residual = found.residual
    if not residual <= MAX_REFINEMENT * found.growth * math.sqrt(reference.area):
        raise CrossingError("the outline is not where the homography puts a contact", residual=residual)
    return Transfer(Grasp.of(found.contacts), H, None, residual)


def _match_peaks(
    description: HomographyDescription, view: Outline, prior: Floats | None
) -> tuple[list[int], list[float]]:
    """Four selected samples of the reference and the four places that match them: the search of Section IV-C.1."""
    first, current, peaks = description.outline, view.contours[0], description.peaks
    if prior is None and current.clipped is not None:
        raise ClippedError("the image border cuts the object, and nothing says how large it is")
    predicted, gate = None, math.inf
    if prior is None:
        there = kernels.curvature_vector(current.points, current.clipped, SMOOTHING)
        here = CurvatureVector(description.arc, description.curvature)
        length = here.arc.item(-1)
        kappa = there.arc.item(-1) / length
        ways = alignments_of_points(first.points, here.arc, current.points, there.arc, current.area)
        shift = choose_alignment(ways, description.view, view).shift * length
        centres = [kappa * (here.arc.item(i) + shift) for i in peaks]
    else:
        carried = apply_homography(_settle_prior(description, view, prior), first.points)
        try:
            here = kernels.curvature_vector(carried, first.clipped, SMOOTHING)
        except ValueError:
            raise ConditioningError("the prior puts all points of the outline in one place") from None
        length, kappa = here.arc.item(-1), 1.0
        if first.clipped is None and current.clipped is None:
            there = kernels.curvature_vector(current.points, None, SMOOTHING)
            kappa = there.arc.item(-1) / length
        else:  # what is left of an outline has another length: one scale for both
            if SMOOTHING * length > 0.25 * current.length:
                raise ClippedError("the image border leaves too little of the outline to compare its curvature")
            there = kernels.curvature_vector(current.points, current.clipped, SMOOTHING, length)
        predicted = carried[peaks]
        places = kernels.project_to_contour(current.points, current.offsets, predicted)
        gate = max(GATE * _prediction_error(carried, current), SMOOTHING * length)
        centres = np.interp(places[:, 1], np.arange(len(current) + 1.0), there.arc).tolist()

    def match_curvature(count: int) -> list[float]:
        """Eq. (3) for the first peaks: places on the current contour, NaN of none, or of one beyond the gate."""
        reach, step = SEARCH * length, NEIGHBOURHOOD * length / RADIUS
        window = MatchWindow(kappa, reach, RADIUS, step, MAX_ERROR)
        found = kernels.match_curvature(here, peaks[:count], there, centres[:count], window)
        if predicted is None:
            return found.places
        off = np.hypot(*(current.points[found.samples] - predicted[:count]).T)
        return [place if o <= gate else math.nan for place, o in zip(found.places, off.tolist(), strict=True)]

    found = match_curvature(4)
    if not any(map(math.isnan, found)):
        return peaks[:4], found
    usable = [(i, j) for i, j in zip(peaks, match_curvature(len(peaks)), strict=True) if not math.isnan(j)]
    if len(usable) < 4:
        raise PeaksError(
            f"only {len(usable)} peaks of the reference outline have a match in this view; four are needed"
        )
    seen = [i for i, _ in usable]
    best, triangle = kernels.best_quadrilateral(first.points[seen], np.abs(description.curvature[seen]))
    if triangle < MIN_TRIANGLE * first.area:
        raise PeaksError("three of the curvature peaks that this view shows lie in a row")
    return [usable[k][0] for k in best], [usable[k][1] for k in best]


def _settle_prior(description: HomographyDescription, view: Outline, prior: Floats) -> Floats:
    """(3, 3) what both outlines say of a prediction; of one that a border cuts they say nothing.

    The alignment of the outlines, if it is meant, as it lies within eq. (3)'s window, takes the place of a prior that fits
    worse. A prior that lies on the outline but for rounding is left as it is.
    """
    first, current = description.outline, view.contours[0]
    some = first.points[:: max(1, len(first) // PROBES)]
    ahead, starts, nearest = apply_homography(prior, some), [prior], SEARCH * current.length
    gaps = kernels.project_to_contour(current.points, current.offsets, ahead)[:, 2]
    if not (first.clipped is None and current.clipped is None and gaps.max() > 1e-9 * current.length):
        return prior
    for way in find_alignments(first, current):
        aligned = as_similarity(way, first, current)
        off = float(np.hypot(*(apply_homography(aligned, some) - ahead).T).max())
        if off <= nearest:
            nearest, starts = off, [prior, aligned]
    settled = settle_homographies(np.array(starts), description.view, view)
    return prior if settled is None else settled


def _prediction_error(carried: Floats, current: Contour) -> float:
    """px, robust standard deviation of the distance between an outline as predicted, (N, 2), and as observed."""
    some = np.ascontiguousarray(carried[:: max(1, len(carried) // PROBES)])
    gaps = kernels.project_to_contour(current.points, current.offsets, some)[:, 2]
    return robust_sd(gaps, median_of_few)
