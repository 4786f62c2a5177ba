# SPDX-License-Identifier: Apache-2.0
"""What a camera lets a plane do: its tilt and the focal length from the poses in views that differ."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import HORIZON, apply_homography
from grasptrack.kernels.results import PlaneViews
from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.target import Target
from grasptrack.typing import Bools, Floats

FEW = 4
"""Views up to which explanations are sought from all sides."""
RINGS, AROUND = 10, 10
"""Of what stands for slopes that are open: rings about the most probable ones, and places on each."""
FEW_RINGS, FEW_AROUND = 2, 8
"""The same about each of many explanations."""
START_SLOPES = (0.4, 1.2)
"""Slopes at which explanations are sought: 22 and 50 degrees from the camera's axis."""
ASPECT_VIEWS = 4
"""Views from which on the pixels' aspect is asked for."""


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
        any_turn: the object is round, and in which turn it lies makes no difference.
    """

    theta: Floats
    scale: Floats
    freedom: float = math.inf
    aspect: float | None = None
    belt: Floats | None = None
    any_turn: bool = False

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


def plane_in_view(
    theta: Floats, centre: tuple[float, float], width: float, height: float, aspect: float = 1.0
) -> Floats:
    """(..., 3, 3) homography from the object's plane, in px as if seen frontally, to px of the first view.

    Both have the same px at the centre, and the same scale but for the tilt there.

    Args:
        theta: (..., 3) as of `Mode`.
        centre: (x, y) px of the first view.
        width, height: px of the image.
        aspect: width of a pixel for each unit of its height.

    Returns:
        NaN where the plane is not seen from its front.
    """
    f, s1, s2 = width * np.exp(theta[..., 0]), theta[..., 1], theta[..., 2]
    x, y = (centre[0] - 0.5 * width) / f, (centre[1] - 0.5 * height) / (f * aspect)
    across, n, one = np.hypot(1.0, s1), np.sqrt(1.0 + s1 * s1 + s2 * s2), np.ones_like(f)
    # axes of the plane: the first without y, the second normal x first; f / (f, u) px from the centre
    first = np.stack([one / across, np.zeros_like(f), -s1 / across], axis=-1) / f[..., None]
    second = np.stack([-s1 * s2 / (n * across), across / n, -s2 / (n * across)], axis=-1) / f[..., None]
    at = np.stack([x, y, one], axis=-1) - first * centre[0] - second * centre[1]
    columns = np.stack([first, second, at], axis=-1)
    columns[..., 0, :] = f[..., None] * columns[..., 0, :] + 0.5 * width * columns[..., 2, :]
    columns[..., 1, :] = (f * aspect)[..., None] * columns[..., 1, :] + 0.5 * height * columns[..., 2, :]
    return np.where((s1 * x + s2 * y + 1.0 > 0.0)[..., None, None], columns, math.nan)


def rectifying_homography(
    theta: Floats, centre: tuple[float, float], width: float, height: float, aspect: float = 1.0
) -> Floats:
    """(..., 3, 3) homography from px of the first view to the object's plane: the inverse of `plane_in_view`."""
    H = np.linalg.inv(plane_in_view(theta, centre, width, height, aspect))
    return np.asarray(H / H[..., 2:, 2:], dtype=np.float64)


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
        """(..., 3, 3) from px of an image to rays of the camera of theta (..., 3), the optical axis last."""
        f = self._width * np.exp(theta[..., 0])
        rays = np.zeros((*f.shape, 3, 3))
        rays[..., 0, 0], rays[..., 1, 1], rays[..., 2, 2] = 1.0 / f, 1.0 / (f * self.aspect), 1.0
        rays[..., 0, 2], rays[..., 1, 2] = -0.5 * self._width / f, -0.5 * self._height / (f * self.aspect)
        return rays

    def in_view(self, theta: Floats) -> Floats:
        """(..., 3, 3) from px of the plane to px of the first view, see `plane_in_view`."""
        return plane_in_view(theta, self._centre, self._width, self._height, self.aspect)

    def _rectifying_homography(self, theta: Floats) -> Floats:
        return rectifying_homography(theta, self._centre, self._width, self._height, self.aspect)

    def are_seen(self, theta: Floats) -> Bools:
        """(m,) for each theta (m, 3) whether all of the first view's outline lies in front of the camera."""
        f = self._width * np.exp(theta[:, 0])
        away = (self.hull - 0.5 * np.array([self._width, self._height])) / (1.0, self.aspect)
        depth = f[:, None] + theta[:, 1:] @ away.T
        return np.asarray(depth.min(axis=1) > HORIZON * np.abs(depth).max(axis=1))

    def _left_open(self) -> Open:
        """What stands for what all explanations leave open of the slopes; the first is the most probable theta."""
        if 0 < len(self._views) < FEW:
            starts = np.array([m.theta[1:] for m in self.modes])
            few = _slope_nodes(math.inf, FEW_RINGS, FEW_AROUND)
            thetas, weights = self._target.handle.open_tilts(self._seen_views(), starts, few)
            if len(weights):
                return Open(thetas, weights, np.zeros(len(weights)))
        nodes = _slope_nodes(math.inf if self._views else self._before.freedom)
        parts = []
        for mode in self.modes:
            C, tilts = mode.covariance, mode.covariance[1:, 1:]
            values, vectors = np.linalg.eigh(tilts)
            focal = np.linalg.solve(tilts, C[1:, 0])  # by what the focal length goes with the slopes
            slopes = nodes @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
            thetas = mode.theta + np.column_stack([slopes @ focal, slopes])
            thetas = thetas[self.are_seen(thetas)]
            left = max(float(C[0, 0] - focal @ C[1:, 0]), 0.0)
            share = mode.probability / len(thetas)
            parts.append(Open(thetas, np.full(len(thetas), share), np.full(len(thetas), left)))
        return Open(*(np.concatenate(each) for each in zip(*parts, strict=True)))

    def _solve_modes(self) -> tuple[Mode, ...]:
        """Explanations of all views, the most probable first."""
        starts = [m.theta for m in self.modes if self._views[1:]]
        starts += [t * (1.0, -1.0, -1.0) for t in starts]
        for reach in START_SLOPES if len(self._views) < FEW else ():
            starts += [self._before.theta + reach * np.array([0, i, j]) for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        found = self._target.handle.plane_modes(self._seen_views(), np.array(starts))
        return tuple(Mode(*each) for each in found) or self.modes

    def _learn_aspect(self) -> bool:
        """The pixels' aspect, where the views fit that of no square ones and nobody told it; whether it changed."""
        if self._before.aspect is not None or len(self._views) < ASPECT_VIEWS:
            return False
        before, theta = self.aspect, self.modes[0].theta
        self.aspect = self._target.handle.pixel_aspect(self._seen_views(), theta)
        return self.aspect != before

    def _seen_views(self) -> PlaneViews:
        """All that tells of theta."""
        poses, covariances = (np.array(each) for each in zip(*((v.G, v.P) for v in self._views), strict=True))
        size, before = (self._width, self._height, self.aspect), self._before
        return PlaneViews(poses, covariances, self.hull, *size, before.theta, before.scale, before.freedom)


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
