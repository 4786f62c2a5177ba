# SPDX-License-Identifier: Apache-2.0
"""What kernels refuse: sizes, indices and coordinates that come from data, each checked in one line."""

import numpy as np

from grasptrack.typing import Floats, Ints

FARTHEST = 1e12
"""Largest coordinate of a contour, px: the powers of its third moments stay finite."""


def check_contour(points: Floats) -> None:
    """Points (N, 2), N > 0, finite and not beyond `FARTHEST`, or ValueError."""
    if points.ndim != 2 or points.shape[1] != 2 or not len(points):
        raise ValueError("a contour needs points")
    if not (np.abs(points) <= FARTHEST).all():
        raise ValueError("a contour's coordinates must be finite, and at most 1e12")


def check_outline(points: Floats, offsets: Ints) -> None:
    """Points as of `check_contour`, and offsets that rise from 0 to their number, or ValueError."""
    if len(offsets) < 2 or offsets[0] != 0 or offsets[-1] != len(points) or (offsets[1:] <= offsets[:-1]).any():
        raise ValueError("offsets must rise from 0 to the number of points")
    check_contour(points)


def check_arc(count: int, arc: Floats) -> None:
    """Arc length (count + 1,) that rises from 0, or ValueError."""
    if count < 1 or arc.ndim != 1 or len(arc) != count + 1:
        raise ValueError("arc needs one entry more than the contour has points")
    if arc[0] != 0 or not 0 < arc[-1] <= FARTHEST * count or not (arc[1:] >= arc[:-1]).all():
        raise ValueError("arc must rise from 0 to a length above 0")


def check_within(value: float, low: float, high: float, name: str) -> None:
    """A number from `low` to `high`, or ValueError."""
    if not low <= value <= high:
        raise ValueError(f"{name} must be from {low:g} to {high:g}, not {value:g}")


def check_size(size: int, most: int, what: str) -> None:
    """A length of at most so many, or ValueError."""
    if size > most:
        raise ValueError(f"at most {most} {what}, not {size}")


def check_indices(indices: Ints | list[int], count: int) -> None:
    """Indices of `count` points, or ValueError."""
    if len(indices) and not 0 <= np.min(indices) <= np.max(indices) < count:
        raise ValueError("index out of range")


def check_power_of_2(count: int) -> None:
    """A power of 2 from 4 to 65536, or ValueError."""
    if not 4 <= count <= 65536 or count & (count - 1):
        raise ValueError(f"count must be a power of 2, from 4 to 65536, not {count}")


def check_finite(values: Floats, name: str) -> None:
    """Finite numbers, or ValueError."""
    if not np.isfinite(values).all():
        raise ValueError(f"{name} must be finite")
