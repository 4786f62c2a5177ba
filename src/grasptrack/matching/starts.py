# SPDX-License-Identifier: Apache-2.0
"""Where the refinement of a match begins: alignments of whitened outlines, of wholes and of parts."""

from __future__ import annotations

import math

import numpy as np

from grasptrack import kernels
from grasptrack.kernels.reference.homography import near_identity
from grasptrack.matching.samples import Sampled
from grasptrack.typing import Floats


def _perspective_bends(*rings: tuple[float, int]) -> Floats:
    turns = [(0.0, 0.0)]
    for radius, count in rings:
        step = 2.0 * math.pi / count
        turns += [(radius * math.cos(step * k), radius * math.sin(step * k)) for k in range(count)]
    return np.array(turns)


BENDS = _perspective_bends((0.1, 6))
"""Perspective that is tried, in units of the whitened outline: up to 0.18 arises when an object that fills 60 % of a view
of 60 degrees is tilted by 60; nine of ten such views are below 0.11."""
MORE_BENDS = _perspective_bends((0.08, 6), (0.15, 6))
"""The same where a first look found nothing that fits."""
COUNT = 128
"""Samples of the whitened alignment."""
APART, APART_MORE = 0.025, 0.015
"""Lengths of the outline between two starts."""
STARTS, STARTS_MORE = 14, 24
"""Alignments that are refined."""
CUTS = tuple((2.0 * math.pi * k / 12, share) for share in (0.15, 0.3) for k in range(12))
"""Direction in rad, and share of the outline that is cut off there, of the parts that are tried."""
STARTS_CUT = 24
"""Alignments of parts that are refined."""
STEPS = 16
"""Of the motion that an outline shows least: a turn by many small steps stays a turn."""


def of_wholes(a: Sampled, b: Sampled, *, more: bool = False) -> Floats:
    """(k, 9) homographies that lay the whole of one outer contour on the whole of the other."""
    if more:
        found = kernels.initial_alignments(a.outer, b.outer, MORE_BENDS, COUNT, APART_MORE, STARTS_MORE)
    else:
        found = kernels.initial_alignments(a.outer, b.outer, BENDS, COUNT, APART, STARTS)
    return np.ascontiguousarray(found[:, 2:])


def of_parts(a: Sampled, b: Sampled) -> Floats:
    """(k, 9) homographies that lay what a straight cut leaves of the first outer contour on the whole of the second.

    If the second is cut or covered there, the two are alike. Of the cuts those count that leave least.
    """
    rows = []
    for angle, share in CUTS:
        depth = a.outer @ np.array([math.cos(angle), math.sin(angle)])
        part = a.outer[depth <= np.quantile(depth, 1.0 - share)]
        rows.append(kernels.initial_alignments(np.ascontiguousarray(part), b.outer, BENDS[:1], COUNT, APART, 4))
    found = np.concatenate(rows)
    return np.ascontiguousarray(found[np.argsort(found[:, 0], kind="stable")][:STARTS_CUT, 2:])


def perturb_homography(H: Floats, a: Sampled, shares: tuple[float, ...]) -> Floats:
    """(k, 9) a homography (3, 3) after the motion of the first outline that its normals show least.

    It moves the farthest point by each of the `shares` of sqrt(area). What is free to slide, a disc, an ellipse, stays
    on itself.
    """
    centre, radius, softest = a.softest
    rows = []
    for share in shares:
        little = near_identity(share * a.size / STEPS * softest, centre, radius)
        rows.append((H @ np.linalg.matrix_power(little, STEPS)).ravel())
    return np.array(rows)
