# SPDX-License-Identifier: Apache-2.0
# The definitions are in tests/oracle/reference; tests/scenarios/test_kernels_api.py holds the signatures of both together.
"""The compiled kernels: what each takes, gives and refuses.

Throughout, `points` is float64 (N, 2) px, a concatenation of closed contours whose first point is not repeated, and
`offsets` int64 (C + 1,) says that contour c is ``points[offsets[c]:offsets[c + 1]]``. With t = (tx, ty) the tangent
along a contour's direction, (ty, -tx) points out of the material and (-ty, tx) into it, for outer contours and holes. A
position on a contour of n points is a vertex index plus the fraction of the segment that follows, in [0, n).
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.results import (
    AlignmentSteps,
    CarriedLine,
    CarriedPoints,
    Closure,
    CurvatureMatches,
    CurvatureVector,
    CyclicShift,
    DescribedLine,
    Distortion,
    FittedHomography,
    FusedPose,
    JudgedContacts,
    MatchWindow,
    PlacedContacts,
    PlaneViews,
    PolygonMoments,
    Quadrilateral,
    RankedCandidates,
    RankedGrasps,
    RankingLimits,
    RefinedContacts,
    RepeatedPatches,
    SelectedPoints,
    StablePairs,
    StableTriples,
    StrongestEdges,
    SurfaceEvidence,
    TracedEdges,
    TraceOptions,
    WrenchSpace,
)
from grasptrack.typing import Floats, Ints

_build: str
EDGE_WINDOW: Final[float]
"""px on either side of an edge whose gradients tell its place (`search_along_normals`)."""
POSE_NUMBERS: Final[tuple[str, ...]]
"""Of `grasptrack.tracking.numbers.Numbers`, those that `PoseTarget` needs."""
PATCH_SIDE: Final[int]
"""Pixels of the side of a patch of texture (`PoseTarget.add_texture`)."""
FINE_LEVELS: Final[int]
"""Levels of texture, from the finest, that are used beside the edges."""
REGION_CELLS: Final[int]
"""Depths on each side of the outline at which grey levels are compared."""
FIRST_CELLS: Final[int]
"""Of those, beside the outline, tell the levels here, and whether a side is as it was."""
NEAR_SAMPLES: Final[int]
"""Seen samples on each side of a stretch that is not seen that count for the levels there."""
LEAST_SPREAD: Final[float]
"""Grey levels that are added to any spread."""
LEAST_HALF_WIDTH: Final[int]
"""Work px on each side of an edge that are averaged, at least."""
MOST_HALF_WIDTH: Final[int]
"""The same at most."""

def first_crossing(points: Floats) -> tuple[int, int]:
    """Two sides of one closed contour that cross, exactly: not one rounding error decides.

    A contour that touches itself, in a point or along sides that lie on each other, does not cross itself there: a chain of
    pixels goes round thin parts so. Points in a row that are equal belong to no contour and must have been dropped.

    Args:
        points: (N, 2) px.

    Returns:
        i < j, the crossing that is farthest to the left as sides begin: side i goes from point i to the next one. (-1, -1) of
        none.

    Raises:
        ValueError: no points, or points that are not finite.
    """

def arc_length(points: Floats) -> Floats:
    """(N + 1,) arc length s in px at each vertex of one closed contour (N, 2); the last entry is the whole length."""

def blend_normals(points: Floats) -> Floats:
    """(N, 2) unit normals out of the material at the vertices of one contour, across the chord of the neighbours.

    Where the neighbours coincide the segment that follows is taken; where that has no length either, (0, 0).
    """

def carry_places(places: Floats, offsets: NDArray[np.int64], points: Floats, current: NDArray[np.int64]) -> Floats:
    """`point_at` of places that were found on another outline.

    Args:
        places: (k, >= 2) rows of contour, position.
        offsets: (C + 1,) of the outline that they were found on.
        points: (N, 2) px of the outline that they are wanted on.
        current: (C + 1,) its offsets.

    Raises:
        ValueError: the outlines differ in their number of contours or points, or as `point_at`.
    """

def curvature_vector(
    points: Floats, clipped: NDArray[np.bool_] | None, smoothing: float, whole: float = 0.0
) -> CurvatureVector:
    """Scale-free curvature of one closed contour and the arc length it is a function of.

    Args:
        points: (N, 2) px.
        clipped: (N,) True where the image border shapes the contour instead of the object, or None.
        smoothing: distance, as a fraction of the length, between the box means whose chords tell the curvature: above 0 and
            at most a quarter.
        whole: px, the length that smoothing and curvature refer to; 0 for the contour's own. What is left of a clipped
            outline has another length than the whole.

    Returns:
        (N + 1,) arc length, px; (N,) curvature times length, NaN within 1.5 steps of a clipped point.

    Raises:
        ValueError: smoothing out of range.
    """

def fixed_places(points: Floats, offsets: NDArray[np.int64], queries: Floats) -> Floats:
    """`project_to_contour`, its numbers rounded to multiples of 2**-32, so that they can be told again without loss."""

def point_at(points: Floats, offsets: NDArray[np.int64], places: Floats) -> Floats:
    """The points of places on the outline.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        places: (k, >= 2) rows of contour, position; further columns are ignored. A position equal to the number of
            points is 0.

    Returns:
        (k, 2) px.

    Raises:
        ValueError: a contour or a position out of range.
    """

def polygon_moments(points: Floats, offsets: NDArray[np.int64]) -> PolygonMoments:
    """Moments of the polygons up to the third order, exact; holes subtract by their sign.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).

    Returns:
        Not finite where there is no area.
    """

def project_to_contour(points: Floats, offsets: NDArray[np.int64], queries: Floats) -> Floats:
    """The nearest point of the outline to each query.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        queries: (k, 2) px.

    Returns:
        (k, 3) contour, position, distance in px. Of equally near places, the first.
    """

def resample(points: Floats, count: int, smooth: float) -> Floats:
    """One closed contour at `count` points equally spaced in its arc length, the first at its first point.

    Args:
        points: (N, 2) px.
        count: number of points wanted, at least 1.
        smooth: px; each output is the mean of the curve over +-smooth/2 of arc length, 0 for plain interpolation.

    Returns:
        (count, 2) px.

    Raises:
        ValueError: count below 1 or above 16,777,216, a contour without length, or smooth negative or above the length.
    """

def closing_triples(
    contacts: Floats, normals: Floats, cx: float, cy: float, rho: float, friction: float
) -> StableTriples:
    """All triples in force closure whose friction cones hold the way to the contacts' mean, or all the way from it.

    Args:
        contacts: (n, 2) px, n <= 256.
        normals: (n, 2) unit, into the material.
        cx: px, the point about which torques are taken.
        cy: px.
        rho: px by which torques are divided, above 0.
        friction: coefficient, above 0.

    Returns:
        triples (t, 3), rising; sense (t,), 1 where the fingers push toward the mean (squeeze) and -1 where they
        push away from it (spread); (t,) epsilon as in `force_closure`, above 1e-6.

    Raises:
        ValueError: arrays of different lengths or of more than 256, rho or friction not above 0.
    """

def contact_frames(points: Floats, offsets: NDArray[np.int64], places: Floats, width: float) -> Floats:
    """The straight line that fits the outline best over +-width/2 px of arc length about each place.

    Integrals run along the curve, ends of segments included, so that the answer does not depend on how it is sampled.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        places: (k, >= 2) rows of contour, position.
        width: px, above 0; a wider finger sees less of the noise and more of the shape.

    Returns:
        (k, 4) nx, ny (unit, into the material; across the chord where no direction stands out), flatness (rms distance
        from the line / width), length used / width (below 1 where the contour is shorter).

    Raises:
        ValueError: a place out of range, or a width that is not above 0.
    """

def force_closure(contacts: Floats, normals: Floats, cx: float, cy: float, rho: float, friction: float) -> Closure:
    """Ferrari and Canny's epsilon of a grasp, and the smallest friction angle with which it closes.

    The edges of the cones are n +- friction * t with a normal component of 1, so that the hull grows with friction.

    Args:
        contacts: (k, 2) px, 2 <= k <= 8.
        normals: (k, 2) unit, into the material.
        cx: px, the point about which torques are taken.
        cy: px.
        rho: px by which torques are divided, above 0.
        friction: coefficient, at least 0.

    Returns:
        epsilon, the radius of the largest ball about the origin in the hull of the wrenches (L1), negative where the
        origin is outside (the most violated facet) and 0 where the hull is flat; friction_angle in rad, pi/2 where no
        friction closes the grasp. Two contacts close when both cones strictly hold the line between them, the
        normals facing each other or facing away.

    Raises:
        ValueError: fewer than 2 or more than 8 contacts, rho not above 0 or friction below 0.
    """

def judge_contacts(
    points: Floats, offsets: Ints, contacts: Floats, width: float, cx: float, cy: float, rho: float, friction: float
) -> JudgedContacts:
    """`project_to_contour`, `contact_frames` and `force_closure` of a grasp in one; arguments and errors are theirs."""

def carried_angles(maps: Floats, contacts: Floats, normals: Floats, rho: float) -> Floats:
    """The smallest friction angle with which a grasp closes under each of some homographies.

    Args:
        maps: (m, 3, 3).
        contacts, normals, rho: as of `force_closure`.

    Returns:
        (m,) rad, pi/2 where no friction closes it.

    Raises:
        ValueError: fewer than 2 or more than 8 contacts, or rho not above 0.
    """

def opposed_pairs(contacts: Floats, normals: Floats, worth: Floats, group: int, friction: float) -> StablePairs:
    """For every two groups of candidates the best pair whose line lies strictly in both friction cones.

    Neighbouring candidates form a group, so that a pair that closes only in a narrow place is found, and yet no more
    pairs are returned than groups allow. The best has the largest share of friction left, times the squared lesser
    worth of its two contacts.

    Args:
        contacts: (m, 2) px, m a multiple of `group`, m <= 20,000.
        normals: (m, 2) unit, into the material.
        worth: (m,) above 0; a candidate without worth is left out.
        group: candidates in a group, those next to each other.
        friction: coefficient, above 0.

    Returns:
        pairs (p, 2), first below second, sorted by group; sense (p,), 1 where the normals face each other (squeeze)
        and -1 where they face away (spread); (p,) friction that each pair needs.

    Raises:
        ValueError: arrays of different lengths, groups that do not fit, or friction not above 0.
    """

def carry_normals(H: Floats, points: Floats, normals: Floats) -> Floats:
    """Points of a contour and their normals under a homography (3, 3), eq. (2).

    Returns:
        (N, 5): u, v px; the unit normal there (normals go by the inverse transpose of the Jacobian); the Jacobian's
        determinant. NaN for points that lie on or behind the horizon, seen from the mean of all: where the image's own
        origin lies is of no account, and -H does what H does.
    """

def carry_points(H: Floats, points: Floats) -> CarriedPoints:
    """Eq. (2): points of one view carried to the other.

    Args:
        H: (3, 3).
        points: (N, 2) px.
    """

def distortion(H: Floats, points: Floats) -> Distortion:
    """How a homography treats the surroundings of some points, at the worst of them.

    Args:
        H: (3, 3).
        points: (N, 2) px; of none, the first two values are infinite.
    """

def fit_homography(points1: Floats, indices1: list[int], points2: Floats, places2: list[float]) -> FittedHomography:
    """Eq. (1): H of four samples of one contour and four places on another, and its `distortion` at the samples.

    Args:
        points1, points2: (N, 2), (N', 2) px.
        indices1: four samples of the first contour.
        places2: four samples of the second, with the share of the side that follows as their fraction. Between samples
            the contour is taken as the cubic curve through them, which cuts no corners as its sides do.

    Raises:
        ValueError: three points in a row in either set, or points that are not finite; other than four, or one out of range.
    """

def blur_threshold(
    image: NDArray[np.uint8], left: int, top: int, right: int, bottom: int, level: float, polarity: int
) -> NDArray[np.uint8]:
    """Where a window of an image, softened by the binomial (1 2 1) both ways, is dark or light.

    One pass without threads: a library's parallel blur waits for its threads longer than a window takes.

    Args:
        image: (H, W).
        left, top, right, bottom: the window, right and bottom not included. Beyond the image its border is repeated.
        level: grey level.
        polarity: +1 marks what is at most the level, -1 what is above it.

    Returns:
        (bottom - top, right - left) of 0 and 255.

    Raises:
        ValueError: a window that is empty or not in the image, or a level that is NaN.
    """

def edge_links(edges: NDArray[np.uint8], reach: float, bend: float, loose: float) -> NDArray[np.int64]:
    """Gaps in thin edges that both of their ends point across (good continuation).

    Two ends are linked when each is the other's best: the shortest gap after a fine on its bends.

    Args:
        edges: (H, W) nonzero on edges one pixel wide.
        reach: px, the longest gap.
        bend: rad, by how much each end may point aside.
        loose: rad, the same across gaps below 8 px.

    Returns:
        (n, 4) x and y of both ends of each link, in the order of the image's rows.

    Raises:
        ValueError: reach, bend or loose is NaN.
    """

def search_along_normals(
    image: NDArray[np.uint8] | NDArray[np.float32], points: Floats, normals: Floats, reach: float, polarity: int
) -> Floats:
    """The strongest edge along the normal at each point, by the centroid of its gradients.

    Args:
        image: (H, W) uint8 or float32 grey levels.
        points: (n, 2) px.
        normals: (n, 2) unit, out of the material.
        reach: px searched on either side; farther finds larger motions, and more of the wrong edges.
        polarity: +1 for grey that rises outward (a dark object), -1 for grey that falls, 0 for either.

    Returns:
        (n, 4) offset px along the normal, strength (grey levels per px at the peak, signed along the normal), mean
        grey inside and outside (1.5 px or farther from the edge within reach, the last sample where there is none).
        NaN, 0, NaN, NaN where fewer than 7 samples lie in the image, one of them is no number, nothing rises as asked, or
        the strongest rise is at the end of the profile, so that the edge may lie beyond.

    Raises:
        ValueError: reach not above 0, or as many points as normals are not given.
    """

def trace_edges(
    image: NDArray[np.uint8], chain: NDArray[np.int32], hidden: NDArray[np.uint8] | None, options: TraceOptions
) -> TracedEdges:
    """Localise the edge along a chain of pixels.

    Args:
        image: (H, W).
        chain: (N, 2) pixel centres just inside the material, either way round.
        hidden: (H, W) nonzero where nothing was looked at, or None.
        options: see `TraceOptions`.

    Returns:
        Points run in the direction of an outer contour or a hole.

    Raises:
        ValueError: no chain, or an image or options of other sizes.
    """

def align_outlines(
    points1: Floats, arc1: Floats, points2: Floats, arc2: Floats, count: int, tie: float
) -> list[CyclicShift]:
    """The cyclic shifts by which one closed contour agrees best with another, up to a similarity.

    Both are sampled at `count` equal steps of arc length and centred: a_i, b_i as complex numbers, each of unit norm.
    With c_k = sum_i conj(a_i) b_(i + k), the best similarity for shift k turns by arg c_k and leaves the share
    sqrt(1 - |c_k|^2) of the second outline's norm.

    Args:
        points1, points2: (N, 2), (N', 2) px.
        arc1, arc2: (N + 1,), (N' + 1,) arc length, px.
        count: number of shifts, a power of 2 from 4 to 65536.
        tie: what may be left beyond the least that is left by any shift.

    Returns:
        Of each local maximum of |c_k| within the tie: shift k / count, angle in rad and what is left, the best first.

    Raises:
        ValueError: no such count, or arc lengths of another contour.
    """

def align_projective(
    starts: Floats,
    points: Floats,
    normals: Floats,
    targets: Floats,
    target_normals: Floats,
    offsets: NDArray[np.int64],
    steps: AlignmentSteps,
) -> Floats:
    """Refine homographies that lay points of one outline on another: Gauss-Newton, point to tangent line.

    In each step every sample is carried by the homography; its counterpart is the nearest target whose normal differs by
    60 degrees at most. Distances to the tangents there are weighted by Tukey's biweight, so that a part that fits
    nowhere counts nothing. Damping holds what the outline hardly shows.

    Args:
        starts: (k, 9) homographies by rows, each refined on its own.
        points, normals: (m, 2) px, (m, 2) unit, samples of the first outline.
        targets, target_normals, offsets: the second outline, as in `outline_gaps`.
        steps: see `AlignmentSteps`.

    Returns:
        (k, 10): the homography by rows, its last element 1, and px rms of the distances that are left, of the samples of
        the last step, those beyond its reach counted as the reach. NaN where too few points have a counterpart, where
        the outline turns over, or where a part of it is sent to infinity.

    Raises:
        ValueError: arrays that do not belong together.
    """

def initial_alignments(first: Floats, second: Floats, bends: Floats, count: int, apart: float, most: int) -> Floats:
    """Homographies that may lay one closed contour on another, without a prior.

    The first contour is whitened: its area gets its mean at 0 and unit second moments. There it is bent by
    (x, y) / (1 + g x + h y), for each bend (g, h), and whitened again. If the bend is right, it then differs from the
    whitened second contour by a turn. Both are sampled at `count` equal steps of their arc length there, and a cyclic
    correlation of the complex samples gives for each shift the best turn, and what it leaves.

    Args:
        first, second: (N, 2), (N', 2) px, of positive signed area.
        bends: (T, 2), T <= 1000.
        count: samples, a power of 2 from 4 to 65536.
        apart: lengths of the outline; of alignments whose shifts differ by less only the best is kept.
        most: alignments that are kept, at most 1000.

    Returns:
        (k, 11), k <= most: the share of the second outline's norm that is left, the shift in lengths of the outline, and
        the homography first -> second by rows, its last element 1. What leaves least comes first.

    Raises:
        ValueError: no such count, or a contour without area.
    """

def outline_gaps(
    points: Floats, normals: Floats, targets: Floats, target_normals: Floats, offsets: NDArray[np.int64], reach: float
) -> Floats:
    """How far each point of one outline is from another outline.

    Of the targets whose normals differ by 60 degrees at most the nearest counts. Its distance is taken to the piece of
    the tangent there that lies half way to the neighbours on either side.

    Args:
        points, normals: (m, 2) px, (m, 2) unit.
        targets, target_normals, offsets: the other outline, (n, 2), (n, 2), (C + 1,).
        reach: px that are searched.

    Returns:
        (m,) px, `reach` where nothing is nearer.

    Raises:
        ValueError: normals or offsets of other points, or no reach, or targets that are not finite.
    """

class OtherPiece:
    """A piece of an outline that shows another shape.

    Attributes:
        log_odds: log-likelihood ratio of another shape by it, -1 where nothing tells.
        samples: (n,) its probability at each sample, (0,) where the outline has too few samples to be looked at.
    """

    log_odds: float
    samples: Floats

class PoseEstimate:
    """A hypothesis made exact. What image and prior tell cannot be written; what else is known of it can.

    Attributes:
        valid: False where there is no such pose; the rest is then void.
        G, P: (3, 3) the pose, (8, 8) covariance of its error, by correlated residuals and the readout's variance as well.
        beforehand: (8, 8) information that is in it and not the image's: what was expected, and what a camera can show.
        contacts, covariance, middle: (k, 2) px, (k, 2, 2) px^2 by P, (x, y) px their mean.
        nuisance, nuisance_covariance: (4,), (4, 4) as of `PoseTarget.solve`, with what this image itself tells of them,
            whatever pose was expected.
        readout, readout_variance: as far as this image tells, infinite where it does not.
        by_readout: (8,) by which the pose's error depends on the readout.
        bend: (3, 8) as it was given.
        sides: as far as this image tells; NaN where it does not.
        light: gain and bias of the surface's grey levels, from the reference to this image.
        edge_width: work px, standard deviation of an edge at rest, the median; NaN where few are seen.
        blur_share: half of an edge's blur, of what moved across it since the last image, the median; NaN where few moved.
        blur: work px, half of what blurs all but a quarter of the edges; NaN where few are seen.
        edge_share: of the outline's samples whose edge was found.
        edge_sigma: work px, of their residuals.
        look: grey levels by which the inner side differs where they were found, the median; 0 of few.
        texture_agreeing: share of all patches that agree with the pose.
        correlation: of each patch of the three finest levels, one (m,) each; NaN outside the image.
        visible, occluded, other: (n,) probabilities that a sample's edge is seen, hidden, or that of something else.
        log_odds: of the outline, this object, partly hidden, against none such.
        elsewhere: share of the outline whose edge lies elsewhere.
        astray: log-likelihood ratio of these edges, of something else against light that hides them and a pose a little off.
        other_shape: log-likelihood ratio of another shape, -1 where nothing tells; to be written, where more does.
        closed_piece, open_piece: what differs there, by a piece whose own end is seen, and by one that goes on.
        hidden: share of the outline that is hidden, to be written.
        covered: that, or has its edge elsewhere.
        origin: what proposed the hypothesis, to be written.
        area: px^2 of the outline in the image, to be written.
        confirmed: a second solution, from farther away, was no better, to be written.
        slipped: probability that it is the outline's alone, which the surface contradicts, to be written.
    """

    valid: bool
    G: Floats
    P: Floats
    beforehand: Floats
    contacts: Floats
    covariance: Floats
    middle: tuple[float, float]
    nuisance: Floats
    nuisance_covariance: Floats
    readout: float
    readout_variance: float
    by_readout: Floats
    bend: Floats
    sides: float
    light: tuple[float, float]
    edge_width: float
    blur_share: float
    blur: float
    edge_share: float
    edge_sigma: float
    look: float
    texture_agreeing: float
    correlation: list[Floats]
    visible: Floats
    occluded: Floats
    other: Floats
    log_odds: float
    elsewhere: float
    astray: float
    other_shape: float
    closed_piece: OtherPiece
    open_piece: OtherPiece
    hidden: float
    covered: float
    origin: str
    area: float
    confirmed: bool
    slipped: float

class PoseFlow:
    """What texture tells of a motion.

    Attributes:
        valid: whether a pose was found.
        G, P: (3, 3) it, and (8, 8) covariance of its error.
        agreeing: share of the patches that agree.
        correlation: their mean.
        used: patches in view.
    """

    valid: bool
    G: Floats
    P: Floats
    agreeing: float
    correlation: float
    used: int

class PoseTarget:
    """What was chosen in the reference view, looked for in other images.

    Places are in work px: the reference view, cut out and reduced. A pose G (3, 3) carries them to px of an image, and its
    error d (8,) is in work px: by it a place (u, v), taken from the centre in units of the radius, moves by
    (d0 + d2 u + d3 v + d6 u^2 + d7 u v, d1 + d4 u + d5 v + d6 u v + d7 v^2), to first order. Images are given as
    pyramids: the image and its halves, uint8 (H, W) each.

    Args:
        numbers: by name, see `grasptrack.tracking.numbers.Numbers`; others than those needed are ignored.
        A: (3, 3) work px to px of the reference image.
        centre, radius: (2,) and above 0, work px: the error's terms of shape count there.
        noise: grey levels, standard deviation of the camera's.
        half: work px on each side of an edge that were averaged for its contrast.
        normal_noise: (n,) rad, by which noise may turn each normal.
        points, normals: (n, 2) samples of the outline in its order, (n, 2) unit, outward.
        contrast: (n,) signed steps there, grey levels.
        inner: (n, 6) grey levels inside each, see `strongest_edges`.
        surface, surface_value: (s, 2) where gain and bias of the light are measured, (s,) grey levels there.
        contacts: (k, 2); their steps say when a pose is settled.
        depth: (16,) distances from the outline.
        inside: (n, 16) grey levels that deep inside each sample; NaN where there is no material.
        outside: (n, 16) above 0 where that far outside is outside.

    Raises:
        ValueError: a number is missing, a length is none, or the radius is not above 0.
    """

    def __init__(
        self,
        numbers: Mapping[str, float],
        A: Floats,
        centre: Floats,
        radius: float,
        noise: float,
        half: float,
        normal_noise: Floats,
        points: Floats,
        normals: Floats,
        contrast: Floats,
        inner: Floats,
        surface: Floats,
        surface_value: Floats,
        contacts: Floats,
        depth: Floats,
        inside: Floats,
        outside: Floats,
    ) -> None: ...
    def taught_by(self, width: float, x: float, y: float) -> None:
        """The reference image was cut out of one so wide, px, whose middle lies at (x, y) px of it.

        As long as nothing is said, each image that is looked at was taken as the reference image was.

        Raises:
            ValueError: no width above 0, or a number that is not finite.
        """

    def hide(self, levels: Sequence[NDArray[np.uint8]]) -> None:
        """Pixels of every image from now on, level by level, that show nothing of the scene: nonzero."""

    def add_texture(self, levels: Sequence[NDArray[np.uint8]], centres: Floats, stride: float) -> int:
        """Patches of the reference image, to be added from fine to coarse.

        Args:
            levels: pyramid of the reference image.
            centres: (m, 2) middles of patches of 7 x 7.
            stride: work px between their pixels.

        Returns:
            How many are whole in view; the others are left out.

        Raises:
            ValueError: the stride is not above 0, or what is hidden is of another size.
        """

    def solve(
        self,
        levels: Sequence[NDArray[np.uint8]],
        G: Floats,
        P: Floats,
        last: Floats,
        bend: Floats,
        readout: float,
        readout_variance: float,
        nuisance: Floats,
        nuisance_covariance: Floats,
        sides: float,
        inner_spread: float,
        gain: float,
        bias: float,
        reach: float,
        edge_width: float,
        blur_share: float,
        lag: Floats,
        aspect: float,
    ) -> PoseEstimate:
        """The pose near a hypothesis that image, prior and camera model agree on.

        Args:
            levels: pyramid of the image.
            G, P: the hypothesis (3, 3), and covariance (8, 8) of its error.
            last: (3, 3) the pose in the image before: what moves fast is blurred; NaN where it is not known.
            bend: (3, 8) b: a rolling shutter has places beside those the pose has them, by readout times J (b0 + b1 u + b2 v),
                J being the derivatives of a place by the pose's error and (u, v) taken from the centre in units of the radius.
            readout, readout_variance: share of the time between two images in which rows are read out, as it is believed.
            nuisance, nuisance_covariance: (4,), (4, 4): the part's thickness in work px, log of the focal length in image
                widths, and slopes of the reference view's normal (theta_1, theta_2, 1).
            sides: probability that a thick part's sides are seen as the object, so that its outline is the lower face's.
            inner_spread: grey levels, by which the object's own inner side differs from what it was.
            gain, bias: of the surface's grey levels, where it was located last.
            reach: work px within which edges are looked for first, at most 1000; 0: by the covariance.
            edge_width: work px, standard deviation of an edge at rest.
            blur_share: of what moved across an edge since the last image: half of its blur.
            lag: (8,) variances of an error of the pose that all patches share; where infinite the texture is only looked at.
            aspect: width of a pixel for each unit of its height.

        Raises:
            ValueError: a length is none, or what is hidden is of another size.
        """

    def known_by(self, estimate: PoseEstimate, P: Floats, beforehand: Floats) -> PoseEstimate:
        """The same estimate with another covariance (8, 8) of its pose's error, work px^2, and that of its contacts.

        Args:
            estimate: of this target.
            P: the covariance.
            beforehand: (8, 8) information in it that is not the image's.

        Raises:
            ValueError: a matrix has another shape.
        """

    def repeats(
        self, before: Sequence[NDArray[np.uint8]], last: Floats, levels: Sequence[NDArray[np.uint8]], G: Floats
    ) -> RepeatedPatches:
        """How much motion changes the patches of the finest levels, and how far those moved that look as if they had not.

        Args:
            before, last: pyramid of the last image, and the pose (3, 3) in it.
            levels, G: pyramid of this one, and the pose (3, 3) in it.

        Raises:
            ValueError: as of `solve`; the images differ in size.
        """

    def follow(
        self,
        before: Sequence[NDArray[np.uint8]],
        last: Floats,
        levels: Sequence[NDArray[np.uint8]],
        start: Floats,
        P: Floats,
        centres: Floats,
        strides: Floats,
    ) -> PoseFlow:
        """The last image's look at some places, laid on the next image.

        Args:
            before, last: pyramid of the last image, and the pose (3, 3) through which it is looked at.
            levels: pyramid of the next one.
            start, P: a pose (3, 3) in it, and covariance (8, 8) of its error.
            centres: (m, 2) middles of patches; each coarser level has half of them, the first ones, but at least 24 or all.
            strides: (l,) work px between their pixels, fine to coarse.

        Raises:
            ValueError: as of `add_texture` and `solve`.
        """

    def moved(self, G: Floats, d: Floats) -> Floats:
        """The pose (3, 3) that G (3, 3) is once its error d (8,), work px, is made good."""

    def difference(self, first: Floats, second: Floats) -> Floats:
        """The error d (8,), work px, that leads from one pose (3, 3) to another; NaN where none does."""

    def placed(self, G: Floats, P: Floats) -> PlacedContacts:
        """The contacts at a pose (3, 3): (k, 2) px, (k, 2, 2) px^2 by the covariance (8, 8) of its error, (x, y) the middle."""

    def joined(self, G: Floats, P: Floats, other: Floats, Q: Floats) -> FusedPose:
        """Two independent predictions of a pose, (3, 3) and (8, 8) each, as one.

        Returns:
            Their squared Mahalanobis distance, infinite where they have none; pose and covariance, the first ones then.
        """

    def plane_cost(self, views: PlaneViews, theta: Floats) -> tuple[float, Floats, Floats]:
        """Twice the negative log of the density of theta (3,), given views of a rigid plane, up to a constant.

        Returns:
            Infinite where the first view's outline does not lie before the camera; matrix (3, 3) and right side (3,) of the
            normal equations there.

        Raises:
            ValueError: an aspect that is not above 0, a scale of no distribution, or poses without covariances.
        """

    def plane_modes(self, views: PlaneViews, starts: Floats) -> list[tuple[Floats, Floats, float]]:
        """Up to two explanations of all views, the most probable first, sought from starts (s, 3); none where there is none.

        Near views of a plane have two explanations, one tilted the other way.

        Returns:
            Of each theta (3,), its covariance (3, 3) and its probability.

        Raises:
            ValueError: as of `plane_cost`.
        """

    def open_tilts(self, views: PlaneViews, starts: Floats, nodes: Floats) -> tuple[Floats, Floats]:
        """What stands for what few views leave open, which no two Gaussians may describe.

        Args:
            views: that told.
            starts: (s, 2) slopes from which explanations are sought.
            nodes: (n, 2) that stand for a Gaussian of mean 0 and covariance 1.

        Returns:
            (m, 3) theta, the most probable first, and (m,) weights, which add up to 1; none where nothing explains the views.

        Raises:
            ValueError: as of `plane_cost`.
        """

    def pixel_aspect(self, views: PlaneViews, theta: Floats) -> float:
        """Width of a px for each unit of its height, as the views have it; about their explanation theta (3,).

        Raises:
            ValueError: as of `plane_cost`.
        """

def patch_noise(camera: float, stride: float) -> float:
    """Grey levels, of the camera's noise in pixels `stride` apart: at least that of 8 bits.

    Halving an image leaves little more than a quarter of it, halving it again the half of that.
    """

def seen_area(G: Floats, points: Floats) -> float:
    """Signed area, px^2, of a polygon (n, 2) seen through G (3, 3).

    Returns:
        NaN where part of it lies behind the camera, or G is not finite; 0 of no points.

    Raises:
        ValueError: points of another shape.
    """

def strongest_edges(
    levels: Sequence[NDArray[np.uint8]], A: Floats, points: Floats, normals: Floats, noise: float, reach: int, half: int
) -> StrongestEdges:
    """The strongest edge near each sample of an outline: what a target is made from.

    Args:
        levels: pyramid of the image, uint8 (H, W) each.
        A: (3, 3) work px to px of the image.
        points, normals: (n, 2) work px, (n, 2) unit, outward.
        noise: grey levels, of the camera.
        reach: work px within which edges are looked for, 0 to 1000; farther away than `half` + 1.5 none is taken.
        half: work px on each side of an edge that are averaged, 2 to 12.

    Returns:
        (n,) work px along the normal, NaN where there is none; (n,) its signed step, grey levels; (n, 6) grey levels inside
        the sample, from `half` + 5 to `half` px, NaN outside the image; (n,) work px, standard deviation of the edge at
        the sample, NaN where it cannot be told. All steps and levels are 0 where a sample lies outside.

    Raises:
        ValueError: a length, the reach or `half` is none.
    """

def surface_evidence(
    correlation: Sequence[Floats],
    usual: Sequence[Floats],
    shares: Floats,
    log_prior: Floats,
    match_spread: float,
    chance_spread: float,
    independent: float,
) -> SurfaceEvidence:
    """Log-likelihood ratios of the correlations of some levels: this surface, a share of it covered, against another one.

    Args:
        correlation: (n,) of each level's patches, NaN where not seen.
        usual: (n,) of late; within 0 and 1.
        shares: (m,) that may be covered, changed or glaring.
        log_prior: (m,) of them.
        match_spread, chance_spread: of a correlation, from 1 where the surface is the same, from 0 where it is not.
        independent: patches that count as one.

    Returns:
        Each level having a share of its own, 0 where nothing is seen; and (m,), all levels having one share.

    Raises:
        ValueError: other numbers of correlations than of what is usual, or of shares than of priors.
    """

def surface_probability(
    correlation: Sequence[Floats], usual: Sequence[Floats], match_spread: float, chance_spread: float
) -> list[Floats]:
    """(n,) for each level that its patches are the surface's own, and no noise that agrees by chance; NaN where not seen.

    The share of noise in a level is the one that makes what its patches show most probable. Arguments are as of
    `surface_evidence`.

    Raises:
        ValueError: other numbers of correlations than of what is usual.
    """

def finger_clearance(
    points: Floats,
    offsets: Ints,
    contacts: Floats,
    directions: Floats,
    places: Floats | None,
    width: float,
    depth: float,
    reach: float,
) -> Floats:
    """How far the outline protrudes into each finger's rectangle under the pad, and what else of it lies there.

    The rectangle reaches from the contact `depth` px against the finger's direction, and width / 2 to either side.
    Segments, not points, are looked at, and a rectangle whose far end lies in material is not free either.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        contacts: (k, 2) px, the middle of each pad.
        directions: (k, 2) unit vectors in which each finger pushes.
        places: (k, >= 2) rows of contour, position of each contact; None where the outline is another object's, of
            which nothing lies under a pad.
        width: px, above 0.
        depth: px; with next to 0 there is no rectangle.
        reach: px of arc length on either side of a contact; segments that begin within it are under the pad.

    Returns:
        (k, 2) the largest distance behind the pad's face of what is under it, 0 where nothing protrudes; the least
        of anything else in the rectangle, inf where there is nothing. Both px.

    Raises:
        ValueError: lengths that differ, a place out of range, a width not above 0, depth or reach below 0.
    """

def rank_grasps(
    candidates: RankedCandidates,
    grasps: Ints,
    strength: Floats,
    bound: Floats,
    space: WrenchSpace,
    limits: RankingLimits,
) -> RankedGrasps:
    """The best grasps, each unlike all better ones, with the regions in which their contacts may slip.

    A grasp's quality is its bound times its room, 0.2 + 0.8 sqrt(r / most) for the least half-length r of its regions.
    Regions are found in the order of the bounds and only as long as they can matter, which leaves the order exact.
    Grasps are alike when, in some order, each contact of one lies nearer than `gap` to one of the other.

    Args:
        candidates: see `RankedCandidates`.
        grasps: (g, 2) or (g, 3) indices of contacts; each grasp closes.
        strength: (g,) the friction that a pair needs, the epsilon of a triple.
        bound: (g,) at least 0.
        space, limits: see `WrenchSpace` and `RankingLimits`.

    Returns:
        The best first.

    Raises:
        ValueError: arrays that do not belong together, indices out of range, or a quantity out of range.
    """

def best_quadrilateral(points: Floats, weights: Floats) -> Quadrilateral:
    """Four of m points that fix a homography best, and the smallest area (px^2) of a triangle among them.

    The smallest triangle, times the root of the smallest weight, decides; the first in order of the list wins a tie.
    Indices come in rising order. With m < 4 the indices are -1, as they are where no four are finite.

    Raises:
        ValueError: more than 32 points, or not as many weights.
    """

def carry_grasp_line(
    points: Floats,
    offsets: NDArray[np.int64],
    line: tuple[float, ...],
    reference: tuple[float, ...],
    ahead: tuple[float, float],
) -> CarriedLine:
    """The contacts with given grasp-line coordinates on another outline.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        line: d_c, alpha_m, d_1, d_2.
        reference: area, cx, cy, theta of the view in which they were measured.
        ahead: the direction in which I_min is expected to point, of any length.
    """

def grasp_line(points: Floats, offsets: NDArray[np.int64], contacts: Floats) -> DescribedLine:
    """The line through two contacts relative to the silhouette's inertia axes.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        contacts: (2, 2) px.

    Returns:
        Not finite where the contacts coincide or the line never meets I_min.

    Raises:
        ValueError: other than two contacts.
    """

def match_curvature(
    first: CurvatureVector, indices: list[int], second: CurvatureVector, centres: list[float], window: MatchWindow
) -> CurvatureMatches:
    """Eq. (3): the place on the second contour whose neighbourhood is most like that of sample i of the first.

    The sample with the least sum of differences is found first. From there two steps of Gauss and Newton, of one side at
    most, go to the place between samples where the differences are least. Where that lies beyond the window, or beyond
    what can be compared, there is a sample and no place.

    Args:
        first, second: curvature of both contours, scale-free.
        indices: samples i of the first contour.
        centres: px: the arc length in the second contour about which each search is centred.
        window: see `MatchWindow`.

    Returns:
        The least matching errors are divided by 2 n + 1.

    Raises:
        ValueError: an index out of range, a radius above 1000, lengths that differ, or an arc length that does not rise.
    """

def refine_contacts(
    H: Floats, contacts: Floats, normals: Floats | None, points: Floats, offsets: NDArray[np.int64]
) -> RefinedContacts:
    """Eq. (2) and Fig. 11: each contact goes to the crossing of the outline that is nearest to where H puts it.

    Args:
        H: (3, 3) reference to current.
        contacts: (k, 2) px in the reference.
        normals: (k, 2) unit normals in the reference: each contact moves along its own, carried by H. None for two
            contacts, which move along the line through both.
        points: (N, 2) px of the current outline.
        offsets: (C + 1,).

    Raises:
        ValueError: no contacts, or without normals other than two.
    """

def select_points(
    points: Floats, arc: Floats, curvature: Floats, separation: float, prominence: float
) -> SelectedPoints:
    """The four points of a contour by which a homography is found, and what else may serve.

    Args:
        points: (N, 2) px.
        arc: (N + 1,) arc length, px.
        curvature: (N,) curvature vector, also the points' weight.
        separation: px along the contour between two peaks of curvature, at least.
        prominence: least rise of a peak above the lowest curvature within 3 separations, on either side.

    Returns:
        Indices of the peaks, the best four first in rising order of strength rank, then the others, strongest
        first; and the smallest triangle of the four in px^2. With fewer than four peaks, these and 0.

    Raises:
        ValueError: arrays of other lengths, or an arc length that does not rise.
    """
