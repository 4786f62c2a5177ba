# SPDX-License-Identifier: Apache-2.0
"""A calibrated camera: where a point of the ideal pinhole image is seen through the lens, and back."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack import arguments
from grasptrack.equality import compared_by_value
from grasptrack.errors import InputError
from grasptrack.typing import Floats

Model = Literal["brown", "fisheye"]

COUNTS: dict[Model, tuple[int, ...]] = {"brown": (0, 4, 5, 8, 12), "fisheye": (0, 4)}
"""How many coefficients each model can have."""
HOLDS = 0.9
"""The polynomials are believed up to this share of the radius at which they turn back."""
_FAR = 3.0
"""The radius up to which they are looked at, in radii of the farthest corner."""
_STEP = 1e-6
_ANGLES = 2.0 * math.pi * np.arange(24) / 24
_WAYS = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Directions from the middle in which they are looked at."""


@compared_by_value
class Camera:
    """Intrinsics of a pinhole camera with a lens, as OpenCV and ROS write them.

    *Ideal* px are those of the pinhole image with the same matrix; *seen* px are those of the image as it is. Far outside
    the image, where the polynomials would turn back, they go on along their tangent, so that both ways are one to one.

    Args:
        matrix: (3, 3) K, px, the centre of the top-left pixel at (0, 0).
        distortion: coefficients in OpenCV's order. Brown: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]]. Fisheye
            (equidistant): k1 k2 k3 k4. None at all: no distortion.
        model: "brown" (plumb_bob, rational_polynomial) or "fisheye" (equidistant).
        size: width and height of the images it was calibrated with, px; None where that is not known.

    Raises:
        InputError: no such matrix, another number of coefficients, values that are not finite, or a lens that folds
            the image within half of its smaller side.
    """

    @arguments.checked(
        matrix=arguments.array(unbounded=True),
        distortion=arguments.array(unbounded=True),
        model=arguments.text,
        size=arguments.optional(arguments.array(2)),
    )
    def __init__(
        self, matrix: ArrayLike, distortion: ArrayLike = (), model: Model = "brown", size: tuple[int, int] | None = None
    ) -> None:
        K, d = _finite_array(matrix, "matrix"), _finite_array(distortion, "distortion").ravel()
        if K.shape != (3, 3) or K[0, 0] <= 0.0 or K[1, 1] <= 0.0 or K[1, 0] != 0.0 or (K[2] != (0.0, 0.0, 1.0)).any():
            raise InputError("a camera's matrix is 3x3 with focal lengths above 0 and 0 0 1 as its last row")
        if model not in COUNTS:
            raise InputError(f'unknown lens model "{model}"; choose from {", ".join(COUNTS)}', model=model)
        if len(d) == 14 and not d[12:].any():
            d = d[:12]
        if len(d) not in COUNTS[model]:
            counts = ", ".join(str(n) for n in COUNTS[model])
            raise InputError(f"a {model} lens has {counts} coefficients, not {len(d)}", count=len(d))
        if size is not None and min(size) < 1:
            raise InputError(f"a calibration is for images of some size, not {size[0]}x{size[1]} px", size=size)
        self.matrix, self.distortion, self.model, self.size = K, d, model, size
        width, height = size or (2.0 * K[0, 2] + 1.0, 2.0 * K[1, 2] + 1.0)
        corners = np.array([(x, y) for x in (-0.5, width - 0.5) for y in (-0.5, height - 0.5)])
        self._corner = float(np.hypot(*self._pixels_to_rays(corners).T).max())
        least = 0.5 * min(width / K[0, 0], height / K[1, 1])
        if self.holds < least and self._least_distorted_radius(self.holds) < least:
            raise InputError(
                f"the calibration folds the image {self._least_distorted_radius(self.holds) * K[0, 0]:.0f} px from its middle: "
                "its distortion is not that of these images",
                radius=self.holds,
            )

    def __repr__(self) -> str:
        fx, fy = self.matrix[0, 0], self.matrix[1, 1]
        size = "" if self.size is None else f", {self.size[0]}x{self.size[1]} px"
        return f"Camera({fx:.1f} {fy:.1f} px, {self.model}, {len(self.distortion)} coefficients{size})"

    @property
    def distorted(self) -> bool:
        """Whether straight lines are seen bent."""
        return self.model == "fisheye" or bool(self.distortion.any())

    @arguments.checked(width=arguments.whole, height=arguments.whole)
    def resized(self, width: int, height: int) -> Camera:
        """The same camera with its images scaled to another size of the same shape.

        Raises:
            InputError: a size that no scaling gives.
        """
        if self.size is None or self.size == (width, height):
            return self if self.size else Camera(self.matrix, self.distortion, self.model, (width, height))
        w, h = self.size
        if abs(width * h - height * w) > 0.5 * max(w, h):  # half a pixel, of rounding
            raise InputError(
                f"the calibration is for {w}x{h} px, the images are {width}x{height}",
                size=self.size,
                image=(width, height),
            )
        K, scale = self.matrix.copy(), (width / w, height / h)
        for axis in (0, 1):  # the middle of the first pixel is at 0, so that the border at -0.5 stays where it is
            K[axis] *= scale[axis]
            K[axis, 2] += 0.5 * scale[axis] - 0.5
        return Camera(K, self.distortion, self.model, (width, height))

    @arguments.checked(points=arguments.array(..., 2))
    def distort(self, points: ArrayLike) -> Floats:
        """(N, 2) px seen, of points (N, 2) in ideal px."""
        p = np.asarray(points, dtype=np.float64)
        return self._rays_to_pixels(self._seen_rays(self._pixels_to_rays(p))) if self.distorted else p.copy()

    @arguments.checked(points=arguments.array(..., 2))
    def undistort(self, points: ArrayLike) -> Floats:
        """(N, 2) ideal px, of points (N, 2) in px seen: the inverse of `distort`, by Newton's method, to rounding.

        Raises:
            InputError: so far outside the image that there is no inverse.
        """
        p = np.asarray(points, dtype=np.float64)
        if not self.distorted:
            return p.copy()
        seen = self._pixels_to_rays(p)
        rays = seen.copy()
        for _ in range(60):
            off = (self._seen_rays(rays) - seen)[..., None]
            try:
                step = np.linalg.solve(self._distortion_jacobian(rays), off)[..., 0]
            except np.linalg.LinAlgError:
                raise InputError("no ideal pixel is known of points so far outside the image") from None
            rays -= step
            if np.abs(step).max(initial=0.0) < 1e-14:
                break
        return self._rays_to_pixels(rays)

    @arguments.checked(points=arguments.array(..., 2))
    def jacobian(self, points: ArrayLike) -> Floats:
        """(N, 2, 2) derivatives of the px seen by the ideal px, at points (N, 2) in ideal px."""
        p = np.asarray(points, dtype=np.float64)
        A = self.matrix[:2, :2]
        slopes = np.broadcast_to(np.eye(2), (*p.shape, 2))
        if self.distorted:
            slopes = self._distortion_jacobian(self._pixels_to_rays(p))
        return np.asarray(A @ slopes @ np.linalg.inv(A), dtype=np.float64)

    @arguments.checked(points=arguments.array(..., 2))
    def within(self, points: ArrayLike) -> NDArray[np.bool_]:
        """(N,) whether the calibration itself holds at points (N, 2) in ideal px, and not its tangent."""
        return np.asarray(np.hypot(*np.moveaxis(self._pixels_to_rays(np.asarray(points)), -1, 0)) <= self.holds)

    # --- in units of the focal length ------------------------------------------------------------

    def _pixels_to_rays(self, points: Floats) -> Floats:
        K = self.matrix
        y = (points[..., 1] - K[1, 2]) / K[1, 1]
        return np.stack([(points[..., 0] - K[0, 2] - K[0, 1] * y) / K[0, 0], y], axis=-1)

    def _rays_to_pixels(self, rays: Floats) -> Floats:
        return np.asarray(rays @ self.matrix[:2, :2].T + self.matrix[:2, 2], dtype=np.float64)

    @cached_property
    def holds(self) -> float:
        """The radius, in focal lengths, up to which the polynomials are believed."""
        far = _FAR * self._corner
        if not self.distorted:
            return far
        radii = far * np.linspace(0.0, 1.0, 401)
        with np.errstate(all="ignore"):
            slopes = self._bare_slopes(radii[:, None, None] * _WAYS)
        # Both directions must go on growing: a fold along the radius and a pole of the quotient alike end it.
        good = (np.linalg.det(slopes) > 0.0) & (np.trace(slopes, axis1=-2, axis2=-1) > 0.0)
        bad = ~good.all(axis=1)
        return HOLDS * float(radii[bad.argmax()]) if bad.any() else far

    def _least_distorted_radius(self, radius: float) -> float:
        """The least radius at which points at a radius are seen."""
        return float(np.hypot(*self._apply_lens_model(radius * _WAYS).T).min())

    def _clamp_rays(self, rays: Floats) -> Floats:
        """The rays, drawn in to where the polynomials hold."""
        r = np.hypot(rays[..., 0], rays[..., 1])
        return np.asarray(rays * np.minimum(1.0, self.holds / np.maximum(r, 1e-300))[..., None])

    def _seen_rays(self, rays: Floats) -> Floats:
        inner = self._clamp_rays(rays)
        beyond = rays - inner
        out = self._apply_lens_model(inner)
        if beyond.any():
            out = out + (self._bare_slopes(inner) @ beyond[..., None])[..., 0]
        return out

    def _distortion_jacobian(self, rays: Floats) -> Floats:
        return _central_differences(self._seen_rays, rays)

    def _bare_slopes(self, rays: Floats) -> Floats:
        return _central_differences(self._apply_lens_model, rays)

    def _apply_lens_model(self, rays: Floats) -> Floats:
        x, y = rays[..., 0], rays[..., 1]
        q = x * x + y * y
        d = np.zeros(12)
        d[: len(self.distortion)] = self.distortion
        if self.model == "fisheye":
            r = np.sqrt(q)
            a = np.arctan(r)
            t = a * a
            seen = a * (1.0 + t * (d[0] + t * (d[1] + t * (d[2] + t * d[3]))))
            scale = np.where(r > 1e-9, seen / np.maximum(r, 1e-300), 1.0)
            return np.stack([x * scale, y * scale], axis=-1)
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = d
        scale = (1.0 + q * (k1 + q * (k2 + q * k3))) / (1.0 + q * (k4 + q * (k5 + q * k6)))
        u = x * scale + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x) + q * (s1 + q * s2)
        v = y * scale + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y + q * (s3 + q * s4)
        return np.stack([u, v], axis=-1)


def _central_differences(function: Callable[[Floats], Floats], rays: Floats) -> Floats:
    """(N, 2, 2) derivatives by central differences."""
    columns = [(function(rays + e) - function(rays - e)) / (2.0 * _STEP) for e in _STEP * np.eye(2)]
    return np.stack(columns, axis=-1)


def _finite_array(values: ArrayLike, what: str) -> Floats:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"a camera's {what} holds numbers only") from None
    if not np.isfinite(array).all():
        raise InputError(f"a camera's {what} holds finite numbers only")
    return array
