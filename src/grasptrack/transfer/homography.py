# SPDX-License-Identifier: Apache-2.0
"""Homography from four matched curvature peaks (Sections III-C and IV-C, Figs. 9 to 11)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import Contour, Outline
from grasptrack.errors import ClippedError, ConditioningError, CrossingError, PeaksError
from grasptrack.grasp import Grasp
from grasptrack.projective import apply_homography, carry_few, check_plausible, jacobian
from grasptrack.transfer.alignment import choose, fits
from grasptrack.transfer.base import Transfer

Floats = NDArray[np.float64]

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
"""A match whose mean curvature difference exceeds this share of the peak's own curvature, or of a circle's where that is
more, is none."""
MAX_REFINEMENT = 0.05
"""The outline must lie within this fraction of sqrt(area) of where the homography puts a contact."""


class HomographyDescription(NamedTuple):
    """What the strategy keeps of the reference view.

    Attributes:
        contacts: (k, 2) px.
        normals: (k, 2) unit normals of the outline at the contacts; None for two, which move along their line.
        outline: the outer contour.
        arc: (N + 1,) its arc length, px.
        curvature: (N,) its curvature times its length.
        peaks: (m,) indices of the outer contour's peaks: the four selected points first, then what may take the place
            of one that a view does not show.
    """

    contacts: Floats
    normals: Floats | None
    outline: Contour
    arc: Floats
    curvature: Floats
    peaks: NDArray[np.int64]


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
        raise PeaksError(
            f"the outline has {len(peaks)} peaks of curvature; a homography needs four", peaks=peaks.tolist()
        )
    if triangle < MIN_TRIANGLE * outline.area:
        raise PeaksError("three of the outline's curvature peaks lie in a row; a homography needs four that do not")
    normals = None
    if len(grasp.contacts) != 2:
        places = kernels.locate(view.points, view.offsets, grasp.contacts)
        normals = kernels.contact_frames(view.points, view.offsets, places, 0.02 * length)[:, :2]
    return HomographyDescription(grasp.contacts, normals, outline, arc, curvature, peaks)


def apply(description: HomographyDescription, view: Outline, prior: Floats | None = None) -> Transfer:
    """Steps 1 to 4 of Fig. 9 on the second contour.

    With a prior, the first contour is carried to the prediction before its curvature is compared, so that the
    comparison is always one of near views, as Section IV-C.1 asks, while the correspondences stay those of the
    reference: nothing adds up over a sequence.

    Raises:
        ClippedError: the border cuts the object and there is no prior.
        PeaksError: a selected point has no match.
        AmbiguousError: several alignments of the outlines fit alike and none is clearly the nearest motion.
        ConditioningError: the four correspondences give no plausible homography.
        CrossingError: the outline is not where the homography puts a contact.
    """
    source, matched = _correspondences(description, view.contours[0], prior)  # step 1, eq. (3)
    try:
        H = kernels.homography_4(source, matched)  # step 2, eq. (1)
    except ValueError:
        raise ConditioningError("the four correspondences give no homography: three lie in a row") from None
    check_plausible(H, source)
    contacts = carry_few(H, description.contacts.tolist())  # step 3, eq. (2)
    return _refine(description, H, contacts, view)  # step 4


def _correspondences(
    description: HomographyDescription, current: Contour, prior: Floats | None
) -> tuple[Floats, Floats]:
    """(4, 2) selected points of the reference and (4, 2) what matches them: the search of Section IV-C.1."""
    first, peaks = description.outline, description.peaks
    if prior is None and current.clipped is not None:
        raise ClippedError("the image border cuts the object, and nothing says how large it is")
    arc2, v2 = kernels.curvature_vector(current.points, current.clipped, SMOOTHING)
    if prior is None:
        arc1, v1 = description.arc, description.curvature
        length = arc1.item(-1)
        kappa = arc2.item(-1) / length
        shift = choose(fits(first.points, arc1, current.points, arc2, current.area)).shift * length
    else:
        carried = apply_homography(prior, first.points)
        arc1, v1 = kernels.curvature_vector(carried, None, SMOOTHING)
        length = arc1.item(-1)
        kappa = 1.0

    def match(indices: NDArray[np.int64]) -> Floats:
        """Eq. (3) for some peaks: the samples of the current contour that match them, or -1, and their errors."""
        if prior is None:
            centres = kappa * (arc1[indices] + shift)
        else:
            places = kernels.locate(current.points, current.offsets, carried[indices])
            centres = np.interp(places[:, 1], np.arange(len(current) + 1.0), arc2)
        step = NEIGHBOURHOOD * length / RADIUS
        return kernels.match_curvature(
            v1, arc1, indices, v2, arc2, centres, kappa, SEARCH * length, RADIUS, step, MAX_ERROR
        )

    four = peaks[:4]
    samples = [int(j) for j, _ in match(four).tolist()]
    if min(samples) >= 0:
        return first.points[four], current.points[samples]
    found = match(peaks)[:, 0].astype(np.int64)
    usable, found = peaks[found >= 0], found[found >= 0]
    if len(usable) < 4:
        raise PeaksError(
            f"only {len(usable)} peaks of the reference outline have a match in this view; four are needed"
        )
    *best, triangle = kernels.best_quadrilateral(first.points[usable], np.abs(description.curvature[usable]))
    if triangle < MIN_TRIANGLE * first.area:
        raise PeaksError("three of the curvature peaks that this view shows lie in a row")
    return first.points[usable[best]], current.points[found[best]]


def _refine(
    description: HomographyDescription, H: Floats, contacts: list[tuple[float, float]], view: Outline
) -> Transfer:
    """Fig. 11: two contacts move along their line onto the outline; more of them, each along its normal."""
    if description.normals is None:
        (x1, y1), (x2, y2) = contacts
        opening = math.hypot(x2 - x1, y2 - y1)
        ux, uy = (x2 - x1) / opening, (y2 - y1) / opening
        p, q, r, s = kernels.nearest_crossings(view.points, view.offsets, x1, y1, ux, uy, 0.0, opening)
        refined = [(p, q), (r, s)]
    else:
        refined = []
        for before, (nx, ny), (x, y) in zip(
            description.contacts.tolist(), description.normals.tolist(), contacts, strict=True
        ):
            a, b, c, d = jacobian(H, *before)
            ux, uy = d * nx - c * ny, a * ny - b * nx  # normals go by the inverse transpose, up to scale
            size = math.hypot(ux, uy)
            p, q, *_ = kernels.nearest_crossings(view.points, view.offsets, x, y, ux / size, uy / size, 0.0, 0.0)
            refined.append((p, q))
    moved = [math.hypot(p - x, q - y) for (p, q), (x, y) in zip(refined, contacts, strict=True)]
    residual = math.nan if any(map(math.isnan, moved)) else max(moved)
    a, b, c, d = jacobian(H, *description.contacts[0].tolist())
    limit = MAX_REFINEMENT * math.sqrt(description.outline.area * abs(a * d - b * c))
    if not residual <= limit or (len(refined) == 2 and refined[0] == refined[1]):
        raise CrossingError("the outline is not where the homography puts a contact", residual=residual)
    return Transfer(Grasp.of(np.array(refined)), H, None, residual)
