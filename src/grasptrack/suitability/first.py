# SPDX-License-Identifier: Apache-2.0
"""The first view as the tracker takes it: the object that is meant, the grasp on it, and what lies beside."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import choice
from grasptrack.errors import ObservationError
from grasptrack.grasp import Grasp
from grasptrack.hand import Hand
from grasptrack.observation.candidate import Candidate
from grasptrack.observation.images import Grey, as_scene, to_bgr, to_mask
from grasptrack.observation.observer import Observer
from grasptrack.observation.proposals import Box
from grasptrack.observation.segmentation import apart, grow
from grasptrack.suitability.strategies import why_not


class FirstView(NamedTuple):
    """What a first image holds.

    Attributes:
        candidate: the object.
        colours: (H, W) or BGR (H, W, 3): the image, or the softened mask in its place.
        hidden: (H, W) nonzero where nothing belongs to the scene, or None.
        grey: (H, W) the image in the mixture of colours that shows the object.
        others: what else lies in the image.
        grasp: on the object, or None.
        carried: the strategy can carry it.
        reason: why there is none that it can; else empty.
    """

    candidate: Candidate
    colours: NDArray[np.uint8]
    hidden: Grey | None
    grey: Grey
    others: list[Candidate]
    grasp: Grasp | None
    carried: bool
    reason: str

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
) -> FirstView:
    """Object and grasp as `GraspTracker.update` chooses them in a first image; arguments as there.

    Raises:
        ObservationError: no object.
        SourceError, InputError: an image or mask that cannot be used.
        GraspError: given contacts that are not on an object.
    """
    colours = to_bgr(image)
    shape = colours.shape[:2]
    hidden = None if ignore is None else grow(to_mask(ignore, shape, "ignore mask"))
    observer = Observer(hidden)
    seen = colours if mask is None else as_scene(to_mask(mask, shape, "mask"))
    observer.look(seen)
    masked = mask is not None
    found = observer.first(masked, object_at, box)
    candidate = found[0] if given is None else choice.holding(found, given)
    grey = observer.choose(candidate)
    others = _others(observer, found, candidate, masked, object_at is not None or box is not None)
    if given is not None:
        grasps, reason = [given.snapped(candidate.view)], ""
    else:
        beside = [c.view for c in apart([candidate, *found])[1:]]
        grasps, reason = choice.grasps(candidate.view, strategy, fingers, friction, hand, beside)
        reason = f"no stable grasp: {reason}"
    for i, grasp in enumerate(grasps):
        refused = why_not(strategy, grasp, candidate.view, grey)
        if not refused:
            return FirstView(candidate, seen, hidden, grey, others, grasp, True, "")
        if i == 0:
            reason = f"no grasp that {strategy} can carry: {refused}"
    return FirstView(candidate, seen, hidden, grey, others, grasps[0] if grasps else None, False, reason)


def _others(
    observer: Observer, found: list[Candidate], candidate: Candidate, masked: bool, asked: bool
) -> list[Candidate]:
    """Further objects of the whole image, also where only one place in it was looked at."""
    if asked:
        try:
            found = observer.first(masked)
        except ObservationError:
            found = []
    return choice.others(found, candidate)
