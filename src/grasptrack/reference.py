# SPDX-License-Identifier: Apache-2.0
"""The reference view: the grasp as it was chosen, and all that is kept of the image it was chosen in."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.analysis import FINGER_WIDTH, GraspAnalysis, analyze
from grasptrack.carriers import Carrier, RegistrationCarrier, SilhouetteCarrier, SnakeCarrier
from grasptrack.contour import View
from grasptrack.errors import StrategyError, TransferError
from grasptrack.grasp import Grasp
from grasptrack.observation.flanks import Flanks
from grasptrack.observation.images import Grey
from grasptrack.observation.interior import Interior
from grasptrack.observation.segmentation import clearance
from grasptrack.observation.support import OutlineSamples
from grasptrack.projective import apply_homography, similarity
from grasptrack.transfer.alignment import alignments, as_similarity

Floats = NDArray[np.float64]

AUTO = "auto"

SYMMETRIC = 0.85
"""Of a turned outline, at least so much must lie on the object's own edges for the turn to be a symmetry."""


ROUND_TURNS = 48
"""Turns in which a surface is compared where the outline shows none."""


class Reference:
    """A grasp in the view in which it was chosen; every later view is registered to this one, so nothing drifts.

    Args:
        grasp: the contacts, on the outline.
        view: the outline.
        grey: the image.
        strategy: "auto" or the name of one.
        polarity: +1 object darker than its surroundings, -1 lighter.
        friction: Coulomb coefficient.
        hidden: (H, W) nonzero where nothing belongs to a scene.

    Raises:
        TransferError: no strategy asked for can describe this grasp on this outline; the message is the reason.
    """

    def __init__(
        self,
        grasp: Grasp,
        view: View,
        grey: Grey,
        strategy: str,
        polarity: int,
        friction: float,
        hidden: Grey | None = None,
    ) -> None:
        self.grasp = grasp
        self.view = view
        self.friction = friction
        area, x, y, *_ = kernels.inertia(view.points, view.offsets)
        self.centre = float(x), float(y)
        self.size = math.sqrt(area)
        self.width = FINGER_WIDTH * self.size
        self.analysis = analyze(grasp, view, friction, self.width, "reference")
        self.samples = OutlineSamples(view, grey, grasp.contacts, self.width, polarity, hidden)
        own = self.samples.outline
        self.flanks = Flanks(self.samples.points[own], self.samples.normals[own], grey, self.size, clearance(hidden))
        self.carriers = _carriers(strategy, grasp, view, grey)
        self.symmetry, self.turns = _symmetries(view, grey, self.samples, grasp.contacts)
        self.registration = _registration(grasp, view, grey, polarity, hidden, self.turns) if strategy == AUTO else None
        self.interior = Interior(view, grey)
        self._outline = np.ascontiguousarray(view.outer.points[:: max(1, len(view.outer) // 64)])
        self._holes = np.array([c.points.mean(axis=0) for c in view.contours[1:]]).reshape(-1, 2)

    def expected(self, H: Floats) -> tuple[Floats, Floats]:
        """Points of the outer contour and centres of the holes as a homography carries them."""
        return apply_homography(H, self._outline), apply_homography(H, self._holes)

    def carried_back(self, contacts: Floats, H: Floats) -> GraspAnalysis:
        """Analysis of contacts of a current view in the reference: perspective bends friction cones.

        Raises:
            GraspError: a contact is not on the reference outline.
        """
        back = apply_homography(np.linalg.inv(H), contacts)
        return analyze(Grasp.of(back), self.view, self.friction, self.width, "reference")

    def corrected(self, H: Floats, view: View) -> Floats:
        """A predicted homography moved and scaled so that the outline's centroid and area are those observed."""
        if view.is_clipped or self.view.is_clipped:
            return H
        area, x, y, *_ = kernels.inertia(view.outer.points, view.outer.offsets)
        moved = apply_homography(H, self._outline)
        wanted, u, v, *_ = kernels.inertia(np.ascontiguousarray(moved), np.array([0, len(moved)], dtype=np.int64))
        s = math.sqrt(area / abs(wanted))
        return np.array([[s, 0.0, x - s * u], [0.0, s, y - s * v], [0.0, 0.0, 1.0]]) @ H


def _symmetries(view: View, grey: Grey, samples: OutlineSamples, contacts: Floats) -> tuple[float, list[Floats]]:
    """rad, the smallest turn under which the reference image bears the outline out again, infinite without one; and (3, 3)
    all such turns: of a disc, which has no smallest one, many."""
    if view.is_clipped:
        return math.inf, []
    fits = alignments(view.outer, view.outer)
    if not fits:
        _, x, y, *_ = kernels.inertia(view.outer.points, view.outer.offsets)
        angles = np.arange(1, ROUND_TURNS) * (2.0 * math.pi / ROUND_TURNS)
        return 0.0, [similarity(1.0, float(angle), (x, y), (x, y)) for angle in angles]
    least, turns = math.inf, []
    for alignment in fits:
        if abs(alignment.angle) > 1e-3:
            H = as_similarity(alignment, view.outer, view.outer)
            if samples.support(grey, H, contacts).share >= SYMMETRIC:
                turns.append(H)
                least = min(least, abs(alignment.angle))
    return least, turns


def _carriers(strategy: str, grasp: Grasp, view: View, grey: Grey) -> list[Carrier]:
    """The strategies to use, in the order in which they are asked.

    Section III: a homography holds for all 6 DoF but needs four peaks of curvature; the grasp line holds for 4 DoF and
    needs two fingers, distinct axes and the whole object; RRP needs nothing but an outline that the snake can hold.
    """
    names = ("homography", "grasp-line", "rrp") if strategy == AUTO else (strategy,)
    carriers: list[Carrier] = []
    reasons: list[str] = []
    for name in names:
        if name == "grasp-line" and len(grasp) != 2 and strategy == AUTO:
            continue
        try:
            if name == "rrp":
                carriers.append(SnakeCarrier(grasp, view, grey, "affine" if strategy == AUTO else "similarity"))
            else:
                carriers.append(SilhouetteCarrier(name, grasp, view))
        except TransferError as error:
            reasons.append(str(error))
    if not carriers:
        raise TransferError(reasons[0], reasons=reasons)
    return carriers


def _registration(
    grasp: Grasp, view: View, grey: Grey, polarity: int, hidden: Grey | None, turns: list[Floats]
) -> RegistrationCarrier | None:
    try:
        return RegistrationCarrier(grasp, view, grey, polarity, hidden, turns)
    except TransferError:
        return None


def describable(grasp: Grasp, view: View) -> int:
    """How many of the strategies that work on silhouettes can describe a grasp."""
    count = 0
    for name in ("homography", "grasp-line"):
        try:
            SilhouetteCarrier(name, grasp, view)
            count += 1
        except (TransferError, StrategyError):
            continue
    return count
