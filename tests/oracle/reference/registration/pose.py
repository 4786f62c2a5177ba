# SPDX-License-Identifier: Apache-2.0
"""The pose of a flat target in an image: one hypothesis made exact, with the evidence for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.kernels import LEAST_HALF_WIDTH, MOST_HALF_WIDTH, REGION_CELLS
from grasptrack.kernels.results import FusedPose, PinholeMisfit, PlacedContacts, StrongestEdges
from grasptrack.typing import Floats
from reference.registration.camera import pinhole_rows
from reference.registration.edges import (
    Light,
    edge_width,
    find_candidates,
    sample_profiles,
)
from reference.registration.estimate import fuse_predictions, project_contacts
from reference.registration.pyramid import Level, Pyramid, level_through
from reference.registration.solver import FARTHEST, Solver
from reference.registration.system import Start
from reference.registration.target import INNER, INNER_FIRST, Patches, Target
from reference.registration.texture import TextureNumbers, cut_patches, follow_look

Grey = NDArray[np.uint8]

NAMES = (
    "edge_missed",
    "same_sign",
    "edge_floor",
    "edge_noise",
    "other_spread",
    "share_object",
    "share_occluded",
    "share_other",
    "stretch",
    "texture_floor",
    "texture_independent",
    "texture_freedom",
    "prior_freedom",
    "perspective",
    "pinhole_sd",
    "pinhole_freedom",
    "sample_distance",
    "wide",
    "cell_unlikely",
    "cell_far",
    "cell_power",
    "cell_cover",
    "tolerance",
    "tolerance_px",
)
"""Numbers that a target needs."""
FEWEST_PLACES = 24
"""Places that coarser levels of a look keep: their patches are wider."""
BESIDE = 1.5
"""Work px by which the strongest edge may lie farther away than half the filter's width."""


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
    ) -> None:
        for name in NAMES:
            if name not in numbers:
                raise ValueError(f"the number {name} is missing")
        if not 0 < radius < np.inf:
            raise ValueError("the radius is above 0")
        self.numbers = {name: np.float64(numbers[name]) for name in NAMES}
        points, surface = _point_array(points, "points"), _point_array(surface, "surface samples")
        n = len(points)
        with np.errstate(all="ignore"):
            self.target = Target(
                _array_of_shape(A, "A", 3, 3),
                _array_of_shape(centre, "the centre", 2),
                np.float64(radius),
                np.float64(noise),
                np.float64(half),
                np.float64(normal_noise),
                points,
                _array_of_shape(_point_array(normals, "normals"), "normals", n, 2),
                _array_of_shape(contrast, "contrast", n),
                _array_of_shape(inner, "inner sides", n, INNER),
                surface,
                _array_of_shape(surface_value, "surface values", len(surface)),
                _point_array(contacts, "contacts"),
                _array_of_shape(depth, "depth", REGION_CELLS),
                _array_of_shape(inside, "inside", n, REGION_CELLS),
                _array_of_shape(outside, "outside", n, REGION_CELLS),
            )
        self.hidden: list[Grey] = []

    def hide(self, levels: Sequence[Grey]) -> None:
        """Pixels of every image from now on, level by level, that show nothing of the scene: nonzero."""
        self.hidden = [level.copy() for level in levels]

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
        self.target.texture.append(
            _cut_target_patches(
                self.target, self._seen(levels), self.target.A, _point_array(centres, "centres"), stride
            )
        )
        return len(self.target.texture[-1])

    def solve(
        self,
        levels: Sequence[Grey],
        G: Floats,
        P: Floats,
        last: Floats,
        bend: Floats,
        readout: float,
        nuisance: Floats,
        nuisance_covariance: Floats,
        sides: float,
        inner_spread: float,
        gain: float,
        bias: float,
        reach: float,
        edge_width: float,
        blur_share: float,
    ) -> dict[str, Any]:
        """The pose near a hypothesis that image, prior and camera model agree on.

        Args:
            levels: pyramid of the image.
            G, P: the hypothesis (3, 3), and covariance (8, 8) of its error.
            last: (3, 3) the pose in the image before: what moves fast is blurred; NaN where it is not known.
            bend: (3, 8) b: a rolling shutter has places beside those the pose has them, by readout times J (b0 + b1 u + b2 v),
                J being the derivatives of a place by the pose's error and (u, v) taken from the centre in units of the radius.
            readout: share of the time between two images in which rows are read out, as it is believed.
            nuisance, nuisance_covariance: (4,), (4, 4): the part's thickness in work px, log of the focal length in image
                widths, and slopes of the reference view's normal (theta_1, theta_2, 1).
            sides: probability that a thick part's sides are seen as the object, so that its outline is the lower face's.
            inner_spread: grey levels, by which the object's own inner side differs from what it was.
            gain, bias: of the surface's grey levels, where it was located last.
            reach: work px within which edges are looked for first, at most 1000; 0: by the covariance.
            edge_width: work px, standard deviation of an edge at rest.
            blur_share: of what moved across an edge since the last image: half of its blur.

        Returns:
            valid: False where there is no such pose; the rest is then void.
            G, P: (3, 3) the pose, (8, 8) covariance of its error, which allows for correlated residuals.
            nuisance, nuisance_covariance: with what this image itself tells of them, whatever pose was expected.
            readout, readout_variance: as far as this image tells, infinite where it does not; by_readout: (8,) by which the
                pose's error depends on it.
            sides: as far as this image tells; NaN where it does not.
            gain, bias: of the surface's grey levels, from the reference to this image.
            edge_width: work px, standard deviation of an edge at rest, the median; NaN where few are seen.
            blur_share: half of an edge's blur, of what moved across it since the last image, the median; NaN where few moved.
            blur: work px, half of what blurs all but a quarter of the edges; NaN where few are seen.
            edge_share: of the outline whose edges were found; edge_sigma: work px, of their residuals.
            look: median grey difference of the inner side where they were found; 0 of few.
            texture_used, texture_agreeing, texture_spread: patches in view, share of all that agree, and their median error in
                predicted standard deviations.
            correlation: of each patch of the three finest levels, one (m,) each; NaN outside the image.
            visible, occluded, other: (n,) probabilities that a sample's edge is seen, hidden, or that of something else.
            log_odds: of the outline, this object, partly hidden, against none such.
            elsewhere: share of the outline whose edge lies elsewhere; astray: log-likelihood ratio of these edges, of something
                else against light that hides them and a pose that is a little off.
            other_shape: log-likelihood ratio of another shape, -1 where nothing tells; differs: (n,) its probability at each
                sample, (0,) where the outline has too few samples to be looked at.

        Raises:
            ValueError: a length is none, or what is hidden is of another size.
        """
        start = Start(
            _array_of_shape(G, "G", 3, 3),
            _array_of_shape(P, "P", 8, 8),
            _array_of_shape(last, "last", 3, 3),
            _array_of_shape(bend, "the bend", 3, 8),
            float(readout),
            _array_of_shape(nuisance, "nuisance", 4),
            _array_of_shape(nuisance_covariance, "nuisance_covariance", 4, 4),
            float(sides),
            np.float64(inner_spread),
            Light(gain, bias),
            float(reach),
            float(edge_width),
            float(blur_share),
        )
        with np.errstate(all="ignore"):
            s = Solver(self.target, self._seen(levels), start, self.numbers).solve()
        return {
            "valid": s.valid,
            "G": s.G,
            "P": s.P,
            "nuisance": s.nuisance,
            "nuisance_covariance": s.nuisance_covariance,
            "readout": s.readout,
            "readout_variance": s.readout_variance,
            "by_readout": s.by_readout,
            "sides": s.sides,
            "gain": s.light.gain,
            "bias": s.light.bias,
            "edge_width": s.edge_width,
            "blur_share": s.blur_share,
            "blur": s.blur,
            "edge_share": s.edge_share,
            "edge_sigma": s.edge_sigma,
            "look": s.look,
            "texture_used": s.texture_used,
            "texture_agreeing": s.texture_agreeing,
            "texture_spread": s.texture_spread,
            "correlation": s.correlation,
            "visible": s.visible,
            "occluded": s.occluded,
            "other": s.other,
            "log_odds": s.log_odds,
            "elsewhere": s.elsewhere,
            "astray": s.astray,
            "other_shape": s.other_shape,
            "differs": s.differs,
        }

    def follow(
        self,
        before: Sequence[Grey],
        last: Floats,
        levels: Sequence[Grey],
        start: Floats,
        P: Floats,
        centres: Floats,
        strides: Floats,
    ) -> dict[str, Any]:
        """The last image's look at some places, laid on the next image.

        Args:
            before, last: pyramid of the last image, and the pose (3, 3) through which it is looked at.
            levels: pyramid of the next one.
            start, P: a pose (3, 3) in it, and covariance (8, 8) of its error.
            centres: (m, 2) middles of patches; each coarser level has half of them, the first ones, but at least 24 or all.
            strides: (l,) work px between their pixels, fine to coarse.

        Returns:
            valid: whether a pose was found; G, P: (3, 3) it, and (8, 8) covariance of its error; agreeing: share of the patches
            that agree; correlation: their mean; used: patches in view.

        Raises:
            ValueError: as of `add_texture` and `solve`.
        """
        old, now, at = self._seen(before), self._seen(levels), _point_array(centres, "centres")
        G, covariance = _array_of_shape(start, "start", 3, 3), _array_of_shape(P, "P", 8, 8)
        numbers = TextureNumbers(*(self.numbers[f"texture_{name}"] for name in TextureNumbers._fields))
        looks = []
        for stride in np.ravel(strides):
            looks.append(_cut_target_patches(self.target, old, _array_of_shape(last, "last", 3, 3), at, stride))
            at = at[: max(FEWEST_PLACES, len(at) // 2)]
        with np.errstate(all="ignore"):
            fit = follow_look(self.target, looks, now, G, covariance, numbers)
        return {
            "valid": fit.valid,
            "G": fit.G,
            "P": fit.covariance,
            "agreeing": fit.agreeing,
            "correlation": fit.correlation,
            "used": fit.used,
        }

    def moved(self, G: Floats, d: Floats) -> Floats:
        """The pose (3, 3) that G (3, 3) is once its error d (8,), work px, is made good."""
        with np.errstate(all="ignore"):
            return self.target.moved(_array_of_shape(G, "G", 3, 3), _array_of_shape(d, "d", 8))

    def difference(self, first: Floats, second: Floats) -> Floats:
        """The error d (8,), work px, that leads from one pose (3, 3) to another; NaN where none does."""
        with np.errstate(all="ignore"):
            d = self.target.difference(
                _array_of_shape(first, "the first pose", 3, 3), _array_of_shape(second, "the second pose", 3, 3)
            )
        return np.full(8, np.nan) if d is None else d

    def placed(self, G: Floats, P: Floats) -> PlacedContacts:
        """The contacts at a pose (3, 3): (k, 2) px, (k, 2, 2) px^2 by the covariance (8, 8) of its error, (x, y) the middle."""
        with np.errstate(all="ignore"):
            return project_contacts(self.target, _array_of_shape(G, "G", 3, 3), _array_of_shape(P, "P", 8, 8))

    def joined(self, G: Floats, P: Floats, other: Floats, Q: Floats) -> FusedPose:
        """Two independent predictions of a pose, (3, 3) and (8, 8) each, as one.

        Returns:
            Their squared Mahalanobis distance, infinite where they have none; pose and covariance, the first ones then.
        """
        with np.errstate(all="ignore"):
            return fuse_predictions(
                self.target,
                _array_of_shape(G, "the first pose", 3, 3),
                _array_of_shape(P, "the first covariance", 8, 8),
                _array_of_shape(other, "the second pose", 3, 3),
                _array_of_shape(Q, "the second covariance", 8, 8),
            )

    def pinhole(self, G: Floats, theta: Floats, width: float, height: float) -> PinholeMisfit:
        """How far a pose is from a pinhole's view of a rigid plane.

        Args:
            G: (3, 3).
            theta: (3,) the last three of `nuisance` of `solve`.
            width, height: px of the image.

        Returns:
            (2,) cosine of the angle of the plane's axes and log of the ratio of their lengths, both 0 in such a view, NaN where
            the camera does not show the reference view; (2, 8) and (2, 3) derivatives by the pose's error and by theta.
        """
        with np.errstate(all="ignore"):
            rows = pinhole_rows(
                self.target,
                _array_of_shape(G, "G", 3, 3),
                _array_of_shape(theta, "theta", 3),
                np.float64(width),
                np.float64(height),
            )
        return PinholeMisfit(rows.misfit, rows.by_pose, rows.by_camera)

    def _seen(self, levels: Sequence[Grey]) -> Pyramid:
        pyramid = _make_pyramid(levels)
        for k, (level, hidden) in enumerate(zip(pyramid, self.hidden, strict=False)):
            if hidden.shape != level.grey.shape:
                raise ValueError("images and the mask of what is hidden need the same size")
            pyramid[k] = Level(level.grey, hidden > 0)
        return pyramid


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
    pyramid, H = _make_pyramid(levels), _array_of_shape(A, "A", 3, 3)
    points = _point_array(points, "points")
    n = len(points)
    normals = _array_of_shape(_point_array(normals, "normals"), "normals", n, 2)
    if not 0 <= reach <= FARTHEST:
        raise ValueError("the reach is from 0 to 1000")
    if not LEAST_HALF_WIDTH <= half <= MOST_HALF_WIDTH:
        raise ValueError("half a width is from 2 to 12")
    offset, step, inner = np.full(n, np.nan), np.zeros(n), np.zeros((n, INNER))
    if n == 0:
        return StrongestEdges(offset, step, inner, np.full(n, np.nan))
    span = reach + 2 * MOST_HALF_WIDTH
    with np.errstate(all="ignore"):
        level, H = level_through(pyramid, H, points.mean(axis=0), 1.0)
        values, inside = sample_profiles(level, H, points, normals, span)
        counts, offsets, steps = find_candidates(values, span, reach, noise, np.full(n, half))
    for i in np.flatnonzero(inside):
        near, strong = offsets[i, : counts[i]], steps[i, : counts[i]]
        score = np.where(np.abs(near) < half + BESIDE, np.abs(strong) * np.exp(-near * near / (2 * half * half)), 0.0)
        if len(score) and score.max() > 0:
            best = int(score.argmax())
            offset[i], step[i] = near[best], strong[best]
        first = span + INNER_FIRST - (half - LEAST_HALF_WIDTH)
        inner[i] = values[i, first : first + INNER]
    width = np.where(inside, edge_width(values, np.full(n, half)), np.nan)
    return StrongestEdges(offset, step, inner, width)


def _array_of_shape(values: ArrayLike, name: str, *shape: int) -> Floats:
    array = np.array(values, dtype=np.float64)
    if array.size != int(np.prod(shape)):
        raise ValueError(f"{name} needs {int(np.prod(shape))} numbers")
    return array.reshape(shape)


def _point_array(values: ArrayLike, name: str) -> Floats:
    array = np.array(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(f"{name} are of shape (N, 2)")
    return array


def _make_pyramid(levels: Sequence[Grey]) -> Pyramid:
    if not len(levels):
        raise ValueError("a pyramid has at least one level")
    return [Level(level) for level in levels]


def _cut_target_patches(target: Target, pyramid: Pyramid, G: Floats, places: Floats, stride: float) -> Patches:
    if not 0 < stride < np.inf:
        raise ValueError("the stride is above 0")
    with np.errstate(all="ignore"):
        return cut_patches(target, pyramid, G, places, np.float64(stride))
