# SPDX-License-Identifier: Apache-2.0
"""What synthesis returns: grasps with everything that their rank rests on, and why others were refused."""

from __future__ import annotations

from typing import NamedTuple

from grasptrack.grasp.contacts import Grasp
from grasptrack.typing import Floats


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
