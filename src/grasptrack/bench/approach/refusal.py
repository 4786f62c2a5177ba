# SPDX-License-Identifier: Apache-2.0
"""Whether a part that synthesis refused can be taken after all: all pairs of points of its true outline, one by one."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.approach.choosing import FRICTION, SIDEWAYS
from grasptrack.bench.physics.gripper import MAX_OPENING, PAD_THICKNESS, PAD_WIDTH
from grasptrack.bench.simulation.outlines import Shape
from grasptrack.typing import Floats

POINTS = 500
"""Points on the outline."""
FINE = 1.5e-4
"""m to a pixel of the picture in which fingers look for room."""
RIDGE = 0.25
"""Of the pad's width: so far the outline may reach behind the pad's face."""
ROUGH = 0.04
"""Of the pad's width: rms distance of the outline under a pad from a straight line, with which it still lies on."""


def pairs_that_close(shape: Shape, size: float, friction: float = FRICTION) -> int:
    """How many pairs of points two fingers could close on from outside: within the opening, both cones, room beside.

    Nothing of the synthesis is used. A pad's normal is that of the straight line that fits the outline under it.

    Args:
        shape: the part.
        size: m, the square root of its area.
        friction: Coulomb coefficient.
    """
    rings = [ring * size for ring in shape.polygons]
    points, normals, rough = sample_pad_contacts(rings)
    ok = rough <= ROUGH
    points, normals = points[ok], normals[ok]
    across = points[None] - points[:, None]
    length = np.hypot(across[..., 0], across[..., 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        way = across / length[..., None]
    cone = math.cos(math.atan(friction))
    into = np.einsum("nmi,ni->nm", way, normals)
    back = -np.einsum("nmi,mi->nm", way, normals)
    close = (into > cone) & (back > cone) & (length <= MAX_OPENING - 2.0 * SIDEWAYS) & (length > 0.0)
    first, second = np.nonzero(np.triu(close, 1))
    material, corner = rasterize_material(rings)
    return sum(
        has_finger_clearance(material, corner, points[i], -way[i, j])
        and has_finger_clearance(material, corner, points[j], way[i, j])
        for i, j in zip(first.tolist(), second.tolist(), strict=True)
    )


def sample_pad_contacts(rings: list[Floats]) -> tuple[Floats, Floats, Floats]:
    """Points (n, 2), normals into the material (n, 2), and roughness (n,) of the outline within a pad's width."""
    lengths = [float(np.hypot(*(np.roll(r, -1, axis=0) - r).T).sum()) for r in rings]
    step = sum(lengths) / POINTS
    found = []
    for ring, length in zip(rings, lengths, strict=True):
        count = max(16, round(4.0 * length / step))
        dense = _resample_evenly(ring, count)
        half = max(1, round(0.5 * PAD_WIDTH / (length / count)))
        window = dense[(np.arange(0, count, 4)[:, None] + np.arange(-half, half + 1)[None]) % count]
        flat = window - window.mean(axis=1, keepdims=True)
        _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", flat, flat))
        normal = vectors[:, :, 0]
        along = window[:, -1] - window[:, 0]
        inward = np.column_stack([-along[:, 1], along[:, 0]])  # outlines run so that the material is on this side
        normal = normal * np.where((normal * inward).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
        off = np.einsum("nki,ni->nk", flat, normal)
        found.append((dense[::4], normal, np.sqrt((off**2).mean(axis=1)) / PAD_WIDTH))
    return tuple(np.concatenate(each) for each in zip(*found, strict=True))  # type: ignore[return-value]


def _resample_evenly(ring: Floats, count: int) -> Floats:
    closed = np.vstack([ring, ring[:1]])
    run = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    at = np.arange(count) * run[-1] / count
    return np.column_stack([np.interp(at, run, closed[:, i]) for i in (0, 1)])


def rasterize_material(rings: list[Floats]) -> tuple[NDArray[np.bool_], Floats]:
    """The material, pixel by pixel, and where its first pixel lies in m."""
    low = rings[0].min(axis=0) - 0.03
    size = np.ceil((rings[0].max(axis=0) + 0.03 - low) / FINE).astype(int)
    drawn = np.zeros((size[1], size[0]), np.uint8)
    cv2.fillPoly(drawn, [np.rint((r - low) / FINE).astype(np.int32) for r in rings], 255)
    return drawn > 0, low


def has_finger_clearance(material: NDArray[np.bool_], corner: Floats, contact: Floats, outward: Floats) -> bool:
    """Whether a finger fits beside a contact, from its pad's face, less what a pad may overlap, to behind its clearance."""
    across = np.array([-outward[1], outward[0]])
    deep = np.arange(RIDGE * PAD_WIDTH, PAD_THICKNESS + SIDEWAYS, 2.0 * FINE)
    wide = np.arange(-PAD_WIDTH / 2.0, PAD_WIDTH / 2.0 + FINE, 2.0 * FINE)
    places = contact + deep[:, None, None] * outward + wide[None, :, None] * across
    pixel = np.rint((places - corner) / FINE).astype(int).reshape(-1, 2)
    pixel = np.clip(pixel, 0, np.array(material.shape[::-1]) - 1)
    return not bool(material[pixel[:, 1], pixel[:, 0]].any())
