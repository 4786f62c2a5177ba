# SPDX-License-Identifier: Apache-2.0
"""Closed sub-pixel outlines of a flat object, holes included, and what one image showed of them (Section III)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack import kernels
from grasptrack.errors import ContourError
from grasptrack.typing import Bools, Floats

MIN_POINTS = 8


class Contour:
    """One closed curve.

    Args:
        points: (N, 2) px, N >= 8, x right and y down, the first point not repeated at the end. The direction is
            normalised: an outer contour gets positive signed area in these axes and a hole negative, the first point
            staying the first.
        hole: the curve bounds a hole, so that the material lies outside it.
        strength: (N,) edge strength in grey levels per px where an image was looked at, else None.
        clipped: (N,) True where the point lies on the image border, that is, where the object goes on outside.

    Raises:
        ContourError: not (N, 2), fewer than 8 points, not finite, or no area.
    """

    __slots__ = ("_arc", "_bounds", "clipped", "hole", "offsets", "points", "signed_area", "strength")

    def __init__(
        self,
        points: ArrayLike,
        *,
        hole: bool = False,
        strength: ArrayLike | None = None,
        clipped: ArrayLike | None = None,
    ) -> None:
        pts = np.array(points, dtype=np.float64, order="C")
        if pts.ndim != 2 or pts.shape[1] != 2:
            raise ContourError(f"a contour is an array of shape (N, 2), not {pts.shape}", shape=pts.shape)
        if len(pts) < MIN_POINTS:
            raise ContourError(f"a contour needs at least {MIN_POINTS} points, not {len(pts)}", count=len(pts))
        x, y = pts[:, 0] - pts[0, 0], pts[:, 1] - pts[0, 1]
        area = 0.5 * float(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1]))
        if not np.isfinite(area):  # as it is with any point that is not
            raise ContourError("a contour's coordinates must be finite", area=area)
        if abs(area) < len(pts) and abs(area) <= 1e-9 * float(np.ptp(x) + np.ptp(y)) ** 2:
            raise ContourError("a contour must enclose an area; these points lie on one line", area=area)
        marks = None if strength is None else np.array(strength, dtype=np.float64)
        cut = None if clipped is None else np.array(clipped, dtype=np.bool_)
        if (area > 0) is hole:
            pts[1:] = pts[:0:-1].copy()
            area = -area
            if marks is not None:
                marks[1:] = marks[:0:-1].copy()
            if cut is not None:
                cut[1:] = cut[:0:-1].copy()
        for name, extra in (("strength", marks), ("clipped", cut)):
            if extra is not None and extra.shape != (len(pts),):
                raise ContourError(f"{name} needs one value for each of the {len(pts)} points", shape=extra.shape)
        pts.flags.writeable = False
        self.points: Floats = pts
        self.hole = hole
        self.strength: Floats | None = marks
        self.clipped: Bools | None = cut if cut is not None and cut.any() else None
        self.signed_area = area
        self.offsets: NDArray[np.int64] = np.array([0, len(pts)], dtype=np.int64)
        self._arc: Floats | None = None
        self._bounds: tuple[tuple[float, float], tuple[float, float]] | None = None

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"Contour({len(self)} points, area {self.area:.1f} px^2{', hole' if self.hole else ''})"

    @property
    def area(self) -> float:
        """Enclosed area in px^2, positive also for a hole."""
        return abs(self.signed_area)

    @property
    def arc_length(self) -> Floats:
        """(N + 1,) arc length s in px at each point, from the first; the last entry is the whole length."""
        if self._arc is None:
            self._arc = kernels.arc_length(self.points)
        return self._arc

    @property
    def length(self) -> float:
        """Length of the closed curve in px."""
        return float(self.arc_length[-1])

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The least and the largest (x, y) px of the curve."""
        if self._bounds is None:
            (left, top), (right, bottom) = self.points.min(axis=0).tolist(), self.points.max(axis=0).tolist()
            self._bounds = (left, top), (right, bottom)
        return self._bounds

    @property
    def contours(self) -> tuple[Contour, ...]:
        """The contour alone, so that it serves wherever a View does."""
        return (self,)

    @property
    def image(self) -> None:
        """No image belongs to a bare contour."""
        return

    def transformed(self, H: ArrayLike) -> Contour:
        """The same curve under a homography (3, 3) that keeps it in front of the camera.

        Its points are worked out when they are first asked for: a tracker's outline is mostly there to be drawn.

        Raises:
            ConditioningError: H sends part of the curve to infinity.
            ContourError: what comes out has no area.
        """
        return _Transformed.of(self, np.array(H, dtype=np.float64))


class _Transformed(Contour):
    """A curve under a homography, worked out late."""

    __slots__ = ("_H", "_source")
    _LATE = frozenset(("clipped", "offsets", "points", "signed_area", "strength"))

    def __init__(self, source: Contour, H: Floats) -> None:
        self._source, self._H = source, H
        self.hole = source.hole
        self._arc = self._bounds = None
        if source.strength is None:
            self.strength = None
        if source.clipped is None:
            self.clipped = None

    @classmethod
    def of(cls, source: Contour, H: Floats) -> Contour:
        """The curve, worked out at once where something might go wrong."""
        carried = cls(source, H)
        if not carried.is_sure:
            carried.work_out()
        return carried

    def __getattr__(self, name: str) -> Any:
        if name not in self._LATE:
            raise AttributeError(f"a contour has no attribute {name!r}")
        self.work_out()
        return getattr(self, name)

    def __reduce__(self) -> tuple[Any, ...]:
        return _Transformed, (self._source, self._H)

    def work_out(self) -> None:
        """Carry the points; raises what `transformed` does."""
        from grasptrack.geometry.homographies import apply_homography

        source = self._source
        points = apply_homography(self._H, source.points)
        super().__init__(points, hole=source.hole, strength=source.strength, clipped=source.clipped)

    @property
    def is_sure(self) -> bool:
        """Whether nothing can go wrong: the curve's bounding box lies in front of the camera, the curve keeps an area."""
        (left, top), (right, bottom) = self._source.bounds
        rows: list[list[float]] = self._H.tolist()
        (a, b, c), (d, e, f), (g, h, i) = rows
        depths = [g * x + h * y + i for x in (left, right) for y in (top, bottom)]
        farthest = max(depths)
        # area shrinks by at most the determinant over the cube of the depth
        determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        area = abs(self._source.signed_area * determinant)
        return min(depths) > 1e-6 * max(farthest, 1.0) and len(self._source) * farthest**3 < area < math.inf


class View:
    """What one image showed: contour 0 is the outer one, holes follow.

    Args:
        contours: the outer contour first, then its holes.
        image: the image itself, (H, W) or (H, W, 3), where there is one.

    Raises:
        ContourError: no contour, a hole in first place, or a second outer contour.
    """

    __slots__ = ("_joined", "contours", "image")

    def __init__(self, contours: Sequence[Contour] | Contour, image: NDArray[Any] | None = None) -> None:
        listed = (contours,) if isinstance(contours, Contour) else tuple(contours)
        if not listed:
            raise ContourError("a view needs at least one contour")
        if listed[0].hole or not all(c.hole for c in listed[1:]):
            raise ContourError("a view has one outer contour, in first place, and then only holes")
        self.contours = listed
        self.image = image
        self._joined: tuple[Floats, NDArray[np.int64]] | None = None

    def __repr__(self) -> str:
        return f"View({len(self.contours)} contours, {len(self.points)} points)"

    @property
    def points(self) -> Floats:
        """(N, 2) px of all contours."""
        return self._joined_contours()[0]

    @property
    def offsets(self) -> NDArray[np.int64]:
        """(C + 1,): contour c is ``points[offsets[c]:offsets[c + 1]]``."""
        return self._joined_contours()[1]

    def _joined_contours(self) -> tuple[Floats, NDArray[np.int64]]:
        if self._joined is None:
            listed = self.contours
            if len(listed) == 1:
                self._joined = listed[0].points, listed[0].offsets
            else:
                points = np.ascontiguousarray(np.concatenate([c.points for c in listed]))
                self._joined = points, np.cumsum([0, *(len(c) for c in listed)], dtype=np.int64)
        return self._joined

    def transformed(self, H: ArrayLike) -> View:
        """The same outlines under a homography (3, 3), see `Contour.transformed`."""
        own = np.array(H, dtype=np.float64)
        return View([_Transformed.of(c, own) for c in self.contours])

    @property
    def outer(self) -> Contour:
        """Contour 0."""
        return self.contours[0]

    @property
    def is_clipped(self) -> bool:
        """Whether the image border cuts the object."""
        return any(c.clipped is not None for c in self.contours)


Outline = Contour | View
"""A bare Contour is taken as a View wherever a View is asked for."""


def as_view(outline: Outline) -> View:
    """The outline as a View; a View comes back as it is."""
    return outline if isinstance(outline, View) else View(outline)
