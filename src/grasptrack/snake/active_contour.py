# SPDX-License-Identifier: Apache-2.0
"""The snake: a B-spline outline moved as a whole to the edges of each new image (Section IV-A, [17])."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasptrack.errors import InputError
from grasptrack.geometry.contours import Contour, Outline, View
from grasptrack.snake.fit import CurveMatch, SnakeModel, fit_to_edges
from grasptrack.snake.shape_space import DOF, ConstantVelocity, ShapeSpace
from grasptrack.snake.template import Grey, Template, sampled_outline
from grasptrack.typing import Floats


@dataclass(frozen=True, slots=True)
class SnakeFit:
    """What one image said.

    Attributes:
        ok: whether the fit is believed.
        reason: why not; empty when ok.
        homography: (3, 3) H_current_reference as measured in this image, not filtered: it does not lag.
        points: (n, 2) px, the fitted curve at the template's samples.
        residual: px, rms distance of the supporting edges; inf where there are none.
        misfit: px, rms over the outline of what a homography would still move it: tilt that the shape space lacks.
    """

    ok: bool
    reason: str
    homography: Floats
    points: Floats
    residual: float
    misfit: float


__all__ = ["Snake", "SnakeFit"]

TOLERANCE = 0.3
"""px rms between the outline and its spline; smaller keeps corners sharper at the price of more samples."""
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


class Snake:
    """A closed B-spline outline that follows one object from image to image without segmenting it again.

    Args:
        view: the object in the first image: outer contour, and holes, which hold the snake as well.
        image: (H, W) uint8 or float32, the first image, from which the edge's polarity, strength and grey levels on
            both sides are learned for each sample.
        contacts: (k, 2) px that must lie within the tolerance of the sampled outline.

    Attributes:
        template: View of the sampled outline in the first image: n points, 6 per span. Describe grasps on it.
        rms: px between the view's contours and the template.

    Raises:
        InputError: an image that is not (H, W).
        ObservationError: the outline lies on no edge of the image.
    """

    def __init__(self, view: Outline, image: Grey, *, contacts: ArrayLike | None = None) -> None:
        self._size = max(1.0, math.sqrt(_require_grey_image(image).size / (640.0 * 480.0)))
        self.template, normals, self.rms = sampled_outline(view, TOLERANCE, contacts)
        self.space = ShapeSpace(self.template.points)
        self._edges = Template(self.template, normals, image)
        self._model = SnakeModel(self._edges, self.space)
        self._metric = self.space.metric_matrix()
        self._motion = ConstantVelocity(DOF, self._size)
        self._last: Floats = np.zeros(DOF)

    @property
    def homography(self) -> Floats:
        """(3, 3) H_current_reference that the filter believes: after `predict` the prediction."""
        return self.space.homography(self._motion.state)

    def view(self, fit: SnakeFit | None = None) -> View:
        """The sampled outline where the filter believes it, or where a fit found it, point i that of the template."""
        points = self.space.curve_points(self._motion.state) if fit is None else fit.points
        pieces = np.split(points, self.template.offsets[1:-1])
        return View([Contour.trusted(p, hole=c.hole) for p, c in zip(pieces, self.template.contours, strict=True)])

    def predict(self, dt: float = 1.0) -> Floats:
        """Move on by dt frames at the velocity that the filter believes, and give the (3, 3) H_current_reference.

        Args:
            dt: time since the last image over the usual time between images.
        """
        self._motion.predict(dt)
        return self.homography

    def reseed(self, H: ArrayLike) -> None:
        """Put the snake at H_current_reference (3, 3), at rest: somebody else found the object again."""
        self._motion.reset(self.space.state_near(H))
        self._last = self._motion.state

    def update(self, image: Grey) -> SnakeFit:
        """Fit the outline to the edges of an image, from the filter's state; call `predict` first for every new image."""
        _require_grey_image(image)
        motion = self._motion
        match = fit_to_edges(self._model, image, motion.state, motion.P, self._search_reach())
        reason = self._loss_reason(match)
        if reason and float(np.abs(motion.state - self._last).max()) > 1.0:
            # it may have stopped: from where it was last seen, as far as the search goes
            wide = MAX_REACH * self._size
            spread = motion.free * (wide / 2.0) ** 2
            other = fit_to_edges(self._model, image, self._last, spread, wide)
            if not self._loss_reason(other):
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
            else:
                self._edges.learn_levels(match.edges, match.seen)
        state = motion.state if match is None else match.state
        residual, misfit = (math.inf, math.inf) if match is None else (match.residual, match.misfit)
        homography, points = self.space.homography(state), self.space.curve_points(state)
        return SnakeFit(not reason, reason, homography, points, residual, misfit)

    def _search_reach(self) -> float:
        """px to search: three standard deviations of the predicted curve along its normals."""
        spread = float(np.trace(self._metric @ self._motion.P)) / 2.0
        return min(max(3.0 * math.sqrt(spread) + 2.0, MIN_REACH * self._size), MAX_REACH * self._size)

    def _loss_reason(self, match: CurveMatch | None) -> str:
        """Why a match is not to be followed; empty when it is."""
        if match is None:
            return "too few edges near the predicted outline"
        visible = float(match.visible.mean())
        if visible < MIN_VISIBLE:
            return f"only {visible:.0%} of the outline is in the image"
        if match.support_share < MIN_SUPPORT:
            return f"only {match.support_share:.0%} of the visible outline is supported by edges"
        if not max(match.misfit, match.common) <= MAX_FOLLOWED * self._size:
            return f"the outline no longer fits the template: {match.misfit:.1f} px of tilt or another shape"
        if not match.spread <= MAX_SPREAD * self._size:
            return f"the visible outline does not fix the object's motion ({match.spread:.1f} px)"
        M = self.space.linear_part(match.state)
        area = float(M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0])
        if not 0.01 < area < 100.0:
            return f"the outline's area would have changed by a factor of {area:.2g}"
        return ""


def _require_grey_image(image: Grey) -> Grey:
    if image.ndim != 2:
        raise InputError(f"a snake needs a grey image (H, W), not {image.shape}", shape=image.shape)
    return image
