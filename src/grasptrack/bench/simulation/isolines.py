# SPDX-License-Identifier: Apache-2.0
"""Closed curves along which a field on pixels has one value: marching squares, sub-pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasptrack.typing import Floats


def trace_isolines(field: NDArray[np.float32] | Floats, level: float) -> list[Floats]:
    """All closed curves (N, 2) px at `level`, each with the larger values on one side.

    Args:
        field: (H, W), below `level` all along its border, so that every curve closes.
        level: between two values of the field; where a pixel has it exactly it counts as below.

    Returns:
        Outer curves have positive signed area, x right and y down; curves round lower values have negative.
    """
    f = np.asarray(field, dtype=np.float64)
    high = f > level
    width = f.shape[1]

    def crossing(a: Floats, b: Floats) -> Floats:
        return np.asarray((level - a) / (b - a), dtype=np.float64)

    # Each crossing has a number: that of the pixel to its upper left, twice, plus 1 on the vertical one of its two sides.
    where: dict[int, tuple[float, float]] = {}
    y, x = np.nonzero(high[:, :-1] != high[:, 1:])
    where.update(
        zip((2 * (y * width + x)).tolist(), zip((x + crossing(f[y, x], f[y, x + 1])).tolist(), y.tolist(), strict=True),
            strict=True)
    )  # fmt: skip
    y, x = np.nonzero(high[:-1] != high[1:])
    where.update(
        zip((2 * (y * width + x) + 1).tolist(),
            zip(x.tolist(), (y + crossing(f[y, x], f[y + 1, x])).tolist(), strict=True), strict=True)
    )  # fmt: skip

    follow: dict[int, int] = {}
    case = high[:-1, :-1] + 2 * high[:-1, 1:] + 4 * high[1:, 1:] + 8 * high[1:, :-1]
    y, x = np.nonzero((case != 0) & (case != 15))
    top = 2 * (y * width + x)
    sides = np.column_stack([top, top + 3, top + 2 * width, top + 1]).tolist()  # top, right, bottom, left of the cell
    mean = (0.25 * (f[y, x] + f[y, x + 1] + f[y + 1, x] + f[y + 1, x + 1]) > level).tolist()
    for kind, side, joined in zip(case[y, x].tolist(), sides, mean, strict=True):
        for start, end in _STEPS[kind if kind not in (5, 10) or joined else kind + 16]:
            follow[side[start]] = side[end]
    curves = []
    while follow:
        first, at = follow.popitem()
        ring = [first]
        while at != first:
            ring.append(at)
            at = follow.pop(at)
        curves.append(np.array([where[k] for k in reversed(ring)]))
    return curves


# Which sides of a cell a curve enters and leaves by (0 top, 1 right, 2 bottom, 3 left), with the high corners to its
# right, seen with y down; corners are numbered 1 upper left, 2 upper right, 4 lower right, 8 lower left.
_STEPS: dict[int, tuple[tuple[int, int], ...]] = {
    1: ((3, 0),),
    2: ((0, 1),),
    3: ((3, 1),),
    4: ((1, 2),),
    6: ((0, 2),),
    7: ((3, 2),),
    8: ((2, 3),),
    9: ((2, 0),),
    11: ((2, 1),),
    12: ((1, 3),),
    13: ((1, 0),),
    14: ((0, 3),),
    5: ((3, 2), (1, 0)),
    10: ((0, 3), (2, 1)),
    5 + 16: ((3, 0), (1, 2)),
    10 + 16: ((0, 1), (2, 3)),
}
