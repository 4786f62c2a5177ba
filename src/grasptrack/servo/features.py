# SPDX-License-Identifier: Apache-2.0
"""Features of a grasp in the image: x/l, y/l, l*/l and the angle, and how they change with the contacts.

For a segment parallel to the image x/l and y/l are the offset from the optical axis over the segment's length in m, l*/l is the
depth over that at the goal, and the angle is the turn: each belongs to one motion of the camera, at any distance. More
contacts have a mean, a mean distance from it and a turn as two have, so that the same four serve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError

Floats = NDArray[np.float64]

SMALL = 1e-6
"""px that contacts must lie apart."""


def wrapped(angle: float) -> float:
    """An angle in rad brought to [-pi, pi)."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def spread(points: Floats) -> float:
    """l of points (k, d): twice their rms distance from their mean; of two points their distance."""
    d = points - points.mean(axis=0)
    return 2.0 * float(np.sqrt((d * d).sum() / len(d)))


@dataclass(frozen=True)
class Features:
    """The four features, measured against a goal.

    Attributes:
        goal: (k, 2) px, the contacts as they should be seen.
        centre: (2,) px from which x and y count.
    """

    goal: Floats
    centre: Floats

    def __post_init__(self) -> None:
        if spread(self.goal) < SMALL:
            raise InputError("the contacts of a goal lie apart", goal=self.goal.tolist())

    def turn(self, contacts: Floats) -> complex:
        """Its argument is the angle from the goal to the contacts, that which leaves least (Procrustes)."""
        z, g = _complex(contacts), _complex(self.goal)
        return complex(((z - z.mean()) * (g - g.mean()).conj()).sum())

    def values(self, contacts: Floats) -> Floats:
        """(x/l, y/l, l*/l, angle) of contacts (k, 2) px; at the goal (x*/l*, y*/l*, 1, 0)."""
        length = spread(contacts)
        if length < SMALL:
            raise InputError("contacts lie apart", contacts=contacts.tolist())
        x, y = (contacts.mean(axis=0) - self.centre) / length
        return np.array([x, y, spread(self.goal) / length, np.angle(self.turn(contacts))])

    def error(self, contacts: Floats) -> Floats:
        """`values` less those of the goal, the angle in [-pi, pi)."""
        out = self.values(contacts) - self.values(self.goal)
        out[3] = wrapped(out[3])
        return out

    def slopes(self, contacts: Floats) -> Floats:
        """Derivatives (4, 2k) of `values` by x1, y1, x2, y2, ..."""
        k, length = len(contacts), spread(contacts)
        d = contacts - contacts.mean(axis=0)
        of_length = (4.0 * d / (k * length)).ravel()
        mean = (contacts.mean(axis=0) - self.centre) / length
        out = np.empty((4, 2 * k))
        for row in (0, 1):
            out[row] = -mean[row] / length * of_length
            out[row, row::2] += 1.0 / (k * length)
        out[2] = -spread(self.goal) / length**2 * of_length
        g = _complex(self.goal)
        by = (g - g.mean()).conj() / self.turn(contacts)
        out[3, 0::2], out[3, 1::2] = by.imag, by.real
        return out

    def off(self, contacts: Floats) -> float:
        """How far the farthest contact is from its goal, px."""
        return float(np.sqrt(((contacts - self.goal) ** 2).sum(axis=1).max()))


def _complex(points: Floats) -> NDArray[np.complex128]:
    return np.asarray(points[:, 0] + 1j * points[:, 1])
