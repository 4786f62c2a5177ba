# SPDX-License-Identifier: Apache-2.0
"""Grasp-line coordinates and the contacts that have them on another outline (Sections III-B and IV-B)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_inertia import inertia
from grasptrack.kernels.reference_lines import nearest_crossings
from grasptrack.typing import Floats

Numbers = tuple[float, ...]


def grasp_line(points: Floats, offsets: NDArray[np.int64], contacts: Floats) -> Numbers:
    """The line through two contacts relative to the silhouette's inertia axes.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        contacts: (2, 2) px.

    Returns:
        d_c, alpha_m (rad), d_1, d_2, distances divided by sqrt(area); t30, t21, t12, t03, area, cx, cy, theta, major,
        minor as from `inertia`; the sine of alpha_m; the contacts' distance in px. Not finite where the contacts
        coincide or the line never meets I_min.

    Raises:
        ValueError: other than two contacts.
    """
    if len(contacts) != 2:
        raise ValueError("a grasp line has two contacts")
    area, cx, cy, theta, major, minor, *skewness = inertia(points, offsets)
    (x1, y1), (x2, y2) = contacts
    with np.errstate(all="ignore"):
        root = np.sqrt(area)
        opening = np.hypot(x2 - x1, y2 - y1)
        ux, uy = (x2 - x1) / opening, (y2 - y1) / opening
        ex, ey = math.cos(theta), math.sin(theta)
        sine, cosine = ex * uy - ey * ux, ex * ux + ey * uy
        along, left = (cx - x1) * ux + (cy - y1) * uy, (cx - x1) * uy - (cy - y1) * ux
        # along the line, I_min passes the centroid's foot by left * cot(alpha)
        meets = along - left * cosine / sine
        line = left / root, np.arctan2(sine, cosine), -meets / root, (opening - meets) / root
    values = (*line, *skewness, area, cx, cy, theta, major, minor, sine, opening)
    return tuple(float(v) for v in values)


def carry_grasp_line(
    points: Floats,
    offsets: NDArray[np.int64],
    line: Numbers,
    reference: Numbers,
    ahead: tuple[float, float],
    least_skewness: float,
) -> tuple[Floats, Floats, float, float, float, float, bool]:
    """The contacts with given grasp-line coordinates on another outline.

    Args:
        points: (N, 2) px.
        offsets: (C + 1,).
        line: d_c, alpha_m, d_1, d_2.
        reference: t30, t21, t12, t03, area, cx, cy, theta of the view in which they were measured.
        ahead: the direction in which I_min is expected to point, of any length, or (0, 0) where it is not: then the
            third moments tell, which change their sign with a half turn.
        least_skewness: norm of the third moments below which they tell nothing.

    Returns:
        (2, 2) px, the crossings of the line and the outline nearest to where the contacts should be; (3, 3) the
        similarity from the reference; px by which the coordinates miss the farther one, NaN where there is no crossing
        and infinite where both share one; area, major and minor as from `inertia`; whether anything told I_min's two
        directions apart.
    """
    area, cx, cy, theta, major, minor, *skewness = inertia(points, offsets)
    d_c, alpha_m, d_1, d_2 = line
    *before, area1, x1, y1, theta1 = reference
    told = True
    with np.errstate(all="ignore"):
        if ahead != (0.0, 0.0):
            same = ahead[0] * math.cos(theta) + ahead[1] * math.sin(theta) > 0.0
        else:
            agreement, norm, now = np.dot(before, skewness), np.linalg.norm(before), np.linalg.norm(skewness)
            told = bool(
                norm >= least_skewness and norm * now >= least_skewness**2 and abs(agreement) >= 0.5 * norm * now
            )
            same = not told or agreement > 0.0
        theta += 0.0 if same else math.pi
        root = float(np.sqrt(area))
        ex, ey = math.cos(theta), math.sin(theta)
        cosine, sine = math.cos(alpha_m), math.sin(alpha_m)
        ux, uy = ex * cosine - ey * sine, ey * cosine + ex * sine
        # from the centroid along I_min to where the line of that d_c crosses it
        shift = float(np.divide(-d_c * root, sine))
        qx, qy = cx + shift * ex, cy + shift * ey
        t1, t2 = d_1 * root, d_2 * root
        x, y, u, v = nearest_crossings(points, offsets, qx, qy, ux, uy, t1, t2)
        missed = max(abs((x - qx) * ux + (y - qy) * uy - t1), abs((u - qx) * ux + (v - qy) * uy - t2))
        missed = math.inf if x == u and y == v else missed
        scale = root / math.sqrt(area1)
        c, s = scale * math.cos(theta - theta1), scale * math.sin(theta - theta1)
        H = np.array([[c, -s, cx - c * x1 + s * y1], [s, c, cy - s * x1 - c * y1], [0.0, 0.0, 1.0]])
    return np.array([[x, y], [u, v]]), H, float(missed), area, major, minor, told
