# SPDX-License-Identifier: Apache-2.0
"""Types of arrays, once; a docstring gives the shape. And the words that stand for something, for type checkers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Pixels = NDArray[np.uint8]
Point = tuple[float, float]
"""x and y, px."""
Box = tuple[float, float, float, float]
"""Left, top, width and height, px."""

Status = Literal["searching", "tracked", "unstable", "lost"]
"""What a tracker says of one frame."""
StrategyName = Literal["auto", "rrp", "grasp-line", "homography", "paper"]
"""The strategies of this package. Where one is asked for, any text passes, for other packages register theirs."""

Progress = Callable[[str, int, int], None]
"""Called with the name of a step, what is done of it, and all of it."""
