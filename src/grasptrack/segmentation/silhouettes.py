# SPDX-License-Identifier: Apache-2.0
"""Silhouettes in a binary image: outer boundaries and holes as pixel chains."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.images import Grey
from grasptrack.typing import Box

Chain = NDArray[np.int32]


class Silhouette(NamedTuple):
    """One connected region.

    Attributes:
        outer: (N, 2) pixel centres along its boundary, image coordinates.
        holes: the same for its holes, largest first.
        area: px^2 within the outer boundary.
        box: x, y, width, height of the outer boundary.
    """

    outer: Chain
    holes: tuple[Chain, ...]
    area: float
    box: tuple[int, int, int, int]

    def contains(self, x: float, y: float) -> bool:
        """Whether a pixel lies within the outer boundary."""
        return bool(cv2.pointPolygonTest(self.outer, (float(x), float(y)), False) >= 0)

    def depth(self, x: float, y: float) -> float:
        """px by which a pixel lies within the outer boundary, negative outside."""
        return float(cv2.pointPolygonTest(self.outer, (float(x), float(y)), True))

    def ring(self, most: int) -> NDArray[np.float64]:
        """(N, 2) px, about `most` points of its outer boundary, with positive signed area."""
        chain = self.outer[:: max(1, len(self.outer) // most)]
        forward = cv2.contourArea(self.outer, oriented=True) > 0.0
        return np.ascontiguousarray(chain if forward else chain[::-1], dtype=np.float64)


def box_iou(one: Box | tuple[int, int, int, int], other: Box) -> float:
    """Intersection over union of two boxes."""
    wide = min(one[0] + one[2], other[0] + other[2]) - max(one[0], other[0])
    tall = min(one[1] + one[3], other[1] + other[3]) - max(one[1], other[1])
    both = max(wide, 0.0) * max(tall, 0.0)
    return both / (one[2] * one[3] + other[2] * other[3] - both)


def trace_silhouettes(
    binary: Grey, least: float, origin: tuple[int, int] = (0, 0), *, holes: bool = True, least_hole: float = 0.002
) -> list[Silhouette]:
    """All silhouettes of at least a given area, largest first.

    Args:
        binary: (H, W), nonzero where there is material.
        least: px^2.
        origin: where the binary image's first pixel lies in the image.
        holes: also find holes, which takes time.
        least_hole: smallest hole as a fraction of its silhouette.
    """
    mode = cv2.RETR_CCOMP if holes else cv2.RETR_EXTERNAL
    chains, tree = cv2.findContours(binary, mode, cv2.CHAIN_APPROX_NONE, offset=origin)
    found: list[Silhouette] = []
    for index, chain in enumerate(chains):
        if len(chain) < 8 or (holes and tree[0][index][3] >= 0):
            continue
        area = float(cv2.contourArea(chain))
        if area < least:
            continue
        inner: list[tuple[float, Chain]] = []
        child = int(tree[0][index][2]) if holes else -1
        while child >= 0:
            if len(chains[child]) >= 8:
                size = float(cv2.contourArea(chains[child]))
                if size >= max(least_hole * area, 12.0):
                    inner.append((size, _chain_points(chains[child])))
            child = int(tree[0][child][0])
        inner.sort(key=lambda pair: -pair[0])
        x, y, w, h = cv2.boundingRect(chain)
        found.append(Silhouette(_chain_points(chain), tuple(c for _, c in inner), area, (x, y, w, h)))
    found.sort(key=lambda s: -s.area)
    return found


def _chain_points(chain: NDArray[Any]) -> Chain:
    """(N, 2) of OpenCV's (N, 1, 2)."""
    return np.asarray(chain, dtype=np.int32).reshape(-1, 2)
