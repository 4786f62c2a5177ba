# SPDX-License-Identifier: Apache-2.0
"""The same for three fingers a third of a turn apart: all triples of points of the true outline."""

from __future__ import annotations

import math

import numpy as np

from grasptrack.bench.approach.choosing import EVEN, FRICTION, SIDEWAYS
from grasptrack.bench.approach.refusal import ROUGH, has_finger_clearance, rasterize_material, sample_pad_contacts
from grasptrack.bench.physics.gripper import MAX_OPENING, PAD_WIDTH
from grasptrack.bench.simulation.outlines import Shape

THIRD = 2.0 * math.pi / 3.0


def triples_that_close(shape: Shape, size: float, friction: float = FRICTION) -> int:
    """How many triples of points three fingers could close on from outside: at equal angles and, within EVEN, distances.

    Each within the opening and its cone, with room beside. Nothing of the synthesis is used. Complex numbers are points.

    Args:
        shape: the part.
        size: m, the square root of its area.
        friction: Coulomb coefficient.
    """
    rings = [ring * size for ring in shape.polygons]
    points, normals, rough = sample_pad_contacts(rings)
    ok = rough <= ROUGH
    p, n = points[ok] @ np.array([1.0, 1.0j]), normals[ok] @ np.array([1.0, 1.0j])
    cone, turn = math.cos(math.atan(friction)), complex(math.cos(THIRD), math.sin(THIRD))
    least, most = PAD_WIDTH / math.sqrt(3.0) / 2.0, 0.5 * MAX_OPENING - SIDEWAYS
    material, corner = rasterize_material(rings)
    found = set()
    for i in range(len(p)):
        # the next contact is this one, turned about the middle: p_j - c = turn (p_i - c)
        middle = (p - turn * p[i]) / (1.0 - turn)
        radius = np.abs(middle - p[i])
        near = (radius > least) & (radius <= most)
        near &= ((middle - p[i]) * n[i].conjugate()).real > cone * radius
        near &= ((middle - p) * n.conjugate()).real > cone * radius
        j = np.flatnonzero(near)
        off = np.abs((middle[j] + turn * (p[j] - middle[j]))[:, None] - p[None])
        row, k = np.nonzero(off <= EVEN)
        c = middle[j[row]]
        fits = ((c - p[k]) * n[k].conjugate()).real > cone * np.abs(c - p[k])
        for one, other, centre in zip(j[row[fits]].tolist(), k[fits].tolist(), c[fits].tolist(), strict=True):
            if len({i, one, other}) < 3 or (key := tuple(sorted((i, one, other)))) in found:
                continue
            outward = [(p[q] - centre) / abs(p[q] - centre) for q in key]
            if all(
                has_finger_clearance(material, corner, np.array([p[q].real, p[q].imag]), np.array([w.real, w.imag]))
                for q, w in zip(key, outward, strict=True)
            ):
                found.add(key)
    return len(found)
