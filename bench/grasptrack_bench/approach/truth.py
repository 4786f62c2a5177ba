# SPDX-License-Identifier: Apache-2.0
"""Judged by the truth: where contacts are when the hand closes, and whether a part that was refused can be grasped after all.

A refusal is checked by all pairs, or triples, of points of the true outline, one by one; nothing of the synthesis is used.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.pose import contact_tolerance
from grasptrack.typing import Floats
from grasptrack_bench.approach.case import Row
from grasptrack_bench.approach.choosing import EVEN, FRICTION, SIDEWAYS, turn_between
from grasptrack_bench.physics import World
from grasptrack_bench.physics.gripper import MAX_OPENING, PAD_THICKNESS, PAD_WIDTH
from grasptrack_bench.simulation.outlines import Shape


def on_part(world: World, contacts: Floats) -> Floats:
    """(k, 2) m, where contacts (k, 2) px lie on the part's upper face now."""
    return apply_homography(np.linalg.inv(world.outline_to_image()), contacts)


def record_closing_errors(row: Row, world: World, chosen: Floats, contacts: Floats) -> None:
    """Fill in what is true when the hand begins to close: contact_error_px, right, aside_mm, turned_deg."""
    seen, rings = apply_homography(world.outline_to_image(), chosen), _outline_in_image(world)
    row.contact_error_px = float(np.hypot(*(contacts - seen).T).max())
    row.right = max(row.contact_error_px, _max_outline_distance(seen, rings)) <= _contact_tolerance(rings)
    part, hand = world.part_pose(), world.pose()
    places = np.column_stack([chosen[:, 0], -chosen[:, 1], np.full(len(chosen), world.setting.part.thickness)])
    local = (places @ part[:3, :3].T + part[:3, 3] - hand[:3, 3]) @ hand[:3, :3]
    row.aside_mm = 1e3 * float(np.hypot(*local.mean(axis=0)[:2]))
    row.turned_deg = math.degrees(turn_between(local[:, :2], world.hand.tips(1.0)[:, :2]))


def _outline_in_image(world: World) -> list[NDArray[np.float32]]:
    """Rings (n, 2) px of the part's outline in the image, the outer one first."""
    size, H = world.setting.part.size, world.outline_to_image()
    return [apply_homography(H, ring * size).astype(np.float32) for ring in world.shape.polygons]


def _max_outline_distance(points: Floats, rings: list[NDArray[np.float32]]) -> float:
    """px, the farthest of some points (k, 2) from an outline."""
    return max(min(abs(cv2.pointPolygonTest(ring, (x, y), True)) for ring in rings) for x, y in points.tolist())


def _contact_tolerance(rings: list[NDArray[np.float32]]) -> float:
    """px within which contacts on an outline are right."""
    areas = [cv2.contourArea(ring) for ring in rings]
    return contact_tolerance(max(2.0 * areas[0] - sum(areas), 0.0), NUMBERS)


POINTS = 500
"""Points on the outline."""
FINE = 1.5e-4
"""m to a pixel of the picture in which fingers look for room."""
RIDGE = 0.25
"""Of the pad's width: so far the outline may reach behind the pad's face."""
ROUGH = 0.04
"""Of the pad's width: rms distance of the outline under a pad from a straight line, with which it still lies on."""


def pairs_that_close(shape: Shape, size: float) -> int:
    """How many pairs of points two fingers could close on from outside: within the opening, both cones, room beside.

    Nothing of the synthesis is used. A pad's normal is that of the straight line that fits the outline under it.
    """
    rings = [ring * size for ring in shape.polygons]
    points, normals = sample_pad_contacts(rings)
    across = points[None] - points[:, None]
    length = np.hypot(across[..., 0], across[..., 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        way = across / length[..., None]
    cone = math.cos(math.atan(FRICTION))
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


def sample_pad_contacts(rings: list[Floats]) -> tuple[Floats, Floats]:
    """Points (n, 2) and normals into the material (n, 2), where the outline within a pad's width is straight enough."""
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
        ok = np.sqrt((off**2).mean(axis=1)) / PAD_WIDTH <= ROUGH
        found.append((dense[::4][ok], normal[ok]))
    points, normals = (np.concatenate(each) for each in zip(*found, strict=True))
    return points, normals


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


THIRD = 2.0 * math.pi / 3.0


def triples_that_close(shape: Shape, size: float) -> int:
    """How many triples of points three fingers could close on from outside: at equal angles and, within EVEN, distances.

    Each within the opening and its cone, with room beside. Nothing of the synthesis is used. Complex numbers are points.
    """
    rings = [ring * size for ring in shape.polygons]
    p, n = (each @ np.array([1.0, 1.0j]) for each in sample_pad_contacts(rings))
    cone, turn = math.cos(math.atan(FRICTION)), complex(math.cos(THIRD), math.sin(THIRD))
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
