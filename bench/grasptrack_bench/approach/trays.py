# SPDX-License-Identifier: Apache-2.0
"""Trays that are emptied: what is tried, what was taught of the part, and what became of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from grasptrack.errors import InputError
from grasptrack.geometry.contours import Contour
from grasptrack.io.parts import Part
from grasptrack.matching import find_symmetries
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.typing import Floats
from grasptrack_bench.approach.case import Row
from grasptrack_bench.approach.choosing import FRICTION, closing_grasps, first_look, hand_for
from grasptrack_bench.approach.truth import on_part
from grasptrack_bench.physics.world import World
from grasptrack_bench.simulation.coverage import subdivide_polygon
from grasptrack_bench.simulation.outlines import Shape

GRASPS = 6
"""Of a part that are tried where fingers have no room for the first one."""
FULL_TURN = 720
"""Turns of a round part in which it is judged."""


@dataclass(frozen=True)
class TrayCase:
    """A tray that is to be emptied.

    Attributes:
        shape: outline of its parts.
        seed: of everything that chance decides.
        count: parts in it.
        snatched: somebody pulls the first part away while the fingers close on it.
        risk: probability below which an answer may be wrong.
    """

    shape: Shape
    seed: int
    count: int = 12
    snatched: bool = False
    risk: float = DEFAULT_RISK

    @property
    def name(self) -> str:
        """Of the tray, and of its picture."""
        return f"{self.shape.name}-{self.seed}"


@dataclass
class PickRow(Row):
    """One try to take a part; a line of picks.csv. What is told of the truth is of the part that was chosen.

    Attributes:
        number: of the try, from 1.
        part: number of the part in the tray.
        grasp: which of the taught grasps, 0 being the first.
        began_s: when the hand looked.
        others: further parts that came up with it.
        empty: how often the fingers closed on nothing.
    """

    number: int = 0
    part: int = -1
    grasp: int = 0
    began_s: float = 0.0
    others: int = 0
    empty: int = 0

    @property
    def closed_wrong(self) -> int:
        """How often the fingers closed elsewhere than where the chosen part was to be grasped, or on another part as well."""
        return max(self.wrong, int(self.others > 0))


@dataclass
class Emptied:
    """What became of a tray.

    Attributes:
        name: of its case.
        count: parts in it.
        picks: tries, in their order.
        left: why each part that is left was not taken, by its number.
        seconds: that it took, in the world's time.
        picture: PNG of the tray, with the order of the picks and the reasons.
        refused: why the tray was not begun: its part cannot be taught, grasped or laid. It then has no parts.
    """

    name: str
    count: int
    picks: list[PickRow] = field(default_factory=list)
    left: dict[int, str] = field(default_factory=dict)
    seconds: float = 0.0
    picture: bytes = b""
    refused: str = ""

    @property
    def lifted(self) -> int:
        """Parts that were taken away."""
        return self.count - len(self.left)


@dataclass(frozen=True)
class Taught:
    """A part as one image taught it, once for each of its grasps, which is then the first; and the same grasps in truth.

    Attributes:
        parts: the part, its grasps in another order each.
        grasps: (k, 2) m of each, on the part's outline.
        turns: rad of the turns by which the outline fits itself, 0 among them.
    """

    parts: list[Part]
    grasps: list[Floats]
    turns: list[float]


def teach(case: TrayCase, alone: World) -> Taught:
    """What the image of a part that lies alone teaches.

    Raises:
        InputError: no part is seen, or it cannot be grasped.
    """
    hand, tips, image = hand_for(alone.setting.part.size), alone.fingertips()[0], alone.image()
    _, result = first_look(image, 0.0, alone.ignore(), hand, tips, risk=case.risk)
    if result.view is None:
        raise InputError(f"{case.shape.name}: no part was seen where it is taught: {result.reason}")
    grasps = closing_grasps(result.view, len(tips), hand)
    if grasps.reason:
        raise InputError(f"{case.shape.name}: {grasps.reason}")
    best = grasps.grasps[:GRASPS]
    part = Part.of(image, result.view, best, name=case.shape.name, friction=FRICTION, hand=hand)
    part = replace(part, face_up=True, same_tilt=True)  # the hand points straight down where it looks
    own = find_symmetries(Contour(subdivide_polygon(case.shape.outer * 100.0, 3.0)))
    turns = np.linspace(0.0, 2.0 * math.pi, FULL_TURN, endpoint=False).tolist() if own.continuous else []
    return Taught(
        [_begun_with(part, k) for k in range(len(best))],
        [on_part(alone, g.contacts) for g in best],
        [0.0, *turns, *(turn.turn for turn in own.turns)],
    )


def _begun_with(part: Part, k: int) -> Part:
    grasps, ways = part.grasps, part.directions
    return replace(part, grasps=(*grasps[k:], *grasps[:k]), directions=(*ways[k:], *ways[:k]))
