# SPDX-License-Identifier: Apache-2.0
"""The first view as the tracker takes it: the object that is meant, the grasp on it, and what lies beside."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.grasp.contacts import Grasp
from grasptrack.images import Grey, to_bgr
from grasptrack.segmentation.candidate import Candidate, distinct_candidates
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.tracking import initialization
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.initialization import FirstScene, Wish, image_size, mask_as_scene, start_tracking
from grasptrack.tracking.strategies import Carrier


class InspectedView(NamedTuple):
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
        candidates: up to three objects that the image may mean, the likeliest first.
        is_sure: the choice among them is, or a person has chosen.
    """

    candidate: Candidate
    colours: NDArray[np.uint8]
    observer: OutlineDetector
    grey: Grey
    others: list[Candidate]
    grasp: Grasp | None
    carrier: Carrier | None
    reason: str
    candidates: list[Candidate]
    is_sure: bool

    @property
    def ignore_mask(self) -> Grey | None:
        """(H, W) nonzero where nothing belongs to the scene, or None."""
        return self.observer.hidden

    @property
    def held_grasp(self) -> Grasp:
        """The grasp; without one, two places on the outline stand for its contacts."""
        outer = self.candidate.view.outer
        return self.grasp or Grasp(outer.points[[0, len(outer) // 2]])


def first_view(image: NDArray[Any], mask: NDArray[Any] | None, wish: Wish, focal: Beforehand | None) -> InspectedView:
    """Object and grasp as `GraspTracker.update` chooses them in a first image; `focal` as for `Plane`."""
    shape = image_size(image)
    wish = replace(wish, said=wish.said.within(shape))
    observer = OutlineDetector(wish.said.hidden)
    colours = to_bgr(image) if mask is None else mask_as_scene(mask, shape)
    observer.set_image(colours)
    chosen = initialization.first_view(observer, wish, mask is not None)
    return _view_of(FirstScene(observer.colours, mask is not None, chosen, wish, focal), observer)


def first_view_of(scene: FirstScene) -> InspectedView:
    """The same of what a tracker chose, without another search."""
    observer = OutlineDetector(scene.wish.said.hidden)
    observer.set_image(scene.colours)
    return _view_of(scene, observer)


def _view_of(scene: FirstScene, observer: OutlineDetector) -> InspectedView:
    """The object, the grasp on it, and what carries it, of a choice in the image that an observer has looked at."""
    colours, masked, chosen, wish, before = scene
    candidate, reason = chosen.candidate, chosen.reason.sentence
    if candidate is None:
        raise ObservationError(reason)
    grey, found = observer.choose_object(candidate), chosen.found
    if wish.said.is_pointed_at:  # only one place in the image was looked at
        try:
            found = observer.find_objects(FirstImage(masked=masked))
        except ObservationError:
            found = []
    others = initialization.other_objects(found, candidate)
    start = start_tracking(chosen, wish, grey, observer, before=before)
    if start.carrier is None:
        start = start._replace(grasp=chosen.grasps[0] if chosen.grasps else None)
        reason = f"no grasp that {wish.strategy} can carry: {start.refusal}" if start.refusal else reason
    reason = "" if start.carrier else reason
    candidates, sure = distinct_candidates(chosen.found), masked or wish.is_sure_of(candidate)
    return InspectedView(
        candidate, colours, observer, grey, others, start.grasp, start.carrier, reason, candidates, sure
    )
