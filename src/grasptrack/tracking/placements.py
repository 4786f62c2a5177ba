# SPDX-License-Identifier: Apache-2.0
"""Where a look at the object shows its outline again, whole or cut by the border: a generalised Hough transform."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.tracking.pose import SAME_PLACE, Look, carried_in_front
from grasptrack.tracking.target import Grey
from grasptrack.typing import Floats

SIZE = 48.0
"""px, sqrt(area) that is left to the object when the look is halved."""
MOST_EDGES = 2000
"""Pixels of edges that vote, evenly drawn of all."""
TURNS, CELLS = 90, 32
"""Cells of the votes in a turn, and in the object's size."""
FARTHEST = 5.0
"""Sizes of the object within which others are looked for."""
WEAKEST = 0.35
"""Strength of an edge that votes over the median of the object's own."""
MOST_PLACEMENTS = 12
"""Of the most votes; each place and turn once."""
APART = 4
"""Cells about a placement in which there is no other."""


def find_placements(look: Look, plane: Floats, points: Floats, lighter: Floats) -> list[Floats]:
    """Poses (3, 3) at which a look may show another object of the same outline that lies in the same plane, in any turn.

    Each edge votes for the turns and places in which it is that of a sample, by its direction (Ballard 1981). What is cut by
    the border gets the votes of what is seen of it.

    Args:
        look: at the object.
        plane: (3, 3) from work px to the object's plane, as far as that is known.
        points: (n, 2) work px, samples of its outline.
        lighter: (n, 2) unit work px, the normals there towards the lighter side.
    """
    rows = kernels.carry_normals(plane, points, lighter)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return []
    samples, middle = rows[:, :2], rows[:, :2].mean(axis=0)
    size = math.sqrt(float(np.prod(np.ptp(samples, axis=0))))
    view = look.G @ np.linalg.inv(plane)
    places, brighter = _edges_in_plane(look.levels, np.asarray(view / view[2, 2]), samples)
    near = np.abs(places - middle).max(axis=1, initial=0.0) < FARTHEST * size
    places, brighter = places[near], brighter[near]
    if not len(places):
        return []
    turn = np.arctan2(brighter[:, 1], brighter[:, 0])[:, None] - np.arctan2(rows[:, 3], rows[:, 2])
    c, s = np.cos(turn), np.sin(turn)
    u, v = (samples - middle).T
    x, y = places[:, :1] - (c * u - s * v), places[:, 1:] - (s * u + c * v)
    low, cell = places.min(axis=0), size / CELLS
    width, height = (int(side) + 1 for side in np.ptp(places, axis=0) / cell)
    i, j = np.floor((x - low[0]) / cell).astype(int), np.floor((y - low[1]) / cell).astype(int)
    k = np.round(turn * TURNS / (2.0 * math.pi)).astype(int) % TURNS
    held = (i >= 0) & (j >= 0) & (i < width) & (j < height)
    counts = np.bincount(((k * height + j) * width + i)[held], minlength=TURNS * height * width)
    votes = counts.reshape(TURNS, height, width).astype(np.float32)
    votes = votes + np.roll(votes, 1, axis=0) + np.roll(votes, -1, axis=0)
    for each in votes:
        cv2.blur(each, (3, 3), each)
    most = votes.max(axis=0)
    own = ((middle - low) / cell).astype(int)
    _clear_about(votes, most, (0, int(own[1]), int(own[0])), int(SAME_PLACE * CELLS), TURNS)
    found: list[Floats] = []
    for _ in range(MOST_PLACEMENTS):
        j0, i0 = (int(each) for each in np.unravel_index(most.argmax(), most.shape))
        k0 = int(votes[:, j0, i0].argmax())
        if not votes[k0, j0, i0] > 0.0:
            break
        angle, M = 2.0 * math.pi * k0 / TURNS, np.eye(3)
        M[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        M[:2, 2] = low + (np.array([i0, j0]) + 0.5) * cell - M[:2, :2] @ middle
        G = view @ M @ plane
        found.append(np.asarray(G / G[2, 2], dtype=np.float64))
        _clear_about(votes, most, (k0, j0, i0), APART, APART)
    return found


def _clear_about(
    votes: NDArray[np.float32], most: NDArray[np.float32], cell: tuple[int, int, int], cells: int, turns: int
) -> None:
    """No votes within so many cells and turns of a cell; `most` has the most in any turn."""
    k, j, i = cell
    rows, columns = (slice(max(n - cells, 0), max(n + cells + 1, 0)) for n in (j, i))
    votes[np.unique(np.arange(k - turns, k + turns + 1) % len(votes)), rows, columns] = 0.0
    most[rows, columns] = votes[:, rows, columns].max(axis=0)


def _edges_in_plane(levels: list[Grey], view: Floats, samples: Floats) -> tuple[Floats, Floats]:
    """(m, 2) places in the plane of edges about as strong as the object's own, and (m, 2) in which it gets lighter there.

    Args:
        levels: the image's pyramid.
        view: (3, 3) from the plane to the image.
        samples: (n, 2) of the object's outline in the plane.
    """
    own = carried_in_front(view, samples)
    size = math.sqrt(float(np.prod(np.ptp(own, axis=0))))
    level = int(math.log2(max(1.0, size / SIZE))) if math.isfinite(size) else 0
    level = min(level, len(levels) - 1)
    grey, scale = levels[level], 2.0**level
    dx, dy = cv2.Sobel(grey, cv2.CV_16S, 1, 0), cv2.Sobel(grey, cv2.CV_16S, 0, 1)
    own = np.round(own[np.isfinite(own).all(axis=1)] / scale)
    own = own[((own >= 0) & (own < grey.shape[::-1])).all(axis=1)].astype(int)
    x, y = own.T
    weakest = WEAKEST * float(np.median(np.hypot(dx[y, x], dy[y, x]))) if len(own) else math.inf
    y, x = np.nonzero(cv2.Canny(dx, dy, weakest, weakest, L2gradient=True))
    every = max(1, math.ceil(len(x) / MOST_EDGES))
    x, y = x[::every], y[::every]
    seen = np.column_stack([x, y]).astype(np.float64) * scale
    places = carried_in_front(np.asarray(np.linalg.inv(view), dtype=np.float64), seen)
    depth = (places @ view[2, :2] + view[2, 2])[:, None, None]
    J = (view[None, :2, :2] - seen[:, :, None] * view[2, :2]) / depth
    brighter = np.einsum("mij,mi->mj", J, np.column_stack([dx[y, x], dy[y, x]]))
    good = np.isfinite(brighter).all(axis=1)
    return places[good], np.asarray(brighter[good])
