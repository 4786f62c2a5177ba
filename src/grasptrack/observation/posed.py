# SPDX-License-Identifier: Apache-2.0
"""What the outline, the object's surface and the ground say at one pose, each by itself and together."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.errors import TransferError
from grasptrack.kernels.reference_evidence import MOTIONS, displacement_fields, near_identity
from grasptrack.projective import apply_homography

Floats = NDArray[np.float64]

INSIDE, GROUND = 1, 2
"""Rows of the evidence; 0 is the outline."""
APART, APART_SIGMA = 0.1, 6.0
"""px, and standard deviations, by which the outline alone asks for another pose when a surface does not move along."""
SEEN = 0.05
"""Motions of which the outline shows less than this share of what it shows of the clearest are not asked for."""
CAUTION = 2.0
"""How many times its noise a surface is taken to have: it has light and reflections of its own."""


class Fused(NamedTuple):
    """A pose and what bears it out.

    Attributes:
        homography: (3, 3) reference to current.
        covariance: (2 k, 2 k) px^2 of the contacts, jointly: x1, y1, x2, ...
        agreement: share of the outline's samples in the image whose edges agree, 0 to 1.
        noise: px, of these edges.
        scatter: px, of all edges that were found: with covers it exceeds the noise.
        surface, ground: correlation of the object's surface and of the ground round it with the reference, -1 to 1; NaN
            where there is nothing to compare.
        used: whether the pose rests on the outline, the surface and the ground.
        held: whether the surfaces alone fix each contact: no cover of the outline can bend the pose then.
        by: how many times the image was shrunk in which surfaces were compared, with a minus without its light.
        leverage: px by which a contact is moved at most by edges that are off by 1 px, rms, however they may be.
        homography_covariance: (9, 9) of the entries of the homography, row by row, its last one being 1.
    """

    homography: Floats
    covariance: Floats
    agreement: float
    noise: float
    scatter: float
    surface: float
    ground: float
    used: tuple[bool, bool, bool]
    held: bool
    by: int
    leverage: float
    homography_covariance: Floats


def leverage(covariance: Floats, count: float, noise: float) -> float:
    """px by which a contact is moved at most by edges that are off by 1 px, rms, in whatever way: exact where edges alone tell
    the pose, and a bound where more does.

    Args:
        covariance: (2 k, 2 k) px^2 of the contacts.
        count: of the edges, weighed.
        noise: px, of one edge, which that covariance supposes.
    """
    most = 0.0
    for i in range(0, len(covariance), 2):
        (xx, xy), (_, yy) = covariance[i : i + 2, i : i + 2].tolist()
        most = max(most, 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy))
    return math.sqrt(count * most) / noise


class Posed:
    """The evidence at one pose, as `kernels.converge` found it.

    Args:
        found: what the kernel told.
        use: whether the outline, the surface and the ground were asked.
        by: how many times the image was shrunk in which surfaces were compared, with a minus without its light.
        loose: px, how large a motion may be of which nothing is seen.
        contacts: (k, 2) px in the reference.

    Raises:
        TransferError: the pose would send the outline behind the camera.
    """

    def __init__(self, found: Any, use: list[bool], by: int, loose: float, contacts: Floats) -> None:
        self.H: Floats = found[0]
        self.moves: int = found[1]
        self.step = float(np.linalg.norm(found[2]))
        self.scatter: float = found[3]
        evidence = found[4]
        self._centre, self._radius, self._basis, self._N, self._sure, self._b, stats, *_ = evidence
        if not math.isfinite(self._radius):
            raise TransferError("the outline would lie behind the camera")
        self.use, self.by, self._loose, self._contacts = use, by, loose, contacts
        self.stats: list[list[float]] = stats.tolist()

    def told(self, row: int) -> bool:
        """Whether a piece of evidence is used and says anything."""
        return self.use[row] and self.stats[row][2] > 0.0

    def alike(self, row: int) -> float:
        """Correlation of a surface with the reference."""
        return self.stats[row][3]

    def parted(self, row: int, most: float = APART_SIGMA) -> bool:
        """Whether one piece of evidence alone asks for another pose than all of it together."""
        if not self.told(row):
            return False
        noise = self.stats[row][2] * (1.0 if row == 0 else CAUTION)
        apart, squares = kernels.seen_motion(self._N[row], self._b[row], SEEN)
        return apart > APART and math.sqrt(squares) > most * noise

    def covariance(self, use: list[bool]) -> Floats:
        """(2 k, 2 k) px^2 of the contacts, by some of the evidence."""
        return kernels.contact_covariance(
            self.H,
            self._contacts,
            self._centre,
            self._radius,
            self._basis,
            self._sure,
            self._shares(use),
            self._loose,
        )

    def homography_covariance(self, use: list[bool]) -> Floats:
        """(9, 9) of the entries of H, row by row, its last one being 1, by some of the evidence."""
        known = (self._shares(use) @ self._sure.reshape(len(self._sure), 64)).reshape(8, 8)
        C = np.linalg.inv(known + np.eye(8) / self._loose**2)
        (x, y), r = self._centre, self._radius
        there = np.array([[r, 0.0, x], [0.0, r, y], [0.0, 0.0, 1.0]])
        back = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, r]]) / r
        moves = there @ (self._basis.T @ MOTIONS.reshape(8, 9)).reshape(8, 3, 3) @ (back @ self.H / r)
        entries = (moves - moves[:, 2:, 2:] * self.H).reshape(8, 9)
        return np.asarray(entries.T @ C @ entries)

    def _shares(self, use: list[bool]) -> Floats:
        """(3,) weight of each piece of evidence."""
        noise = [self.stats[0][2], *(CAUTION * each[2] for each in self.stats[1:])]
        return np.array([1.0 / n**2 if used and n > 0.0 else 0.0 for used, n in zip(use, noise, strict=True)])

    def deviation(self, use: list[bool] | None = None) -> float:
        """px, the largest standard deviation of a contact in x or y."""
        return math.sqrt(float(self.covariance(self.use if use is None else use).diagonal().max()))

    def leverage(self, covariance: Floats) -> float:
        """As the function of this name; infinite where the outline is not asked.

        Args:
            covariance: (2 k, 2 k) px^2 of the contacts, as the evidence in use leaves it.
        """
        count, _, noise, _ = self.stats[0]
        return leverage(covariance, count, noise) if self.told(0) else math.inf

    def slid(self, by: float) -> tuple[Floats, Floats]:
        """(3, 3) each, the poses to either side in which the contacts have moved by so many px, rms, the way that the outline
        shows least."""
        at = apply_homography(self.H, self._contacts)
        rows = (displacement_fields((at - self._centre) / self._radius) @ self._basis).reshape(-1, 8)
        share = 1.0 / max(self.stats[0][2], 1e-9) ** 2
        C = np.linalg.inv(share * self._sure[0] + np.eye(8) / self._loose**2)
        freest = np.linalg.eigh(rows @ C @ rows.T)[1][:, -1]
        motion = C @ rows.T @ freest
        motion *= by * math.sqrt(len(at)) / float(np.linalg.norm(rows @ motion))
        step = self._basis @ motion / self._radius
        there, back = (near_identity(sign * step, self._centre, self._radius) @ self.H for sign in (1.0, -1.0))
        return there / there[2, 2], back / back[2, 2]
