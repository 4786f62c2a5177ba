# SPDX-License-Identifier: Apache-2.0
"""The first view as the tracker takes it: the object that is meant, the grasp on it, and what lies beside."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import ObservationError, TransferError
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.hand import Hand
from grasptrack.segmentation.candidate import Candidate
from grasptrack.segmentation.images import Grey, as_scene, to_bgr, to_mask
from grasptrack.segmentation.objects import dilate_mask
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.segmentation.proposals import Box
from grasptrack.tracking import initialization
from grasptrack.tracking.initialization import Wish
from grasptrack.tracking.plane import Beforehand
from grasptrack.tracking.strategies import Carrier, carrier_for


class FirstView(NamedTuple):
    """What a first image holds.

    Attributes:
        candidate: the object.
        colours: (H, W) or BGR (H, W, 3): the image, or the softened mask in its place.
        observer: that found the object and has been told that it is the one.
        grey: (H, W) the image in the mixture of colours that shows the object.
        others: what else lies in the image.
        grasp: on the object, or None.
        carrier: takes it to later images; None without a grasp that the strategy can carry.
        reason: why there is none that it can; else empty.
    """

    candidate: Candidate
    colours: NDArray[np.uint8]
    observer: OutlineDetector
    grey: Grey
    others: list[Candidate]
    grasp: Grasp | None
    carrier: Carrier | None
    reason: str

    @property
    def hidden(self) -> Grey | None:
        """(H, W) nonzero where nothing belongs to the scene, or None."""
        return self.observer.hidden

    @property
    def held(self) -> Grasp:
        """The grasp; without one, two places on the outline stand for its contacts."""
        outer = self.candidate.view.outer
        return self.grasp or Grasp(outer.points[[0, len(outer) // 2]])


def first_view(
    image: NDArray[Any],
    given: Grasp | None,
    fingers: int,
    friction: float,
    object_at: tuple[float, float] | None,
    box: Box | None,
    mask: NDArray[Any] | None,
    ignore: NDArray[Any] | None,
    hand: Hand | None,
    strategy: str,
    risk: float,
    focal: Beforehand | None,
) -> FirstView:
    """Object and grasp as `GraspTracker.update` chooses them in a first image; arguments as there, `focal` as for `Plane`.

    Raises:
        ObservationError: no object.
        SourceError, InputError: an image or mask that cannot be used.
        GraspError: given contacts that are not on an object.
    """
    colours = to_bgr(image)
    shape = colours.shape[:2]
    hidden = None if ignore is None else dilate_mask(to_mask(ignore, shape, "ignore mask"))
    observer = OutlineDetector(hidden)
    seen = colours if mask is None else as_scene(to_mask(mask, shape, "mask"))
    observer.look(seen)
    masked = mask is not None
    wish = Wish(fingers, strategy, friction, given, object_at, box, hand)
    chosen = initialization.first_view(observer, wish, masked)
    candidate, reason = chosen.candidate, chosen.reason.sentence
    if candidate is None:
        raise ObservationError(reason)
    grey = observer.choose(candidate)
    others = _other_objects(observer, chosen.found, candidate, masked, object_at is not None or box is not None)
    for i, grasp in enumerate(chosen.grasps):
        try:
            carrier = carrier_for(strategy, grasp, candidate.view, grey, None, observer, risk, focal)
        except TransferError as error:
            if i == 0:
                reason = f"no grasp that {strategy} can carry: {error}"
            continue
        return FirstView(candidate, seen, observer, grey, others, grasp, carrier, "")
    held = chosen.grasps[0] if chosen.grasps else None
    return FirstView(candidate, seen, observer, grey, others, held, None, reason)


def _other_objects(
    observer: OutlineDetector, found: list[Candidate], candidate: Candidate, masked: bool, asked: bool
) -> list[Candidate]:
    """Further objects of the whole image, also where only one place in it was looked at."""
    if asked:
        try:
            found = observer.first(masked)
        except ObservationError:
            found = []
    return initialization.other_objects(found, candidate)
