# SPDX-License-Identifier: Apache-2.0
"""Edges of an image along a curve, outlines traced on them, gaps in edges closed, and thresholds."""

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels import EDGE_WINDOW
from grasptrack.kernels.results import TracedEdges, TraceOptions
from grasptrack.typing import Bools, Floats
from reference.geometry import arc_length, blend_normals, resample

__all__ = ["blur_threshold", "edge_links", "search_along_normals", "trace_edges"]


# --- Edges of an image, sub-pixel, along the normals of a curve -----

Image = NDArray[np.uint8] | NDArray[np.float32]

SPACING = 0.5  # px between samples
AWAY = 1.5  # px from the edge where its two sides begin
SETTLED = 1e-3  # px; Newton's steps halve their digits, so that the next would change nothing
MIN_SAMPLES = 7
MARGIN = int((EDGE_WINDOW + 1) / SPACING) + 1  # samples that the window of an edge may need beyond it


def _sample_profile(image: Image, x: float, y: float, nx: float, ny: float, half: int) -> Floats:
    """Bilinear samples at SPACING * (-half..half) along (nx, ny); NaN outside the image, infinite where its levels are none."""
    height, width = image.shape
    along = SPACING * np.arange(-half, half + 1)
    px, py = x + along * nx, y + along * ny
    out = np.full(len(along), np.nan)
    inside = (px >= 0) & (px <= width - 1) & (py >= 0) & (py <= height - 1)
    px, py = px[inside], py[inside]
    ix, iy = np.minimum(px.astype(np.intp), max(width - 2, 0)), np.minimum(py.astype(np.intp), max(height - 2, 0))
    fx, fy = px - ix, py - iy
    jx, jy = np.minimum(ix + 1, width - 1), np.minimum(iy + 1, height - 1)
    top = image[iy, ix] + fx * (image[iy, jx].astype(np.float64) - image[iy, ix])
    bottom = image[jy, ix] + fx * (image[jy, jx].astype(np.float64) - image[jy, ix])
    level = top + fy * (bottom - top)
    out[inside] = np.where(np.isfinite(level), level, np.inf)
    return out


def _gradient_centroid(profile: Floats, start: float, sign: float, peak: float) -> float:
    """Where gradients of one sign balance under the weight u (1 - u^2), u = (x - centre) / EDGE_WINDOW, near `peak`.

    By Newton's steps. A weight that fades out does not feel where the samples lie.
    """
    gradient = np.maximum(sign * np.diff(profile), 0.0)
    along = start + SPACING * (np.arange(len(gradient)) + 0.5)
    centre = peak
    for _ in range(3):
        u = (along - centre) / EDGE_WINDOW
        weight = np.maximum(1 - u * u, 0.0)
        mass = float((weight * gradient).sum())
        moment = float((weight * u * gradient).sum())
        rate = float(((1 - 3 * u * u) * gradient)[weight > 0].sum())
        before = centre
        centre = min(max(centre + EDGE_WINDOW * moment / max(rate, 0.2 * mass), peak - 1.0), peak + 1.0)
        if abs(centre - before) < SETTLED:
            break
    return centre


def search_along_normals(image: Image, points: Floats, normals: Floats, reach: float, polarity: int) -> Floats:
    if not 0 < reach <= 1000:
        raise ValueError(f"reach must be above 0 and at most 1000 px, not {reach:g}")
    if len(points) != len(normals):
        raise ValueError(f"{len(points)} points but {len(normals)} normals")
    half = int(reach / SPACING + 1e-9)
    out = np.tile([np.nan, 0.0, np.nan, np.nan], (len(points), 1))
    for row, (x, y), (nx, ny) in zip(out, points, normals, strict=True):
        # Beyond its reach an edge is not looked for, but the window of one found near the end needs its samples.
        samples = _sample_profile(image, x, y, nx, ny, half + MARGIN)
        valid = np.flatnonzero(~np.isnan(samples))
        within = valid[(valid >= MARGIN) & (valid <= 2 * half + MARGIN)]
        if len(within) < MIN_SAMPLES or np.isinf(samples[within]).any():
            continue
        profile, along = samples[within], SPACING * (within - half - MARGIN)
        slope = (profile[2:] - profile[:-2]) / (2 * SPACING)
        score = np.abs(slope) if polarity == 0 else slope * (1 if polarity > 0 else -1)
        peak = int(np.argmax(score))
        if not score[peak] > 0 or peak in (0, len(score) - 1):
            continue
        at = int(within[peak + 1])
        wide = valid[(valid >= at - MARGIN) & (valid <= at + MARGIN)]
        if np.isinf(samples[wide]).any():
            continue
        sign = 1.0 if slope[peak] > 0 else -1.0
        offset = _gradient_centroid(
            samples[wide], SPACING * (int(wide[0]) - half - MARGIN), sign, float(along[peak + 1])
        )
        inside, outside = profile[along <= offset - AWAY], profile[along >= offset + AWAY]
        row[:] = (
            offset,
            slope[peak],
            inside.mean() if len(inside) else profile[0],
            outside.mean() if len(outside) else profile[-1],
        )
    return out


# --- NumPy reference of the step from the chain of pixels round a silhouette to sub-pixel points -----

MOST_POINTS = 65_536


def settle_edges(
    points: Floats, normals: Floats, edges: Floats, fixed: NDArray[np.bool_], fallback: float, outlier: float
) -> tuple[Floats, Floats]:
    """Points of one closed contour moved along their normals onto the edges that were found.

    Args:
        points, normals: (N, 2), N >= 5.
        edges: (N, >= 2) offset px along the normal (NaN where none was found) and signed strength.
        fixed: (N,) points that stay where they are, with strength 0.
        fallback: px, offset where no edge was found; its strength is 0.
        outlier: px; an offset that differs by more from the median of the five about it becomes that median, with
            strength 0: it is on some other edge.

    Returns:
        (N, 2) points and (N,) absolute strengths.
    """
    missing = np.isnan(edges[:, 0])
    offset = np.where(missing, fallback, edges[:, 0])
    around = np.median(np.stack([np.roll(offset, k) for k in range(-2, 3)]), axis=0)
    stray = np.abs(offset - around) > outlier
    offset = np.where(stray, around, offset)
    offset[fixed] = 0.0
    strength = np.where(missing | stray | fixed, 0.0, np.abs(edges[:, 1]))
    return points + offset[:, None] * normals, strength


def trace_edges(
    image: NDArray[np.uint8], chain: NDArray[np.int32], hidden: NDArray[np.uint8] | None, options: TraceOptions
) -> TracedEdges:
    if len(chain) < 3:
        raise ValueError("a chain has at least 3 pixels")
    if hidden is not None and hidden.shape != image.shape:
        raise ValueError("what is hidden needs the image's size")
    hole, polarity, spacing, most, smoothing, reach, border, outlier = options
    if not image.size:
        raise ValueError("an image has pixels")
    if not spacing > 0 or not 16 <= most <= MOST_POINTS or not 0 < reach <= 1000 or not smoothing >= 0:
        raise ValueError(
            "spacing must be above 0, reach too and at most 1000 px, points 16 to 65536, smoothing at least 0"
        )
    rough = chain.astype(np.float64)
    x, y = (rough - rough[0]).T
    area = float(x @ np.roll(y, -1) - np.roll(x, -1) @ y)
    if (area > 0) is hole:
        rough = np.ascontiguousarray(rough[::-1])
    length = float(arc_length(rough)[-1])
    count = int(np.clip(np.rint(length / spacing), 16, most))
    points = resample(rough, count, min(smoothing, length))
    normals = blend_normals(points)
    right, bottom = image.shape[1] - 1.0, image.shape[0] - 1.0
    cut: Bools = np.any((points < border) | (points > (right - border, bottom - border)), axis=1)
    if hidden is not None:
        column, row = np.rint(np.clip(points, 0.0, (right, bottom))).astype(np.intp).T
        cut |= hidden[row, column] != 0
    edges = search_along_normals(image, points, normals, reach, polarity)
    # where no edge is found the silhouette's own boundary, half a pixel outside the pixels' centres, is the best guess
    settled, strength = settle_edges(points, normals, edges, cut, 0.5, outlier)
    some = slice(None, None, max(1, count // 100))
    levels = edges[some, 2:][strength[some] > 0.0]
    inside, outside = np.median(levels, axis=0).tolist() if len(levels) else (math.nan, math.nan)
    return TracedEdges(settled, strength, cut, inside, outside)


# --- NumPy reference of the links between the ends of broken edges -----

BACK = 12  # pixels of an edge from its end that give its direction
LEAST = 8  # pixels; a shorter edge has none
BORDER = 3  # px from the image's border, where edges end because the image does
NEAR = 8.0  # px; across so little a gap directions say little
WEIGHT = 4.0  # of the squared angles against the gap
REACH_OF_LENGTH = 1.5  # gaps may be so many times as long as the shorter of their two edges has pixels
AROUND = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))


def edge_links(edges: NDArray[np.uint8], reach: float, bend: float, loose: float) -> NDArray[np.int64]:
    if math.isnan(reach) or math.isnan(bend) or math.isnan(loose):
        raise ValueError("reach, bend and loose must be numbers")
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
        if not (BORDER <= x < width - BORDER and BORDER <= y < height - BORDER):
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


# --- NumPy reference of the threshold that every frame begins with -----


def blur_threshold(
    image: NDArray[np.uint8], left: int, top: int, right: int, bottom: int, level: float, polarity: int
) -> NDArray[np.uint8]:
    height, width = image.shape
    if not (0 <= left < right <= width and 0 <= top < bottom <= height):
        raise ValueError("the window must lie in the image and hold a pixel")
    if math.isnan(level):
        raise ValueError("the level must be a number")
    p = np.pad(image, 1, mode="edge")[top : bottom + 2, left : right + 2].astype(np.int32)
    across = p[:, :-2] + 2 * p[:, 1:-1] + p[:, 2:]
    total = across[:-2] + 2 * across[1:-1] + across[2:]
    dark = total <= math.floor(16.0 * min(max(level, -1.0), 256.0))
    return np.where(dark if polarity > 0 else ~dark, np.uint8(255), np.uint8(0))
