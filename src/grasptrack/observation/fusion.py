# SPDX-License-Identifier: Apache-2.0
"""The pose on all the evidence at once: the outline's edges, the object's surface, and the ground round it.

An outline leaves motions open that slide it along itself: a disc turns, a pencil slips. What is printed, scratched or
grown on the object settles them, and so does the ground, as long as it moves along with the object.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import View
from grasptrack.errors import TransferError
from grasptrack.kernels.reference_evidence import displacement_fields
from grasptrack.kernels.reference_registration import moved
from grasptrack.observation.images import Grey
from grasptrack.observation.registration import MIN_STRENGTH, RELATIVE_STRENGTH, OutlineRegistration
from grasptrack.observation.surface import Surfaces, shrunk, surfaces

Floats = NDArray[np.float64]

INSIDE, GROUND = 1, 2
"""Rows of the evidence; 0 is the outline."""
FEW, MANY, FIXED = 200, 900, 0.2
"""Places on each surface, in the finest image: few where the outline alone fixes each contact to so many px, else many."""
FINE, COARSE, COARSEST = 2, 4, 8
"""How many times the images are shrunk in which surfaces are compared: noise shrinks alike, and a coarse one is compared
over longer ways."""
REACH, FAR_REACH = 3.0, 6.0
"""px on either side in which edges are searched, with fine and with coarse surfaces."""
MOST_ROUNDS = 8
"""Steps until the pose stands still ..."""
STILL = 0.02
"""... which is when the outline moves by less than so many px, rms."""
FAINT = 0.6
"""A correlation below which noise hides much of a surface: a coarser image may show more of it."""
FADED = 0.15
"""A surface shows less than usual where its correlation is less by so much, ..."""
LACKING, LACKING_ALSO = 3.0, 0.03
"""... or where it lacks, of perfect correlation, so many times as much as usual and this besides."""
LEAST_ALIKE, ALIKE = 0.5, 0.8
"""Correlations below which a surface is none that moves along; from which on one that did not is looked at again."""
CHANCE = 4.0
"""A correlation is chance when it is below so many over the root of the number of places."""
OTHER = 0.3
"""A correlation less than usual by so much is another surface's, or that of another turn."""
HELD = 0.7
"""px: surfaces that fix each contact to so much hold the pose, whatever covers the outline."""
FORGETTING = 0.01
"""By how much less a correlation may get from image to image and still be usual."""
APART, APART_SIGMA = 0.1, 6.0
"""px, and standard deviations, by which the outline alone asks for another pose when a surface does not move along."""
SEEN = 0.05
"""Motions of which the outline shows less than this share of what it shows of the clearest are not asked for."""
CAUTION = 2.0
"""How many times its noise a surface is taken to have: it has light and reflections of its own."""
LOOSE = 0.25
"""What no evidence shows of a motion may be as large as this fraction of sqrt(area)."""


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
        by: how many times the image was shrunk in which surfaces were compared.
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


class Fusion:
    """Lays a reference view on images.

    Args:
        registration: of its outline.
        view, grey: the outline and the image of it.
        contacts: (k, 2) px.
        hidden: (H, W) nonzero where nothing belongs to the scene.
    """

    def __init__(
        self, registration: OutlineRegistration, view: View, grey: Grey, contacts: Floats, hidden: Grey | None = None
    ) -> None:
        self._outline, self._contacts = registration, contacts
        self._size = math.sqrt(view.outer.area)
        self._trusted = [True, True, True]
        self._usual = {by: [-1.0, -1.0, -1.0] for by in (FINE, COARSE, COARSEST)}
        self._seen: tuple[Grey, dict[int, Grey]] | None = None
        self._surfaces = {by: surfaces(view, grey, by, MANY, hidden) for by in (FINE, COARSE, COARSEST)}
        if self._look(grey, np.eye(3), FINE, [True, False, False]).deviation(contacts) <= FIXED:
            self._surfaces[FINE] = surfaces(view, grey, FINE, FEW, hidden)

    @property
    def textured(self) -> bool:
        """Whether a surface bears poses out."""
        return any(self._trusted[1:])

    def refine(self, grey: Grey, H: Floats, *, far: bool = False) -> Fused:
        """The pose nearest to a first one that all the evidence asks for.

        Args:
            grey: (H, W).
            H: (3, 3) to begin with.
            far: it may be off by several px.

        Raises:
            TransferError: too little evidence.
        """
        state = self._settled(grey, H, self._trusted, far)
        for row in (GROUND, INSIDE):  # what does not move along must not bend the pose
            if state.told(row) and state.parted():
                state = self._settled(grey, H, [used and each != row for each, used in enumerate(state.use)], far)
        return self._told(state)

    @property
    def telling(self) -> bool:
        """Whether the object's surface is one that can be known again."""
        return max(usual[INSIDE] for usual in self._usual.values()) >= ALIKE

    @property
    def on_trusted_ground(self) -> bool:
        """Whether the ground moved along in the last image that was believed."""
        return self._trusted[GROUND] and max(usual[GROUND] for usual in self._usual.values()) > 0.0

    def differs(self, fused: Fused) -> bool:
        """Whether the object's surface, which was seen to be as in the reference, is not so in a pose."""
        usual = self._usual[fused.by][INSIDE]
        return usual >= ALIKE and math.isfinite(fused.surface) and fused.surface < usual - OTHER

    def settles(self, grey: Grey, fused: Fused, turns: list[Floats]) -> bool:
        """Whether the object's surface tells a pose from the pose turned by each of some symmetries."""
        if not fused.used[INSIDE] or fused.surface < LEAST_ALIKE:
            return False
        other = self.best(grey, [fused.homography @ turn for turn in turns], fused.surface - OTHER)
        return other is None

    def best(self, grey: Grey, poses: list[Floats], least: float = FAINT) -> Fused | None:
        """The pose in which the object's surface is most like the reference; None where in none it is so as asked."""
        seen = [self._look(grey, H, COARSE, [True, True, False]) for H in poses]
        seen = sorted((s for s in seen if s.told(INSIDE)), key=lambda s: -s.stats[INSIDE, 3])[:3]
        found = [self._converged(grey, s) for s in seen]
        found = [s for s in found if s.stats[INSIDE, 3] > least]
        return self._told(max(found, key=lambda s: float(s.stats[INSIDE, 3]))) if found else None

    def on_ground(self, grey: Grey, H: Floats) -> Floats | None:
        """(3, 3) where the object must lie if it went along with the ground, which alone is looked at; None where the
        ground does not tell.

        Args:
            grey: (H, W).
            H: (3, 3) where it was expected.
        """
        if not self._trusted[GROUND]:
            return None
        try:
            state = self._converged(grey, self._look(grey, H, COARSEST, [False, False, True]))
        except TransferError:
            return None
        if not state.told(GROUND) or self._weak(state, GROUND) or state.deviation(self._contacts) > HELD:
            return None
        return state.H

    def believe(self, fused: Fused) -> None:
        """The verdict accepted this one: from now on only what moved along is used."""
        usual = self._usual[fused.by]
        for row, correlation in ((INSIDE, fused.surface), (GROUND, fused.ground)):
            if math.isfinite(correlation):
                self._trusted[row] = fused.used[row] or correlation >= max(ALIKE, usual[row] - FADED)
                if self._trusted[row]:
                    usual[row] = max(correlation, usual[row] - FORGETTING)

    def _settled(self, grey: Grey, H: Floats, use: list[bool], far: bool) -> _State:
        state = self._converged(grey, self._look(grey, H, COARSEST if far else FINE, use))
        if not far and self._lacking(state):
            again = self._converged(grey, self._look(grey, H, COARSEST, use))
            state = min(state, again, key=self._lack)
        faint = any(state.told(row) and state.stats[row, 3] < FAINT for row in (INSIDE, GROUND))
        ends = [state, self._converged(grey, self._look(grey, state.H, COARSE, use), COARSE)] if faint else [state]
        for i, end in enumerate(ends):
            strong = [used and not self._weak(end, row) for row, used in enumerate(use)]
            if strong != use:
                ends[i] = self._converged(grey, self._look(grey, end.H, end.by, strong), end.by)
        return min(ends, key=lambda end: end.deviation(self._contacts))

    def _converged(self, grey: Grey, state: _State, end: int = FINE) -> _State:
        """Step by step, in ever finer images, to where the pose stands still."""
        for _ in range(MOST_ROUNDS):
            if state.by > end and state.step < 0.25 * state.by:
                state = self._look(grey, state.H, max(state.by // 2, end), state.use)
            if state.by == end and state.step < STILL:
                return state
            state = self._look(grey, state.moved(), state.by, state.use)
        return state if state.by == end else self._look(grey, state.H, end, state.use)

    def _lacking(self, state: _State) -> bool:
        """Whether a surface shows less than usual: the pose may be too far off to feel where it belongs."""
        return any(self._weak(state, row) for row in (INSIDE, GROUND))

    def _lack(self, state: _State) -> float:
        """How much the surfaces lack of their usual correlations."""
        usual = self._usual[state.by]
        return float(sum(max(usual[row] - state.stats[row, 3], 0.0) for row in (INSIDE, GROUND) if state.told(row)))

    def _look(self, grey: Grey, H: Floats, by: int, use: list[bool]) -> _State:
        samples: Surfaces = self._surfaces[by]
        found = kernels.motion_equations(
            grey,
            self.shrunk(grey, by),
            float(by),
            H,
            *self._outline.samples,
            REACH if by == FINE else FAR_REACH,
            MIN_STRENGTH,
            RELATIVE_STRENGTH,
            samples.places,
            samples.values,
            samples.slopes,
            samples.starts,
        )
        return _State(H, found, use, by, LOOSE * self._size)

    def shrunk(self, grey: Grey, by: int) -> Grey:
        """The image shrunk, kept as long as it is the one at hand."""
        if self._seen is None or self._seen[0] is not grey:
            self._seen = grey, {}
        images = self._seen[1]
        if by not in images:
            images[by] = shrunk(grey if by == FINE else self.shrunk(grey, by // 2), 2)
        return images[by]

    def _weak(self, state: _State, row: int) -> bool:
        """Whether a surface that is used shows less of the reference than usual: it is off, or something else."""
        return bool(state.told(row) and state.stats[row, 3] < self._least(state.by, row))

    def _least(self, by: int, row: int) -> float:
        """The least correlation of a surface that is where it belongs."""
        usual = self._usual[by][row]
        return max(LEAST_ALIKE, usual - FADED, 1.0 - LACKING * (1.0 - usual) - LACKING_ALSO)

    def _told(self, state: _State) -> Fused:
        stats = state.stats
        used = [state.use[row] and bool(stats[row, 2] > 0.0) for row in range(3)]
        for row in (INSIDE, GROUND):
            used[row] = used[row] and bool(stats[row, 3] * math.sqrt(stats[row, 0]) > CHANCE)
        if not any(used):
            raise TransferError("too few edges along the outline where it was expected")
        left = np.abs(state.left[np.isfinite(state.left)])
        return Fused(
            state.H,
            state.covariance(self._contacts),
            float(stats[0, 1]),
            float(stats[0, 2]),
            1.4826 * float(np.median(left)) if len(left) else math.nan,
            _correlation(stats[INSIDE]),
            _correlation(stats[GROUND]),
            (used[0], used[1], used[2]),
            any(used[1:]) and state.deviation(self._contacts, [False, *used[1:]]) <= HELD,
            state.by,
        )

    def covariances(self, grey: Grey, H: Floats) -> tuple[Floats, Floats, Floats]:
        """(2 k, 2 k) px^2 of the contacts at a pose: by the outline alone, with the surface, and with the ground as well.

        Args:
            grey: (H, W), another image than the reference, whose noise would pass for a surface in itself.
            H: (3, 3) the pose.
        """
        told: list[list[Floats]] = []
        for by in (FINE, COARSE):
            state = self._look(grey, H, by, [True] * 3)
            surface, ground = (state.told(row) and not self._weak(state, row) for row in (INSIDE, GROUND))
            uses = [True, False, False], [True, surface, False], [True, surface, ground]
            told.append([state.covariance(self._contacts, use) for use in uses])
        outline, surface_too, all_there_is = (min(pair, key=_widest) for pair in zip(*told, strict=True))
        return outline, surface_too, all_there_is


def _widest(covariance: Floats) -> float:
    return float(np.diag(covariance).max())


def _correlation(stats: Floats) -> float:
    return float(stats[3]) if stats[2] > 0.0 else math.nan


class _State:
    """The evidence at one pose, and the step that it asks for."""

    def __init__(self, H: Floats, found: Any, use: list[bool], by: int, loose: float) -> None:
        self.H, self.use, self.by, self._loose = H, use, by, loose
        self._centre, self._radius, self._basis, self._N, self._sure, self._b, self.stats, self.left, self.weights = (
            found
        )
        if not math.isfinite(self._radius):
            raise TransferError("the outline would lie behind the camera")
        share = self._share(use)
        self._x = np.linalg.solve(np.tensordot(share, self._N, 1) + np.eye(8) / loose**2, share @ self._b)
        self.step = math.sqrt(float(self._x @ self._x))

    def _share(self, use: list[bool]) -> Floats:
        """(1 + G,) weights of the evidence."""
        noise = self.stats[:, 2] * (1.0, CAUTION, CAUTION)
        return np.where(use & (noise > 0.0), 1.0 / np.maximum(noise, 1e-9) ** 2, 0.0)

    def told(self, row: int) -> bool:
        """Whether a piece of evidence is used and says anything."""
        return bool(self.use[row] and self.stats[row, 2] > 0.0)

    def moved(self) -> Floats:
        """(3, 3) the pose after the step."""
        H = moved(self._basis @ self._x / self._radius, self._centre, self._radius) @ self.H
        if not abs(H[2, 2]) > 1e-12:
            raise TransferError("the outline would lie behind the camera")
        return np.asarray(H / H[2, 2])

    def parted(self) -> bool:
        """Whether the outline alone asks for another pose than all the evidence together."""
        noise = self.stats[0, 2]
        if not noise > 0.0:
            return False
        told, V = np.linalg.eigh(self._N[0])
        seen = told > SEEN * told[-1]
        x = (V.T @ self._b[0])[seen] / told[seen]
        apart, sigmas = math.sqrt(float(x @ x)), math.sqrt(float(x @ (told[seen] * x))) / noise
        return apart > APART and sigmas > APART_SIGMA

    def covariance(self, contacts: Floats, use: list[bool] | None = None) -> Floats:
        """(2 k, 2 k) px^2 of the contacts (k, 2) of the reference, by the evidence used or by some of it."""
        h = self.H
        at = contacts @ h[:2, :2].T + h[:2, 2]
        at = at / (contacts @ h[2, :2] + h[2, 2])[:, None]
        rows = (displacement_fields((at - self._centre) / self._radius) @ self._basis).reshape(-1, 8)
        share = self._share(self.use if use is None else use)
        C = np.linalg.inv(np.tensordot(share, self._sure, 1) + np.eye(8) / self._loose**2)
        return np.asarray(rows @ C @ rows.T)

    def deviation(self, contacts: Floats, use: list[bool] | None = None) -> float:
        """px, the largest standard deviation of a contact in x or y."""
        return math.sqrt(float(np.diag(self.covariance(contacts, use)).max()))
