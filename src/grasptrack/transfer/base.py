# SPDX-License-Identifier: Apache-2.0
"""What all grasp transfers share: what they return and the protocol they follow (Section IV, Fig. 6)."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from grasptrack.equality import compared_by_value
from grasptrack.geometry.contours import Outline
from grasptrack.grasp.contacts import Grasp
from grasptrack.presentation import to_dict
from grasptrack.typing import Floats


@compared_by_value
class Transfer(NamedTuple):
    """A grasp carried to another view.

    Attributes:
        grasp: the transferred contacts, in the grasp's order.
        homography: (3, 3) H_current_reference as the strategy sees it (a similarity for the grasp line), or None.
        covariance: (k, 2, 2) px^2 of the contacts, or None where the strategy has no estimate.
        residual: px. What the strategy had to bend to put the contacts on the outline: the largest distance between a
            contact as its description places it and as it was returned. RRP bends nothing: NaN between plain outlines,
            and the rms distance of its edges where a snake carried it.
    """

    grasp: Grasp
    homography: Floats | None
    covariance: Floats | None
    residual: float

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        return to_dict(self)

    def __repr__(self) -> str:
        return f"Transfer({self.grasp!r}, residual {self.residual:.2f} px)"


class TransferStrategy(Protocol):
    """Describe a grasp in one view, apply the description in another."""

    def describe(self, grasp: Grasp, view: Outline) -> Any:
        """What stays the same of the grasp when the view changes (Section III)."""

    def apply(self, description: Any, view: Outline, prior: Floats | None = None) -> Transfer:
        """The grasp with that description in another view (Section IV).

        Args:
            description: from `describe`.
            view: the current outline.
            prior: (3, 3) H_current_reference as predicted, where there is a prediction; it settles what one pair of
                views leaves open.

        Raises:
            TransferError: the view does not allow it; the message is the reason.
        """
