# SPDX-License-Identifier: Apache-2.0
"""A grasp: two or more contacts on the outline of an object (Section I)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from grasptrack import kernels
from grasptrack.errors import GraspError
from grasptrack.geometry.contours import Outline
from grasptrack.typing import Floats


class Grasp:
    """Contacts in one view, one for each finger, in an order that is kept.

    Args:
        contacts: (k, 2) px, k >= 2.
        quality: a synthesiser's score, higher is better; NaN where nobody scored it.

    Raises:
        GraspError: not (k, 2) with k >= 2, or not finite.
    """

    __slots__ = ("contacts", "quality")

    def __init__(self, contacts: ArrayLike, quality: float = math.nan) -> None:
        pts = np.array(contacts, dtype=np.float64, order="C")
        if pts.ndim != 2 or pts.shape[1:] != (2,) or len(pts) < 2:
            raise GraspError(f"a grasp is an array of contacts of shape (k, 2) with k >= 2, not {pts.shape}")
        if not np.isfinite(pts).all():
            raise GraspError("a grasp's contacts must be finite", contacts=pts.tolist())
        self.contacts: Floats = pts
        self.quality = quality

    @classmethod
    def of(cls, contacts: Floats, quality: float = math.nan) -> Grasp:
        """A grasp on an array that is known to be float64 (k, 2): no copy, no checks, for the inner loop."""
        grasp = cls.__new__(cls)
        grasp.contacts = contacts
        grasp.quality = quality
        return grasp

    def __len__(self) -> int:
        return len(self.contacts)

    def __repr__(self) -> str:
        listed = " ".join(f"{x:.2f},{y:.2f}" for x, y in self.contacts)
        return f'Grasp("{listed}")'

    @property
    def opening(self) -> float:
        """Distance in px between the first two contacts."""
        return math.dist(self.contacts[0], self.contacts[1])

    def on(self, outline: Outline) -> Floats:
        """(k, 3) where each contact lies on an outline: contour index, position (point index + fraction), distance px."""
        return kernels.project_to_contour(outline.points, outline.offsets, self.contacts)

    def snapped(self, outline: Outline) -> Grasp:
        """The same grasp with each contact moved to the nearest point of the outline."""
        return Grasp.of(kernels.point_at(outline.points, outline.offsets, self.on(outline)), self.quality)


def parse_contacts(text: str) -> Floats:
    """Contacts from ``"x1,y1 x2,y2 ..."`` in px, as `--grasp` takes them.

    Raises:
        GraspError: anything else.
    """
    try:
        pairs = [tuple(float(v) for v in part.split(",")) for part in text.split()]
    except ValueError:
        pairs = []
    if len(pairs) < 2 or any(len(p) != 2 for p in pairs) or not np.isfinite(np.array(pairs)).all():
        raise GraspError(f'contacts are written "x1,y1 x2,y2", not "{text}"', text=text)
    return np.array(pairs, dtype=np.float64)
