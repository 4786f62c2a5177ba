# SPDX-License-Identifier: Apache-2.0
"""Which motions an outline shows: from the normal equations of a registration."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack.equality import compared_by_value
from grasptrack.geometry.homographies import displacement_fields, whitening_matrix
from grasptrack.typing import Floats

MODELS = {"similarity": 4, "affine": 6, "homography": 8}
"""Parameters of each model, the first so many of a homography's."""
NAMES = ("shift along", "shift across", "scale", "turn", "stretch along", "shear", "bend along", "bend across")
"""The motions that a homography is made of near the identity, in the frame of the outline's inertia axes."""
TURN = NAMES.index("turn")
SLIDING = 0.16
"""A motion whose part along the normals is, rms, less than this share of itself is not seen, for noise does as much."""
FREE = 0.4
"""A motion is not shown when so much of it, by its square, lies among those that slide the outline along itself."""


@compared_by_value
class Motion(NamedTuple):
    """One motion.

    Attributes:
        name: one of NAMES.
        shown: 0 to 1: of the motion, how much is across the outline and moves its edges, rms; below SLIDING the tracker
            takes it as not seen.
        observed: in which models it is told from the other motions.
    """

    name: str
    shown: float
    observed: tuple[str, ...]


@compared_by_value
class MotionModel(NamedTuple):
    """A model of the motion.

    Attributes:
        name: "similarity", "affine" or "homography".
        observable: the outline shows all its motions.
        weakest: 0 to 1, the part across the outline of the motion that it shows least; the tracker asks for SLIDING.
        least: the named motion that is most like that one.
        unswayed: 0 to 1, `weakest` had the normals no noise that is taken off: what is much more than `weakest` is hidden by
            noise, not by the shape.
    """

    name: str
    observable: bool
    weakest: float
    least: str
    unswayed: float


class Basis(NamedTuple):
    """Coordinates in which motions are told: the outline's inertia axes about its centre, px, in units of sqrt(area), px.

    Axes are unit rows (2, 2): along and across.
    """

    centre: Floats
    axes: Floats
    size: float

    def place_points(self, points: Floats) -> Floats:
        """(m, 2) points of the image, px, in the frame."""
        return np.asarray((points - self.centre) @ self.axes.T / self.size)


@compared_by_value
class Motions(NamedTuple):
    """What an outline shows.

    Attributes:
        motions: all eight.
        models: by name.
        frame: in which the motions are told.
        slide: (8,) parameters in the frame of the motion, of the smallest model that has any, which the outline shows least,
            moving it by 1 px rms; None where it shows all.
    """

    motions: tuple[Motion, ...]
    models: dict[str, MotionModel]
    frame: Basis
    slide: Floats | None


def motions_of(points: Floats, normals: Floats, frame: Basis, sway: float = 0.0) -> Motions:
    """What edges at points (m, 2) px with normals (m, 2), those that a registration uses, show of a motion.

    `sway`, rad, is the standard deviation of the normals' directions; what this makes of a motion along the outline is no sign
    of it.
    """
    fields = displacement_fields(frame.place_points(points))
    across = normals @ frame.axes.T
    along = np.column_stack([-across[:, 1], across[:, 0]])
    models, seen = {}, {}
    slide = None
    for name, count in MODELS.items():
        own = whitening_matrix(fields[:, :, :count])
        named = np.linalg.inv(own)  # columns: the named motions, in motions of their own
        A = np.einsum("mi,mij->mj", across, fields[:, :, :count]) @ own
        B = np.einsum("mi,mij->mj", along, fields[:, :, :count]) @ own
        told, V = np.linalg.eigh(A.T @ A - sway**2 * (B.T @ B))
        slides = told <= SLIDING**2 * len(points)
        parts = np.square(V.T @ named) / np.square(named).sum(axis=0)
        models[name] = MotionModel(
            name,
            not slides.any(),
            math.sqrt(max(told.item(0), 0.0) / max(len(points), 1)),
            NAMES[int(parts[0].argmax())],
            math.sqrt(max(float(np.linalg.eigvalsh(A.T @ A)[0]), 0.0) / max(len(points), 1)),
        )
        seen[name] = parts[slides].sum(axis=0) <= FREE
        if slide is None and slides.any():
            slide = np.concatenate([own @ V[:, 0], np.zeros(8 - count)])
    moved = np.sqrt(np.square(fields).sum(axis=(0, 1)))
    part = np.square(np.einsum("mi,mij->mj", across, fields)).sum(axis=0)
    part -= sway**2 * np.square(np.einsum("mi,mij->mj", along, fields)).sum(axis=0)
    part = np.sqrt(np.maximum(part, 0.0)) / np.maximum(moved, 1e-300)
    listed = tuple(
        Motion(name, float(part[i]), tuple(m for m, n in MODELS.items() if i < n and seen[m][i]))
        for i, name in enumerate(NAMES)
    )
    return Motions(listed, models, frame, slide)


def sliding_displacement(motions: Motions, points: Floats) -> Floats:
    """(m, 2) px by which the motion that an outline shows least moves points (m, 2) px; zero where it shows all."""
    if motions.slide is None:
        return np.zeros_like(points)
    frame = motions.frame
    return np.asarray(displacement_fields(frame.place_points(points)) @ motions.slide @ frame.axes)
