# SPDX-License-Identifier: Apache-2.0
"""What a camera lets a plane do: its tilt and the focal length from the poses in views that differ."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import HORIZON, apply_homography
from grasptrack.kernels.results import PinholeMisfit
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.target import Target
from grasptrack.typing import Floats

FEW = 4
"""Views up to which explanations are sought from all sides."""
MOST_MODES = 2
"""Explanations that are kept: two views of a plane have two."""
LEAST_SD = 1e-3
"""Of theta, below which a standard deviation is not looked at more closely."""
RINGS, AROUND = 10, 10
"""Of what stands for slopes that are open: rings about the most probable ones, and places on each."""
FEW_RINGS, FEW_AROUND = 2, 8
"""The same about each of many explanations."""
FOCALS = np.linspace(-2.1, 2.1, 7)
"""Standard deviations of the focal length's log, at which few views are looked at."""
WIDER = 2.0
"""By which a variance is taken larger where it says where to look."""
NEGLIGIBLE = 1e-3
"""Probability below which what is open is left out."""
HELD = 1e12
"""Precision of what shall not move."""
START_SLOPES = (0.4, 1.2)
"""Slopes at which explanations are sought: 22 and 50 degrees from the camera's axis."""
SAME_SLOPES = 0.01
"""Slopes nearer than this are one explanation: half a degree."""
MAX_COST_ABOVE = 20.0
"""Cost above the least, twice a log, beyond which an explanation is dropped: 1 to 22,000."""
TWO_SD_COST = 4.0
"""Rise of the cost at two standard deviations of a Gaussian."""
STEPS, COST_STEP = 20, 1e-3
"""Of Levenberg and Marquardt: most steps, and the gain below which they end."""
DAMPING, LESS_DAMPING, MORE_DAMPING, MAX_DAMPING = 1e-3, 0.3, 5.0, 1e5
"""Of the same: at first, its factors after a better and a worse step, and where no step is better."""
NOT_SQUARE, MOST_ASPECT = 0.01, 0.3
"""Probability that pixels of which nothing is told are not square, and the log of their aspect's range then on either side."""
ASPECT_VIEWS, ASPECT_STEP = 4, 1e-3
"""Views from which on the pixels' aspect is asked for, and the step of the difference that stands for its derivative."""
SQUARE = 0.02
"""Log of an aspect, up to which pixels count as square: lenses and shutters that are not quite a pinhole make as much."""
NARROWER = 0.7
"""Factor by which a standard deviation is tried smaller."""


class Mode(NamedTuple):
    """An explanation of the views.

    Attributes:
        theta: (3,) log of the focal length in image widths, and the slopes of the first view's normal (theta_1, theta_2, 1).
        covariance: (3, 3) of it.
        probability: that it is this one.
    """

    theta: Floats
    covariance: Floats
    probability: float


@dataclass(frozen=True)
class Beforehand:
    """What is known of theta before a view has told anything.

    Attributes:
        theta: (3,) the most probable.
        scale: (3, 3) its covariance, where the slopes are Gaussian, as the focal length's log always is.
        freedom: of the slopes' t distribution, above 2, the scale then being its own; infinite where they are Gaussian.
        aspect: width of a pixel for each unit of its height, where it is told; None where views shall tell.
        belt: (2,) px/s, how a belt on which the object lies moves in the first view; None where that is not told.
    """

    theta: Floats
    scale: Floats
    freedom: float = math.inf
    aspect: float | None = None
    belt: Floats | None = None

    @staticmethod
    def of_unknown(numbers: Numbers) -> Beforehand:
        """Of a camera of which nothing is told: about one image width, looking down, and now and then from far aside."""
        return Beforehand.with_focal(0.0, numbers.focal_sd, numbers)

    @staticmethod
    def with_focal(log: float, sd: float, numbers: Numbers) -> Beforehand:
        """The same where the focal length's log, in image widths, is told and how far that is known."""
        scale = np.diag(np.square([sd, numbers.normal_sd, numbers.normal_sd]))
        return Beforehand(np.array([log, 0.0, 0.0]), scale, numbers.prior_freedom)

    @staticmethod
    def by_calibration(told: tuple[float, float] | None, numbers: Numbers) -> Beforehand | None:
        """The same by a calibration, as `Undistortion.focal` has it; None where that tells nothing."""
        if told is None:
            return None
        focal, aspect = told
        return replace(Beforehand.with_focal(math.log(focal), numbers.calibrated_sd, numbers), aspect=aspect)

    @property
    def covariance(self) -> Floats:
        """(3, 3) of theta."""
        C = self.scale.copy()
        if math.isfinite(self.freedom):
            C[1:, 1:] *= self.freedom / (self.freedom - 2.0)
        return C

    def prior_cost(self, theta: Floats) -> tuple[float, Floats, Floats]:
        """Twice the negative log of its density at theta; and the normal equations' matrix (3, 3) and right side (3,) there."""
        inverse, row, left = self._precision_parts
        off, A, n = self.theta - theta, left.copy(), self.freedom
        far, weight = float(off[1:] @ inverse @ off[1:]), 1.0
        if math.isfinite(n):
            far, weight = (n + 2.0) * math.log1p(far / n), (n + 2.0) / (n + far)
        A[1:, 1:] += weight * inverse
        return far + float(row @ off) ** 2, A, A @ off

    @cached_property
    def _precision_parts(self) -> tuple[Floats, Floats, Floats]:
        """Of the slopes (2, 2) the inverse scale; of the focal length, beyond what goes with them, (3,) and (3, 3)."""
        C = self.scale
        by_slopes = np.linalg.solve(C[1:, 1:], C[1:, 0])
        row = np.array([1.0, *-by_slopes]) / math.sqrt(float(C[0, 0] - by_slopes @ C[1:, 0]))
        return np.asarray(np.linalg.inv(C[1:, 1:]), dtype=np.float64), row, np.outer(row, row)


def plane_in_view(
    theta: Floats, centre: tuple[float, float], width: float, height: float, aspect: float = 1.0
) -> Floats:
    """(3, 3) homography from the object's plane, in px as if seen frontally, to px of the first view.

    Both have the same px at the centre, and the same scale but for the tilt there.

    Args:
        theta: as of `Mode`.
        centre: (x, y) px of the first view.
        width, height: px of the image.
        aspect: width of a pixel for each unit of its height.

    Returns:
        NaN where the plane is not seen from its front.
    """
    f = width * math.exp(theta[0])
    x, y = (centre[0] - 0.5 * width) / f, (centre[1] - 0.5 * height) / (f * aspect)
    s1, s2 = float(theta[1]), float(theta[2])
    across, n = math.hypot(1.0, s1), math.sqrt(1.0 + s1 * s1 + s2 * s2)
    if not s1 * x + s2 * y + 1.0 > 0.0:
        return np.full((3, 3), math.nan)
    # axes of the plane: the first without y, the second normal x first; f / (f, u) px from the centre
    first = (1.0 / across, 0.0, -s1 / across)
    second = (-s1 * s2 / (n * across), across / n, -s2 / (n * across))
    columns = np.array([[first[0], second[0], x], [first[1], second[1], y], [first[2], second[2], 1.0]])
    columns[:, :2] /= f
    columns[:, 2] -= columns[:, 0] * centre[0] + columns[:, 1] * centre[1]
    K = np.array([[f, 0.0, 0.5 * width], [0.0, f * aspect, 0.5 * height], [0.0, 0.0, 1.0]])
    return np.asarray(K @ columns, dtype=np.float64)


def rectifying_homography(
    theta: Floats, centre: tuple[float, float], width: float, height: float, aspect: float = 1.0
) -> Floats:
    """(3, 3) homography from px of the first view to the object's plane: the inverse of `plane_in_view`."""
    H = np.linalg.inv(plane_in_view(theta, centre, width, height, aspect))
    return np.asarray(H / H[2, 2], dtype=np.float64)


def rectifying_view(theta: Floats, view: View, *, width: float, height: float, aspect: float = 1.0) -> Floats:
    """(3, 3) homography from px of a view, of which theta is known, to the plane of the object whose outline it shows."""
    x, y = view.outer.points.mean(axis=0).tolist()
    return rectifying_homography(theta, (x, y), width, height, aspect)


@dataclass(frozen=True)
class SeenPose:
    """A view that told of the plane: its pose (3, 3), work px -> px, and covariance (8, 8)."""

    G: Floats
    P: Floats


class Open(NamedTuple):
    """What stands for what the views leave open.

    Attributes:
        thetas: (m, 3) that show the whole outline, the focal length as it goes with the slopes.
        weights: (m,) their probabilities, which add up to 1.
        focal: (m,) variance of the focal length's log that is left there.
    """

    thetas: Floats
    weights: Floats
    focal: Floats


class PlaneSolver:
    """Explains views of a rigid plane by a focal length and the slopes of the first view's normal.

    A rigid plane seen by a pinhole has six freedoms of a homography's eight: each view gives two equations for theta. They
    are solved together and from several starts, for near views of a plane have two explanations, one tilted the other way;
    a filter that takes one view after another settles on one of them, which can be the wrong one.

    Args:
        target: what is followed.
        width, height: px of the image.
        before: what is known of theta beforehand.

    Attributes:
        hull: (n, 2) px of the first view, round the outline.
        modes: the explanations, the most probable first.
        aspect: width of a pixel for each unit of its height, as it was told or as the views tell it.
    """

    def __init__(self, target: Target, width: float, height: float, before: Beforehand) -> None:
        self._target, self._width, self._height, self._before = target, float(width), float(height), before
        x, y, w = (target.A @ np.array([*target.outline.mean(axis=0), 1.0])).tolist()
        self._centre = x / w, y / w
        hull = cv2.convexHull(apply_homography(target.A, target.outline).astype(np.float32))[:, 0]
        self.hull = np.asarray(hull, dtype=np.float64)
        self._views: list[SeenPose] = []
        self.aspect = before.aspect or 1.0
        self.modes: tuple[Mode, ...] = (Mode(before.theta, before.covariance, 1.0),)

    def pixel_to_ray(self, theta: Floats) -> Floats:
        """(3, 3) from px of an image to rays of the camera, the optical axis last."""
        f = self._width * math.exp(theta[0])
        down = f * self.aspect
        return np.array(
            [[1.0 / f, 0.0, -0.5 * self._width / f], [0.0, 1.0 / down, -0.5 * self._height / down], [0.0, 0.0, 1.0]]
        )

    def in_view(self, theta: Floats) -> Floats:
        """(3, 3) from px of the plane to px of the first view, see `plane_in_view`."""
        return plane_in_view(theta, self._centre, self._width, self._height, self.aspect)

    def _rectifying_homography(self, theta: Floats) -> Floats:
        return rectifying_homography(theta, self._centre, self._width, self._height, self.aspect)

    def is_seen(self, theta: Floats) -> bool:
        """Whether all of the first view's outline lies in front of the camera."""
        f = self._width * math.exp(theta[0])
        depth = f + (self.hull - 0.5 * np.array([self._width, self._height])) @ (theta[1:] / (1.0, self.aspect))
        return bool(depth.min() > HORIZON * np.abs(depth).max())

    def _left_open(self) -> Open:
        """What stands for what all explanations leave open of the slopes; the first is the most probable theta."""
        if 0 < len(self._views) < FEW:
            found = self._explore_modes()
            if found is not None:
                return found
        nodes = _slope_nodes(math.inf if self._views else self._before.freedom)
        parts = []
        for mode in self.modes:
            C, tilts = mode.covariance, mode.covariance[1:, 1:]
            values, vectors = np.linalg.eigh(tilts)
            focal = np.linalg.solve(tilts, C[1:, 0])  # by what the focal length goes with the slopes
            slopes = nodes @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
            thetas = mode.theta + np.column_stack([slopes @ focal, slopes])
            thetas = thetas[[self.is_seen(theta) for theta in thetas]]
            left = max(float(C[0, 0] - focal @ C[1:, 0]), 0.0)
            share = mode.probability / len(thetas)
            parts.append(Open(thetas, np.full(len(thetas), share), np.full(len(thetas), left)))
        return Open(*(np.concatenate(each) for each in zip(*parts, strict=True)))

    def _explore_modes(self) -> Open | None:
        """The same of few views, which may leave open what no two Gaussians describe; None where nothing explains them.

        For each of some focal lengths the slopes that explain the views best are sought, and what lies about these counts as
        probable as it is: importance sampling, by the Gaussians that were found.
        """
        sd = math.sqrt(float(self._before.scale[0, 0]))
        far = [reach * np.array(way) for reach in START_SLOPES for way in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        starts = [m.theta[1:] for m in self.modes] + far
        thetas, costs, odds = [], [], []
        for log in self._before.theta[0] + sd * FOCALS:
            bumps: list[tuple[Floats, Floats]] = []
            for start in starts:
                _, theta, C = self._minimize_cost(np.array([log, *start]), slopes_alone=True)
                new = all(((theta[1:] - other) ** 2).sum() > SAME_SLOPES**2 for other, _ in bumps)
                if new and np.isfinite(C).all() and self.is_seen(theta):
                    bumps.append((theta[1:], WIDER * C[1:, 1:]))
            if not bumps:
                continue
            starts = [middle for middle, _ in bumps] + far[4:]
            places = np.concatenate(
                [m + _slope_nodes(math.inf, FEW_RINGS, FEW_AROUND) @ np.linalg.cholesky(C).T for m, C in bumps]
            )
            density = sum(_gaussian_density(places - middle, C) for middle, C in bumps)
            for place, d in zip(places, np.asarray(density).tolist(), strict=True):
                theta = np.array([log, *place])
                cost = self._normal_equations(theta)[0]
                if math.isfinite(cost):
                    thetas.append(theta)
                    costs.append(cost)
                    odds.append(1.0 / d)
        if not thetas:
            return None
        weights = np.exp(-0.5 * (np.array(costs) - min(costs))) * odds
        weights /= weights.sum()
        kept = np.argsort(-weights)[: int((weights > NEGLIGIBLE).sum())]
        return Open(np.array(thetas)[kept], weights[kept] / weights[kept].sum(), np.zeros(len(kept)))

    # --- all views together ----------------------------------------------------------------------

    def _solve_modes(self) -> tuple[Mode, ...]:
        """Explanations of all views, the most probable first."""
        starts = [m.theta for m in self.modes if self._views[1:]]
        starts += [t * (1.0, -1.0, -1.0) for t in starts]
        for reach in START_SLOPES if len(self._views) < FEW else ():
            starts += [self._before.theta + reach * np.array([0, i, j]) for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        found: list[tuple[float, Floats, Floats]] = []
        for start in starts:
            cost, theta, covariance = self._minimize_cost(start)
            apart = [theta - other for _, other, _ in found]
            if math.isfinite(cost) and all(d[1] ** 2 + d[2] ** 2 > SAME_SLOPES**2 for d in apart):
                found.append((cost, theta, covariance))
        found.sort(key=lambda each: each[0])
        if not found:
            return self.modes
        least, found = found[0][0], found[:MOST_MODES]
        found = [(c, t, self._shrink_covariance(c, t, C)) for c, t, C in found if c < least + MAX_COST_ABOVE]
        odds = [math.exp(-0.5 * (c - least)) * math.sqrt(max(float(np.linalg.det(C)), 0.0)) for c, _, C in found]
        modes = [Mode(t, C, o / sum(odds)) for (_, t, C), o in zip(found, odds, strict=True)]
        return self._merge_modes(modes, least) if len(modes) > 1 else tuple(modes)

    def _merge_modes(self, modes: list[Mode], least: float) -> tuple[Mode, ...]:
        """Two explanations as one where what lies between them explains the views nearly as well."""
        one, other = modes
        middle = one.probability * one.theta + other.probability * other.theta
        if self._normal_equations(middle)[0] > least + TWO_SD_COST:
            return tuple(sorted(modes, key=lambda m: -m.probability))
        spread = sum(m.probability * (m.covariance + np.outer(m.theta - middle, m.theta - middle)) for m in modes)
        return (Mode(middle, np.asarray(spread), 1.0),)

    def _minimize_cost(self, theta: Floats, *, slopes_alone: bool = False) -> tuple[float, Floats, Floats]:
        """Cost, theta and covariance of the explanation that is reached from a start, by Levenberg and Marquardt.

        With `slopes_alone` the focal length stays.
        """
        held = np.array([HELD if slopes_alone else 0.0, 0.0, 0.0])
        cost, A, b = self._normal_equations(theta)
        damping = DAMPING
        for _ in range(STEPS):
            if not math.isfinite(cost):
                break
            new = theta + np.linalg.solve(A + np.diag(damping * np.diag(A) + held), b)
            there = self._normal_equations(new)
            if there[0] < cost:
                done, theta = cost - there[0] < COST_STEP, new
                cost, A, b = there
                damping *= LESS_DAMPING
                if done:
                    break
            else:
                damping *= MORE_DAMPING
                if damping > MAX_DAMPING:
                    break
        return cost, theta, np.asarray(np.linalg.inv(A + np.diag(held)), dtype=np.float64) if math.isfinite(cost) else A

    def _shrink_covariance(self, cost: float, theta: Floats, covariance: Floats) -> Floats:
        """A covariance, made smaller along axes on which the cost rises sooner than its second derivative says.

        About a frontal view the equations do not change with the slopes to first order.
        """
        values, axes = np.linalg.eigh(covariance)
        kept = []
        for value, axis in zip(values.tolist(), axes.T, strict=True):
            sd = math.sqrt(max(value, 0.0))
            while (
                sd > LEAST_SD
                and sum(self._normal_equations(theta + s * axis)[0] for s in (sd, -sd)) - 2.0 * cost > TWO_SD_COST
            ):
                sd *= NARROWER
            kept.append(sd)
        return np.asarray((axes * np.square(kept)) @ axes.T, dtype=np.float64)

    def _normal_equations(self, theta: Floats) -> tuple[float, Floats, Floats]:
        """Cost at theta, its normal equations' matrix (3, 3) and right side (3,).

        A pose can be plainly wrong, as one in an image that is blurred or half covered: its error has heavy tails.
        """
        cost, A, b = self._before.prior_cost(theta)
        if not self.is_seen(theta):
            return math.inf, A, b
        freedom = self._target.numbers.prior_freedom
        for view in self._views:
            misfit, W, by_theta, far = self._misfit_of(view, theta)
            cost += (freedom + 2.0) * math.log1p(far / freedom)
            weighed = by_theta.T @ W * ((freedom + 2.0) / (freedom + far))
            A = A + weighed @ by_theta
            b = b - weighed @ misfit
        return (cost if math.isfinite(cost) else math.inf), A, b

    def _misfit_of(self, view: SeenPose, theta: Floats) -> tuple[Floats, Floats, Floats, float]:
        """(2,) by how much a view is none of this plane, its weight (2, 2), derivatives (2, 3), and the squared distance."""
        misfit, by_pose, by_theta = self._pinhole_of(view, theta, self.aspect)
        own = self._target.numbers.pinhole_sd**2
        (c, d), (_, e) = (by_pose @ view.P @ by_pose.T).tolist()
        c, e = c + own, e + own
        W = np.array([[e, -d], [-d, c]]) / (c * e - d * d)
        return misfit, W, by_theta, float(misfit @ W @ misfit)

    def _pinhole_of(self, view: SeenPose, theta: Floats, aspect: float) -> PinholeMisfit:
        found: PinholeMisfit = self._target.handle.pinhole(view.G, theta, self._width, self._height, aspect)
        return found

    # --- pixels that are not square -----------------------------------------------------------------

    def _learn_aspect(self) -> bool:
        """The pixels' aspect, where the views fit that of no square ones and nobody told it; whether it changed.

        One step from the most probable explanation on theta and aspect together. Pixels are square, or, as seldom as
        `NOT_SQUARE`, of any aspect within `MOST_ASPECT`: the evidence of both decides.
        """
        if self._before.aspect is not None or len(self._views) < ASPECT_VIEWS:
            return False
        theta, freedom = self.modes[0].theta, self._target.numbers.prior_freedom
        A, b = np.zeros((4, 4)), np.zeros(4)
        A[:3, :3], b[:3] = self._before.prior_cost(theta)[1:]
        for view in self._views:
            misfit, W, by_theta, far = self._misfit_of(view, theta)
            there = self._pinhole_of(view, theta, self.aspect * math.exp(ASPECT_STEP)).misfit
            J = np.column_stack([by_theta, (there - misfit) / ASPECT_STEP])
            weighed = J.T @ W * ((freedom + 2.0) / (freedom + far))
            A, b = A + weighed @ J, b - weighed @ misfit
        if not np.isfinite(A).all() or not A[3, 3] > 0.0:
            return False
        step, C = np.linalg.solve(A, b), np.linalg.inv(A)
        log, sd = math.log(self.aspect) + float(step[3]), math.sqrt(max(float(C[3, 3]), 0.0))
        log = min(max(log, -MOST_ASPECT), MOST_ASPECT)
        gain = 0.5 * min((log / sd) ** 2, 2.0 * MAX_COST_ABOVE)
        odds = NOT_SQUARE * math.sqrt(2.0 * math.pi) * sd / (2.0 * MOST_ASPECT) * math.exp(gain)
        new = math.exp(log) if odds > 1.0 and abs(log) > SQUARE else 1.0
        changed = new != self.aspect
        self.aspect = new
        return changed


@lru_cache
def _slope_nodes(freedom: float, rings: int = RINGS, around: int = AROUND) -> Floats:
    """(1 + rings * around, 2) slopes, equally probable, of a t distribution of mean 0 and covariance 1; the first is 0.

    About it lie rings, each as far as its share of the distribution is on average, rms, and turned against the one before.
    """
    count = 1 + rings * around
    edges = 1.0 - np.append(0.0, 1.0 + around * np.arange(rings + 1.0)) / count  # probabilities to lie farther out
    edges[-1] = 0.0
    if math.isfinite(freedom):
        share = 1.0 - 2.0 / freedom
        within = (freedom - 2.0) * (edges**share / share - edges)
    else:
        within = 2.0 * (edges - edges * np.log(np.maximum(edges, 1e-300)))
    squares = (within[:-1] - within[1:])[1:] * count / around
    squares *= 2.0 * count / (around * squares.sum())  # the middle's is theirs
    turns = 2.0 * math.pi * (np.arange(around) / around + 0.5 * np.arange(rings)[:, None] / around)
    places = np.sqrt(squares)[:, None, None] * np.stack([np.cos(turns), np.sin(turns)], axis=2)
    return np.concatenate([np.zeros((1, 2)), places.reshape(-1, 2)])


def _gaussian_density(off: Floats, C: Floats) -> Floats:
    """(m,) densities, up to a factor, at places (m, 2) from the mean, of a covariance (2, 2)."""
    far = (off * np.linalg.solve(C, off.T).T).sum(axis=1)
    return np.asarray(np.exp(-0.5 * far) / math.sqrt(float(np.linalg.det(C))))
