# SPDX-License-Identifier: Apache-2.0
"""The snake: a B-spline outline moved as a whole to the edges of each new image (Section IV-A, [17])."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack.contour import Contour, Outline, View
from grasptrack.errors import InputError
from grasptrack.observation.shape_space import Shape, ShapeSpace
from grasptrack.observation.snake_fit import Match, Model, columns, fit
from grasptrack.observation.snake_motion import ConstantVelocity
from grasptrack.observation.snake_template import NEAR, Grey, Template, sampled_outline

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

TOLERANCE = 0.3
"""px rms between the outline and its spline."""
MIN_REACH, MAX_REACH = 6.0, 30.0
"""px at 640x480 searched on either side of the predicted curve; larger images scale them."""
MIN_SUPPORT = 0.6
"""Share of the visible outline that must lie on edges like the template's."""
MIN_VISIBLE = 0.3
"""Share of the outline that must be in the image."""
MAX_MISFIT = 1.0
"""px, rms over the outline of what the shape space cannot follow (tilt, bending) up to which contacts are believed."""
MAX_FOLLOWED = 6.0
"""The same up to which the snake goes on following, so that it is there when the tilt is over."""
MAX_ELSEWHERE = 0.06
"""Share of the outline that may lie in rows on edges beside the curve."""
MAX_SPREAD = 1.0
"""px, largest standard deviation of any part of the state: beyond it the visible outline may slide along itself."""


@dataclass(frozen=True, slots=True)
class SnakeFit:
    """What one image said.

    Attributes:
        ok: whether the fit is believed.
        reason: why not; empty when ok.
        homography: (3, 3) H_current_reference as measured in this image, not filtered: it does not lag.
        points: (n, 2) px, the fitted curve at the template's samples.
        seen: (n,) whether an edge like the template's lies within 1.75 px of the curve there.
        residual: px, rms distance of the supporting edges; inf where there are none.
        misfit: px, rms over the outline of what a homography would still move it: tilt that the shape space lacks.
        support: share of the samples inside the image that are seen, of those that had an edge in the first image.
        outside: share of the samples outside the image, which speak neither for nor against the fit.
        bias, covariance: (8,) px and (8, 8) px^2 of the parameters of `snake_fit.columns`.
        linear: (2, 2) linear part of the homography.
        offsets: (C + 1,) first sample of each contour.
        space: the shape space.
    """

    ok: bool
    reason: str
    homography: Floats
    points: Floats
    seen: Bools
    residual: float
    misfit: float
    support: float
    outside: float
    bias: Floats
    covariance: Floats
    linear: Floats
    offsets: NDArray[np.int64]
    space: ShapeSpace

    def covariance_at(self, points: ArrayLike) -> Floats:
        """(k, 2, 2) px^2 in this image of reference points (k, 2).

        It holds the noise of the edges, and what the shape space cannot follow: the part that the edges show, and as
        much again as an unseen side may hide.
        """
        field = columns(self.linear, (np.asarray(points, dtype=np.float64) - self.space.centre) / self.space.rho)
        shift = field @ self.bias
        return np.asarray(field @ self.covariance @ field.transpose(0, 2, 1) + shift[:, :, None] * shift[:, None, :])

    @property
    def refined(self) -> Floats:
        """(3, 3) H_current_reference with what the shape space lacks put in: `bias` to first order.

        Beside the snake of the paper, not part of it: its points no longer lie in the shape space. Good to a few
        hundredths of a px for a misfit of some px.
        """
        p0, p1, p2, p3, p4, p5, p6, p7 = (self.bias / self.space.rho).tolist()
        small = np.array(((1.0 + p2 + p4, p5 - p3, p0), (p3 + p5, 1.0 + p2 - p4, p1), (-p6, -p7, 1.0)))
        rho, (x, y) = self.space.rho, self.space.centre.tolist()
        out = np.array(((rho, 0.0, x), (0.0, rho, y), (0.0, 0.0, 1.0)))
        back = np.array(((1.0 / rho, 0.0, -x / rho), (0.0, 1.0 / rho, -y / rho), (0.0, 0.0, 1.0)))
        H = self.homography @ out @ small @ back
        return np.asarray(H / H[2, 2])

    def seen_at(self, places: ArrayLike, width: int = 6) -> Floats:
        """(k,) 0 to 1: share of the samples about each place (k, >= 2; contour, position) of the template that are seen.

        Args:
            places: as `Grasp.on(snake.template)` gives them.
            width: samples on either side.
        """
        out = []
        around = np.arange(-width, width + 1)
        for c, position in np.asarray(places, dtype=np.float64)[:, :2].tolist():
            first, last = self.offsets[int(c)], self.offsets[int(c) + 1]
            out.append(self.seen[first + (round(position) + around) % (last - first)].mean())
        return np.array(out)


class Snake:
    """A closed B-spline outline that follows one object from image to image without segmenting it again.

    Args:
        view: the object in the first image: outer contour, and holes, which hold the snake as well.
        image: (H, W) uint8 or float32, the first image, from which the edge's polarity, strength and grey levels on both
            sides are learned for each sample.
        shape: "similarity" (4 DoF: the paper's) or "affine" (6 DoF: holds more tilt, and fixes less when hidden).
        tolerance: px rms between outline and spline; smaller keeps corners sharper at the price of more samples.
        contacts: (k, 2) px that must lie within the tolerance of the sampled outline.

    Attributes:
        template: View of the sampled outline in the first image: n points, 6 per span. Describe grasps on it.
        rms: px between the view's contours and the template.

    Raises:
        InputError: an image that is not (H, W).
        ObservationError: the outline lies on no edge of the image.
        StrategyError: unknown shape.
    """

    def __init__(
        self,
        view: Outline,
        image: Grey,
        shape: Shape = "similarity",
        *,
        tolerance: float = TOLERANCE,
        contacts: ArrayLike | None = None,
    ) -> None:
        self._size = max(1.0, math.sqrt(_checked(image).size / (640.0 * 480.0)))
        self.template, normals, self.rms = sampled_outline(view, tolerance, contacts)
        self.space = ShapeSpace(self.template.points, shape)
        self._edges = Template(self.template, normals, image)
        self._model = Model(self._edges, self.space)
        self._metric = self.space.metric()
        self._motion = ConstantVelocity(self.space.dof, self._size)
        self._last: Floats = np.zeros(self.space.dof)

    @property
    def homography(self) -> Floats:
        """(3, 3) H_current_reference that the filter believes: after `predict` the prediction."""
        return self.space.homography(self._motion.state)

    def view(self, fit: SnakeFit | None = None) -> View:
        """The sampled outline where the filter believes it, or where a fit found it, point i that of the template."""
        points = self.space.curve(self._motion.state) if fit is None else fit.points
        first = self.template.offsets
        return View(
            [Contour(points[a:b], hole=c.hole) for a, b, c in zip(first, first[1:], self.template.contours, strict=False)]
        )

    def predict(self, dt: float = 1.0) -> Floats:
        """Move on by dt frames at the velocity that the filter believes, and give the (3, 3) H_current_reference.

        Args:
            dt: time since the last image over the usual time between images.
        """
        self._motion.predict(dt)
        return self.homography

    def reseed(self, H: ArrayLike) -> None:
        """Put the snake at H_current_reference (3, 3), at rest: somebody else found the object again.

        Raises:
            ConditioningError: H sends part of the outline to infinity.
        """
        self._motion.reset(self.space.state(H))
        self._last = self._motion.state

    def update(self, image: Grey) -> SnakeFit:
        """Fit the outline to the edges of an image, from the filter's state; call `predict` first for every new image.

        Raises:
            InputError: an image that is not (H, W).
        """
        _checked(image)
        motion = self._motion
        match = fit(self._model, image, motion.state, motion.P, self._reach())
        reason = self._lost(match)
        if reason and float(np.abs(motion.state - self._last).max()) > 1.0:
            # it may have stopped: from where it was last seen, as far as the search goes
            wide = MAX_REACH * self._size
            spread = motion.free * (wide / 2.0) ** 2
            other = fit(self._model, image, self._last, spread, wide)
            if not self._lost(other):
                match, reason = other, ""
        if reason or match is None:
            motion.coast()
        else:
            motion.correct(match.state, match.noise + match.misfit**2 * motion.free)
            self._last = match.state
            misfit = max(match.misfit, match.common)
            if match.elsewhere > MAX_ELSEWHERE:
                reason = f"{match.elsewhere:.0%} of the outline lies on edges beside the fitted curve: tilt or a cover"
            elif misfit > MAX_MISFIT * self._size:
                reason = f"the outline no longer fits the template: {misfit:.1f} px of tilt or another shape"
        return self._result(match, reason)

    def _reach(self) -> float:
        """px to search: three standard deviations of the predicted curve along its normals."""
        spread = float(np.trace(self._metric @ self._motion.P)) / 2.0
        return min(max(3.0 * math.sqrt(spread) + 2.0, MIN_REACH * self._size), MAX_REACH * self._size)

    def _lost(self, match: Match | None) -> str:
        """Why a match is not to be followed; empty when it is."""
        if match is None:
            return "too few edges near the predicted outline"
        visible = float(match.visible.mean())
        if visible < MIN_VISIBLE:
            return f"only {visible:.0%} of the outline is in the image"
        if match.support < MIN_SUPPORT:
            return f"only {match.support:.0%} of the visible outline is supported by edges"
        if not max(match.misfit, match.common) <= MAX_FOLLOWED * self._size:
            return f"the outline no longer fits the template: {match.misfit:.1f} px of tilt or another shape"
        if not match.spread <= MAX_SPREAD * self._size:
            return f"the visible outline does not fix the object's motion ({match.spread:.1f} px)"
        M = self.space.linear(match.state)
        area = float(M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0])
        if not 0.01 < area < 100.0:
            return f"the outline's area would have changed by a factor of {area:.2g}"
        return ""

    def _result(self, match: Match | None, reason: str) -> SnakeFit:
        edges, space = self._edges, self.space
        state = self._motion.state if match is None else match.state
        seen = np.zeros(len(edges.nearest), dtype=np.bool_)
        residual, misfit, support, outside = math.inf, math.inf, 0.0, 0.0
        bias, covariance = np.zeros(8), np.full((8, 8), math.inf)
        if match is not None:
            seen = match.seen[edges.nearest] & edges.relied
            residual, misfit, support = match.residual, match.misfit, match.support
            outside = 1.0 - float(match.visible.mean())
            bias, covariance = match.bias, match.covariance
        return SnakeFit(
            ok=not reason,
            reason=reason,
            homography=space.homography(state),
            points=space.curve(state),
            seen=seen,
            residual=residual,
            misfit=misfit,
            support=support,
            outside=outside,
            bias=bias,
            covariance=covariance,
            linear=space.linear(state),
            offsets=self.template.offsets,
            space=space,
        )


def _checked(image: Grey) -> Grey:
    if image.ndim != 2:
        raise InputError(f"a snake needs a grey image (H, W), not {image.shape}", shape=image.shape)
    return image
