# SPDX-License-Identifier: Apache-2.0
"""Shapes with walls, holes and notches, for the tests of synthesis."""

import itertools

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import Contour, View
from outlines import BRACKET, dense


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


def material(view, points):
    """(n,) depth in px of points in the material, negative outside."""
    outlines = [c.points.astype(np.float32) for c in view.contours]
    inside = [[cv2.pointPolygonTest(o, (float(x), float(y)), True) for x, y in points] for o in outlines]
    return np.min([np.array(d) if i == 0 else -np.array(d) for i, d in enumerate(inside)], axis=0)


def near(one, other, gap):
    """Whether the contacts of two grasps lie within a gap, in some order."""
    orders = itertools.permutations(range(len(one)))
    return any((np.hypot(*(one - other[list(o)]).T) <= gap).all() for o in orders)
