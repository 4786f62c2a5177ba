# SPDX-License-Identifier: Apache-2.0
"""Closed sub-pixel outlines of a flat object, holes included, and what one image showed of them (Section III)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack import arguments, kernels
from grasptrack.equality import are_equal
from grasptrack.errors import ContourError, InputError
from grasptrack.presentation import png_of
from grasptrack.typing import Bools, Floats

MIN_POINTS = 8
MAX_POINTS = 100_000
"""More than the outline of an image of 100 megapixels has."""
FARTHEST = 1e9
"""px: of a larger coordinate too few digits are left for fractions of a pixel."""
LEAST_SIZE = 1e-3
"""px: what is smaller, in width and height together, is a place."""
THINNEST = 1e-5
"""Area over the square of width and height together: what is thinner is a line, and only rounding tells on which side of it a
contact lies."""


class Contour:
    """One closed curve.

    Args:
        points: (N, 2) px, x right and y down, up to 100,000 of at most 1e9 px. Points that repeat the one before are merged
            with it, and so is the first point where it is repeated at the end, as in ``np.linspace(0, 2 * pi, n)``; at least
            8 must be left. The direction is normalised: an outer contour gets positive signed area in these axes and a hole
            negative, the first point staying the first. The curve may touch itself, as a chain of pixels round a thin part
            does, but not cross itself.
        hole: the curve bounds a hole, so that the material lies outside it.
        strength: (N,) edge strength in grey levels per px where an image was looked at, else None. Of merged points that of
            the first one stays.
        clipped: (N,) True where the point lies on the image border, that is, where the object goes on outside. Merged points
            are clipped where one of them is.

    Raises:
        ContourError: points that are no numbers of shape (N, 2), too few or too many, not finite, too far away, all in one
            place, that enclose no area, or whose curve crosses itself; or a strength or clipped of another length.
    """

    __slots__ = ("_arc", "_bounds", "clipped", "hole", "offsets", "points", "signed_area", "strength")

    @arguments.checked(hole=arguments.truth)
    def __init__(
        self,
        points: ArrayLike,
        *,
        hole: bool = False,
        strength: ArrayLike | None = None,
        clipped: ArrayLike | None = None,
    ) -> None:
        pts = _as_points(points)
        if len(pts) > MAX_POINTS:
            raise ContourError(f"a contour has at most {MAX_POINTS} points, not {len(pts)}", count=len(pts))
        marks = _as_marks("strength", strength, np.float64, len(pts))
        cut = _as_marks("clipped", clipped, np.bool_, len(pts))
        fresh = (pts != np.roll(pts, 1, axis=0)).any(axis=1)
        if not fresh.all():
            pts, marks, cut = _merge_repeated(pts, fresh, marks, cut)
        self._set_points(pts, bool(hole), marks, cut)
        width, height = np.ptp(self.points, axis=0).tolist()
        if width + height < LEAST_SIZE:
            raise ContourError(
                f"a contour is at least {LEAST_SIZE:g} px wide and high together, not {width + height:g}",
                size=width + height,
            )
        if self.area < THINNEST * (width + height) ** 2:
            raise ContourError(
                f"a contour must enclose an area; these points lie on one line but for {THINNEST:g} of its length",
                area=self.area,
            )
        i, j = kernels.first_crossing(self.points)
        if i >= 0:
            (x, y), (u, v) = self.points[i].tolist(), self.points[j].tolist()
            raise ContourError(
                f"a contour must not cross itself, as this one does where it goes on from ({x:g}, {y:g}) and ({u:g}, {v:g})",
                first=i,
                second=j,
            )

    @classmethod
    def trusted(
        cls,
        points: ArrayLike,
        *,
        hole: bool = False,
        strength: ArrayLike | None = None,
        clipped: ArrayLike | None = None,
    ) -> Contour:
        """A contour of points that correspond to those of another, or were measured: none is merged, and nothing is refused for
        crossing itself or being thin. For code that made them from a contour, and in the inner loop.

        Raises:
            ContourError: fewer than 8 points, not finite, too far away, or no area.
        """
        contour = Contour.__new__(Contour)
        pts = _as_points(points)
        marks = _as_marks("strength", strength, np.float64, len(pts))
        contour._set_points(pts, hole, marks, _as_marks("clipped", clipped, np.bool_, len(pts)))
        return contour

    def _set_points(self, pts: Floats, hole: bool, marks: Floats | None, cut: Bools | None) -> None:
        """Take points that are this contour's own, in their right direction."""
        if len(pts) < MIN_POINTS:
            raise ContourError(f"a contour needs at least {MIN_POINTS} points, not {len(pts)}", count=len(pts))
        farthest = max(float(pts.max()), -float(pts.min()))
        if not farthest <= FARTHEST:
            raise ContourError(
                f"a contour's coordinates must be finite, and at most {FARTHEST:g} px, not {farthest:g}",
                farthest=farthest,
            )
        x, y = pts[:, 0] - pts[0, 0], pts[:, 1] - pts[0, 1]
        area = 0.5 * float(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1]))
        if abs(area) < len(pts) and abs(area) <= 1e-9 * float(np.ptp(x) + np.ptp(y)) ** 2:
            raise ContourError(
                "a contour must enclose an area; these points lie on one line, or go round one way as much as the other",
                area=area,
            )
        if (area > 0) is hole:
            pts[1:] = pts[:0:-1].copy()
            area = -area
            if marks is not None:
                marks[1:] = marks[:0:-1].copy()
            if cut is not None:
                cut[1:] = cut[:0:-1].copy()
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

    def to_dict(self) -> dict[str, Any]:
        """Points (N, 2) px as lists, whether it is a hole, and its area in px^2."""
        return {"points": self.points.tolist(), "hole": self.hole, "area": self.area}

    def _repr_png_(self) -> bytes:
        return png_of(self)

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
            InputError: H is no array of numbers (3, 3).
            ConditioningError: H sends part of the curve to infinity.
            ContourError: what comes out has no area.
        """
        return _Transformed.of_contour(self, _as_homography(H))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Contour):
            return NotImplemented
        return self is other or (
            self.hole == other.hole
            and np.array_equal(self.points, other.points)
            and are_equal(self.strength, other.strength)
            and are_equal(self.clipped, other.clipped)
        )

    def __hash__(self) -> int:
        return hash((self.hole, len(self.points), *self.points[0].tolist()))


def _as_homography(H: ArrayLike) -> Floats:
    """An own (3, 3) array."""
    try:
        own = np.array(H, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        own = np.zeros(0)
    if own.shape != (3, 3):
        raise InputError("H is a homography, an array of numbers of shape (3, 3)")
    return own


def _as_points(points: ArrayLike) -> Floats:
    """An own (N, 2) array."""
    try:
        given = np.asarray(points)
        if given.dtype.kind in "cSU":  # which NumPy would make numbers of
            raise TypeError
        pts = np.array(given, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        raise ContourError("a contour is an array of numbers of shape (N, 2)") from None
    if pts.ndim != 2 or pts.shape[1] != 2:
        raise ContourError(f"a contour is an array of shape (N, 2), not {pts.shape}", shape=pts.shape)
    return pts


def _as_marks(name: str, values: ArrayLike | None, kind: type[Any], count: int) -> NDArray[Any] | None:
    """An own (count,) array, or None."""
    if values is None:
        return None
    try:
        marks = np.array(values, dtype=kind)
    except (TypeError, ValueError, OverflowError):
        raise ContourError(f"{name} needs one value for each of the {count} points") from None
    if marks.shape != (count,):
        raise ContourError(f"{name} needs one value for each of the {count} points", shape=marks.shape)
    return marks


def _merge_repeated(
    pts: Floats, fresh: Bools, marks: Floats | None, cut: Bools | None
) -> tuple[Floats, Floats | None, Bools | None]:
    """Points without those that repeat the one before; `fresh`: which do not."""
    fresh[0] = True  # who repeats it at the end goes
    last = len(pts)
    while last > 1 and (pts[last - 1] == pts[0]).all():
        last -= 1
    fresh[last:] = False
    starts = np.flatnonzero(fresh)
    if cut is not None:
        ended = cut[last:].any()
        cut = np.logical_or.reduceat(cut[:last], starts)
        cut[0] |= ended
    return pts[starts], None if marks is None else marks[starts], cut


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
    def of_contour(cls, source: Contour, H: Floats) -> Contour:
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
        strength = None if source.strength is None else source.strength.copy()
        clipped = None if source.clipped is None else source.clipped.copy()
        self._set_points(points, source.hole, strength, clipped)

    @property
    def is_sure(self) -> bool:
        """Whether nothing can go wrong: the curve's bounding box lies in front of the camera, the curve keeps an area."""
        (left, top), (right, bottom) = self._source.bounds
        rows: list[list[float]] = self._H.tolist()
        (a, b, c), (d, e, f), (g, h, i) = rows
        depths = [g * x + h * y + i for x in (left, right) for y in (top, bottom)]
        nearest, farthest = min(depths), max(depths)
        across = max(abs(p * x + q * y + r) for p, q, r in rows[:2] for x in (left, right) for y in (top, bottom))
        # area shrinks by at most the determinant over the cube of the depth
        determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        area = abs(self._source.signed_area * determinant)
        return (
            nearest > 1e-6 * max(farthest, 1.0)
            and across < FARTHEST * nearest
            and len(self._source) * farthest**3 < area < math.inf
        )


class View:
    """What one image showed: contour 0 is the outer one, holes follow.

    Args:
        contours: the outer contour first, then its holes.
        image: the image itself, (H, W) or (H, W, 3), where there is one.

    Raises:
        InputError: something that is no contour.
        ContourError: no contour, a hole in first place, a second outer contour, or holes as large as the outer contour.
    """

    __slots__ = ("_joined", "contours", "image")

    def __init__(self, contours: Sequence[Contour] | Contour, image: NDArray[Any] | None = None) -> None:
        try:
            listed = (contours,) if isinstance(contours, Contour) else tuple(contours)
        except TypeError:
            listed = (None,)  # type: ignore[assignment]
        if not all(isinstance(c, Contour) for c in listed):
            raise InputError("a view is made of a Contour, or of several: the outer one, then its holes")
        if not listed:
            raise ContourError("a view needs at least one contour")
        if listed[0].hole or not all(c.hole for c in listed[1:]):
            raise ContourError("a view has one outer contour, in first place, and then only holes")
        if len(listed) > 1 and not sum(c.signed_area for c in listed) > 0.0:
            raise ContourError("a view's holes must leave some of the area within its outer contour")
        self._set_contours(listed, image)

    def _set_contours(self, listed: tuple[Contour, ...], image: NDArray[Any] | None) -> None:
        self.contours = listed
        self.image = image
        self._joined: tuple[Floats, NDArray[np.int64]] | None = None

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, View):
            return NotImplemented
        return self is other or (self.contours == other.contours and are_equal(self.image, other.image))

    def __hash__(self) -> int:
        return hash(self.contours)

    def __repr__(self) -> str:
        return f"View({len(self.contours)} contours, {len(self.points)} points)"

    def to_dict(self) -> dict[str, Any]:
        """Its contours as plain values, the outer one first; the image is left out."""
        return {"contours": [c.to_dict() for c in self.contours]}

    def _repr_png_(self) -> bytes:
        return png_of(self)

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
        own = _as_homography(H)
        view = View.__new__(View)  # as many contours in the same order: the areas are left to be worked out late
        view._set_contours(tuple(_Transformed.of_contour(c, own) for c in self.contours), None)
        return view

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


OutlineLike = Outline | ArrayLike
"""An outline, or the points (N, 2) px of an outer contour."""

_as_array = arguments.array(unbounded=True)


def outline_like(value: Any) -> str:
    """For `arguments.checked`: an outline or an array of numbers, whose shape and values are the contour's to refuse."""
    fits = isinstance(value, (Contour, View)) or not _as_array(value)
    return "" if fits else "a Contour or a View, or an array of numbers of shape (N, 2)"


def as_outline(given: OutlineLike) -> Outline:
    """A Contour or View as it is; of points (N, 2) px a Contour."""
    return given if isinstance(given, (Contour, View)) else Contour(given)


def as_view(outline: OutlineLike) -> View:
    """The outline as a View; a View comes back as it is."""
    given = as_outline(outline)
    return given if isinstance(given, View) else View(given)
