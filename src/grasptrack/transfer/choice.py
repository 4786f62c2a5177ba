# SPDX-License-Identifier: Apache-2.0
"""Which of the paper's strategies suits: by time, object, view and motion (Sections III and V)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

from grasptrack import arguments
from grasptrack.errors import GraspTrackError, InputError, StrategyError
from grasptrack.geometry.contours import OutlineLike, View, as_outline, outline_like
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer import grasp_line, homography
from grasptrack.transfer.alignment import SAME_TURN, find_alignments

COST_US = {"rrp": 15.0, "grasp-line": 35.0, "homography": 290.0}
"""The paper's times of a transfer (Section V), on a 2.5 GHz Celeron. Only their order matters where no budget is given."""


@arguments.checked(arguments.truth, budget_us=arguments.number, dof=arguments.whole)
@dataclass(frozen=True, slots=True)
class TransferContext:
    """What the choice of a strategy hangs on.

    Attributes:
        budget_us: time for a transfer, us on the paper's machine, see `COST_US`.
        antipodal: two contacts whose line has coordinates beside the axes of inertia (Section III-B).
        symmetric: the outline maps to itself by a turn, so that one pair of views is ambiguous.
        slender: no four peaks of curvature of which no three are in a row, as of a bar or a disc (Section IV-C).
        tracked: a tracker of 4 DoF moves the outline as a whole, so that point i stays the same one (Section III-A).
        whole: the whole outline is in view.
        predicted: the last frame's homography is known, so that a prediction tells turns apart.
        dof: of the motion so far: 4 where a similarity lays the first outline on the current one, else 6.

    Raises:
        InputError: a motion of neither 4 nor 6 DoF, or a budget that is not above 0.
    """

    budget_us: float = math.inf
    antipodal: bool = True
    symmetric: bool = False
    slender: bool = False
    tracked: bool = False
    whole: bool = True
    predicted: bool = False
    dof: Literal[4, 6] = 4

    def __post_init__(self) -> None:
        if self.dof not in (4, 6):
            raise InputError(f"dof must be 4 or 6, not {self.dof}", dof=self.dof)
        if not self.budget_us > 0.0:
            raise InputError(f"budget_us must be above 0, not {self.budget_us:g}", budget_us=self.budget_us)

    @classmethod
    @arguments.checked(
        grasp=arguments.instance(Grasp), view=outline_like, tracked=arguments.truth, predicted=arguments.truth
    )
    def of(cls, grasp: Grasp, view: OutlineLike, *, tracked: bool = False, predicted: bool = False) -> TransferContext:
        """What a grasp and its outline say of it; the motion is still of 4 DoF.

        Args:
            grasp: contacts (k, 2) px on the outline.
            view: a Contour or View, or points (N, 2) px.
            tracked: see the attributes.
            predicted: likewise.

        Raises:
            ContourError: points that are no contour.
        """
        outline = as_outline(view)
        outer = outline.contours[0]
        whole = not outline.is_clipped if isinstance(outline, View) else outline.clipped is None
        turned = whole and any(abs(way.angle) > SAME_TURN for way in find_alignments(outer, outer))
        antipodal = slender = False
        try:
            grasp_line.describe(grasp, outline)
            antipodal = True
        except GraspTrackError:
            pass  # whichever reason: the line has no coordinates
        try:
            homography.describe(grasp, outline)
        except GraspTrackError:
            slender = True
        return cls(
            antipodal=antipodal, symmetric=turned, slender=slender, tracked=tracked, whole=whole, predicted=predicted
        )


class StrategyChoice(NamedTuple):
    """A strategy's name, and why no cheaper one was taken, "" if there is none."""

    strategy: str
    reason: str


@arguments.checked(context=arguments.instance(TransferContext))
def choose_strategy(context: TransferContext) -> StrategyChoice:
    """The cheapest of the paper's strategies that suffices (Sections III and V).

    RRP coordinates need a tracked outline and a motion of 4 DoF; the grasp line an antipodal grasp, the whole outline and 4
    DoF; the homography four peaks of curvature. Without a prediction neither of the last two carries a grasp on a symmetric
    outline, and the homography none on part of one.

    Raises:
        StrategyError: none suffices; the message says why not, one by one.
    """
    turns = "the outline maps to itself by a turn" if context.symmetric and not context.predicted else ""
    tilts = "the motion has more than 4 DoF" if context.dof > 4 else ""
    reasons = {
        "rrp": tilts or ("" if context.tracked else "no tracker moves the outline"),
        "grasp-line": tilts
        or ("" if context.antipodal else "the grasp has no grasp-line coordinates")
        or ("" if context.whole else "part of the outline is out of view")
        or turns,
        "homography": ("four peaks of curvature are missing" if context.slender else "")
        or ("" if context.whole or context.predicted else "part of the outline is out of view")
        or turns,
    }
    refused: list[str] = []
    for name, reason in reasons.items():
        late = f"{COST_US[name]:g} us are more than {context.budget_us:g}" if COST_US[name] > context.budget_us else ""
        if not (reason or late):
            return StrategyChoice(name, "; ".join(refused))
        refused.append(f"{name}: {reason or late}")
    raise StrategyError(f"no strategy suffices: {'; '.join(refused)}")
