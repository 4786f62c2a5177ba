# SPDX-License-Identifier: Apache-2.0
"""Features of a grasp in the image: x/l, y/l, l*/l and the angle, and how they change with the contacts.

For a segment parallel to the image x/l and y/l are the offset from the optical axis over the segment's length in m, l*/l is the
depth over that at the goal, and the angle is the turn: each belongs to one motion of the camera, at any distance. More
contacts have a mean, a mean distance from it and a turn as two have, so that the same four serve.
"""

from __future__ import annotations

import cmath
import math

import numpy as np

from grasptrack.errors import InputError
from grasptrack.servo.camera import complex_numbers
from grasptrack.typing import Floats

MIN_DISTANCE_PX = 1e-6
"""px that contacts must lie apart."""


def wrap_angle(angle: float) -> float:
    """An angle in rad brought to [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def rms_diameter(points: Floats) -> float:
    """l of points (k, d): twice their rms distance from their mean; of two points their distance."""
    d = points - points.sum(axis=0) / len(points)
    return 2.0 * math.sqrt(float(np.vdot(d, d)) / len(d))


class Features:
    """The four features of contacts, against a goal (k, 2) px where they should be; x and y count from a centre (2,) px."""

    def __init__(self, goal: Floats, centre: Floats) -> None:
        self.goal, self.centre = goal, complex(*centre)
        self._middle, self._around, self._length = _decompose_points(goal)
        if self._length < MIN_DISTANCE_PX:
            raise InputError("the contacts of a goal lie apart", goal=goal.tolist())

    def _complex_turn(self, around: list[complex]) -> complex:
        """Its argument is the angle from the goal to contacts about their mean, that which leaves least (Procrustes)."""
        return sum((u * v.conjugate() for u, v in zip(around, self._around, strict=True)), 0j)

    def feature_values(self, contacts: Floats) -> Floats:
        """(x/l, y/l, l*/l, angle) of contacts (k, 2) px; at the goal (x*/l*, y*/l*, 1, 0)."""
        middle, around, length = _decompose_points(contacts)
        if length < MIN_DISTANCE_PX:
            raise InputError("contacts lie apart", contacts=contacts.tolist())
        at = (middle - self.centre) / length
        return np.array([at.real, at.imag, self._length / length, cmath.phase(self._complex_turn(around))])

    def feature_error(self, contacts: Floats) -> Floats:
        """`feature_values` less those of the goal, the angle in [-pi, pi)."""
        out = self.feature_values(contacts)
        at = (self._middle - self.centre) / self._length
        out -= (at.real, at.imag, 1.0, 0.0)
        out[3] = wrap_angle(float(out[3]))
        return out

    def jacobian_at(self, contacts: Floats) -> Floats:
        """Derivatives (4, 2k) of `feature_values` by x1, y1, x2, y2, ..."""
        k = len(contacts)
        middle, around, length = _decompose_points(contacts)
        at, share, turn = (middle - self.centre) / length, 1.0 / (k * length), self._complex_turn(around)
        columns = []
        for u, v in zip(around, self._around, strict=True):
            by_length, by_turn = 4.0 * share * u, v.conjugate() / turn
            for of_length, x, y, angle in (
                (by_length.real, share, 0.0, by_turn.imag),
                (by_length.imag, 0.0, share, by_turn.real),
            ):
                along = of_length / length
                columns.append((x - at.real * along, y - at.imag * along, -self._length * along / length, angle))
        return np.array(columns).T

    def farthest_error(self, contacts: Floats) -> float:
        """How far the farthest contact is from its goal, px."""
        return max(map(math.dist, contacts.tolist(), self.goal.tolist()))


def _decompose_points(points: Floats) -> tuple[complex, list[complex], float]:
    """Complex numbers standing for vectors: the points' mean, the points about it, and l."""
    z = complex_numbers(points)
    middle = sum(z) / len(z)
    around = [p - middle for p in z]
    length = 2.0 * math.sqrt(sum(p.real * p.real + p.imag * p.imag for p in around) / len(z))
    return middle, around, length
