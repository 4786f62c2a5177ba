# SPDX-License-Identifier: Apache-2.0
"""A strategy at work on images: how it gets its outline, and how its transfer is applied to it (Figs. 3 and 6)."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from grasptrack.contour import View
from grasptrack.errors import ObservationError, TransferError
from grasptrack.grasp import Grasp
from grasptrack.observation.fusion import Fusion
from grasptrack.observation.images import Grey
from grasptrack.observation.posed import Fused
from grasptrack.observation.registration import CLOSE, FAR, OutlineRegistration, Schedule
from grasptrack.observation.segmentation import clearance
from grasptrack.observation.shape_space import Shape
from grasptrack.observation.snake import Snake
from grasptrack.projective import apply_homography, check_plausible
from grasptrack.transfer import Transfer, TransferStrategy, rrp, strategy_named

Floats = NDArray[np.float64]


AT_ONCE, CALM = 0.8, 2.0
"""Of the outline, so much must agree where nothing was searched; and px by which the prediction may have been off in the
image before."""
MOST_AGREE = 0.75
"""Where less of the outline agrees, the surfaces are asked for another pose."""


class Carried(NamedTuple):
    """A transfer in an image, not yet believed.

    Attributes:
        strategy: its name.
        transfer: always with a homography.
        view: the outline that it was made on.
        fused: of a registration, what bears it out.
    """

    strategy: str
    transfer: Transfer
    view: View
    fused: Fused | None = None


class Carrier(Protocol):
    """One strategy with what it remembers of the reference."""

    name: str
    needs_silhouette: bool

    def carry(self, grey: Grey, view: View | None, prior: Floats | None) -> Carried:
        """Transfer the grasp to an image.

        Raises:
            TransferError: with the reason.
        """
        ...


class SilhouetteCarrier:
    """Grasp line and homography: the outline is segmented anew in every image.

    Raises:
        TransferError: the reference cannot be described this way.
    """

    needs_silhouette = True

    def __init__(self, name: str, grasp: Grasp, reference: View) -> None:
        self.name = name
        self._strategy: TransferStrategy = strategy_named(name)
        self._description: Any = self._strategy.describe(grasp, reference)

    def carry(self, grey: Grey, view: View | None, prior: Floats | None) -> Carried:
        """See Carrier."""
        if view is None:
            raise TransferError("the object was not found in this image")
        return Carried(self.name, self._strategy.apply(self._description, view, prior), view)


class RegistrationCarrier:
    """The reference view laid on the image: no silhouette, no description, all the evidence there is.

    Args:
        grasp, reference, grey: the grasp, its outline and the image of both.
        polarity: as for `OutlineRegistration`.
        hidden: (H, W) nonzero where nothing belongs to a scene.
        turns: (3, 3) each, under which the outline lies on itself.

    Attributes:
        hurried: the last pose was carried without a search.

    Raises:
        TransferError: the reference shows too few edges.
    """

    name = "registration"
    needs_silhouette = False

    def __init__(
        self,
        grasp: Grasp,
        reference: View,
        grey: Grey,
        polarity: int,
        hidden: Grey | None = None,
        turns: list[Floats] | None = None,
    ) -> None:
        self._contacts, self._reference, self._turns = grasp.contacts, reference, turns or []
        self._registration = OutlineRegistration(reference, grey, polarity, clearance(hidden))
        self._calm = self.hurried = False
        self.fusion = Fusion(self._registration, reference, grey, grasp.contacts, hidden)

    def carry(self, grey: Grey, view: View | None, prior: Floats | None) -> Carried:
        """See Carrier; the view is not looked at."""
        if prior is None:
            raise TransferError("nothing says where the outline may be")
        problem: TransferError | None = None
        best = self._at_once(grey, prior)
        self.hurried = best is not None
        if best is not None:
            return self._carried(best)
        try:
            best = self.fusion.refine(grey, self._registration.refine(grey, prior, FAR).homography)
        except TransferError as error:
            problem = error
        if (best is None or best.agreement < MOST_AGREE) and self.fusion.trust.textured:
            # where the outline is covered, the surfaces lead
            try:
                other = self.fusion.refine(grey, prior, far=True)
                if best is None or other.agreement > best.agreement:
                    best = other
            except TransferError as error:
                problem = error
        if best is None:
            assert problem is not None
            raise problem
        return self._carried(self._turned(grey, best))

    def _at_once(self, grey: Grey, prior: Floats) -> Fused | None:
        """The pose where the prediction is as good as of late, without a search: the fast path."""
        if not self._calm:
            return None
        try:
            fused = self.fusion.refine(grey, prior)
        except TransferError:
            return None
        return None if fused.agreement < AT_ONCE or self.fusion.differs(fused) else fused

    def search_next(self) -> None:
        """What was carried without a search is not believed: the next is searched for."""
        self._calm = False

    def believe(self, carried: Carried, predicted: Floats) -> None:
        """The verdict accepted this one.

        Args:
            carried: by this carrier.
            predicted: (3, 3) pose that had been expected.
        """
        assert carried.fused is not None
        self.fusion.trust.believe(carried.fused)
        outline = self._reference.outer.points[::16]
        off = apply_homography(carried.fused.homography, outline) - apply_homography(predicted, outline)
        self._calm = bool(np.hypot(*off.T).max() <= CALM)

    def _turned(self, grey: Grey, fused: Fused) -> Fused:
        """Where the surface is not as it should be, the symmetric turn in which it is, if there is one."""
        if not self._turns or not self.fusion.differs(fused):
            return fused
        return self.fusion.best(grey, [fused.homography @ turn for turn in self._turns]) or fused

    def polished(self, grey: Grey, carried: Carried) -> Carried:
        """What another strategy carried, laid on the edges.

        Raises:
            TransferError: too few edges there.
        """
        H = carried.transfer.homography
        assert H is not None
        return self.laid(grey, self.on_edges(grey, H, CLOSE))

    def on_edges(self, grey: Grey, H: Floats, schedule: Schedule, most: float = math.inf) -> Floats:
        """(3, 3) the pose that the edges alone ask for: what it costs to see whether a pose promises anything.

        Raises:
            TransferError: too few edges there, or they scatter by more than `most` px, or no camera sees it so.
        """
        found = self._registration.refine(grey, H, schedule)
        scatter = 1.4826 * float(np.nanmedian(np.abs(found.left)))
        if scatter > most:
            raise TransferError(f"the outline's edges scatter by {scatter:.1f} px where it was looked for")
        check_plausible(found.homography, self._reference.outer.points)
        return found.homography

    def laid(self, grey: Grey, H: Floats) -> Carried:
        """The grasp at the pose that all the evidence asks for, from one (3, 3) on the edges.

        Raises:
            TransferError: too little evidence there.
        """
        return self._carried(self._turned(grey, self.fusion.refine(grey, H)))

    def led_by_surfaces(self, grey: Grey, H: Floats) -> Carried:
        """The same from a pose some px off, where the outline is covered and the surfaces lead.

        Raises:
            TransferError: too little evidence there.
        """
        if not self.fusion.trust.textured:
            raise TransferError("too few edges along the outline where it was expected")
        return self._carried(self._turned(grey, self.fusion.refine(grey, H, far=True)))

    def _carried(self, fused: Fused) -> Carried:
        H = fused.homography
        check_plausible(H, self._reference.outer.points)
        contacts = apply_homography(H, self._contacts)
        view = View([c.transformed(H) for c in self._reference.contours])
        k = len(contacts)
        own = np.stack([fused.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(k)])
        return Carried(self.name, Transfer(Grasp.of(contacts), H, own, fused.scatter), view, fused)


class SnakeCarrier:
    """RRP: a snake follows the outline as a whole, and the contacts are places on it (Section IV-A).

    Args:
        grasp, reference, grey: the grasp, its outline and the image of both.
        shape: the snake's shape space: "similarity" as in the paper, or "affine".
    """

    name = "rrp"
    needs_silhouette = False

    def __init__(self, grasp: Grasp, reference: View, grey: Grey, shape: Shape) -> None:
        self._contacts = grasp.contacts
        self._make: Callable[[], Snake] = partial(Snake, reference, grey, shape, contacts=grasp.contacts)
        self._described: tuple[Snake, rrp.RRPDescription] | None = None
        self._grasp = grasp

    def carry(self, grey: Grey, view: View | None, prior: Floats | None) -> Carried:
        """See Carrier; the view is not looked at. Without a prior the snake's own filter predicts."""
        if self._described is None:  # made when it is first asked for: `auto` seldom needs it
            try:
                snake = self._make()
            except ObservationError as error:
                raise TransferError(str(error)) from None
            self._described = snake, rrp.describe(self._grasp, snake.template)
        snake, description = self._described
        if prior is None:
            snake.predict()
        else:
            snake.reseed(prior)
        fit = snake.update(grey)
        if not fit.ok:
            raise TransferError(fit.reason)
        followed = snake.view(fit)
        moved = rrp.apply(description, followed).grasp
        covariance = fit.covariance_at(self._contacts)
        return Carried(self.name, Transfer(moved, fit.homography, covariance, fit.residual), followed)
