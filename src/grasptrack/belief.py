# SPDX-License-Identifier: Apache-2.0
"""Grasp transfer and its check (Fig. 3): the transfer that one image bears out, or why none is."""

from __future__ import annotations

import contextlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.agreement import HELD, MOST_NOISE, WHOLE, Agreement
from grasptrack.carriers import Carried, Carrier, RegistrationCarrier
from grasptrack.errors import ConditioningError, TransferError
from grasptrack.observation.flanks import BY
from grasptrack.observation.fusion import OTHER
from grasptrack.observation.images import Grey
from grasptrack.observation.posed import GROUND, INSIDE, Fused
from grasptrack.observation.registration import CLOSE, FAR
from grasptrack.observation.support import Support
from grasptrack.observation.trust import LEAST_ALIKE
from grasptrack.projective import apply_homography
from grasptrack.reference import Reference
from grasptrack.search import Hypothesis, Search
from grasptrack.verdict import (
    MIN_SHARE_AGAIN,
    MIN_SHARE_REGISTERED,
    RISK_PLAIN,
    close,
    error,
    refuse,
    risk,
)

Floats = NDArray[np.float64]


class Believed(NamedTuple):
    """A transfer that an image bears out, its homography (3, 3), the evidence, and the risk that it is not the object."""

    carried: Carried
    homography: Floats
    support: Support
    risk: float = RISK_PLAIN


PROMISING, MOST_SCATTER = 0.1, MOST_NOISE * HELD
"""Where the edges alone show so much less of the outline than would be believed, or scatter by more px, nothing can come of
a pose."""
SOON, SELDOM = 3, 4
"""In so many frames after a loss surfaces are looked at about where the object was, and then in every so manyth: they cost."""
SAME = 0.02
"""Share of sqrt(area) by which poses differ that are one."""
TWO_OBJECTS = 5.0
"""px from which on two poses are two objects'."""
COVERED, LATELY = 0.06, 3
"""Of the outline, so much under a cover makes it likelier that it is the cover which seems to cut or to add to the object
elsewhere, if that was believed within so many frames."""
SPEAKS_AGAINST = "another s"
"""How reasons begin that name another shape or surface."""


class Belief:
    """Transfers the grasp to image after image, and believes what the edges bear out.

    Args:
        reference: the reference view, with the strategies to use.
        search: says where the outline may be, and whether a pose may be the object's.

    Attributes:
        reasons: why what was tried in this image is not believed; the first is the one to tell.
    """

    def __init__(self, reference: Reference, search: Search) -> None:
        self._reference, self._search = reference, search
        self._agreement = Agreement()
        self._suspect = False
        self.reasons: list[str] = []

    def find(self, grey: Grey, time: float | None) -> Believed | None:
        """The first hypothesis of where the object is that an image (H, W), taken at a time in s, bears out."""
        self.reasons = []
        self._search.whereabouts.motion.look(time)
        self._agreement.begin()
        for hypothesis in self._search.hypotheses(grey, self.reasons):
            found = self._transfer(grey, hypothesis)
            if found is not None:
                return found
        self._coast(grey)
        return None

    def _coast(self, grey: Grey) -> None:
        """What is covered is where the ground has gone."""
        registration, motion = self._reference.registration, self._search.whereabouts.motion
        if registration is not None and motion.remembered and not self._search.whereabouts.gone:
            H = registration.fusion.on_ground(grey, motion.predict())
            if H is not None:
                motion.coast(H)

    def accept(self, found: Believed) -> None:
        """The analysis could judge this one: learn from it."""
        self._suspect = False
        self._agreement.believe(found.carried)
        registration = self._reference.registration
        if found.carried.fused is not None and registration is not None:
            with contextlib.suppress(ConditioningError):
                registration.believe(found.carried, self._search.whereabouts.motion.predict())
            self._search.whereabouts.telling = registration.fusion.trust.telling
        self._search.believe(found.carried.view, found.homography, found.support.levels)

    def _transfer(self, grey: Grey, hypothesis: Hypothesis) -> Believed | None:
        """The best transfer that the image bears out, or None with the reasons noted."""
        registration = self._reference.registration
        if registration is not None:
            found = self._carried(grey, hypothesis, registration)
            if found is None and registration.hurried:
                registration.search_next()
                found = self._carried(grey, hypothesis, registration)
            if found is not None or hypothesis.view is None:
                return found
        best: Believed | None = None
        for carrier in self._reference.carriers:
            if registration is not None and (best is not None or not carrier.needs_silhouette):
                break  # all are laid on the same edges
            if best is not None and not carrier.needs_silhouette and close(best.support):
                break  # the snake is asked when no silhouette served well
            found = self._carried(grey, hypothesis, carrier)
            if found is not None and (best is None or error(found.support) < error(best.support)):
                best = found
        return best

    def _carried(self, grey: Grey, hypothesis: Hypothesis, carrier: Carrier) -> Believed | None:
        """What one strategy makes of a hypothesis, if the image and all that is known bear it out."""
        registration = self._reference.registration
        try:
            if registration is not None and carrier is registration:
                carried = self._laid(grey, hypothesis, registration)
            else:
                carried = carrier.carry(grey, hypothesis.view, hypothesis.prior)
                carried = carried if registration is None else registration.polished(grey, carried)
            H = carried.transfer.homography
            assert H is not None
            worse = self._agreement.refuse(carried)
            if worse:
                raise TransferError(worse)
            support = self._reference.samples.support(grey, H, carried.transfer.grasp.contacts)
            explained = support.share
            if carried.fused is not None and carried.transfer.covariance is not None:
                support = support._replace(covariance=carried.transfer.covariance)
                support, explained = self._judged(grey, H, support, carried.fused)
        except TransferError as problem:
            self.reasons.append(str(problem))
            return None
        whereabouts, fused = self._search.whereabouts, carried.fused
        # what the ground holds has gone along with it, covered or not; so has what lies where it was, but for its covers
        still = fused is not None and fused.held and fused.used[GROUND] and not whereabouts.gone
        again = whereabouts.again(H) and not (still or (explained >= MIN_SHARE_AGAIN and whereabouts.stayed(H)))
        refusal = refuse(support, again=again, registered=registration is not None)
        if (
            not refusal
            and fused is not None
            and registration is not None
            and fused.agreement >= WHOLE
            and registration.fusion.differs(fused)
        ):
            refusal = "another surface: the object does not show what it showed before"
        if refusal.startswith(SPEAKS_AGAINST):
            self._suspect = True
        elif not refusal and self._suspect and registration is not None and fused is not None:
            unseen = registration.fusion.trust.on_ground and not fused.used[GROUND]
            refusal = "another shape was seen here of late, and the ground round it does not show now" if unseen else ""
        rivals = hypothesis.rivals
        if not refusal and registration is not None:
            whereabouts.equals |= any(self._stands(grey, other, H) for other in whereabouts.on_its_way(H))
        doubt = "" if refusal else self._search.doubt(H, grey, lambda: still or self._settled(grey, carried, rivals))
        if rivals and not refusal and not doubt and not self._settled(grey, carried, rivals):
            doubt = "found again, but its outline fits itself in more than one way: ambiguous"
        if refusal or doubt:
            self.reasons.insert(0 if doubt else len(self.reasons), refusal or doubt)
            return None
        if fused is None:
            return Believed(carried, H, support)
        return Believed(carried, H, support, risk(explained, any(fused.used[1:])))

    def _stands(self, grey: Grey, other: Floats, H: Floats) -> bool:
        """Whether something with the object's outline stands at another pose (3, 3) than this one."""
        registration, centre = self._reference.registration, np.array([self._reference.centre])
        assert registration is not None
        try:
            other = registration.on_edges(grey, other, FAR, MOST_SCATTER)
            share = self._reference.samples.support(grey, other, self._reference.grasp.contacts).share
            apart = np.hypot(*(apply_homography(other, centre) - apply_homography(H, centre))[0])
        except (TransferError, ConditioningError):
            return False
        return share >= MIN_SHARE_AGAIN and bool(apart > TWO_OBJECTS)

    def _judged(self, grey: Grey, H: Floats, support: Support, fused: Fused) -> tuple[Support, float]:
        """The evidence with both sides of the outline looked at: a cover does not speak against it, a notch or a tab does.
        And the share of the outline that shows its edge or lies under a cover."""
        samples, ground = self._reference.samples, fused.used[GROUND]
        asked = max(support.visible * samples.count, 1.0)
        if self._search.whereabouts.gone or (not ground and not samples.against.any()):
            return support, support.share  # of what was away no cover is forgiven: it would hide what tells twins apart
        assert self._reference.registration is not None
        coarse = self._reference.registration.fusion.shrunk(grey, BY)
        left, covered = self._reference.flanks.judged(coarse, H, samples.against, samples.missed, ground)
        hidden = int(np.count_nonzero(covered)) / asked
        if hidden >= COVERED and self._search.whereabouts.motion.missed <= LATELY:
            left[:] = False  # what was right until a cover came is not another shape beside it: the cover ends there
        explained = support.share + hidden
        return support._replace(contradicted=int(np.count_nonzero(left)) / asked), explained

    def _laid(self, grey: Grey, hypothesis: Hypothesis, registration: RegistrationCarrier) -> Carried:
        """A hypothesis laid on the image. After a loss only what the edges promise is looked at closely: that costs."""
        whereabouts, prior = self._search.whereabouts, hypothesis.prior
        missed, matched = whereabouts.motion.missed, hypothesis.start == "matched"
        if prior is None or (missed == 0 and hypothesis.start == "expected"):
            return registration.carry(grey, None, prior)
        led = hypothesis.start == "expected" and not whereabouts.gone and (missed <= SOON or missed % SELDOM == 0)
        try:
            if led and missed > SOON:
                return registration.led_by_surfaces(grey, prior)
            H = registration.on_edges(grey, prior, CLOSE if matched else FAR, MOST_SCATTER)
            contacts = apply_homography(H, self._reference.grasp.contacts)
            share = self._reference.samples.support(grey, H, contacts).share
            again = matched and not whereabouts.stayed(H)
            if share < (MIN_SHARE_AGAIN if again else MIN_SHARE_REGISTERED) - PROMISING:
                raise TransferError(
                    f"only {100 * share:.0f} % of the outline shows its edge where the grasp's view says it is"
                )
            return registration.laid(grey, H)
        except TransferError:
            if not led or missed > SOON:
                raise
        return registration.led_by_surfaces(grey, prior)

    def _settled(self, grey: Grey, carried: Carried, rivals: tuple[Floats, ...] = ()) -> bool:
        """Whether the surface tells which way round a symmetric object lies, and in which of some ways (3, 3)."""
        registration, fused = self._reference.registration, carried.fused
        if registration is None or fused is None or not fused.used[INSIDE] or fused.surface < LEAST_ALIKE:
            return False
        fusion, points = registration.fusion, self._reference.samples.points[::16]
        there = apply_homography(fused.homography, points)
        for H in rivals:
            other = fusion.best(grey, [H], fused.surface - OTHER)
            if other is not None:
                apart = np.hypot(*(apply_homography(other.homography, points) - there).T).max()
                if apart > SAME * self._reference.size:
                    return False
        return not self._reference.turns or fusion.settles(grey, fused, self._reference.turns)
