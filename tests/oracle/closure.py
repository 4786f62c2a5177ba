# SPDX-License-Identifier: Apache-2.0
"""Force closure by its definition, a linear programme, and all stable pairs of an outline by brute force."""

import numpy as np
from scipy.optimize import linprog

from grasptrack import kernels
from grasptrack.typing import Floats


def programme(contacts: Floats, normals: Floats, centre: Floats, rho: float, friction: float) -> float:
    """Largest smallest weight with which the cone edges cancel: above 0 exactly where the grasp closes."""
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    forces = np.concatenate([normals + friction * tangents, normals - friction * tangents])
    arms = np.concatenate([contacts, contacts]) - centre
    w = np.column_stack([forces, (arms[:, 0] * forces[:, 1] - arms[:, 1] * forces[:, 0]) / rho])
    if np.linalg.matrix_rank(w, tol=1e-9) < 3:
        return 0.0
    m = len(w)
    done = linprog(
        np.r_[np.zeros(m), -1.0],
        A_ub=np.column_stack([-np.eye(m), np.ones(m)]),
        b_ub=np.zeros(m),
        A_eq=np.vstack([np.column_stack([w.T, np.zeros(3)]), np.r_[np.ones(m), 0.0]]),
        b_eq=[0, 0, 0, 1],
        bounds=[(0, None)] * m + [(None, None)],
    )
    return -done.fun if done.status == 0 else -1.0


def evenly(view, count, shift=0.0):
    """(n, 2) places, spread evenly over all contours, moved along them by a shift in px."""
    total = sum(c.length for c in view.contours)
    rows = []
    for index, contour in enumerate(view.contours):
        n = max(round(count * contour.length / total), 4)
        s = (np.arange(n) * contour.length / n + shift) % contour.length
        rows.append(
            np.column_stack([np.full(n, float(index)), np.interp(s, contour.arc_length, np.arange(len(contour) + 1))])
        )
    return np.concatenate(rows)


def every_stable_pair(view, count, width, friction):
    """All stable pairs of evenly spread places, by the angles alone: places, contacts, pairs (p, 2), sense (p,)."""
    places, at = evenly(view, count), contacts_of(view, count, width, 0.0)
    squeeze, spread = senses(at, at, friction)
    first, second = np.nonzero(np.triu(squeeze | spread, 1))
    return places, at[0], np.column_stack([first, second]), np.where(squeeze[first, second], 1, -1)


def contacts_of(view, count, width, shift):
    """Contacts (n, 2) and normals (n, 2) of evenly spread places, moved along the outline by a shift in px."""
    places = evenly(view, count, shift)
    contacts = kernels.point_at(view.points, view.offsets, places)
    return contacts, kernels.contact_frames(view.points, view.offsets, places, width)[:, :2]


def senses(first, second, friction):
    """(n, n) each: of every contact of the first with every one of the second, whether they close inward, and outward."""
    line = second[0][None] - first[0][:, None]
    with np.errstate(invalid="ignore"):
        line = line / np.hypot(line[..., 0], line[..., 1])[..., None]
    one, other = np.einsum("ik,ijk->ij", first[1], line), -np.einsum("jk,ijk->ij", second[1], line)
    hold = np.cos(np.arctan(friction) - 1e-5)
    return (one > hold) & (other > hold), (one < -hold) & (other < -hold)


def firm(view, count, width, friction, pairs, step):
    """(p,) of pairs of evenly spread places, those that stay stable when both contacts move half a step in px either way."""
    moved = [contacts_of(view, count, width, share * step) for share in (-0.5, -0.25, 0.0, 0.25, 0.5)]
    inward, outward = np.ones(len(pairs), dtype=bool), np.ones(len(pairs), dtype=bool)
    for first in moved:
        for second in moved:
            squeeze, spread = senses(first, second, friction)
            inward &= squeeze[pairs[:, 0], pairs[:, 1]]
            outward &= spread[pairs[:, 0], pairs[:, 1]]
    return inward | outward
