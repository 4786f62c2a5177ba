# SPDX-License-Identifier: Apache-2.0
"""The steps of two transfers: by four peaks of curvature and a homography, and by a grasp line (Sections III and IV)."""

import math
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.results import (
    CarriedLine,
    CurvatureMatches,
    CurvatureVector,
    DescribedLine,
    MatchWindow,
    Quadrilateral,
    RefinedContacts,
    SelectedPoints,
)
from grasptrack.typing import Floats, Ints
from reference.checks import check_arc, check_indices, check_outline, check_size, check_within
from reference.geometry import nearest_crossings, polygon_moments

__all__ = [
    "best_quadrilateral", "carry_grasp_line", "grasp_line", "match_curvature", "refine_contacts", "select_points",
]  # fmt: skip


# --- Peaks of curvature, and the four of them that fix a homography best (Section IV-C) -----

MAX_PEAKS = 8
MOST_CHOSEN_FROM = 32


def curvature_peaks(curvature: Floats, arc: Floats, separation: float, prominence: float) -> Ints:
    """Local maxima of the absolute curvature of one closed contour, strongest first, at most 8.

    What lies closer together than a 1e-10th of the highest is equal: of neighbours the last is the peak, of peaks the first
    comes first.

    Args:
        curvature: (N,) curvature vector; a NaN is never a peak and no neighbour of one.
        arc: (N + 1,) arc length, px.
        separation: px along the contour between two peaks, at least.
        prominence: least rise of a peak above the lowest curvature within 3 separations, on either side.
    """
    v = np.abs(curvature)
    length = arc[-1]
    n = len(v)
    equal = 1e-10 * np.nanmax(v)
    with np.errstate(invalid="ignore"):
        crest = np.flatnonzero((v >= np.roll(v, 1) - equal) & (v > np.roll(v, -1) + equal))
    falling = crest[np.argsort(-v[crest])]
    level = np.cumsum(np.append(0.0, -np.diff(v[falling])) > equal)[: len(falling)]
    peaks: list[int] = []
    for i in falling[np.lexsort((falling, level))].tolist():
        if any(min(abs(arc[i] - arc[p]), length - abs(arc[i] - arc[p])) < separation for p in peaks):
            continue
        rises = []
        for way in (1, -1):
            low, j = v[i], i
            # the sample that lies beyond the reach is still looked at
            while abs(j - i) < n and abs(_unwrapped_arc_length(arc, j) - arc[i]) <= 3.0 * separation:
                j += way
                low = np.fmin(low, v[j % n])
            rises.append(v[i] - low)
        if min(rises) >= prominence:
            peaks.append(i)
        if len(peaks) == MAX_PEAKS:
            break
    return np.array(peaks, dtype=np.int64)


def _unwrapped_arc_length(arc: Floats, i: int) -> float:
    """Arc length of a sample whose index may run on beyond either end."""
    lap, j = divmod(i, len(arc) - 1)
    return float(arc[j] + lap * arc[-1])


def best_quadrilateral(points: Floats, weights: Floats) -> Quadrilateral:
    check_size(len(points), MOST_CHOSEN_FROM, "points")
    if len(weights) != len(points):
        raise ValueError("each point needs its weight")
    best, score, area = (-1, -1, -1, -1), -1.0, 0.0
    for a, b, c, d in combinations(range(len(points)), 4):
        least = min(_triangle_area(points[[i, j, k]]) for i, j, k in ((a, b, c), (a, b, d), (a, c, d), (b, c, d)))
        value = least * np.sqrt(weights[[a, b, c, d]].min())
        if value > score * (1.0 + 1e-9):
            best, score, area = (a, b, c, d), value, least
    return Quadrilateral(list(best), area)


def _triangle_area(p: Floats) -> float:
    u, w = p[1] - p[0], p[2] - p[0]
    return 0.5 * abs(float(u[0] * w[1] - u[1] * w[0]))


def select_points(
    points: Floats, arc: Floats, curvature: Floats, separation: float, prominence: float
) -> SelectedPoints:
    check_arc(len(points), arc)
    check_arc(len(curvature), arc)
    peaks = curvature_peaks(curvature, arc, separation, prominence)
    if len(peaks) < 4:
        return SelectedPoints(peaks.tolist(), 0.0)
    four, triangle = best_quadrilateral(points[peaks], np.abs(curvature[peaks]))
    if four[0] < 0:
        return SelectedPoints(peaks.tolist(), 0.0)
    return SelectedPoints([*peaks[four].tolist(), *np.delete(peaks, four).tolist()], triangle)


# --- Eq. (3): curvature compared between two outlines (Section IV-C.1) -----


def match_curvature(
    first: CurvatureVector, indices: list[int], second: CurvatureVector, centres: list[float], window: MatchWindow
) -> CurvatureMatches:
    (arc1, v1), (arc2, v2) = first, second
    kappa, reach, radius, step, tolerance = window
    check_arc(len(v1), arc1)
    check_arc(len(v2), arc2)
    check_indices(indices, len(v1))
    check_within(radius, 0, 1000, "radius")
    if len(centres) != len(indices):
        raise ValueError("each index needs its centre")
    closed1, closed2 = np.append(v1, v1[0]), np.append(v2, v2[0])
    length1, length2 = arc1[-1], arc2[-1]
    k = np.arange(-radius, radius + 1)
    samples, errors, places = [], [], []
    for i, centre in zip(indices, centres, strict=True):
        wanted = np.interp(np.mod(arc1[i] + k * step, length1), arc1, closed1)
        gap = np.mod(arc2[:-1] - centre + 0.5 * length2, length2) - 0.5 * length2
        near = np.flatnonzero(np.abs(gap) <= kappa * reach)
        found = np.interp(np.mod(arc2[near][:, None] + kappa * step * k, length2), arc2, closed2)
        error = np.abs(wanted - found).mean(axis=1)
        error[np.isnan(error)] = np.inf
        best = int(np.argmin(error)) if len(near) else -1
        least = float(error[best]) if best >= 0 else np.inf
        good = np.isfinite(least) and least <= tolerance * max(abs(v1[i]), 2.0 * np.pi)
        samples.append(int(near[best]) if good else -1)
        errors.append(least)
        place = math.nan
        if good:
            ahead = kappa * step * k.astype(np.float64)
            place = _place_between_samples(wanted, arc2, closed2, samples[-1], ahead, centre, kappa * reach)
        places.append(place)
    return CurvatureMatches(samples, errors, places)


def _place_between_samples(
    wanted: Floats, arc: Floats, closed: Floats, sample: int, ahead: Floats, centre: float, limit: float
) -> float:
    """The place near a sample about which the closed sequence is most like the one wanted; NaN if it is none."""
    n, length = len(arc) - 1, float(arc[-1])
    middle = float(arc[sample])

    def read(shift: float) -> Floats:
        return np.asarray(np.interp(np.mod(middle + shift + ahead, length), arc, closed))

    after = float(arc[sample + 1]) - middle
    before = middle - (float(arc[sample - 1]) if sample else float(arc[n - 1]) - length)
    with np.errstate(all="ignore"):
        # slopes across both sides: they are the same whichever way the contour runs
        slope = (read(after) - read(-before)) / (before + after)
        weight = float(slope @ slope)
    if math.isnan(weight):
        return math.nan
    shift = 0.0
    for _ in range(2):
        if not weight > 0.0:
            break
        moved = shift + float(slope @ (wanted - read(shift))) / weight
        if not math.isfinite(moved):
            return math.nan
        shift = min(max(moved, -before), after)
    offset = middle - centre - round((middle - centre) / length) * length
    if not abs(offset + shift) <= limit:
        return math.nan
    share = shift / (after if shift > 0.0 else before) if shift != 0.0 else 0.0
    place = sample + share
    if place < 0.0:
        place += n
    return place if place < n else place - n  # so little before the first that it is rounded to the end is the first


# --- Contacts carried by a homography and moved onto the outline (Fig. 11) -----


def refine_contacts(
    H: Floats, contacts: Floats, normals: Floats | None, points: Floats, offsets: NDArray[np.int64]
) -> RefinedContacts:
    if not len(contacts):
        raise ValueError("contacts are needed")
    if (normals is None and len(contacts) != 2) or (normals is not None and len(normals) != len(contacts)):
        raise ValueError("contacts without normals are two, others have their normals")
    check_outline(points, offsets)
    with np.errstate(all="ignore"):
        depth = contacts @ H[2, :2] + H[2, 2]
        carried = (contacts @ H[:2, :2].T + H[:2, 2]) / depth[:, None]
        # d(x', y') / d(x, y), (k, 2, 2)
        local = (H[:2, :2] - carried[:, :, None] * H[2, :2]) / depth[:, None, None]
        (a, b), (c, d) = local[0]
        growth = math.sqrt(abs(float(a * d - b * c)))
        in_front = float((depth * (-1.0 if depth[0] < 0 else 1.0)).min())
        if normals is None:
            (x1, y1), (x2, y2) = carried.tolist()
            opening = np.hypot(x2 - x1, y2 - y1)
            line = x1, y1, (x2 - x1) / opening, (y2 - y1) / opening
            out = np.array(nearest_crossings(points, offsets, *line, 0.0, float(opening))).reshape(2, 2)
            if (out[0] == out[1]).all():
                return RefinedContacts(out, math.inf, growth, in_front)
        else:
            out = np.empty_like(carried)
            for i, ((x, y), (nx, ny)) in enumerate(zip(carried.tolist(), normals.tolist(), strict=True)):
                (a, b), (c, d) = local[i]
                ux, uy = d * nx - c * ny, a * ny - b * nx  # normals go by the inverse transpose, up to scale
                size = np.hypot(ux, uy)
                out[i] = nearest_crossings(points, offsets, x, y, float(ux / size), float(uy / size), 0.0, 0.0)[:2]
        moved = np.hypot(*(out - carried).T)
    return RefinedContacts(out, float(moved.max()), growth, in_front)


# --- Grasp-line coordinates and the contacts that have them on another outline (Sections III-B and IV-B) -----

Numbers = tuple[float, ...]


def grasp_line(points: Floats, offsets: NDArray[np.int64], contacts: Floats) -> DescribedLine:
    if len(contacts) != 2:
        raise ValueError("a grasp line has two contacts")
    area, cx, cy, theta, major, minor, *_ = polygon_moments(points, offsets)
    (x1, y1), (x2, y2) = contacts
    with np.errstate(all="ignore"):
        root = np.sqrt(area)
        opening = np.hypot(x2 - x1, y2 - y1)
        ux, uy = (x2 - x1) / opening, (y2 - y1) / opening
        ex, ey = np.cos(theta), np.sin(theta)
        sine, cosine = ex * uy - ey * ux, ex * ux + ey * uy
        along, left = (cx - x1) * ux + (cy - y1) * uy, (cx - x1) * uy - (cy - y1) * ux
        # along the line, I_min passes the centroid's foot by left * cot(alpha)
        meets = along - left * cosine / sine
        line = left / root, np.arctan2(sine, cosine), -meets / root, (opening - meets) / root
    d_c, alpha_m, d_1, d_2 = (float(v) for v in line)
    frame = area, (cx, cy), theta, major, minor
    return DescribedLine(d_c, alpha_m, d_1, d_2, *frame, float(sine), float(opening))


def carry_grasp_line(
    points: Floats,
    offsets: NDArray[np.int64],
    line: Numbers,
    reference: Numbers,
    ahead: tuple[float, float],
) -> CarriedLine:
    area, cx, cy, theta, major, minor, *_ = polygon_moments(points, offsets)
    d_c, alpha_m, d_1, d_2 = line
    area1, x1, y1, theta1 = reference
    with np.errstate(all="ignore"):
        theta += 0.0 if ahead[0] * np.cos(theta) + ahead[1] * np.sin(theta) > 0.0 else math.pi
        root = float(np.sqrt(area))
        ex, ey = np.cos(theta), np.sin(theta)
        cosine, sine = np.cos(alpha_m), np.sin(alpha_m)
        ux, uy = ex * cosine - ey * sine, ey * cosine + ex * sine
        # from the centroid along I_min to where the line of that d_c crosses it
        shift = float(np.divide(-d_c * root, sine))
        qx, qy = cx + shift * ex, cy + shift * ey
        t1, t2 = d_1 * root, d_2 * root
        x, y, u, v = nearest_crossings(points, offsets, qx, qy, ux, uy, t1, t2)
        missed = max(abs((x - qx) * ux + (y - qy) * uy - t1), abs((u - qx) * ux + (v - qy) * uy - t2))
        missed = math.inf if x == u and y == v else missed
        scale = float(np.divide(root, np.sqrt(area1)))
        c, s = scale * np.cos(theta - theta1), scale * np.sin(theta - theta1)
        H = np.array([[c, -s, cx - c * x1 + s * y1], [s, c, cy - s * x1 - c * y1], [0.0, 0.0, 1.0]])
    return CarriedLine(np.array([[x, y], [u, v]]), H, float(missed), area, major, minor)
