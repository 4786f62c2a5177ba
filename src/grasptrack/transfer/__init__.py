# SPDX-License-Identifier: Apache-2.0
"""Grasp transfer: the same grasp in another view, three ways (Sections III and IV, Fig. 6)."""

from __future__ import annotations

from types import ModuleType
from typing import cast

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import StrategyError
from grasptrack.geometry.contours import Outline
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer import grasp_line, homography, rrp
from grasptrack.transfer.base import Transfer, TransferStrategy

__all__ = ["STRATEGIES", "Transfer", "TransferStrategy", "strategy_named", "transfer"]

_MODULES: dict[str, ModuleType] = {"rrp": rrp, "grasp-line": grasp_line, "homography": homography}
STRATEGIES: tuple[str, ...] = tuple(_MODULES)


def strategy_named(name: str) -> TransferStrategy:
    """The strategy of that name.

    Raises:
        StrategyError: unknown; the message lists the choices.
    """
    try:
        return cast(TransferStrategy, _MODULES[name])
    except KeyError:
        raise StrategyError(f'unknown strategy "{name}"; choose from {", ".join(STRATEGIES)}', name=name) from None


def transfer(
    grasp: Grasp, reference: Outline, current: Outline, strategy: str, prior: NDArray[np.float64] | None = None
) -> Transfer:
    """Carry a grasp from the reference view to the current one.

    Args:
        grasp: contacts in the reference view, on its outline.
        reference: outline of the reference view.
        current: outline of the current view.
        strategy: "rrp" (point i of both outlines must be the same physical point), "grasp-line" (motions within the
            image plane and scale, the object whole in view) or "homography" (any motion, four curvature peaks in view).
        prior: (3, 3) predicted H_current_reference, which settles what one pair leaves open.

    Raises:
        StrategyError: unknown strategy, or a grasp or pair of outlines that it cannot carry.
        TransferError: the views do not allow it; the message is the reason.
    """
    chosen = _MODULES.get(strategy) or strategy_named(strategy)
    result: Transfer = chosen.apply(chosen.describe(grasp, reference), current, prior)
    return result
