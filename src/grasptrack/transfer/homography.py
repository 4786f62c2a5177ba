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
from grasptrack.projective import apply_homography, check_plausible, jacobian
from grasptrack.transfer.alignment import align
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
"""A match whose mean curvature difference exceeds this share of the neighbourhood's own mean curvature is none."""
MAX_REFINEMENT = 0.05
"""The outline must lie within this fraction of sqrt(area) of where the homography puts a contact."""


class HomographyDescription(NamedTuple):
    """What the strategy keeps of the reference view.

    Attributes:
        contacts: (k, 2) px.
        normals: (k, 2) unit normals of the outline at the contacts.
        outline: the outer contour.
        curvature: (N,) of the outer contour times its length.
        peaks: (m,) indices of the outer contour's peaks: the four selected points first, then what may take the place
            of one that a view does not show.
    """

    contacts: Floats
    normals: Floats
    outline: Contour
    curvature: Floats
    peaks: NDArray[np.int64]


def describe(grasp: Grasp, view: Outline) -> HomographyDescription:
    """Select the four points (step 1 of Fig. 9, first contour).

    Raises:
        PeaksError: fewer than four peaks of curvature, or three of any four in a row.
    """
    outline = view.contours[0]
    length = outline.length
    curvature = _curvature(outline.points, outline.clipped, length)
    peaks = kernels.curvature_peaks(curvature, outline.arc_length, SEPARATION * length, PROMINENCE)
    if len(peaks) < 4:
        raise PeaksError(f"the outline has {len(peaks)} peaks of curvature; a homography needs four", peaks=peaks.tolist())
    *four, triangle = kernels.best_quadrilateral(outline.points[peaks], np.abs(curvature[peaks]))
    if triangle < MIN_TRIANGLE * outline.area:
        raise PeaksError("three of the outline's curvature peaks lie in a row; a homography needs four that do not")
    places = kernels.locate(view.points, view.offsets, grasp.contacts)
    normals = kernels.contact_frames(view.points, view.offsets, places, 0.02 * length)[:, :2]
    spare = np.delete(peaks, four)
    return HomographyDescription(grasp.contacts, normals, outline, curvature, np.concatenate([peaks[four], spare]))


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
    source, matched = _correspondences(description, view.contours[0], prior)
    try:
        H = kernels.homography_4(source, matched)
    except ValueError:
        raise ConditioningError("the four correspondences give no homography: three lie in a row") from None
    check_plausible(H, source)
    contacts = apply_homography(H, description.contacts)
    return _refine(description, H, contacts, view)


def _curvature(points: Floats, clipped: NDArray[np.bool_] | None, length: float) -> Floats:
    """Scale-free curvature vector, NaN wherever the image border instead of the object shapes it."""
    step = SMOOTHING * length
    curvature: Floats = kernels.curvature(points, step) * length
    if clipped is not None:
        arc = kernels.arc_length(points)
        reach = int(math.ceil(1.5 * step / max(float(arc[-1]) / len(points), 1e-9)))
        bad = clipped.copy()
        for shift in range(1, reach + 1):
            bad |= np.roll(clipped, shift) | np.roll(clipped, -shift)
        curvature[bad] = np.nan
    return curvature


def _correspondences(
    description: HomographyDescription, current: Contour, prior: Floats | None
) -> tuple[Floats, Floats]:
    """(4, 2) selected points of the reference and (4, 2) what matches them: the search of Section IV-C.1."""
    first, peaks = description.outline, description.peaks
    if prior is not None:
        carried = apply_homography(prior, first.points)
        arc1 = kernels.arc_length(carried)
        length = float(arc1[-1])
        v1, v2 = _curvature(carried, None, length), _curvature(current.points, current.clipped, length)
        kappa = 1.0
    else:
        if current.clipped is not None:
            raise ClippedError("the image border cuts the object, and nothing says how large it is")
        arc1, length = first.arc_length, first.length
        v1, v2 = description.curvature, _curvature(current.points, None, current.length)
        kappa = current.length / length
        shift = align(first, current).shift

    def match(indices: NDArray[np.int64]) -> tuple[Floats, NDArray[np.bool_]]:
        """Eq. (3) for some peaks: the samples of the current contour, and which of them are matches."""
        if prior is not None:
            places = kernels.locate(current.points, current.offsets, carried[indices])
            centres = np.interp(places[:, 1], np.arange(len(current) + 1.0), current.arc_length)
        else:
            centres = kappa * (arc1[indices] + shift * length)
        step = NEIGHBOURHOOD * length / RADIUS
        found = kernels.match_curvature(
            v1, arc1, indices, v2, current.arc_length, centres, kappa, SEARCH * length, RADIUS, step
        )
        good = found[:, 1] <= MAX_ERROR * np.maximum(np.abs(v1[indices]), 2 * math.pi)
        return found[:, 0], good

    samples, good = match(peaks[:4])
    if good.all():
        return first.points[peaks[:4]], current.points[samples.astype(np.int64)]
    samples, good = match(peaks)
    usable, samples = peaks[good], samples[good].astype(np.int64)
    if len(usable) < 4:
        raise PeaksError(f"only {len(usable)} peaks of the reference outline have a match in this view; four are needed")
    *four, triangle = kernels.best_quadrilateral(first.points[usable], np.abs(description.curvature[usable]))
    if triangle < MIN_TRIANGLE * first.area:
        raise PeaksError("three of the curvature peaks that this view shows lie in a row")
    return first.points[usable[four]], current.points[samples[four]]


def _refine(description: HomographyDescription, H: Floats, contacts: Floats, view: Outline) -> Transfer:
    """Fig. 11: two contacts move along their line onto the outline; more of them, each along its normal."""
    if len(contacts) == 2:
        (x1, y1), (x2, y2) = contacts.tolist()
        opening = math.hypot(x2 - x1, y2 - y1)
        ux, uy = (x2 - x1) / opening, (y2 - y1) / opening
        found = kernels.nearest_crossings(view.points, view.offsets, x1, y1, ux, uy, 0.0, opening)
        refined = np.array((found[:2], found[2:]))
    else:
        refined = np.empty_like(contacts)
        for i, ((x, y), (nx, ny)) in enumerate(zip(contacts.tolist(), description.normals.tolist(), strict=True)):
            a, b, c, d = jacobian(H, *description.contacts[i].tolist())
            ux, uy = d * nx - c * ny, a * ny - b * nx  # normals go by the inverse transpose, up to scale
            size = math.hypot(ux, uy)
            refined[i] = kernels.nearest_crossings(view.points, view.offsets, x, y, ux / size, uy / size, 0.0, 0.0)[:2]
    moved = refined - contacts
    residual = math.sqrt(float(np.einsum("ij,ij->i", moved, moved).max()))
    a, b, c, d = jacobian(H, *description.contacts[0].tolist())
    limit = MAX_REFINEMENT * math.sqrt(description.outline.area * abs(a * d - b * c))
    if not residual <= limit or (len(refined) == 2 and (refined[0] == refined[1]).all()):
        raise CrossingError("the outline is not where the homography puts a contact", residual=residual)
    return Transfer(Grasp.of(refined), H, None, residual)
