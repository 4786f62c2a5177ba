# SPDX-License-Identifier: Apache-2.0
"""NumPy reference of the pose that an image asks for, step by step, and of what it leaves open at the contacts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_evidence import displacement_fields, near_identity
from grasptrack.kernels.reference_fusion import MotionEquations, motion_equations

Floats = NDArray[np.float64]


class Converged(NamedTuple):
    """A pose, and what the image says there.

    Attributes:
        homography: (3, 3) reference to current.
        moves: steps that were made.
        step: (8,) px, the motion in the basis of `evidence` that is still asked for.
        scatter: px, of all edges that were found there; NaN without any.
        evidence: at this pose; all NaN and 0 where it, or the next one, would send the outline to infinity.
    """

    homography: Floats
    moves: int
    step: Floats
    scatter: float
    evidence: MotionEquations


def converge(
    image: NDArray[np.uint8],
    coarse: NDArray[np.uint8],
    shrink: float,
    H: Floats,
    points: Floats,
    normals: Floats,
    strength: Floats,
    polarity: int,
    reach: float,
    least_strength: float,
    relative_strength: float,
    places: Floats,
    values: Floats,
    slopes: Floats,
    starts: NDArray[np.int64],
    use: NDArray[np.bool_],
    caution: float,
    loose: float,
    still: float,
    least: int,
    most: int,
    clear: NDArray[np.uint8] | None = None,
) -> Converged:
    """The pose to which an image leads from a first one, by Gauss-Newton's steps.

    Args:
        image, coarse, shrink, H, points, normals, strength, polarity, reach: as for `motion_equations`, and ...
        least_strength, relative_strength, places, values, slopes, starts: ... so are these.
        use: (1 + G,) whether the outline and each surface are asked.
        caution: how many times its noise a surface is taken to have.
        loose: px, how large a motion may be of which nothing is seen.
        still: px rms, a step below which no more are made.
        least, most: steps.
        clear: as for `motion_equations`.

    Raises:
        ValueError: as `motion_equations`; flags of another number; nothing loose.
    """
    moves = 0
    while True:
        found = motion_equations(
            image,
            coarse,
            shrink,
            H,
            points,
            normals,
            strength,
            polarity,
            reach,
            least_strength,
            relative_strength,
            places,
            values,
            slopes,
            starts,
            clear,
        )
        if len(use) != len(starts):
            raise ValueError(f"the outline and each surface are in use or not: {len(starts)} flags")
        if not loose > 0.0:
            raise ValueError(f"motions are loose by more than 0 px, not {loose:g}")
        if not math.isfinite(found.radius):
            return Converged(H, moves, np.full(8, np.nan), math.nan, found)
        share = shares(found.stats, use, caution)
        step = np.asarray(np.linalg.solve(np.tensordot(share, found.N, 1) + np.eye(8) / loose**2, share @ found.b))
        if moves >= most or (moves >= least and math.sqrt(float(step @ step)) < still):
            return Converged(H, moves, step, _scatter(found.left), found)
        further = near_identity(found.basis @ step / found.radius, found.centre, found.radius) @ H
        if not abs(further[2, 2]) > 1e-12:
            return Converged(H, moves, np.full(8, np.nan), math.nan, _nothing(found))
        H = np.asarray(further / further[2, 2])
        moves += 1


def _scatter(left: Floats) -> float:
    left = np.abs(left[np.isfinite(left)])
    return 1.4826 * float(np.median(left)) if len(left) else math.nan


def _nothing(found: MotionEquations) -> MotionEquations:
    """What is said where there is nothing to see."""
    return MotionEquations(
        centre=np.full(2, np.nan),
        radius=math.nan,
        basis=np.full((8, 8), np.nan),
        N=np.zeros_like(found.N),
        sure=np.zeros_like(found.sure),
        b=np.zeros_like(found.b),
        stats=np.zeros_like(found.stats),
        left=np.full_like(found.left, np.nan),
        weights=np.zeros_like(found.weights),
    )


def shares(stats: Floats, use: NDArray[np.bool_], caution: float) -> Floats:
    """(1 + G,) weights of pieces of evidence, one over the squares of their noise; 0 of what is not used.

    Args:
        stats: (1 + G, 4) of `MotionEquations`.
        use: (1 + G,) flags.
        caution: as for `converge`.
    """
    noise = stats[:, 2].copy()
    noise[1:] *= caution
    return np.where(use & (noise > 0.0), 1.0 / np.maximum(noise, 1e-9) ** 2, 0.0)


def seen_motion(N: Floats, b: Floats, least: float) -> tuple[float, float]:
    """The size of the motion x that solves N x = b, as far as N shows it, and x' N x.

    Args:
        N: (8, 8) squares.
        b: (8,) products.
        least: motions of which N shows less than this share of what it shows of the clearest are left out.

    Raises:
        ValueError: arrays of other shapes.
    """
    if N.shape != (8, 8) or b.shape != (8,):
        raise ValueError("eight motions are needed")
    told, V = np.linalg.eigh(N)
    seen = told > least * told[-1]
    x = (V.T @ b)[seen] / told[seen]
    return math.sqrt(float(x @ x)), float(x @ (told[seen] * x))


def contact_covariance(
    H: Floats, contacts: Floats, centre: Floats, radius: float, basis: Floats, sure: Floats, share: Floats, loose: float
) -> Floats:
    """(2 k, 2 k) px^2, what the evidence leaves open at contacts, jointly: x1, y1, x2, ...

    Args:
        H: (3, 3) reference to current.
        contacts: (k, 2) px in the reference.
        centre, radius, basis, sure: of `MotionEquations` at this pose.
        share: (1 + G,) weights of the evidence.
        loose: px, as for `converge`.

    Raises:
        ValueError: arrays of other shapes.
    """
    if sure.shape != (len(share), 8, 8) or basis.shape != (8, 8) or centre.shape != (2,):
        raise ValueError("eight motions are needed, and of each piece of evidence its squares and share")
    at = (contacts @ H[:2, :2].T + H[:2, 2]) / (contacts @ H[2, :2] + H[2, 2])[:, None]
    rows = (displacement_fields((at - centre) / radius) @ basis).reshape(-1, 8)
    C = np.linalg.inv(np.tensordot(share, sure, 1) + np.eye(8) / loose**2)
    return np.asarray(rows @ C @ rows.T)
