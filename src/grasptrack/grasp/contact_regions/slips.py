# SPDX-License-Identifier: Apache-2.0
"""The places to which one contact may slip, and what changes there."""

from __future__ import annotations

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import Outline
from grasptrack.typing import Bools, Floats

SAMPLES = 60
"""BoundarySamples to each side that are looked at, close together near the contact and wider apart away from it."""


class BoundarySamples:
    """Where one contact may slip to: places on both sides of it, its own in the middle."""

    def __init__(self, outline: Outline, contour: int, position: float, reach: float, width: float) -> None:
        line = outline.contours[contour]
        s = line.arc_length
        here = float(np.interp(position, np.arange(len(s)), s))
        steps = min(reach, 0.5 * line.length) * (np.arange(SAMPLES + 1) / SAMPLES) ** 2
        self.at: Floats = np.concatenate([-steps[:0:-1], steps])
        along = np.mod(here + self.at, line.length)
        position_of = np.interp(along, s, np.arange(len(s), dtype=np.float64)) % len(line)
        places = np.column_stack([np.full(len(along), float(contour)), position_of])
        self.contacts: Floats = kernels.point_at(outline.points, outline.offsets, places)
        frames = kernels.contact_frames(outline.points, outline.offsets, places, width)
        self.normals: Floats = np.ascontiguousarray(frames[:, :2])
        self.usable: Bools = np.ones(len(along), dtype=np.bool_)
        if line.clipped is not None:
            cut = (
                line.clipped[np.floor(position_of).astype(np.int64)]
                | line.clipped[np.ceil(position_of).astype(np.int64) % len(line)]
            )
            self.usable = ~cut
        n = self.normals
        between = np.arctan2(
            np.abs(n[:-1, 0] * n[1:, 1] - n[:-1, 1] * n[1:, 0]), (n[:-1] * n[1:]).sum(axis=1)
        )  # by what the normal turns from one place to the next
        self.turn: Floats = np.maximum(np.append(between, 0.0), np.insert(between, 0, 0.0))
        gaps = np.diff(self.at)
        self.gap: Floats = 0.5 * np.maximum(np.append(gaps, 0.0), np.insert(gaps, 0, 0.0))

    def edges(self, centre: Floats, rho: float, friction: float) -> Floats:
        """(m, 2, 3) both edges of the friction cone at each place, as wrenches."""
        n = self.normals
        t = np.column_stack([-n[:, 1], n[:, 0]])
        forces = np.stack([n + friction * t, n - friction * t], axis=1)
        arms = (self.contacts - centre) / rho
        torque = arms[:, None, 0] * forces[..., 1] - arms[:, None, 1] * forces[..., 0]
        return np.concatenate([forces, torque[..., None]], axis=2)
