# SPDX-License-Identifier: Apache-2.0
"""What kernels take and return where it is more than arrays and numbers; both backends make and read these."""

from __future__ import annotations

from typing import NamedTuple

from grasptrack.typing import Bools, Floats, Ints


class CurvatureVector(NamedTuple):
    """Of a closed contour: (N + 1,) arc length px, and (N,) curvature times the contour's length, NaN where clipped."""

    arc: Floats
    curvature: Floats


class PolygonMoments(NamedTuple):
    """Of the material inside contours.

    Attributes:
        area: px^2.
        x, y: px, the centroid.
        angle: rad in (-pi, pi] from x to y, of I_min; its sense makes t30 + t12, or where that is 0 t21 + t03, positive.
        major, minor: variances along I_min and across it, px^2.
        t30, t21, t12, t03: third moments in these axes, divided by area^2.5.
    """

    area: float
    x: float
    y: float
    angle: float
    major: float
    minor: float
    t30: float
    t21: float
    t12: float
    t03: float


class CarriedPoints(NamedTuple):
    """(N, 2) px, and lambda of eq. (2), least, after the first one's sign: above 0 when all points lie in front."""

    points: Floats
    in_front: float


class Distortion(NamedTuple):
    """How a homography treats some points, at the worst of them.

    Attributes:
        in_front: as of `CarriedPoints`; NaN when H is not finite.
        determinant: least, of the local map: below 0 when it mirrors.
        ratio: largest, of its two magnifications: at least 1.
    """

    in_front: float
    determinant: float
    ratio: float


class FittedHomography(NamedTuple):
    """H (3, 3), and its distortion at the points that it was fitted to, as of `Distortion`."""

    H: Floats
    in_front: float
    determinant: float
    ratio: float


class TraceOptions(NamedTuple):
    """How an edge is localised along a chain of pixels.

    Attributes:
        hole: the chain runs round a hole.
        polarity: +1 for an object darker than what surrounds it, -1 for a lighter one.
        spacing: px between points, of which there are 16 to `most`.
        smoothing: px of outline over which the chain's stairs are averaged first.
        reach: px on either side in which the edge is searched.
        border: px from the image's border within which a point is cut off.
        outlier: px from the median of its neighbours at which an edge is some other edge.
    """

    hole: bool
    polarity: int
    spacing: float
    most: int
    smoothing: float
    reach: float
    border: float
    outlier: float


class TracedEdges(NamedTuple):
    """(n, 2) points and (n,) strengths, whether cut off; median grey levels inside and outside, NaN of no edge."""

    points: Floats
    strength: Floats
    clipped: Bools
    inside: float
    outside: float


class CyclicShift(NamedTuple):
    """By which an outline lies on another: share of the length, rad, and the share of the second's norm that is left."""

    shift: float
    angle: float
    residual: float


class AlignmentSteps(NamedTuple):
    """How one outline is laid on another, step by step.

    Attributes:
        reaches: (s,) px within which a counterpart is looked for.
        damping: (s,) of each parameter, relative to the energy of its displacements.
        strides: (s,) every so many-th point takes part.
        least_noise: px; distances are never taken for less noisy.
    """

    reaches: Floats
    damping: Floats
    strides: Ints
    least_noise: float


class Quadrilateral(NamedTuple):
    """Indices of four points, rising, -1 of fewer; px^2 of the smallest triangle among them."""

    corners: list[int]
    triangle: float


class SelectedPoints(NamedTuple):
    """Indices of peaks of curvature, the best four first; px^2 of the four's smallest triangle, 0 of fewer."""

    peaks: list[int]
    triangle: float


class MatchWindow(NamedTuple):
    """Where and how neighbourhoods of curvature are compared.

    Attributes:
        kappa: the second contour's length over the first's.
        reach: xi in px of the first contour: the search runs over centre +- kappa xi.
        radius: n: neighbourhoods have 2 n + 1 values.
        step: px of the first contour between two of them (kappa step in the second).
        tolerance: largest matching error of a match, as a share of the curvature at the sample or of a circle's 2 pi,
            whichever is more.
    """

    kappa: float
    reach: float
    radius: int
    step: float
    tolerance: float


class CurvatureMatches(NamedTuple):
    """Of each sample of the first contour its match on the second.

    Attributes:
        samples: the sample of the least error, -1 of none.
        errors: the least error, infinite of none comparable.
        places: the same between samples: the sample, and as its fraction the share of the side that follows; NaN of
            none, and where the least error is no minimum but the end of the search.
    """

    samples: list[int]
    errors: list[float]
    places: list[float]


class RefinedContacts(NamedTuple):
    """Contacts moved onto the outline.

    Attributes:
        contacts: (k, 2) px.
        residual: px, the largest distance moved; NaN where there was no crossing, infinite where two contacts share one.
        growth: root of the magnification of areas at the first contact.
        in_front: as of `CarriedPoints`.
    """

    contacts: Floats
    residual: float
    growth: float
    in_front: float


class DescribedLine(NamedTuple):
    """A grasp line relative to the silhouette's inertia axes.

    Attributes:
        d_c, alpha_m, d_1, d_2: grasp-line coordinates, rad and distances divided by sqrt(area).
        area, centroid, angle, major, minor: as of `PolygonMoments`.
        sine: of alpha_m.
        opening: px between the contacts.
    """

    d_c: float
    alpha_m: float
    d_1: float
    d_2: float
    area: float
    centroid: tuple[float, float]
    angle: float
    major: float
    minor: float
    sine: float
    opening: float


class CarriedLine(NamedTuple):
    """A grasp line on another outline.

    Attributes:
        contacts: (2, 2) px, the crossings of line and outline nearest to where the contacts should be.
        H: (3, 3) the similarity from the reference.
        residual: px by which the coordinates miss the farther one; NaN of no crossing, infinite where both share one.
        area, major, minor: as of `PolygonMoments`.
    """

    contacts: Floats
    H: Floats
    residual: float
    area: float
    major: float
    minor: float


class Closure(NamedTuple):
    """Ferrari and Canny's epsilon, and rad, the smallest friction angle with which a grasp closes."""

    epsilon: float
    friction_angle: float


class JudgedContacts(NamedTuple):
    """Contacts on an outline, by the stretches nearest to them.

    Attributes:
        normals: (k, 2) unit, into the material.
        flatness: (k,) rms distance of the stretch from a straight line, in widths.
        distances: px from the outline.
        epsilon, friction_angle: as of `Closure`.
    """

    normals: Floats
    flatness: Floats
    distances: list[float]
    epsilon: float
    friction_angle: float


class StablePairs(NamedTuple):
    """(p, 2) indices; (p,) 1 where normals face each other, -1 where they face away; (p,) the friction that is needed."""

    indices: Ints
    sense: Floats
    friction: Floats


class StableTriples(NamedTuple):
    """(t, 3) indices; (t,) 1 where fingers push toward their mean, -1 where away from it; (t,) epsilon."""

    indices: Ints
    sense: Floats
    epsilon: Floats


class RankedCandidates(NamedTuple):
    """Places at which a finger may touch.

    Attributes:
        contacts, normals: (m, 2) px and unit, into the material, contour after contour in their order along it.
        usable: (m,) whether a finger can touch there.
        starts: (C + 1,) first candidate of each contour.
        steps: (C,) px of outline between two candidates of a contour.
    """

    contacts: Floats
    normals: Floats
    usable: Bools
    starts: Ints
    steps: Floats


class WrenchSpace(NamedTuple):
    """Friction coefficient; px, the point about which torques are taken; px by which they are divided."""

    friction: float
    cx: float
    cy: float
    rho: float


class RankingLimits(NamedTuple):
    """px beyond which a longer region counts no more; px within which grasps are alike; grasps that are wanted."""

    most: float
    gap: float
    top: int


class RankedGrasps(NamedTuple):
    """(n,) indices of the best grasps, (n,) their qualities, (n, k) half-lengths of their regions, px."""

    indices: Ints
    quality: Floats
    regions: Floats


class StrongestEdges(NamedTuple):
    """(N,) offsets and signed steps; (N, 6) inner sides; (N,) widths. NaN where there is none."""

    offset: Floats
    step: Floats
    inner: Floats
    width: Floats


class SurfaceEvidence(NamedTuple):
    """Log-likelihood ratio of the surface, and of each share of it that may be hidden."""

    log_odds: float
    by_share: Floats


class PlacedContacts(NamedTuple):
    """(k, 2) px, their covariances (k, 2, 2) px^2, and their mean."""

    contacts: Floats
    covariance: Floats
    middle: tuple[float, float]


class FusedPose(NamedTuple):
    """Mahalanobis distance, squared, of two poses; the pose (3, 3) between them and its covariance (8, 8)."""

    distance: float
    G: Floats
    P: Floats


class RepeatedPatches(NamedTuple):
    """Patches that repeat the last image though they moved.

    Attributes:
        change: grey levels^2, the sum of what the motion changes of each patch.
        way: of those that repeat the last image to the grey level, as no two exposures do but an encoder does, the sum of that
            times the square of their way, work px.
    """

    change: float
    way: float


class PlaneViews(NamedTuple):
    """What views of a rigid plane tell of its tilt and the focal length, theta, and what is known of these beforehand.

    Attributes:
        poses, covariances: (v, 3, 3) work px to px, (v, 8, 8) of their errors, of views that differ.
        hull: (n, 2) px of the first view, round the outline.
        width, height: px of the image.
        aspect: width of a px for each unit of its height.
        theta, scale: (3,), (3, 3) the most probable and its covariance: log of the focal length in image widths, and slopes of
            the first view's normal (theta_1, theta_2, 1).
        freedom: of the slopes' t distribution, above 2; infinite where they are Gaussian.
    """

    poses: Floats
    covariances: Floats
    hull: Floats
    width: float
    height: float
    aspect: float
    theta: Floats
    scale: Floats
    freedom: float
