# SPDX-License-Identifier: Apache-2.0
"""The object's own plane as the views so far let it be known: its tilt, what rectifies the first view, and how far it is."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.closure_probability import Rectifications
from grasptrack.tracking.camera import Beforehand, Mode, PlaneSolver, SeenPose
from grasptrack.tracking.target import Target
from grasptrack.typing import Floats

NEW_SHAPE = 0.08
"""Change of the object's image, but for its place, as a share of sqrt(area), after which a view tells anew of the plane."""
MOST_VIEWS = 16
"""Views that are kept; of more every other one is left out."""
DOUBT = 0.1
"""Of theta: so far a pose may be from a view of the plane that is believed."""
TINY = 1e-300
"""Where a direction of length 0 is taken."""
STEP = 1e-3
"""Of the differences that stand for derivatives, in units of theta."""


class Tilt(NamedTuple):
    """rad between the optical axis and the object's plane's normal, and its standard deviation."""

    angle: float
    sd: float


class Plane(PlaneSolver):
    """Learns the first view's tilt and the focal length from poses in views that differ.

    Args:
        target: what is followed.
        width, height: px of the image.
        before: what is known of theta beforehand; None where nothing is.

    Attributes:
        open_back, open_view: (m, 3, 3) `pixel_to_ray` and `in_view` of what the views leave open.
    """

    def __init__(self, target: Target, width: float, height: float, before: Beforehand | None = None) -> None:
        super().__init__(target, width, height, before or Beforehand.of_unknown(target.numbers))
        self._last, self._way = target.A, NEW_SHAPE * target.size
        # entries of a homography are as small as px make them
        far = 1e3 / (self._width + self._height)
        self.steps = STEP * np.array([1.0, 1.0, 1.0 / far, 1.0, 1.0, 1.0 / far, far * 1e-3, far * 1e-3, 1.0])
        self.entries = np.eye(9).reshape(9, 3, 3) * self.steps[:, None, None]
        self._to_middle = np.array([[1.0, 0.0, 0.5 * self._width], [0.0, 1.0, 0.5 * self._height], [0.0, 0.0, 1.0]])
        self._set_modes(self.modes)

    def learn_view(self, G: Floats, P: Floats) -> bool:
        """What a view teaches in which the object was located: its pose and covariance (8, 8). Whether it was new."""
        shape = self._target.handle.difference(self._last, G)[2:]
        if not float(shape @ shape) > self._way**2:
            return False
        self._last = G
        self._views.append(SeenPose(G, P * self._target.numbers.inflate**2))
        if len(self._views) > MOST_VIEWS:
            self._views, self._way = self._views[1::2], 2.0 * self._way
        self._set_modes(self._solve_modes())
        if self._learn_aspect():
            self._set_modes(self._solve_modes())
        return True

    @property
    def is_squeezed(self) -> bool:
        """Whether the views fit no camera with pixels as they were told, or square ones."""
        return self.aspect != (self._before.aspect or 1.0)

    def tilt_in(self, homography: Floats, covariance: Floats) -> Tilt:
        """Of the object's plane against the camera of a view.

        Args:
            homography: (3, 3) H_current_reference.
            covariance: (9, 9) of its entries, row by row.
        """
        slopes, by_theta, by_entry = self._slopes_in_view(homography)
        steep = math.hypot(*slopes.tolist())
        u = slopes / steep if steep else np.array([1.0, 0.0])
        across = np.array([-u[1], u[0]])
        # of what is left about each explanation: rad by the slopes, along the steepest and across it
        turns = np.array([u / (1.0 + steep**2), across / math.hypot(1.0, steep)])
        by_focal = by_theta[:, :1] * math.sqrt(float(self.open.weights @ self.open.focal))
        spread = turns @ (by_entry @ covariance @ by_entry.T + by_focal @ by_focal.T) @ turns.T
        # of the explanations: how far the normal of each is turned from the most probable one's
        lines = self._open_horizons @ (np.linalg.inv(homography) @ self._to_middle)
        seen = self._open_focal * lines[:, :2] / lines[:, 2:]
        ahead = (seen @ slopes + 1.0) / math.hypot(1.0, steep)
        aside = np.array([(seen @ u - steep) / math.hypot(1.0, steep), seen @ across])
        far = np.hypot(*aside)
        ways = aside * (np.arctan2(far, ahead) / np.maximum(far, TINY))
        spread += (ways * self.open.weights) @ ways.T
        (a, b), (_, c) = spread.tolist()
        most = 0.5 * (a + c) + math.hypot(0.5 * (a - c), b)
        return Tilt(math.atan(steep), math.sqrt(max(most, 0.0)))

    def as_prior(self, homography: Floats, covariance: Floats) -> Beforehand:
        """What all of this tells of the same plane to who takes a later view for the first one; arguments as of `tilt_in`.

        DOUBT is added: the view that will be the first is a later one.
        """
        slopes, by_theta, by_entry = self._slopes_in_view(homography)
        own, spread = self._spread_of_modes()
        J = np.vstack([[1.0, 0.0, 0.0], by_theta])
        C = J @ spread @ J.T
        C[1:, 1:] += by_entry @ covariance @ by_entry.T + DOUBT**2 * np.eye(2)
        return Beforehand(np.array([own[0], *slopes]), C, aspect=self.aspect)

    def _slopes_in_view(self, homography: Floats) -> tuple[Floats, Floats, Floats]:
        """(2,) slopes of the plane's normal in a view, and their derivatives (2, 3) by theta and (2, 9) by the homography."""
        # as believed, after a step of each number of theta, and of each entry
        seen = self._camera_back @ homography @ self._in_view
        slopes = _normal_slopes(np.concatenate([seen, seen[0] + self._moved_entries]))
        return slopes[0], (slopes[1:4] - slopes[0]).T / STEP, (slopes[4:] - slopes[0]).T / self.steps

    def theta_and_covariance(self) -> tuple[Floats, Floats]:
        """(3,) and (3, 3) of all explanations about the most probable one, for the prior of a pose.

        DOUBT is added, where not more is known beforehand: a pose must not be drawn to what it shall tell.
        """
        own, spread = self._spread_of_modes()
        return own, spread + np.diag(np.minimum(DOUBT**2, np.diagonal(self._before.scale)))

    def _spread_of_modes(self) -> tuple[Floats, Floats]:
        """The most probable theta (3,), and the covariance (3, 3) of all explanations about it."""
        own = self.modes[0].theta
        spread = sum(m.probability * (m.covariance + np.outer(m.theta - own, m.theta - own)) for m in self.modes)
        return own, np.asarray(spread, dtype=np.float64)

    def _set_modes(self, modes: tuple[Mode, ...]) -> None:
        """What follows from the explanations, the most probable first."""
        self.modes, theta = modes, modes[0].theta
        self._camera_back = self.pixel_to_ray(theta)
        self._in_view = self.in_view(np.vstack([theta, theta + STEP * np.eye(3)]))
        self._moved_entries = self._camera_back @ self.entries @ self._in_view[0]
        self.open = self._left_open()
        self.open_back, self.open_view = self.pixel_to_ray(self.open.thetas), self.in_view(self.open.thetas)
        # of each, a plane's normal is its horizon, seen by a camera: that goes by the inverse of what carries its points
        self._open_horizons = np.cross(self.open_view[:, :, 0], self.open_view[:, :, 1])
        self._open_focal = self._width * np.exp(self.open.thetas[:, :1]) * (1.0, self.aspect)
        maps = self._rectifying_homography(self.open.thetas)
        told = bool(self._views) or not math.isfinite(self._before.freedom)
        self.rectifications = Rectifications(self._rectifying_homography(theta), maps, self.open.weights, told)


def _normal_slopes(seen: Floats) -> Floats:
    """(m, 2) slopes of a plane's normal, of the (m, 3, 3) rays of its axes and its origin."""
    a, b = seen[:, :, 0], seen[:, :, 1]
    z = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    x, y = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1], a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    return np.array([x / z, y / z]).T


ENDS = 0.25
"""Of an edge's width, a standard deviation as well, by which each end of the object is off: blur rounds what is pointed."""


class Distance(NamedTuple):
    """From the camera to the object, and its standard deviation, in the unit in which its length was told."""

    value: float
    sd: float


UNKNOWN = Distance(math.nan, math.nan)
"""Where nobody said how long the object is."""


class _ModeSamples(NamedTuple):
    """For each theta that stands for what the views leave open.

    Attributes:
        weights: (m,), which add up to 1.
        back: (m, 3, 3) px of a view to rays.
        in_view: (m, 3, 3) px of the plane to px of the first view.
        unit: (m,) of a px of the plane, in the user's unit.
        focal: (m,) variance of the focal length's log about it.
    """

    weights: Floats
    back: Floats
    in_view: Floats
    unit: Floats
    focal: Floats


def make_ruler(target: Target, plane: Plane, length: float) -> Ruler | None:
    """What tells how far a target of this length is; None where it is cut off in the first view."""
    if target.view.is_clipped:
        return None
    ends = ENDS * target.edge_width * float(target.A[0, 0])
    return Ruler(plane, target.contacts.mean(axis=0), ends, length)


class Ruler:
    """Tells how far the object's plane is from the camera.

    Args:
        plane: as the views so far let it be known.
        middle: (2,) px of the first view, to which the distance is told.
        ends: px of the first view, standard deviation by which each end of the object is off.
        length: of the object in any unit: the longer side of the smallest rectangle round its outline, as a caliper measures
            it.
    """

    def __init__(self, plane: Plane, middle: Floats, ends: float, length: float) -> None:
        self._plane, self._middle, self._ends, self._length = plane, middle, ends, length
        self._modes: tuple[Mode, ...] = ()

    def distance_in(self, homography: Floats, covariance: Floats) -> Distance:
        """In a view: along the line of sight.

        Args:
            homography: (3, 3) H_current_reference.
            covariance: (9, 9) of its entries, row by row.

        Returns:
            NaN where no distance follows, as from a homography near 0.
        """
        if self._modes is not self._plane.modes:
            self._modes, self._all = self._plane.modes, self._sample_modes()
        with np.errstate(all="ignore"):  # where no distance follows, none is told
            mean, variance = self._distance_moments(homography, covariance)
        known = 0.0 < mean < math.inf and 0.0 <= variance < math.inf
        return Distance(mean, math.sqrt(variance)) if known else UNKNOWN

    def _distance_moments(self, homography: Floats, covariance: Floats) -> tuple[float, float]:
        """Mean and variance over what the views leave open; not finite where the homography has no such view."""
        weights, back, in_view, unit, focal = self._all
        ray = np.array([*self._middle, 1.0])
        told = self._line_of_sight_distances(back, homography, in_view, unit, ray)
        mean = float(weights @ told)
        # a camera that is nearer by its focal length shows the same but for perspective: distances go with it
        variance = float(weights @ ((told - mean) ** 2 + focal * told**2))
        moved = self._line_of_sight_distances(back[:1], homography + self._plane.entries, in_view[:1], unit[:1], ray)
        by_entry = (moved - told[0]) / self._plane.steps
        variance += float(by_entry @ covariance @ by_entry) + float(np.square(mean * self._off))
        return mean, variance

    @staticmethod
    def _line_of_sight_distances(
        back: Floats, homography: Floats, in_view: Floats, unit: Floats, middle: Floats
    ) -> Floats:
        """(m,) distances along the line of sight to the middle, a (3,) place of the first view."""
        seen = back @ homography
        axes = seen @ in_view
        # of what lies at (u, v) of the plane, u and v such that it is the middle
        at = np.linalg.solve(in_view, np.broadcast_to(middle, (len(in_view), 3))[..., None])
        ray = (axes @ (at / at[:, 2:]))[..., 0]
        lengths = np.linalg.norm(axes[:, :, :2], axis=1)
        return np.asarray(unit * np.linalg.norm(ray, axis=1) / np.sqrt(lengths[:, 0] * lengths[:, 1]))

    def _sample_modes(self) -> _ModeSamples:
        """By the plane as it is known now."""
        plane = self._plane
        _, weights, focal = plane.open
        in_view = plane.open_view
        extents = np.array([outline_extent(apply_homography(np.linalg.inv(H), plane.hull)) for H in in_view])
        self._off = math.sqrt(2.0) * self._ends / float(extents[0])
        return _ModeSamples(weights, plane.open_back, in_view, self._length / extents, focal)


def outline_extent(outline: Floats) -> float:
    """The longer side of the smallest rectangle round points (n, 2), in their unit."""
    about = outline - outline.mean(axis=0)  # it counts in single precision
    return float(max(cv2.minAreaRect(np.ascontiguousarray(about, dtype=np.float32))[1]))
