# SPDX-License-Identifier: Apache-2.0
"""Where a look at the object shows its outline again, whole or in part: a generalised Hough transform, and a first score."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.tracking.pose import SAME_PLACE, Hypothesis, PoseEstimate, carried_in_front, lead_alike, sane_area
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Floats

SIZE = 48.0
"""px, sqrt(area) that is left to the object when the look is halved."""
MOST_EDGES = 2000
"""Pixels of edges that vote, evenly drawn of all."""
TURNS, CELLS = 90, 32
"""Cells of the votes in a turn, and in the object's size, ..."""
MOST_CELLS, COARSER = 320, 2
"""... but no more along an image; and how many are one while the size is looked for, too."""
WEAKEST = 0.35
"""Strength of an edge that votes over the median of the object's own."""
MOST_PLACEMENTS = 12
"""Of the most votes; each place and turn once."""
APART = 4
"""Cells about a placement in which there is no other."""
SCORE_SAMPLES, SIDE_REACH = 64, 3.0
"""Samples of the outline for a first score, and px about each within which its own edge is looked for."""
STRENGTH_KEPT = 0.25
"""Share of its own strength that an edge keeps, blurred or in less light."""
MIN_SEEN = 0.3
"""Share of the outline that has an edge of its sign nearby for a pose to be solved. Grained ground offers chance edges for
about as much, and of what shows less than that nothing is believed."""
MAX_SOLVED = 2
"""Poses that are solved of one search: they cost more than the search, and a better one will be found in the next turns."""
MIN_REACH = 4.0
"""px about the outline of a small object, within which edges count."""


class OutlineSamples:
    """A few samples of an outline, with the strength of the edge that each has in an image, for votes and first scores.

    Args:
        target: the object.
        grey: (H, W) in which it lies.
        G: (3, 3) the pose at which it does, work px -> px.
    """

    def __init__(self, target: Target, grey: Grey, G: Floats) -> None:
        every = max(1, len(target.points) // SCORE_SAMPLES)
        self._target = target
        self.points = np.ascontiguousarray(target.points[::every])
        self._normals = np.ascontiguousarray(target.normals[::every])
        at, normals = self._project(G)
        strength = kernels.search_along_normals(grey, at, normals, SIDE_REACH, 0)[:, 1] if len(at) else np.zeros(0)
        self._strength = np.asarray(strength, dtype=np.float64)

    @property
    def lighter_sides(self) -> tuple[Floats, Floats]:
        """(n, 2) work px of the samples that have an edge, and (n, 2) unit normals there towards the lighter side."""
        told = self._strength != 0.0
        return self.points[told], self._normals[told] * np.sign(self._strength[told])[:, None]

    def edge_share(self, grey: Grey, G: Floats, *, turned: bool = False) -> float:
        """Share of the outline at a pose (3, 3) that has an edge of its sign nearby in an image (H, W), quickly.

        With `turned` the share that has one of the other sign.
        """
        area = sane_area(self._target, G)
        if not len(self.points) or not area:
            return 0.0
        at, normals = self._project(G)
        reach = max(MIN_REACH, self._target.numbers.wide * math.sqrt(area))
        hits = 0
        for sign in (1, -1):
            own = self._strength * sign > 0.0
            if own.any():
                asked = -sign if turned else sign
                edges = kernels.search_along_normals(grey, at[own], normals[own], reach, asked)[:, 1]
                hits += int(np.count_nonzero(np.abs(edges) >= STRENGTH_KEPT * np.abs(self._strength[own])))
        return hits / len(self.points)

    def promising(
        self,
        grey: Grey,
        hypotheses: list[Hypothesis],
        most: int = MAX_SOLVED,
        known: Sequence[Hypothesis | PoseEstimate] = (),
    ) -> list[Hypothesis]:
        """Those that are worth solving: of what shows enough of the outline the best, each place once, but none known."""
        rated = sorted(((-self.edge_share(grey, h.G), i) for i, h in enumerate(hypotheses)))
        kept: list[Hypothesis] = []
        for score, i in rated:
            one = hypotheses[i]
            if (
                -score >= MIN_SEEN
                and len(kept) < most
                and not any(lead_alike(self._target, one, other) for other in [*known, *kept])
            ):
                kept.append(one)
        return kept

    def _project(self, G: Floats) -> tuple[Floats, Floats]:
        """(n, 2) px places and (n, 2) unit normals of the samples at a pose."""
        rows = kernels.carry_normals(np.ascontiguousarray(G), self.points, self._normals)
        return np.ascontiguousarray(rows[:, :2]), np.ascontiguousarray(rows[:, 2:4])


class PlaneEdges(NamedTuple):
    """Edges of an image in a plane.

    Attributes:
        view: (3, 3) from the plane to px.
        places: (m, 2) in the plane.
        brighter: (m, 2) the direction in which it gets lighter there.
    """

    view: Floats
    places: Floats
    brighter: Floats


def find_placements(
    edges: PlaneEdges,
    plane: Floats,
    samples: OutlineSamples,
    known: Floats,
    *,
    scales: Floats | None = None,
    farthest: float = math.inf,
) -> list[Floats]:
    """Poses (3, 3) at which an outline may lie in a plane, in any turn.

    Each edge votes for the turns and places in which it is that of a sample, by its direction (Ballard 1981). What is covered,
    or cut by the border, gets the votes of what is seen of it.

    Args:
        edges: of the image.
        plane: (3, 3) from work px to the plane, as far as that is known.
        samples: of the outline.
        known: (n, 2) px, middles of what is known to lie in the image.
        scales: (k,) by which it may be larger there, looked for by coarser cells; None where the plane tells its size.
        farthest: sizes of the object, from the first of what is known, within which edges vote.
    """
    points, lighter = samples.lighter_sides
    rows = kernels.carry_normals(np.ascontiguousarray(plane), points, lighter)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return []
    laid, middle = rows[:, :2], rows[:, :2].mean(axis=0)
    own_size = math.sqrt(float(np.prod(np.ptp(laid, axis=0))))
    places, brighter = edges.places, edges.brighter
    others = carried_in_front(np.asarray(np.linalg.inv(edges.view), np.float64), known)
    if math.isfinite(farthest):
        near = np.abs(places - others[0]).max(axis=1, initial=0.0) < farthest * own_size
        places, brighter = places[near], brighter[near]
    if not len(places):
        return []
    others = others[np.isfinite(others).all(axis=1)]
    turn = np.arctan2(brighter[:, 1], brighter[:, 0])[:, None] - np.arctan2(rows[:, 3], rows[:, 2])
    c, s, (u, v) = np.cos(turn), np.sin(turn), (laid - middle).T
    aside, ahead = c * u - s * v, s * u + c * v
    k = np.round(turn * TURNS / (2.0 * math.pi)).astype(int) % TURNS
    low, extent = places.min(axis=0), np.ptp(places, axis=0)
    coarse = 1 if scales is None else COARSER
    found: list[Floats] = []
    for scale in [1.0] if scales is None else scales.tolist():
        size = scale * own_size
        cell = coarse * max(size / CELLS, float(extent.max()) / MOST_CELLS)
        width, height = (int(side) + 1 for side in extent / cell)
        i = np.floor((places[:, :1] - low[0] - scale * aside) / cell).astype(int)
        j = np.floor((places[:, 1:] - low[1] - scale * ahead) / cell).astype(int)
        held = (i >= 0) & (j >= 0) & (i < width) & (j < height)
        counts = np.bincount(((k * height + j) * width + i)[held], minlength=TURNS * height * width)
        votes = counts.reshape(TURNS, height, width).astype(np.float32)
        beside = votes.copy()
        beside[1:] += votes[:-1]
        beside[:-1] += votes[1:]
        beside[0] += votes[-1]
        beside[-1] += votes[0]
        votes = beside
        for each in votes:
            cv2.blur(each, (3, 3), each)
        most = votes.max(axis=0)
        for column, row in ((others - low) / cell).astype(int).tolist():
            _clear_about(votes, most, (0, row, column), int(SAME_PLACE * size / cell), TURNS)
        for _ in range(MOST_PLACEMENTS):
            j0, i0 = (int(each) for each in np.unravel_index(most.argmax(), most.shape))
            k0 = int(votes[:, j0, i0].argmax())
            if not votes[k0, j0, i0] > 0.0:
                break
            angle, M = 2.0 * math.pi * k0 / TURNS, np.eye(3)
            M[:2, :2] = scale * np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
            M[:2, 2] = low + (np.array([i0, j0]) + 0.5) * cell - M[:2, :2] @ middle
            G = edges.view @ M @ plane
            found.append(np.asarray(G / G[2, 2], dtype=np.float64))
            _clear_about(votes, most, (k0, j0, i0), APART // coarse, APART)
    return found


def _clear_about(
    votes: NDArray[np.float32], most: NDArray[np.float32], cell: tuple[int, int, int], cells: int, turns: int
) -> None:
    """No votes within so many cells and turns of a cell; `most` has the most in any turn."""
    k, j, i = cell
    rows, columns = (slice(max(n - cells, 0), max(n + cells + 1, 0)) for n in (j, i))
    votes[np.unique(np.arange(k - turns, k + turns + 1) % len(votes)), rows, columns] = 0.0
    most[rows, columns] = votes[:, rows, columns].max(axis=0)


def edges_in_plane(levels: list[Grey], view: Floats, own: Floats) -> PlaneEdges:
    """Edges of an image in a plane, about as strong as those of an outline.

    Args:
        levels: the image's pyramid.
        view: (3, 3) from the plane to px.
        own: (n, 2) px of that outline.
    """
    view = np.asarray(view / view[2, 2], dtype=np.float64)
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
    return PlaneEdges(view, places[good], np.asarray(brighter[good]))
