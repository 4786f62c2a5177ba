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
from grasptrack.observation.images import Grey
from grasptrack.observation.registration import CLOSE, FAR, OutlineRegistration, Schedule
from grasptrack.observation.shape_space import Shape
from grasptrack.observation.snake import Snake
from grasptrack.projective import apply_homography, check_plausible
from grasptrack.transfer import Transfer, TransferStrategy, rrp, strategy_named

Floats = NDArray[np.float64]


class Carried(NamedTuple):
    """A transfer in an image, not yet believed.

    Attributes:
        strategy: its name.
        transfer: always with a homography.
        view: the outline that it was made on.
        agreement: of a registration, the share of the outline whose edges agree, 0 to 1; NaN of others.
        noise: px, of these edges; NaN of others.
    """

    strategy: str
    transfer: Transfer
    view: View
    agreement: float = math.nan
    noise: float = math.nan


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
    """The reference outline laid on the edges of the image: no silhouette, no description, all the evidence there is.

    Args:
        grasp, reference, grey: the grasp, its outline and the image of both.
        polarity: as for `OutlineRegistration`.

    Raises:
        TransferError: the reference shows too few edges.
    """

    name = "registration"
    needs_silhouette = False

    def __init__(self, grasp: Grasp, reference: View, grey: Grey, polarity: int) -> None:
        self._contacts, self._reference = grasp.contacts, reference
        self._registration = OutlineRegistration(reference, grey, polarity)

    def carry(self, grey: Grey, view: View | None, prior: Floats | None) -> Carried:
        """See Carrier; the view is not looked at."""
        if prior is None:
            raise TransferError("nothing says where the outline may be")
        return self._carried(grey, prior, FAR)

    def polished(self, grey: Grey, carried: Carried) -> Carried:
        """What another strategy carried, laid on the edges.

        Raises:
            TransferError: too few edges there.
        """
        H = carried.transfer.homography
        assert H is not None
        return self._carried(grey, H, CLOSE)

    def _carried(self, grey: Grey, H: Floats, schedule: Schedule) -> Carried:
        found = self._registration.refine(grey, H, schedule)
        check_plausible(found.homography, self._reference.outer.points)
        contacts = apply_homography(found.homography, self._contacts)
        view = View([c.transformed(found.homography) for c in self._reference.contours])
        carried = Transfer(Grasp.of(contacts), found.homography, None, found.noise)
        return Carried(self.name, carried, view, float(found.weights.mean()), found.noise)


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
