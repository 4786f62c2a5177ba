# SPDX-License-Identifier: Apache-2.0
"""The pose of a flat target in an image: what the compiled classes take, give and refuse, and where a target's edges are.

What a pose makes least is defined in `objective`.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels import LEAST_HALF_WIDTH, MOST_HALF_WIDTH
from grasptrack.kernels.results import FusedPose, PinholeMisfit, PlacedContacts, RepeatedPatches, StrongestEdges
from grasptrack.typing import Floats
from reference.registration.edges import edge_width, find_candidates, sample_profiles
from reference.registration.objective import FARTHEST
from reference.registration.pyramid import Level, level_through
from reference.registration.target import INNER, INNER_FIRST

Grey = NDArray[np.uint8]

BESIDE = 1.5
"""Work px by which the strongest edge may lie farther away than half the filter's width."""


class PoseEstimate:
    """A hypothesis made exact. What image and prior tell cannot be written; what else is known of it can.

    Attributes:
        valid: False where there is no such pose; the rest is then void.
        G, P: (3, 3) the pose, (8, 8) covariance of its error, by correlated residuals and the readout's variance as well.
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
        other_shape: log-likelihood ratio of another shape, -1 where nothing tells.
        differs: (n,) its probability at each sample, (0,) where the outline has too few samples to be looked at.
        hidden: share of the outline that is hidden, to be written.
        covered: that, or has its edge elsewhere.
        origin: what proposed the hypothesis, to be written.
        area: px^2 of the outline in the image, to be written.
        confirmed: a second solution, from farther away, was no better, to be written.
    """

    valid: bool
    G: Floats
    P: Floats
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
    differs: Floats
    hidden: float
    covered: float
    origin: str
    area: float
    confirmed: bool


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
        normal_noise: rad, by which noise may turn the normals.
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
        normal_noise: float,
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

    def hide(self, levels: Sequence[Grey]) -> None:
        """Pixels of every image from now on, level by level, that show nothing of the scene: nonzero."""

    def add_texture(self, levels: Sequence[Grey], centres: Floats, stride: float) -> int:
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
        levels: Sequence[Grey],
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

    def unsure(self, estimate: PoseEstimate, other: PoseEstimate, probability: float) -> PoseEstimate:
        """An estimate whose covariances are those of its mixture with another one, which is right with a probability.

        Raises:
            ValueError: there is no way from one pose to the other.
        """

    def repeats(self, before: Sequence[Grey], last: Floats, levels: Sequence[Grey], G: Floats) -> RepeatedPatches:
        """How much motion changes the patches of the finest levels, and how far those moved that look as if they had not.

        Args:
            before, last: pyramid of the last image, and the pose (3, 3) in it.
            levels, G: pyramid of this one, and the pose (3, 3) in it.

        Raises:
            ValueError: as of `solve`; the images differ in size.
        """

    def follow(
        self,
        before: Sequence[Grey],
        last: Floats,
        levels: Sequence[Grey],
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

    def pinhole(self, G: Floats, theta: Floats, width: float, height: float, aspect: float) -> PinholeMisfit:
        """How far a pose is from a pinhole's view of a rigid plane.

        Args:
            G: (3, 3).
            theta: (3,) the last three of `nuisance` of `solve`.
            width, height: px of the image.
            aspect: as of `solve`.

        Returns:
            (2,) cosine of the angle of the plane's axes and log of the ratio of their lengths, both 0 in such a view, NaN where
            the camera does not show the reference view; (2, 8) and (2, 3) derivatives by the pose's error and by theta.
        """


def strongest_edges(
    levels: Sequence[Grey], A: Floats, points: Floats, normals: Floats, noise: float, reach: int, half: int
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
    n, A = len(points), np.reshape(A, (3, 3))
    if not len(levels):
        raise ValueError("a pyramid has at least one level")
    if np.shape(normals) != (n, 2):
        raise ValueError("each point needs its normal")
    if not 0 <= reach <= FARTHEST:
        raise ValueError("the reach is from 0 to 1000")
    if not LEAST_HALF_WIDTH <= half <= MOST_HALF_WIDTH:
        raise ValueError("half a width is from 2 to 12")
    offset, step, inner, width = np.full(n, np.nan), np.zeros(n), np.zeros((n, INNER)), np.full(n, np.nan)
    if n == 0:
        return StrongestEdges(offset, step, inner, width)
    span = reach + 2 * MOST_HALF_WIDTH
    with np.errstate(all="ignore"):
        level, H = level_through([Level(level) for level in levels], A, points.mean(axis=0), 1.0)
        values, inside = sample_profiles(level, H, points, normals, span)
        for i in np.flatnonzero(inside):
            near = [(x, g) for x, g in find_candidates(values[i], reach, noise, half) if abs(x) < half + BESIDE]
            if near:
                offset[i], step[i] = max(
                    near, key=lambda edge: abs(edge[1]) * np.exp(-(edge[0] ** 2) / (2 * half * half))
                )
            first = span + INNER_FIRST - (half - LEAST_HALF_WIDTH)
            inner[i], width[i] = values[i, first : first + INNER], edge_width(values[i], half)
    return StrongestEdges(offset, step, inner, width)
