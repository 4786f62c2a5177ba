# SPDX-License-Identifier: Apache-2.0
"""Shapes with walls, holes and notches, and grasps searched by brute force, for the tests of synthesis."""

import os
from pathlib import Path

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import Contour, View
from outlines import BRACKET, dense

SILHOUETTES = (
    Path(os.environ.get("GRASPTRACK_DATA", Path(__file__).resolve().parents[3] / "shared" / "data")) / "silhouettes"
)


def circle(x, y, radius, count):
    t = 2 * np.pi * np.arange(count) / count
    return np.column_stack([x + radius * np.cos(t), y + radius * np.sin(t)])


def polygon(*vertices, count=300):
    return dense(np.array(vertices, dtype=float), count)


RING = View([Contour(circle(200, 200, 100, 200)), Contour(circle(200, 200, 62, 100), hole=True)])
FRAME = View(
    [
        Contour(polygon((0, 0), (300, 0), (300, 220), (0, 220), count=200)),
        Contour(polygon((50, 40), (240, 40), (240, 170), (50, 170), count=100), hole=True),
    ]
)
NOTCHED = Contour(polygon((0, 0), (300, 0), (300, 200), (200, 200), (200, 80), (100, 80), (100, 200), (0, 200)))
BAR = Contour(polygon((0, 0), (600, 0), (600, 40), (0, 40)))
SHAPES = {"ring": RING, "frame": FRAME, "notched": NOTCHED, "bar": BAR, "bracket": Contour(dense(BRACKET))}


def mapped(view, S):
    """A view under a similarity."""
    return View([c.transformed(S) for c in view.contours])


def traced(path):
    """The outline of the largest component of a silhouette, holes too, stairs smoothed; None where there is none."""
    mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    mask = cv2.copyMakeBorder(np.where(mask > 127, 255, 0).astype(np.uint8), 3, 3, 3, 3, cv2.BORDER_CONSTANT)
    chains, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    outer = max((i for i in range(len(chains)) if tree[0][i][3] < 0), key=lambda i: cv2.contourArea(chains[i]))
    least = max(0.002 * cv2.contourArea(chains[outer]), 12.0)
    holes = [i for i in range(len(chains)) if tree[0][i][3] == outer and cv2.contourArea(chains[i]) > least]
    size = np.sqrt(cv2.contourArea(chains[outer]))

    def smoothed(index):
        chain = np.ascontiguousarray(chains[index][:, 0].astype(float))
        count = int(np.clip(round(300 * len(chain) / len(chains[outer])), 16, 300))
        return kernels.resample(chain, count, max(4.0, 0.01 * size))

    return View([Contour(smoothed(outer)), *(Contour(smoothed(i), hole=True) for i in holes)])


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


def material(view, points):
    """(n,) depth in px of points in the material, negative outside."""
    outlines = [c.points.astype(np.float32) for c in view.contours]
    inside = [[cv2.pointPolygonTest(o, (float(x), float(y)), True) for x, y in points] for o in outlines]
    return np.min([np.array(d) if i == 0 else -np.array(d) for i, d in enumerate(inside)], axis=0)
