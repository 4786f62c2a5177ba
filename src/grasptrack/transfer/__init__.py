# SPDX-License-Identifier: Apache-2.0
"""Grasp transfer: the same grasp in another view, three ways (Sections III and IV, Fig. 6)."""

from __future__ import annotations

from types import ModuleType
from typing import cast, get_args

import numpy as np
from numpy.typing import NDArray

from grasptrack import arguments
from grasptrack.errors import StrategyError
from grasptrack.geometry.contours import OutlineLike, as_outline, outline_like
from grasptrack.grasp.contacts import Grasp
from grasptrack.plugins import load_plugin, plugin_names
from grasptrack.transfer import grasp_line, homography, rrp
from grasptrack.transfer.base import Transfer, TransferStrategy
from grasptrack.typing import StrategyName

__all__ = [
    "STRATEGIES", "Transfer", "TransferStrategy", "check_strategy", "strategy_named", "strategy_names", "transfer",
]  # fmt: skip

_MODULES: dict[str, ModuleType] = {"rrp": rrp, "grasp-line": grasp_line, "homography": homography}
STRATEGIES: tuple[str, ...] = tuple(_MODULES)
"""The paper's. Other packages add theirs by the entry point `grasptrack.strategies`."""


def strategy_names() -> tuple[str, ...]:
    """The paper's strategies, then those of other packages."""
    return (*STRATEGIES, *(name for name in plugin_names("grasptrack.strategies") if name not in STRATEGIES))


def check_strategy(name: str) -> str:
    """The name of a strategy by which a tracker can carry a grasp: one of `StrategyName`, or one that a package registered.

    Raises:
        StrategyError: it is none.
    """
    known = get_args(StrategyName)
    if name not in known and name not in (choices := tuple(dict.fromkeys((*known, *strategy_names())))):
        raise StrategyError(f'unknown strategy "{name}"; choose from {", ".join(choices)}', name=name)
    return name


def strategy_named(name: str) -> TransferStrategy:
    """The strategy of that name: one of the paper's, or one that a package registered."""
    found = _MODULES.get(name) or load_plugin("grasptrack.strategies", name)
    if found is None:
        raise StrategyError(f'unknown strategy "{name}"; choose from {", ".join(strategy_names())}', name=name)
    return cast(TransferStrategy, found)


@arguments.checked(
    grasp=arguments.instance(Grasp),
    reference=outline_like,
    current=outline_like,
    strategy=arguments.text,
    prior=arguments.optional(arguments.array(3, 3)),
)
def transfer(
    grasp: Grasp,
    reference: OutlineLike,
    current: OutlineLike,
    strategy: StrategyName | str,
    prior: NDArray[np.float64] | None = None,
) -> Transfer:
    """Carry a grasp from the reference view to the current one.

    Args:
        grasp: contacts in the reference view, on its outline.
        reference: outline of the reference view: a Contour or View, or points (N, 2) px of a contour.
        current: outline of the current view, likewise.
        strategy: "rrp" (point i of both outlines must be the same physical point), "grasp-line" (motions within the
            image plane and scale, the object whole in view), "homography" (any motion, four curvature peaks in view), or
            one that a package registered.
        prior: (3, 3) predicted H_current_reference, which settles what one pair leaves open.

    Raises:
        ContourError: points that are no contour.
        StrategyError: unknown strategy, or a grasp or pair of outlines that it cannot carry.
        TransferError: the views do not allow it; the message is the reason.
    """
    chosen = strategy_named(strategy)
    return chosen.apply(chosen.describe(grasp, as_outline(reference)), as_outline(current), prior)
