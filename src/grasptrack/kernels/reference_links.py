# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of the links between the ends of broken edges."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

BACK = 12  # pixels of an edge from its end that give its direction
LEAST = 8  # pixels; a shorter edge has none
MARGIN = 3  # px from the image's border, where edges end because the image does
NEAR = 8.0  # px; across so little a gap directions say little
WEIGHT = 4.0  # of the squared angles against the gap
REACH_OF_LENGTH = 1.5  # gaps may be so many times as long as the shorter of their two edges has pixels
AROUND = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))


def edge_links(edges: NDArray[np.uint8], reach: float, bend: float, loose: float) -> NDArray[np.int64]:
    """Gaps in thin edges that both of their ends point across (good continuation).

    Two ends are linked when each is the other's best: the shortest gap after a fine on its bends.

    Args:
        edges: (H, W) nonzero on edges one pixel wide.
        reach: px, the longest gap.
        bend: rad, by how much each end may point aside.
        loose: rad, the same across gaps below 8 px.

    Returns:
        (n, 4) x and y of both ends of each link, in the order of the image's rows.
    """
    ends, ways, sizes = _edge_ends(edges)
    if len(ends) < 2:
        return np.zeros((0, 4), np.int64)
    best = [_best_partner(i, ends, ways, sizes, reach, bend, loose) for i in range(len(ends))]
    links = [[*ends[i], *ends[j]] for i, j in enumerate(best) if i < j and best[j] == i]
    return np.array(links, dtype=np.int64).reshape(-1, 4)


def _edge_ends(edges: NDArray[np.uint8]) -> tuple[list[tuple[int, int]], list[tuple[float, float]], list[int]]:
    """Ends of edges, the direction in which each would go on, and the number of pixels of its edge."""
    on = edges != 0
    height, width = on.shape
    padded = np.pad(on, 1).astype(np.int64)
    beside = sum(padded[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width] for dx, dy in AROUND)
    ends: list[tuple[int, int]] = []
    ways: list[tuple[float, float]] = []
    sizes: list[int] = []
    for y, x in zip(*np.nonzero(on & (beside <= 1)), strict=True):
        if not (MARGIN <= x < width - MARGIN and MARGIN <= y < height - MARGIN):
            continue
        path = _trace_from_end(on, int(x), int(y))
        if len(path) < LEAST:
            continue
        dx, dy = path[0][0] - path[-1][0], path[0][1] - path[-1][1]
        norm = math.sqrt(float(dx * dx + dy * dy))
        ends.append((int(x), int(y)))
        ways.append((dx / norm, dy / norm) if norm > 0.0 else (0.0, 0.0))
        sizes.append(_component_size(on, int(x), int(y)))
    return ends, ways, sizes


def _trace_from_end(on: NDArray[np.bool_], x: int, y: int) -> list[tuple[int, int]]:
    """The first pixels of an edge from its end."""
    height, width = on.shape
    path, seen = [(x, y)], {(x, y)}
    while len(path) < BACK:
        x, y = path[-1]
        beside = [(x + dx, y + dy) for dx, dy in AROUND]
        beside = [(u, v) for u, v in beside if 0 <= u < width and 0 <= v < height and on[v, u] and (u, v) not in seen]
        if not beside:
            break
        seen.update(beside)
        path.append(beside[0])
    return path


def _component_size(on: NDArray[np.bool_], x: int, y: int) -> int:
    """Pixels of the edge that holds one."""
    height, width = on.shape
    stack, seen = [(x, y)], {(x, y)}
    while stack:
        x, y = stack.pop()
        beside = {(x + dx, y + dy) for dx, dy in AROUND} - seen
        new = [(u, v) for u, v in beside if 0 <= u < width and 0 <= v < height and on[v, u]]
        seen.update(new)
        stack.extend(new)
    return len(seen)


def _best_partner(
    i: int,
    ends: list[tuple[int, int]],
    ways: list[tuple[float, float]],
    sizes: list[int],
    reach: float,
    bend: float,
    loose: float,
) -> int:
    """The end that end i is best linked with, or -1."""
    best, lowest = -1, math.inf
    x, y = ends[i]
    for j, (u, v) in enumerate(ends):
        gap = math.sqrt(float((u - x) ** 2 + (v - y) ** 2))
        if j == i or gap == 0.0 or gap > reach or gap > REACH_OF_LENGTH * min(sizes[i], sizes[j]):
            continue
        dx, dy = (u - x) / gap, (v - y) / gap
        one = math.acos(min(max(ways[i][0] * dx + ways[i][1] * dy, -1.0), 1.0))
        other = math.acos(min(max(-ways[j][0] * dx - ways[j][1] * dy, -1.0), 1.0))
        if max(one, other) > (loose if gap < NEAR else bend):
            continue
        cost = gap * (1.0 + WEIGHT * (one * one + other * other))
        if cost < lowest:
            best, lowest = j, cost
    return best
