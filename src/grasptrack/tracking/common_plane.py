# SPDX-License-Identifier: Apache-2.0
"""The plane that several parts of one image lie in: what its own outline leaves open of a pose the others may tell.

Images of parts in one plane differ by no more than similarities, but for what rectifies this image and those that taught the
parts: R(image) G R(taught)^-1 is a similarity for each pose G, with one R for the image and one for each kind of part. An
outline of few arcs, as a crescent's, slides along itself under one motion, which turns with the part, so that the others tell
how far. All of a kind that slide as far look like an image that taught them aslant: where the camera leans as it did then, the
R of the image is that of the part as well, all have one scale, and nothing is left open. Whoever says so may err: the parts
tell. Parts that lean are told from those that lie flat by how well they agree with the rest.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import numpy as np

from grasptrack.geometry.homographies import MOTIONS
from grasptrack.tracking.evidence import MAX_EXPONENT
from grasptrack.tracking.target import Target
from grasptrack.typing import Floats

STRETCH = math.tan(math.pi / 8.0) ** 2
"""By how much a tilt of 45 degrees stretches what is seen, as a share of its size, ..."""
BEND = math.tan(math.radians(35.0))
"""... and by how much it bends it at the border of an image that is 70 degrees wide, ..."""
PART = 0.15
"""... of which a part fills so much."""
NEARER = 0.05
"""Share of the camera's distance by which a part that lies on others is nearer than they."""
OF_IMAGE = np.array([STRETCH, STRETCH, BEND, BEND])
"""Standard deviations of what rectifies an image, in units of half its width, ..."""
OF_PART = np.array([STRETCH, STRETCH, PART * BEND, PART * BEND])
"""... of what rectifies the image that taught a part, in units of half the part's size, ..."""
LEANING = np.append(OF_PART, NEARER)
"""... and of what a part deviates that leans, the log of its scale among it."""
SAME_TILT = 0.03
"""Share of OF_PART that is left where both images are seen under one tilt: one degree of 45."""
WRONGLY_SAID = 1e-3
"""Probability that a camera leans otherwise than is said."""
ANY_SCALE = 10.0
"""Standard deviation of the log of a scale that is not known."""
ANNEALED = (1.0, 0.3, 0.1, 0.03, 0.01, *[0.0] * 7)
"""Shares of what a part may lean that are taken for noise, round by round."""
STEP = 1e-4
"""Of the differences that stand for derivatives: a share of the unit."""
SETTLED = 1e-7
"""Of what rectifies the images; a round that changes no more is the last."""


class PlanePose:
    """A part's pose as the image alone tells it.

    Args:
        kind: which part it is, by a number.
        target: that part.
        G: (3, 3) work px -> px.
        P: (8, 8) covariance of its error, work px^2.
        size: (height, width) px of the image.
        taught: (3, 3) from work px to the image that taught the part, in units of half its width about its middle, where that
            was seen under the same tilt; None where nothing is known of it.

    Attributes:
        noise: (5,) variances of a deviation beside those of the pose's error: scales are compared under one tilt only.
    """

    def __init__(
        self, kind: int, target: Target, G: Floats, P: Floats, size: tuple[int, ...], taught: Floats | None = None
    ) -> None:
        self.kind, self.P, self.same_tilt = kind, P, taught is not None
        self.noise = np.array([0.0, 0.0, 0.0, 0.0, 0.0 if self.same_tilt else 1.0])
        half, (x, y) = 0.5 * target.size, target.centre
        part = np.array([[half, 0.0, x], [0.0, half, y], [0.0, 0.0, 1.0]])
        self._taught = np.eye(3) if taught is None else taught @ part
        self._step = STEP * target.size
        ways = [G, *(target.handle.moved(G, d) for d in self._step * np.eye(8))]
        self._ways: Floats = _to_unit(size) @ np.array(ways) @ part

    def forget_tilt(self) -> PlanePose:
        """The same, were nothing said of the tilt."""
        other = copy.copy(self)
        other.same_tilt, other.noise = False, np.array([0.0, 0.0, 0.0, 0.0, 1.0])
        return other

    def deviation(self, image: Floats, own: Floats) -> tuple[Floats, Floats]:
        """(5,) how unlike a similarity of a known scale it is, and (5, 8) by the pose's error.

        Args:
            image: (4,) what rectifies the image.
            own: (5,) what rectifies that of the part, and the log of the scale.
        """
        told = self._compute_deviations(image, own, self._ways)
        return told[0], (told[1:] - told[0]).T / self._step

    def by_rectifying(self, image: Floats, own: Floats) -> Floats:
        """(5, 9) the deviation's derivatives by what rectifies the image, and by each of `own`."""
        steps, way = STEP * np.eye(9), self._ways[:1]
        moved = self._compute_deviations(image + steps[:, :4], own + steps[:, 4:], way) - self._compute_deviations(
            image, own, way
        )
        return np.asarray(moved.T / STEP)

    def _compute_deviations(self, image: Floats, own: Floats, ways: Floats) -> Floats:
        """(n, 5) of each of some ways (n, 3, 3), or of one where the images are rectified by each of some numbers."""
        found = _unlikeness(_rectifying(image) @ ways @ self._map_from_plane(image, own))
        found[:, 4] = found[:, 4] - own[..., 4] if self.same_tilt else 0.0
        return found

    def _map_from_plane(self, image: Floats, own: Floats) -> Floats:
        """(..., 3, 3) from the plane, about the part, to the part's image in units of half the part's size."""
        R = _rectifying(own[..., :4])
        if self.same_tilt:
            seen = np.linalg.inv(self._taught) @ _rectifying(image) @ self._taught
            seen = seen / seen[..., 2:, 2:]
            about = np.zeros_like(seen) + np.eye(3)
            about[..., :2, 2] = -seen[..., :2, 2]
            R = R @ about @ seen
        return np.asarray(np.linalg.inv(R))


class CommonPlane:
    """The plane in which most of some parts lie, as far as they tell it.

    Args:
        poses: of the parts.

    Attributes:
        doubt: probability that the camera leans otherwise than is said.
    """

    doubt = 0.0

    @classmethod
    def of(cls, poses: Sequence[PlanePose]) -> CommonPlane:
        """The plane under the tilt that is said, or under any where the parts show that it is not that one."""
        said = cls(poses)
        if not said.is_said:
            return said
        free = cls([pose.forget_tilt() for pose in poses])
        odds = WRONGLY_SAID * math.exp(min(free.measure_evidence() - said.measure_evidence(), MAX_EXPONENT))
        said.doubt = odds / (1.0 + odds)
        return free if odds > 1.0 else said

    def __init__(self, poses: Sequence[PlanePose]) -> None:
        self._poses, kinds = list(poses), sorted({p.kind for p in poses})
        self._at = [slice(4 + 5 * kinds.index(p.kind), 9 + 5 * kinds.index(p.kind)) for p in poses]
        tilts = {p.kind: SAME_TILT if p.same_tilt else 1.0 for p in poses}
        own = [np.append(tilts[kind] * OF_PART, ANY_SCALE) for kind in kinds]
        self._prior = np.concatenate([OF_IMAGE, *own]) ** -2.0
        self._x = np.zeros(len(self._prior))
        for at in self._at:
            alike = [p for p, other in zip(poses, self._at, strict=True) if other == at]
            self._x[at.stop - 1] = np.median([p.deviation(np.zeros(4), np.zeros(5))[0][4] for p in alike])
        self._flat = 0.5
        self._terms: list[tuple[Floats, Floats]] = []
        for share in ANNEALED:
            if self._next_round(share) < SETTLED and share == 0.0:
                break

    def _next_round(self, share: float) -> float:
        """One step of Gauss and Newton, each part weighed by the probability that it lies flat. How far it led."""
        self._terms, flat = [], 0.0
        for pose, at in zip(self._poses, self._at, strict=True):
            told, by_pose = pose.deviation(self._x[:4], self._x[at])
            own = pose.by_rectifying(self._x[:4], self._x[at])
            D = np.zeros((5, len(self._x)))
            D[:, :4], D[:, at] = own[:, :4], own[:, 4:]
            S = _spread(told, by_pose, pose.P) + np.diag(pose.noise + (share * LEANING) ** 2)
            weight = _flat_probability(told, S, self._flat)
            flat += weight
            by = weight * np.linalg.solve(S, D).T
            self._terms.append((by @ D, -by @ told))
        self._flat = (flat + 1.0) / (len(self._poses) + 2.0)
        A = np.diag(self._prior) + sum(term[0] for term in self._terms)
        step = np.linalg.solve(A, sum(term[1] for term in self._terms) - self._prior * self._x)
        self._x = self._x + step
        return float(np.abs(step).max())

    @property
    def is_said(self) -> bool:
        """Whether it is seen under the tilt under which parts were taught, as somebody says."""
        return any(pose.same_tilt for pose in self._poses)

    def prior_of(self, k: int, pose: PlanePose, P: Floats) -> tuple[Floats, Floats]:
        """What the other parts tell of one: how far (8,) it is off, and (8, 8) the covariance of what they leave open.

        Args:
            k: which of the parts it is.
            pose: from which on, another than its own perhaps.
            P: (8, 8) how far it may be off as long as nothing is told.
        """
        told, by_pose, spread = self._without(k, pose if self._poses[k].same_tilt else pose.forget_tilt())
        gain = np.linalg.solve(_spread(told, by_pose, P) + spread, by_pose @ P).T
        left = P - gain @ by_pose @ P
        return np.asarray(-gain @ told), np.asarray(0.5 * (left + left.T))

    def rectification(self, size: tuple[int, ...]) -> Floats:
        """(3, 3) from px of the image, (height, width), to the plane, up to a similarity."""
        return np.asarray(_rectifying(self._x[:4]) @ _to_unit(size))

    def leaning_probability(self, k: int) -> float:
        """Probability that a part does not lie in the plane of the others, as far as the image alone tells its pose, or that
        the plane is another one."""
        pose = self._poses[k]
        told, by_pose, spread = self._without(k, pose)
        flat = _flat_probability(told, _spread(told, by_pose, pose.P) + spread, self._flat)
        return 1.0 - flat * (1.0 - self.doubt)

    def measure_evidence(self) -> float:
        """Log of the probability of how the parts stretch and bend in it, by Laplace's approximation, up to a constant."""
        A, told_by_all = np.diag(self._prior), 0.0
        for pose, at in zip(self._poses, self._at, strict=True):
            told, by_pose = pose.deviation(self._x[:4], self._x[at])
            S, bends = _spread(told, by_pose, pose.P)[:4, :4], told[:4]
            logs = [
                math.log(share) - 0.5 * (float(bends @ np.linalg.solve(C, bends)) + float(np.linalg.slogdet(C)[1]))
                for share, C in ((self._flat, S), (1.0 - self._flat, S + np.diag(OF_PART**2)))
            ]
            both = float(np.logaddexp(logs[0], logs[1]))
            by_plane = pose.by_rectifying(self._x[:4], self._x[at])[:4]
            D = np.zeros((4, len(self._x)))
            D[:, :4], D[:, at] = by_plane[:, :4], by_plane[:, 4:]
            A = A + math.exp(logs[0] - both) * D.T @ np.linalg.solve(S, D)
            told_by_all += both
        x = self._x.copy()
        x[8::5] = 0.0  # scales are no matter of the tilt
        told_by_all -= 0.5 * float(x @ (self._prior * x))
        return told_by_all + 0.5 * float(np.log(self._prior).sum() - np.linalg.slogdet(A)[1])

    def _without(self, k: int, pose: PlanePose) -> tuple[Floats, Floats, Floats]:
        """(5,) how far a pose of one part is from the others' plane, (5, 8) by its error, and (5, 5) how well they know it."""
        A = np.diag(self._prior) + sum(term[0] for i, term in enumerate(self._terms) if i != k)
        C = np.linalg.inv(A)
        x = self._x - C @ (self._terms[k][1])
        image, own = x[:4], x[self._at[k]]
        told, by_pose = pose.deviation(image, own)
        by_plane = pose.by_rectifying(image, own)
        D = np.zeros((5, len(x)))
        D[:, :4], D[:, self._at[k]] = by_plane[:, :4], by_plane[:, 4:]
        return told, by_pose, np.asarray(D @ C @ D.T) + np.diag(pose.noise)


def _to_unit(size: tuple[int, ...]) -> Floats:
    """(3, 3) from px of an image, (height, width), to half its width about its middle."""
    return np.array([[1.0, 0.0, -0.5 * size[1]], [0.0, 1.0, -0.5 * size[0]], [0.0, 0.0, 0.5 * size[1]]])


def _rectifying(x: Floats) -> Floats:
    """(..., 3, 3) homographies that stretch and bend by so much (..., 4)."""
    return np.asarray(np.eye(3) + np.tensordot(x, MOTIONS[4:], axes=1), dtype=np.float64)


def _unlikeness(S: Floats) -> Floats:
    """(n, 5) how homographies (n, 3, 3) stretch and bend what lies about the origin, 0 of a similarity, and the log of their
    scale there."""
    S = S / S[:, 2:, 2:]
    J = S[:, :2, :2] - S[:, :2, 2:] * S[:, 2:, :2]
    alike = J[:, 0, 0] + J[:, 1, 1] + 1j * (J[:, 1, 0] - J[:, 0, 1])
    stretch = (J[:, 0, 0] - J[:, 1, 1] + 1j * (J[:, 1, 0] + J[:, 0, 1])) / alike
    return np.column_stack([stretch.real, stretch.imag, S[:, 2, :2], np.log(0.5 * np.abs(alike))])


def _spread(told: Floats, by_pose: Floats, P: Floats) -> Floats:
    """(5, 5) covariance of a deviation (5,) of a pose known with P (8, 8): what is linear in its error leaves out a square.

    That error is no larger than what deviates, nor than P lets it be.
    """
    linear = by_pose @ P @ by_pose.T
    return np.asarray(linear + min(float(told @ told), float(np.trace(linear))) ** 2 * np.eye(5))


def _flat_probability(told: Floats, S: Floats, share: float) -> float:
    """Probability that what deviates from a plane by so much (5,), known with covariance S (5, 5), lies in it."""
    odds = math.log(share / (1.0 - share))
    for sign, covariance in ((1.0, S), (-1.0, S + np.diag(LEANING**2))):
        odds -= 0.5 * sign * (float(told @ np.linalg.solve(covariance, told)) + float(np.linalg.slogdet(covariance)[1]))
    return 1.0 / (1.0 + math.exp(min(-odds, MAX_EXPONENT)))
