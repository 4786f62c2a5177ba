# SPDX-License-Identifier: Apache-2.0
"""The pose on all the evidence at once: the outline's edges, the object's surface, and the ground round it.

An outline leaves motions open that slide it along itself: a disc turns, a pencil slips. What is printed, scratched or
grown on the object settles them, and so does the ground, as long as it moves along with the object.
"""

from __future__ import annotations

import contextlib
import math

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.contour import View
from grasptrack.errors import TransferError
from grasptrack.kernels.reference_fusion import LEAST_NOISE_GREY
from grasptrack.observation.images import Grey
from grasptrack.observation.posed import CAUTION, GROUND, INSIDE, Fused, Posed
from grasptrack.observation.pyramid import Pyramid
from grasptrack.observation.registration import MIN_STRENGTH, RELATIVE_STRENGTH, OutlineRegistration
from grasptrack.observation.surface import Surfaces, surfaces
from grasptrack.observation.trust import ALIKE, LEAST_ALIKE, Trust
from grasptrack.projective import apply_homography

Floats = NDArray[np.float64]

FEW, MANY, FIXED = 200, 900, 0.2
"""Places on each surface, in the finest image: few where the outline alone fixes each contact to so many px, else many."""
FINE, COARSE, COARSEST = 2, 4, 8
"""How many times the images are shrunk in which surfaces are compared: noise shrinks alike, and a coarse one is compared
over longer ways."""
LEVELS = (FINE, COARSE, COARSEST, -FINE, -COARSE, -COARSEST)
"""Images in which surfaces are compared: shrunk, and with a minus without the light that lies on them."""
REACH, FAR_REACH = 3.0, 6.0
"""px on either side in which edges are searched, with fine and with coarse surfaces."""
MOST_ROUNDS = 8
"""Steps until the pose stands still ..."""
STILL = 0.02
"""... which is when the outline moves by less than so many px, rms."""
FAINT = 0.6
"""A correlation below which noise hides much of a surface: a coarser image may show more of it."""
CHANCE = 4.0
"""A correlation is chance when it is below so many over the root of the number of places."""
UNLIKE, OTHER = 0.35, 0.3
"""A correlation below which a surface that was well known is another one; and by how much that of another turn is less."""
HELD = 0.7
"""px: surfaces that fix each contact to so much hold the pose, whatever covers the outline."""
SPREAD = 1.25
"""How many times larger a variance is than if all edges were independent, as counted on scenes with truth."""
STRANGE, SPREAD_STRANGE = 2.0, 2.5
"""A ground that is none of the reference's, so many times as rough as the object's surface, bends edges in stretches:
variances are so many times larger then."""
ASTRAY = 0.15
"""Fraction of sqrt(area) that a step is long from which nothing converges."""
DECISIVE, STRICT = 0.5, 3.0
"""px, and standard deviations, by which the ground may disagree where it decides."""
MOVED = 1.0
"""px from the reference from which on it is asked whether the ground stayed behind."""
SLID, SLID_PX = 0.04, 3.0
"""A surface must tell the pose from those slid along the outline by this fraction of sqrt(area), or so many px, whichever is
more: ..."""
CLEARER = 1.25
"""... so many times as much of what it shows is unexplained there. Light that falls off over a ring does not turn with it."""
LOOSE = 0.25
"""What no evidence shows of a motion may be as large as this fraction of sqrt(area)."""


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
        self.trust = Trust(LEVELS)
        self._pyramid = Pyramid()
        self._surfaces = {by: surfaces(view, grey, abs(by), MANY, hidden, shaded=by < 0) for by in LEVELS}
        if self._look(grey, np.eye(3), FINE, [True, False, False]).deviation() <= FIXED:
            for by in (FINE, -FINE):
                self._surfaces[by] = surfaces(view, grey, FINE, FEW, hidden, shaded=by < 0)

    def shrunk(self, grey: Grey, by: int) -> Grey:
        """The image (H, W) as many times shrunk, a power of two, kept as long as it is the one at hand."""
        return self._pyramid.shrunk(grey, by)

    def refine(self, grey: Grey, H: Floats, *, far: bool = False) -> Fused:
        """The pose nearest to a first one that all the evidence asks for.

        Args:
            grey: (H, W).
            H: (3, 3) to begin with.
            far: it may be off by several px.

        Raises:
            TransferError: too little evidence.
        """
        state = self._settled(grey, H, self.trust.use, far)
        for row in (GROUND, INSIDE):  # what does not move along must not bend the pose
            if state.told(row) and (
                state.parted(0)
                or state.parted(row)
                or self._alike_slid(grey, state, row)
                or (row == GROUND and self._misleads(grey, state, far))
            ):
                state = self._settled(grey, H, [used and each != row for each, used in enumerate(state.use)], far)
        if self._contradicted(grey, state):
            raise TransferError("the outline and the surface within it ask for different poses: it may not be flat")
        return self._told(state)

    def _contradicted(self, grey: Grey, state: Posed) -> bool:
        """Whether a surface that is well known, and was left out, is seen as well as ever in another pose."""
        by = max((FINE, -FINE), key=lambda by: self.trust.usual(by, INSIDE))
        if state.use[INSIDE] or not self.trust.use[INSIDE] or self.trust.usual(by, INSIDE) < ALIKE:
            return False
        try:
            other = self._converged(grey, state.H, 2 * by, [False, True, False], by)
        except TransferError:
            return False
        known = other.told(INSIDE) and not self.trust.weak(other, INSIDE) and other.deviation() <= HELD
        return known and self._apart(state, other)

    def _alike_slid(self, grey: Grey, state: Posed, row: int) -> bool:
        """Whether a surface, which alone tells slides of the outline, looks the same where it has slid."""
        if state.deviation([True, False, False]) <= HELD:
            return False
        most = 0.0
        for H in state.slid(max(SLID_PX, SLID * self._size)):
            with contextlib.suppress(TransferError):
                most = max(most, self._look(grey, H, state.by, state.use).alike(row))
        return 1.0 - most**2 < CLEARER * (1.0 - state.alike(row) ** 2)

    def _misleads(self, grey: Grey, state: Posed, far: bool) -> bool:
        """Whether the ground may not be believed although nothing speaks against it yet: where the surface decides, it must
        agree, and where it decides alone, be at rest with the object rather than with the camera."""
        if state.deviation([True, False, False]) <= HELD:
            return False
        if state.deviation([True, state.use[INSIDE], False]) > HELD:
            return state.parted(0, STRICT) or state.parted(GROUND, STRICT) or self._stayed(grey, state)
        other = self._settled(grey, state.H, [True, state.use[INSIDE], False], far)
        return self._apart(state, other)

    def _apart(self, state: Posed, other: Posed) -> bool:
        """Whether another pose puts a contact elsewhere, by more than it is itself uncertain."""
        apart = apply_homography(other.H, self._contacts) - apply_homography(state.H, self._contacts)
        return bool(np.hypot(*apart.T).max() > max(DECISIVE, STRICT * other.deviation()))

    def _stayed(self, grey: Grey, state: Posed) -> bool:
        """Whether the ground is rather where it was in the reference than where the object would have taken it: a camera
        that stands still sees the object move on its own."""
        off = apply_homography(state.H, self._contacts) - self._contacts
        if np.hypot(*off.T).max() < MOVED:
            return False
        still = self._look(grey, np.eye(3), state.by, [False, False, True])
        return still.told(GROUND) and still.alike(GROUND) >= state.alike(GROUND)

    def differs(self, fused: Fused) -> bool:
        """Whether the object's surface, which was seen to be as in the reference, is not so in a pose."""
        usual = self.trust.usual(fused.by, INSIDE)
        return usual >= ALIKE and math.isfinite(fused.surface) and fused.surface < UNLIKE

    def settles(self, grey: Grey, fused: Fused, turns: list[Floats]) -> bool:
        """Whether the object's surface tells a pose from the pose turned by each of some symmetries."""
        if not fused.used[INSIDE] or fused.surface < LEAST_ALIKE:
            return False
        other = self.best(grey, [fused.homography @ turn for turn in turns], fused.surface - OTHER)
        return other is None

    def best(self, grey: Grey, poses: list[Floats], least: float = FAINT) -> Fused | None:
        """The pose in which the object's surface is most like the reference; None where in none it is so as asked."""
        use = [True, True, False]
        seen = [self._look(grey, H, COARSE, use) for H in poses]
        seen = sorted((s for s in seen if s.told(INSIDE)), key=lambda s: -s.alike(INSIDE))[:3]
        found = []
        for state in seen:
            with contextlib.suppress(TransferError):  # a turn that is none leads anywhere
                found.append(self._converged(grey, state.H, COARSE, use))
        found = [s for s in found if s.alike(INSIDE) > least]
        return self._told(max(found, key=lambda s: s.alike(INSIDE))) if found else None

    def on_ground(self, grey: Grey, H: Floats) -> Floats | None:
        """(3, 3) where the object must lie if it went along with the ground, which alone is looked at; None where the
        ground does not tell.

        Args:
            grey: (H, W).
            H: (3, 3) where it was expected.
        """
        if not self.trust.use[GROUND]:
            return None
        try:
            state = self._converged(grey, H, COARSEST, [False, False, True])
        except TransferError:
            return None
        if not state.told(GROUND) or self.trust.weak(state, GROUND) or state.deviation() > HELD:
            return None
        return state.H

    def _settled(self, grey: Grey, H: Floats, use: list[bool], far: bool) -> Posed:
        state = self._settled_at(grey, H, use, far, FINE)
        if state.use == use:
            return state
        # a shadow may lie over what did not show
        return min(state, self._settled_at(grey, H, use, far, -FINE), key=Posed.deviation)

    def _settled_at(self, grey: Grey, H: Floats, use: list[bool], far: bool, fine: int) -> Posed:
        """The pose by the images as they are (FINE) or without the light on them (-FINE)."""
        found: list[Posed] = []
        for start in (COARSEST // FINE,) if far else (1, COARSEST // FINE):
            with contextlib.suppress(TransferError):  # a start may lead anywhere
                found.append(self._converged(grey, H, start * fine, use, fine))
                if not self.trust.lacking(found[-1]):
                    break
        if not found:
            raise TransferError("the outline would lie behind the camera")
        ends = [min(found, key=self.trust.lack)]
        if any(ends[0].told(row) and ends[0].alike(row) < FAINT for row in (INSIDE, GROUND)):
            with contextlib.suppress(TransferError):
                ends.append(self._converged(grey, ends[0].H, 2 * fine, use, 2 * fine))
        for i, end in enumerate(ends):
            strong = [used and not self.trust.weak(end, row) for row, used in enumerate(use)]
            if strong != use:  # what is dropped may have led astray along what the others leave open
                again = [self._converged(grey, begin, end.by, strong, end.by) for begin in (end.H, H)]
                ends[i] = max(again, key=lambda state: state.stats[0][1])
        return min(ends, key=Posed.deviation) if len(ends) > 1 else ends[0]

    def _converged(self, grey: Grey, H: Floats, by: int, use: list[bool], end: int = FINE) -> Posed:
        """Step by step, in ever finer images, to where the pose stands still."""
        left, least = MOST_ROUNDS, 0
        while True:
            state = self._look(grey, H, by, use, STILL if by == end else 0.25 * abs(by), least, left)
            left -= state.moves
            if state.step > ASTRAY * self._size:
                raise TransferError(
                    "the evidence asks for ever larger steps: the outline is not where it was looked for"
                )
            if by == end or left == 0:
                return state if by == end else self._look(grey, state.H, end, use)
            H, by = state.H, by // 2
            least = 0 if by == end else 1

    def _look(
        self, grey: Grey, H: Floats, by: int, use: list[bool], still: float = 0.0, least: int = 0, most: int = 0
    ) -> Posed:
        """The evidence at a pose, after so many steps at least and at most, until one is smaller than `still` px."""
        samples: Surfaces = self._surfaces[by]
        found = kernels.converge(
            grey,
            self._pyramid.relief(grey, -by) if by < 0 else self._pyramid.shrunk(grey, by),
            float(abs(by)),
            H,
            *self._outline.samples,
            REACH if abs(by) == FINE else FAR_REACH,
            MIN_STRENGTH,
            RELATIVE_STRENGTH,
            samples.places,
            samples.values,
            samples.slopes,
            samples.starts,
            np.array(use),
            CAUTION,
            LOOSE * self._size,
            still,
            least,
            most,
            self._outline.clear,
        )
        return Posed(found, use, by, LOOSE * self._size, self._contacts)

    def _told(self, state: Posed) -> Fused:
        stats = state.stats
        used = [state.told(row) for row in range(3)]
        for row in (INSIDE, GROUND):
            used[row] = used[row] and stats[row][3] * math.sqrt(stats[row][0]) > CHANCE
        if not any(used):
            raise TransferError("too few edges along the outline where it was expected")
        surfaces_alone, spread = [False, *used[1:]], SPREAD
        if not used[GROUND] and stats[GROUND][2] > STRANGE * max(stats[INSIDE][2], LEAST_NOISE_GREY):
            spread *= SPREAD_STRANGE
        covariance = state.covariance(state.use)
        return Fused(
            state.H,
            spread * covariance,
            stats[0][1],
            stats[0][2],
            state.scatter,
            _correlation(stats[INSIDE]),
            _correlation(stats[GROUND]),
            (used[0], used[1], used[2]),
            any(surfaces_alone) and state.deviation(surfaces_alone) <= HELD,
            state.by,
            state.leverage(covariance),
            spread * state.homography_covariance(state.use),
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
            surface, ground = (state.told(row) and not self.trust.weak(state, row) for row in (INSIDE, GROUND))
            uses = [True, False, False], [True, surface, False], [True, surface, ground]
            told.append([state.covariance(use) for use in uses])
        outline, surface_too, all_there_is = (min(pair, key=_widest) for pair in zip(*told, strict=True))
        return outline, surface_too, all_there_is


def _widest(covariance: Floats) -> float:
    return float(np.diag(covariance).max())


def _correlation(stats: list[float]) -> float:
    return stats[3] if stats[2] > 0.0 else math.nan
