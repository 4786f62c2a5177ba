# SPDX-License-Identifier: Apache-2.0
"""Whether a grasp closes where its contacts are, and the probability that it does although they may be off."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.equality import compared_by_value
from grasptrack.errors import InputError
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import HORIZON, behind_camera_error
from grasptrack.grasp.contact_regions import Regions, regions_of
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import Analyzer, ForceClosure, GraspAnalysis
from grasptrack.typing import Floats

CHANCE = 0.9
"""A grasp that closes with less than this probability, its contacts being as uncertain as they are, is not stable."""
BUILD = math.radians(0.3)
"""rad of margin, by which it may change before the regions are found anew."""
SAME = 1e-4
"""px within which contacts are those of the first view."""
NORMAL_PX = 0.05
"""px, standard deviation by which the ends of the line under a finger are off across the outline."""
BEND_PX = 1.5
"""px along the outline, of the first view, by which a bend is off."""


class Rectifications(NamedTuple):
    """How the view of a grasp's choice maps to the object's own plane, as well as that is known.

    Attributes:
        best: (3, 3) px of that view to px of the plane, seen frontally: up to a similarity the plane itself.
        maps: (m, 3, 3) others that stand for what is open of it; none where nothing is said of that.
        weights: (m,) their probabilities, which add up to 1.
        told: whether a view has told of the plane; else all that is open is what was thought beforehand.
    """

    best: Floats
    maps: Floats
    weights: Floats
    told: bool = True

    @staticmethod
    def known_exactly(best: Floats) -> Rectifications:
        """One map (3, 3), and nothing said of how sure that is."""
        return Rectifications(best, np.empty((0, 3, 3)), np.empty(0))


FRONTAL = Rectifications.known_exactly(np.eye(3))
"""The view of the choice taken as frontal, and nothing said of how sure that is."""


@compared_by_value
class Judgement(NamedTuple):
    """Whether a grasp closes.

    Attributes:
        analysis: of the contacts in the object's own plane.
        margin_sd: rad, of the margin, by what is not known of the plane and by the noise of the outline.
        margin_image: rad, in the current view as it is.
        closes: chance that the grasp closes where its contacts are thought to be, by what is not known of plane and outline.
        stays: chance that the contacts are so near to there that it closes as well, by their covariance.
        settled: the plane leaves less of the margin open than the first outline does, so that later views tell little more.
    """

    analysis: GraspAnalysis
    margin_sd: float
    margin_image: float
    closes: float
    stays: float
    settled: bool

    @property
    def closure_probability(self) -> float:
        """That the grasp closes."""
        return self.closes * self.stays


class ClosureCheck:
    """Judges a grasp in the object's own plane, image after image: perspective bends friction cones.

    Of contacts, outline and a finger's width, px, in the view of the grasp's choice, and Coulomb's coefficient of friction.
    """

    def __init__(self, grasp: Grasp, view: View, friction: float, width: float) -> None:
        self._view, self._contacts, self._friction = view, grasp.contacts, friction
        self._points, self._offsets = view.points, view.offsets
        self._built: float | None = None  # margin at which the regions were found
        self._share = width / math.sqrt(kernels.polygon_moments(view.points, view.offsets).area)
        self._update_rectification(FRONTAL)

    def _update_rectification(self, plane: Rectifications) -> None:
        """What is the same for all images as long as nothing more is known of the plane."""
        frontal = np.array_equal(plane.best, FRONTAL.best)
        view = self._view if frontal else self._view.transformed(plane.best)
        contacts = self._contacts if frontal else carried_points(plane.best, self._contacts)
        width = self._share * math.sqrt(kernels.polygon_moments(view.points, view.offsets).area)
        self._plane, self._analyzer = plane, Analyzer(view, width, "plane")
        self._analysis = self._analyzer.analyze(contacts, self._friction)
        self._to_view = np.asarray(np.linalg.inv(plane.best), dtype=np.float64)
        if self._built is None or abs(self._analysis.margin - self._built) > BUILD or not self._analysis.stable:
            # for three fingers it takes some tens of ms
            self._regions = regions_of(Grasp.of(contacts), view, self._friction, width)
            self._regions_to_view, self._built = self._to_view, self._analysis.margin
        self._margin_sd, self._closes, self._settled = self._margin_uncertainty(contacts, view, width)

    def _margin_uncertainty(self, contacts: Floats, view: View, width: float) -> tuple[float, float, bool]:
        """`margin_sd`, `closes` and `settled` of the judgement; it closes where nothing is said of the plane."""
        noise, (_, maps, weights, _) = self._margin_noise_variance(contacts, view, width), self._plane
        if not len(maps):
            return math.sqrt(noise), 1.0, True
        analysis = self._analysis
        needed = kernels.carried_angles(maps @ self._to_view, contacts, analysis.normals, analysis.rho)
        margins = math.atan(self._friction) - needed
        closes = sum(
            w * interval_probability(-math.inf, m, noise)
            for m, w in zip(margins.tolist(), weights.tolist(), strict=True)
        )
        tilted = float(weights @ (margins - self._analysis.margin) ** 2)
        return math.sqrt(tilted + noise), closes, tilted < noise

    def _margin_noise_variance(self, contacts: Floats, view: View, width: float) -> float:
        """rad^2, variance of the margin by what the first view's outline is off: across it, and by what bends under a finger.

        A bend is seen where it is only to within the blur of the image, which a tilted view makes longer in the plane.
        """
        normals, margin = self._analysis.normals, self._analysis.margin
        tangents = self._to_view[:2, :2] @ np.stack([-normals[:, 1], normals[:, 0]])
        tangents = (tangents / np.hypot(*tangents)).T * BEND_PX
        x, y = contacts[0].tolist()  # about which point torque is taken is of no account to the margin
        most = 0.0
        for way in (-1.0, 1.0):
            beside = carried_points(self._plane.best, self._contacts + way * tangents)
            places = kernels.project_to_contour(view.points, view.offsets, beside)
            there = kernels.contact_frames(view.points, view.offsets, places, width)[:, :2]
            for i in range(len(contacts)):
                changed = normals.copy()
                changed[i] = there[i]
                closure = ForceClosure.of(contacts, changed, (x, y), self._analysis.rho, self._friction)
                most = max(most, abs(closure.margin - margin))
        across = NORMAL_PX * math.sqrt(2.0) / width
        return most**2 + across**2

    def in_image(self, contacts: Floats, carried: Floats) -> float:
        """Margin, rad, of contacts (k, 2) px in a view as it is, the outline carried there by H_current_reference (3, 3)."""
        points = kernels.carry_points(carried, self._points).points
        width = self._share * math.sqrt(kernels.polygon_moments(points, self._offsets).area)
        (x, y), rho, friction = contacts[0].tolist(), self._analysis.rho, self._friction
        judged = kernels.judge_contacts(points, self._offsets, contacts, width, x, y, rho, friction)
        return math.atan(friction) - judged.friction_angle

    def judge_first(self, plane: Rectifications) -> Judgement:
        """In the view of the choice, where the contacts are by definition."""
        if plane is not self._plane:
            self._update_rectification(plane)
        stays, here = 1.0 if self._analysis.stable else 0.0, self.in_image(self._contacts, np.eye(3))
        return Judgement(self._analysis, self._margin_sd, here, self._closes, stays, self._settled)

    def judge(
        self,
        contacts: Floats,
        friction: float,
        carried: Floats,
        homography: Floats,
        covariance: Floats,
        plane: Rectifications = FRONTAL,
    ) -> Judgement:
        """Analysis of contacts in a current view, and the chance that they close.

        Args:
            contacts: (k, 2) px in the current view.
            friction: Coulomb coefficient.
            carried: (3, 3) H_current_reference by which they were carried there.
            homography: (3, 3) H_current_reference as the tracker knows it.
            covariance: (k, 2, 2) px^2 of the contacts.
            plane: as the tracker knows it by now.

        Raises:
            GraspError: a contact is not on the outline.
            ConditioningError: the view is of no plane that lies in front of the camera.
        """
        if plane is not self._plane or friction != self._friction:
            self._built = self._built if friction == self._friction else None
            self._friction = friction
            self._update_rectification(plane)
        contacts = np.ascontiguousarray(contacts)
        inverse = np.ascontiguousarray(np.linalg.inv(carried), dtype=np.float64)
        back, in_front = kernels.carry_points(inverse, contacts)
        if not in_front > HORIZON:
            raise behind_camera_error(carried)
        analysis = self._analysis
        if not np.abs(back - self._contacts).max() < SAME:
            analysis = self._analyzer.analyze(carried_points(plane.best, back), self._friction)
        stays = chance_of_closing(self._regions, covariance, homography @ self._regions_to_view, contacts)
        return Judgement(
            analysis, self._margin_sd, self.in_image(contacts, carried), self._closes, stays, self._settled
        )


def carried_points(H: Floats, points: Floats) -> Floats:
    """(k, 2) points under a homography (3, 3) that keeps them in front of the camera."""
    return np.asarray(kernels.carry_points(H, np.ascontiguousarray(points)).points, dtype=np.float64)


def chance_of_closing(
    regions: Regions, covariance: Floats, homography: Floats | None = None, contacts: Floats | None = None
) -> float:
    """The probability that all contacts lie within their regions, 0 to 1: at most that with which the grasp closes.

    Errors are Gaussian. Only what slips along the outline counts: across it the finger closes until it touches. It is
    carried back to the view of the regions by the derivative of the inverse homography.

    Args:
        regions: in the reference view.
        covariance: (k, 2, 2) px^2 in the current view; the contacts' errors are independent.
        homography: (3, 3) H_current_reference; None where both views are one.
        contacts: (k, 2) px in the current view, where they are not the regions' own under the homography.

    Returns:
        NaN where the covariance or the homography is not finite.
    """
    k = len(regions.contacts)
    if covariance.shape != (k, 2, 2):
        raise InputError(f"a covariance of {k} contacts is ({k}, 2, 2), not {covariance.shape}")
    found = _slip_rows(regions, homography)
    if found is None:
        return math.nan
    rows, places = found
    low, high = [-b for b in regions.back.tolist()], regions.ahead.tolist()
    if contacts is not None:  # not far from where the homography puts them, so that its derivative will do
        for i, ((u, v), (px, py), (x, y)) in enumerate(zip(rows, places, contacts.tolist(), strict=True)):
            off = u * (x - px) + v * (y - py)
            low[i], high[i] = low[i] - off, high[i] - off
    chance = 1.0
    for (u, v), ((xx, xy), (yx, yy)), a, b in zip(rows, covariance.tolist(), low, high, strict=True):
        chance *= interval_probability(a, b, u * (u * xx + v * (xy + yx)) + v * v * yy)
    return chance


_Pairs = list[tuple[float, float]]


def _slip_rows(regions: Regions, homography: Floats | None) -> tuple[_Pairs, _Pairs] | None:
    """For each contact the slip along its tangent in the reference by a shift in the current view, and its place there.

    None where the homography is not finite or cannot be inverted.
    """
    rows, places = [], []
    h = None if homography is None else homography.tolist()
    for (x, y), (tx, ty) in zip(regions.contacts.tolist(), regions.tangents.tolist(), strict=True):
        if h is None:
            rows.append((tx, ty))
            places.append((x, y))
            continue
        w = h[2][0] * x + h[2][1] * y + h[2][2]
        px, py = (h[0][0] * x + h[0][1] * y + h[0][2]) / w, (h[1][0] * x + h[1][1] * y + h[1][2]) / w
        a, b = (h[0][0] - h[2][0] * px) / w, (h[0][1] - h[2][1] * px) / w
        c, d = (h[1][0] - h[2][0] * py) / w, (h[1][1] - h[2][1] * py) / w
        determinant = a * d - b * c
        if determinant == 0.0 or not math.isfinite(determinant):
            return None
        rows.append(((tx * d - ty * c) / determinant, (ty * a - tx * b) / determinant))
        places.append((px, py))
    return rows, places


def interval_probability(low: float, high: float, variance: float) -> float:
    """The chance of a Gaussian of mean 0 to lie between two bounds."""
    if not math.isfinite(variance):
        return math.nan
    if variance <= 0.0:
        return 1.0 if low <= 0.0 <= high and low < high else 0.0
    scale = 1.0 / math.sqrt(2.0 * variance)
    return 0.5 * (math.erf(high * scale) - math.erf(low * scale))
