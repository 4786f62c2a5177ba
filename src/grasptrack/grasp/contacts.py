# SPDX-License-Identifier: Apache-2.0
"""A grasp: two or more contacts on the outline of an object (Section I), and a ranked one as synthesis returns it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from grasptrack import arguments, kernels
from grasptrack.equality import compared_by_value
from grasptrack.errors import GraspError
from grasptrack.geometry.contours import OutlineLike, as_outline, outline_like
from grasptrack.presentation import to_dict
from grasptrack.typing import Floats

MOST_CONTACTS = 8
"""Of a grasp that is judged: no hand has more fingers, and kernels take no more."""


@compared_by_value
class Grasp:
    """Contacts in one view, one for each finger, in an order that is kept.

    Args:
        contacts: (k, 2) px, k >= 2.
        quality: a synthesiser's score, higher is better; NaN where nobody scored it.

    Raises:
        GraspError: not (k, 2) with k >= 2, or not finite.
    """

    __slots__ = ("contacts", "quality")

    @arguments.checked(contacts=arguments.array(unbounded=True), quality=arguments.number)
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

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        return to_dict(self)

    @property
    def opening(self) -> float:
        """Distance in px between the first two contacts."""
        return math.dist(self.contacts[0], self.contacts[1])

    @arguments.checked(outline=outline_like)
    def on(self, outline: OutlineLike) -> Floats:
        """(k, 3) where each contact lies on an outline: contour index, position (point index + fraction), distance px.

        Raises:
            ContourError: points that are no contour.
        """
        outline = as_outline(outline)
        return kernels.project_to_contour(outline.points, outline.offsets, self.contacts)

    @arguments.checked(outline=outline_like)
    def snapped(self, outline: OutlineLike) -> Grasp:
        """The same grasp with each contact moved to the nearest point of the outline.

        Raises:
            ContourError: points that are no contour.
        """
        outline = as_outline(outline)
        return Grasp.of(kernels.point_at(outline.points, outline.offsets, self.on(outline)), self.quality)


def parse_contacts(text: str) -> Floats:
    """Contacts from ``"x1,y1 x2,y2 ..."`` in px, as `--grasp` takes them."""
    try:
        pairs = [tuple(float(v) for v in part.split(",")) for part in text.split()]
    except ValueError:
        pairs = []
    if len(pairs) < 2 or any(len(p) != 2 for p in pairs) or not np.isfinite(np.array(pairs)).all():
        raise GraspError(f'contacts are written "x1,y1 x2,y2", not "{text}"', text=text)
    return np.array(pairs, dtype=np.float64)


class Terms(NamedTuple):
    """The terms of a quality, each from 0 (useless) to 1 (could not be better); the quality is their product.

    Attributes:
        closure: how much of the friction can be done without.
        centre: how near the grasp lies to the centroid.
        flatness: how straight the outline is under the pads and beside them.
        room: how far the contacts may slip along the outline before the grasp no longer closes.
        span: how little the hand opens for the object's size: across a body rather than from tip to tip.
    """

    closure: float
    centre: float
    flatness: float
    room: float
    span: float


@compared_by_value
class RankedGrasp(Grasp):
    """A grasp as synthesis found it.

    Attributes:
        contacts, quality: as in Grasp.
        terms: what the quality is made of.
        spread: the fingers push outward, inside a hole or a notch.
        margin: rad, how much smaller the friction angle could be.
        directions: (k, 2) unit vectors, the direction in which each finger moves to touch.
        regions: (k,) px, the half-length along the outline within which each contact may lie, whatever the others do
            within theirs, and the grasp still closes (independent contact regions).
        fingers: (k, 4, 2) px, corners of each finger's rectangle at the contact.
        swept: (k, 4, 2) px, the same with its way in: finger and clearance.
    """

    __slots__ = ("directions", "fingers", "margin", "regions", "spread", "swept", "terms")

    def __init__(
        self,
        contacts: Floats,
        quality: float,
        terms: Terms,
        *,
        spread: bool,
        margin: float,
        directions: Floats,
        regions: Floats,
        fingers: Floats,
        swept: Floats,
    ) -> None:
        super().__init__(contacts, quality)
        self.terms, self.spread, self.margin = terms, spread, margin
        self.directions, self.regions, self.fingers, self.swept = directions, regions, fingers, swept

    @property
    def margin_deg(self) -> float:
        """The margin in degrees."""
        return math.degrees(self.margin)


@compared_by_value
class GraspList(list[RankedGrasp]):
    """Grasps, best first, and why others were refused.

    Attributes:
        reason: empty where there are grasps, else one sentence: why there is none.
        refused: how many stable candidates each reason removed, the most frequent first.
    """

    def __init__(self, grasps: list[RankedGrasp], reason: str = "", refused: dict[str, int] | None = None) -> None:
        super().__init__(grasps)
        self.reason = reason
        self.refused: dict[str, int] = dict(refused or {})
