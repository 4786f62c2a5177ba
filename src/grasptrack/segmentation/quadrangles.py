# SPDX-License-Identifier: Apache-2.0
"""Quadrangles of straight edges: sheets, boards, boxes and books, also where fingers or neighbours break their outline.

Line segments on one line are joined; four lines make a quadrangle where their segments cover its sides for the most part.
Proposed where a person points at an object: anywhere else floors and furniture have too many.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.segmentation.closed_edges import Planes
from grasptrack.typing import Bools, Floats, Point

MIN_SEGMENT = 18.0
"""px; a shorter segment has no direction of its own."""
MAX_SEGMENTS, MAX_LINES, MAX_QUADRANGLES = 300, 40, 12
"""Segments that are joined, lines that are combined, and quadrangles that are proposed."""
MAX_TURN, MAX_ASIDE = math.radians(2.5), 2.0
"""Segments are of one line if they are turned and lie aside by less (rad, px), ..."""
TURN_SPREAD = math.radians(0.7)
"""... with so much more, rad, for the way from the one to the other."""
MIN_ANGLE = math.radians(25.0)
"""Between neighbouring sides."""
MIN_COVERED, MIN_COVERED_ALL = 0.45, 0.7
"""Share of each side that segments cover, and of all four together."""
CORNER_MARGIN = 3.0
"""px by which a corner may lie outside the image."""
MIN_SIDE, MIN_QUADRANGLE = 15.0, 400.0
"""px, and px^2."""
AREA_POWER = 0.25
"""Of the area, with which larger quadrangles come first."""
MIN_CORNER_GAP = 4.0
"""px; of quadrangles whose corners are nearer the better one is kept."""
LIGHTNESS_STEPS, CHROMA_STEPS = 2.55, 2.5
"""Grey levels that a unit of lightness counts, and one of a colour plane, where segments are looked for."""


class EdgeLine(NamedTuple):
    """Segments on the line through a point (2,) px along a unit direction (2,).

    The spans (n, 2), px along it from the point, are those that segments cover, apart from each other.
    """

    point: Floats
    direction: Floats
    spans: Floats


def find_quadrangles(planes: Planes, within: Point | None = None) -> list[Floats]:
    """Quadrangles (4, 2) px of planes (H, W, C), the best first: those that edges cover best, the larger ones.

    All of them contain `within`, (x, y) px, if it is given.
    """
    lines = join_segments(_longest_segments(planes))
    if len(lines) < 4:
        return []
    corners, met = _find_corners(lines, planes.shape[:2])
    covered, length = _side_coverage(lines, corners, met)
    found: list[tuple[float, Floats]] = []
    for i, j, k, m in _find_cycles(covered >= MIN_COVERED):
        shape = corners[[i, j, k, m], [j, k, m, i]]
        sides = [(j, i, k), (k, j, m), (m, k, i), (i, m, j)]
        lengths, shares = np.array([length[s] for s in sides]), np.array([covered[s] for s in sides])
        share = float(lengths @ shares / lengths.sum())
        if share < MIN_COVERED_ALL or not cv2.isContourConvex(shape.astype(np.float32)):
            continue
        area = float(cv2.contourArea(shape.astype(np.float32)))
        if area < MIN_QUADRANGLE or (
            within is not None and cv2.pointPolygonTest(shape.astype(np.float32), within, False) < 0
        ):
            continue
        found.append((share * math.sqrt(shares.min()) * area**AREA_POWER, shape))
    found.sort(key=lambda each: -each[0])
    kept: list[Floats] = []
    for _, shape in found:
        if not any(_corner_gap(shape, other) < MIN_CORNER_GAP for other in kept):
            kept.append(shape)
        if len(kept) == MAX_QUADRANGLES:
            break
    return kept


def join_segments(segments: Floats) -> list[EdgeLine]:
    """Lines of the segments (n, 4) px, the longest covered first, at most MAX_LINES."""
    starts, ends = segments[:, :2], segments[:, 2:]
    lengths = np.hypot(*(ends - starts).T)
    directions, middles = (ends - starts) / lengths[:, None], 0.5 * (starts + ends)
    free = np.ones(len(segments), dtype=np.bool_)
    lines: list[EdgeLine] = []
    for k in range(len(segments)):
        if not free[k]:
            continue
        along = directions[k]
        normal = np.array([-along[1], along[0]])
        aside = np.maximum(np.abs((starts - middles[k]) @ normal), np.abs((ends - middles[k]) @ normal))
        away = np.minimum(np.abs((starts - middles[k]) @ along), np.abs((ends - middles[k]) @ along))
        own = free & (np.abs(directions @ along) > math.cos(MAX_TURN)) & (aside < MAX_ASIDE + TURN_SPREAD * away)
        own[k] = True
        free &= ~own
        points, weights = np.vstack([starts[own], ends[own]]), np.tile(lengths[own], 2)
        point = np.average(points, axis=0, weights=weights)
        direction = np.linalg.svd((points - point) * np.sqrt(weights)[:, None], full_matrices=False)[2][0]
        reach = np.sort(np.column_stack([(starts[own] - point) @ direction, (ends[own] - point) @ direction]), axis=1)
        lines.append(EdgeLine(point, direction, _merge_spans(reach)))
    lines.sort(key=lambda line: -float(np.diff(line.spans, axis=1).sum()))
    return lines[:MAX_LINES]


def _longest_segments(planes: Planes) -> Floats:
    """(n, 4) px, the ends of the longest line segments in any plane."""
    found = [np.zeros((0, 4))]
    for k in range(planes.shape[2]):
        plane = planes[:, :, k] - planes[:, :, k].min()
        grey = np.clip(plane * (LIGHTNESS_STEPS if k == 0 else CHROMA_STEPS), 0, 255).astype(np.uint8)
        ends = cv2.createLineSegmentDetector(cv2.LSD_REFINE_NONE).detect(grey)[0]
        if ends is not None:
            found.append(np.asarray(ends, dtype=np.float64).reshape(-1, 4))
    segments = np.vstack(found)
    lengths = np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
    order = np.argsort(-lengths, kind="stable")[:MAX_SEGMENTS]
    return np.asarray(segments[order][lengths[order] >= MIN_SEGMENT], dtype=np.float64)


def _merge_spans(spans: Floats) -> Floats:
    """(m, 2) spans apart from each other that cover the same as those of (n, 2)."""
    joined: list[list[float]] = []
    for low, high in spans[np.argsort(spans[:, 0])].tolist():
        if joined and low <= joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], high)
        else:
            joined.append([low, high])
    return np.array(joined)


def _find_corners(lines: list[EdgeLine], size: tuple[int, ...]) -> tuple[Floats, Bools]:
    """(n, n, 2) px where each two lines cross, and (n, n) whether that may be a corner of an image of (height, width)."""
    points = np.array([line.point for line in lines])
    directions = np.array([line.direction for line in lines])
    normals = np.column_stack([-directions[:, 1], directions[:, 0]])
    along = (points * normals).sum(axis=1)
    crossing = normals[:, None, 0] * normals[None, :, 1] - normals[:, None, 1] * normals[None, :, 0]
    met = np.abs(crossing) > math.sin(MIN_ANGLE)
    divisor = np.where(met, crossing, 1.0)
    x = (along[:, None] * normals[None, :, 1] - along[None, :] * normals[:, None, 1]) / divisor
    y = (normals[:, None, 0] * along[None, :] - normals[None, :, 0] * along[:, None]) / divisor
    met &= (x > -CORNER_MARGIN) & (x < size[1] - 1 + CORNER_MARGIN)
    met &= (y > -CORNER_MARGIN) & (y < size[0] - 1 + CORNER_MARGIN)
    return np.stack([x, y], axis=-1), met


def _side_coverage(lines: list[EdgeLine], corners: Floats, met: Bools) -> tuple[Floats, Floats]:
    """(n, n, n) share of the side on line i between its corners with lines j and k that segments cover, and its length, px."""
    covered = np.zeros((len(lines),) * 3)
    length = np.zeros_like(covered)
    for i, line in enumerate(lines):
        at = (corners[i] - line.point) @ line.direction
        low, high = np.minimum(at[:, None], at[None, :]), np.maximum(at[:, None], at[None, :])
        length[i] = high - low
        for start, end in line.spans.tolist():
            covered[i] += np.clip(np.minimum(high, end) - np.maximum(low, start), 0.0, None)
        side = met[i][:, None] & met[i][None, :] & (length[i] > MIN_SIDE)
        covered[i] = np.where(side, covered[i] / np.maximum(length[i], MIN_SIDE), 0.0)
    return covered, length


def _find_cycles(sides: Bools) -> list[tuple[int, int, int, int]]:
    """Lines (i, j, k, m), each crossing the next, that have all four sides of (n, n, n)."""
    n = len(sides)
    found: list[tuple[int, int, int, int]] = []
    for j in range(n):
        for m in range(j + 1, n):
            between = np.flatnonzero(sides[:, j, m])
            pairs = np.triu(sides[j][np.ix_(between, between)] & sides[m][np.ix_(between, between)], 1)
            found.extend((int(between[a]), j, int(between[b]), m) for a, b in np.argwhere(pairs).tolist())
    return found


def _corner_gap(one: Floats, other: Floats) -> float:
    """px by which a corner of one quadrangle is away from the other's nearest one, the largest."""
    return float(np.hypot(*(one[:, None] - other[None]).transpose(2, 0, 1)).min(axis=1).max())
