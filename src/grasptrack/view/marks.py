# SPDX-License-Identifier: Apache-2.0
"""What stands for a grasp in any picture: its lines and friction cones."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from grasptrack.typing import Floats

if TYPE_CHECKING:
    from grasptrack.tracking.result import TrackResult

_ARC = np.linspace(-1.0, 1.0, 13)


def grasp_spokes(contacts: Floats) -> list[Floats]:
    """The lines (2, 2) that stand for a grasp: between two contacts, from the middle to each of more."""
    middle = contacts.mean(axis=0)
    return [contacts] if len(contacts) == 2 else [np.vstack([middle, c]) for c in contacts]


def sector_polygon(apex: Floats, direction: Floats, half_angle: float, length: float) -> Floats:
    """A sector as a closed polygon (m, 2) px.

    Args:
        apex: (2,) px.
        direction: (2,) of its middle.
        half_angle: rad.
        length: px from apex to arc.
    """
    angles = math.atan2(direction[1], direction[0]) + half_angle * np.linspace(-1.0, 1.0, 17)
    return np.vstack([apex, apex + length * np.column_stack([np.cos(angles), np.sin(angles)])])


def friction_cones(result: TrackResult, length: float) -> list[Floats]:
    """Friction cones as closed polygons (m, 2) px of the current image: apex at the contact, opening into the material.

    A cone that was judged in the object's own plane, or in the reference view, is bent by the same perspective as the object:
    each of its directions is carried over by the derivative of the homography at the contact.

    Args:
        result: contacts and their analysis; empty without them.
        length: px from apex to arc.
    """
    if result.contacts is None or result.analysis is None:
        return []
    half, H = math.atan(result.analysis.friction), None
    if result.homography is not None and result.analysis.judged_in == "reference":
        H = result.homography
    elif result.homography is not None and result.rectification is not None and result.analysis.judged_in == "plane":
        H = result.homography @ np.linalg.inv(result.rectification)
    polygons = []
    for contact, normal in zip(result.contacts, result.analysis.normals, strict=False):
        angles = math.atan2(normal[1], normal[0]) + half * _ARC
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        if H is not None:
            directions = directions @ jacobian_at(H, contact).T
        norms = np.linalg.norm(directions, axis=1, keepdims=True)
        if not np.isfinite(norms).all() or norms.min() <= 0.0:
            continue
        polygons.append(np.vstack([contact, contact + length * directions / norms]))
    return polygons


def jacobian_at(H_current_reference: Floats, point: Floats) -> Floats:
    """(2, 2) derivative of a homography at the reference point that it maps to `point` of the current view."""
    H = H_current_reference / np.linalg.norm(H_current_reference)
    u, v, w = np.linalg.solve(H, np.array([point[0], point[1], 1.0]))
    scale = float(H[2] @ np.array([u / w, v / w, 1.0]))
    x, y = point
    J: Floats = np.array([H[0, :2] - x * H[2, :2], H[1, :2] - y * H[2, :2]]) / scale
    return J


def cone_length(contacts: Floats, unit: float) -> float:
    """px; a third of the way to the contacts' middle on either side, within what is legible."""
    reach = float(np.linalg.norm(contacts - contacts.mean(axis=0), axis=1).mean())
    return min(max(0.62 * reach, 14.0 * unit), 64.0 * unit)
