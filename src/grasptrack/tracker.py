# SPDX-License-Identifier: Apache-2.0
"""The grasp tracking procedure of Fig. 3: synthesise once, then contour, transfer, analysis, verdict for each image."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack import choice
from grasptrack.analysis import DEFAULT_FRICTION, check_friction
from grasptrack.belief import Belief, Believed
from grasptrack.calibration import Camera
from grasptrack.closing import Regions, chance_of_closing, regions_of
from grasptrack.contour import View
from grasptrack.errors import (
    ConditioningError,
    GraspError,
    InputError,
    ObservationError,
    SourceError,
    StrategyError,
    TransferError,
)
from grasptrack.grasp import Grasp
from grasptrack.hand import Hand
from grasptrack.observation.candidate import Candidate
from grasptrack.observation.images import Grey, as_scene, to_bgr, to_mask
from grasptrack.observation.observer import Observer
from grasptrack.observation.segmentation import Segmenter, apart, grow
from grasptrack.observation.undistortion import Told, Undistortion
from grasptrack.reference import AUTO, Reference
from grasptrack.search import Search
from grasptrack.tracking.result import TrackResult
from grasptrack.transfer import STRATEGIES
from grasptrack.verdict import Verdict, judge, lost

Floats = NDArray[np.float64]


class GraspTracker:
    """Chooses a grasp in the first view and finds the same physical contacts in every image that follows.

    Args:
        fingers: number of contacts to synthesise, 2 or 3.
        strategy: "auto", "rrp", "grasp-line" or "homography".
        friction: Coulomb coefficient for synthesis and analysis.
        grasp: (k, 2) px contacts in the first image, in place of synthesis; they choose the object.
        object_at: (x, y) px of the object in the first image.
        box: left, top, width and height of it, px, in the place of a pixel.
        ignore: (H, W) nonzero where nothing belongs to the scene.
        resynthesize: choose a new grasp, with a new grasp_id, when the analysis refuses the present one.
        hand: opening and fingers that a synthesised grasp must suit; default fingers in proportion to the object.
        choose: your own choice in the place of synthesis: given the object's outline in the first view, the grasps to try, the
            best first, of so many fingers each.
        segmenter: your own segmentation, asked for a mask of every image that comes without one.
        camera: its calibration. Images are made straight before anything is looked at. Everything that goes in and comes
            out stays in px of the images as they are, but for the homography, which is in ideal px.

    Raises:
        StrategyError: unknown strategy, or more fingers than it can carry.
        GraspError: contacts that are none, or fewer than two fingers.
        InputError: friction not positive, both a pixel and a box, or both a grasp and a choice.
    """

    def __init__(
        self,
        *,
        fingers: int = 2,
        strategy: str = AUTO,
        friction: float = DEFAULT_FRICTION,
        grasp: ArrayLike | None = None,
        object_at: tuple[float, float] | None = None,
        box: tuple[float, float, float, float] | None = None,
        ignore: NDArray[Any] | None = None,
        resynthesize: bool = False,
        hand: Hand | None = None,
        choose: Callable[[View], Sequence[Grasp]] | None = None,
        segmenter: Segmenter | None = None,
        camera: Camera | None = None,
    ) -> None:
        if strategy not in (AUTO, *STRATEGIES):
            raise StrategyError(f'unknown strategy "{strategy}"; choose from {", ".join((AUTO, *STRATEGIES))}')
        check_friction(friction)
        self._given = None if grasp is None else Grasp(grasp)
        fingers = fingers if self._given is None else len(self._given)
        if fingers < 2:
            raise GraspError(f"a grasp has at least 2 fingers, not {fingers}", fingers=fingers)
        if strategy == "grasp-line" and fingers != 2:
            raise StrategyError(f"grasp-line carries 2 fingers, not {fingers}; use rrp or homography", fingers=fingers)
        if self._given is None and fingers > 3:
            raise StrategyError(
                f"grasps are synthesised for 2 or 3 fingers, not {fingers}; give the contacts", fingers=fingers
            )
        self.fingers, self.strategy, self.friction = fingers, strategy, friction
        if object_at is not None and box is not None:
            raise InputError("a pixel and a box both say which object is meant: give one of them")
        if grasp is not None and choose is not None:
            raise InputError("a grasp and a choice of one both say which grasp is meant: give one of them")
        self._object_at, self._box, self._ignore, self._resynthesize = object_at, box, ignore, resynthesize
        self._hand, self._choose, self._segmenter, self._camera = hand, choose, segmenter, camera
        self._lens: Undistortion | None = None
        self._frame = -1
        self._grasp_id = 0
        self._shape: tuple[int, int] | None = None
        self._reference: Reference | None = None
        self._observer = Observer()
        self._search: Search | None = None
        self._belief: Belief | None = None
        self._regions: Regions | None = None
        self._unstable: View | None = None
        self._reasons: list[str] = []

    # --- Fig. 3 ----------------------------------------------------------------------------------

    def update(self, image: NDArray[Any], time: float | None = None, mask: NDArray[Any] | None = None) -> TrackResult:
        """Look at the next image.

        Args:
            image: 8 or 16 bit, grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4).
            time: s, at which it was taken; the motion is carried on for as long, so that dropped frames do no harm. None
                counts frames.
            mask: (H, W) the user's segmentation of this image, nonzero on the object; it takes the image's place.

        Raises:
            SourceError: an image of another size than the first, or one that cannot be used.
            GraspError: given contacts that are not on an object.
            InputError: a mask of another size than the image.
        """
        started = clock.perf_counter()
        mask = self._segmenter.segment(image) if mask is None and self._segmenter else mask
        grey = self._prepare(*self._straight(image, mask))
        self._frame += 1
        self._reasons = []
        if self._reference is None or self._search is None or self._belief is None:
            result = self._begin(masked=mask is not None or self._segmenter is not None)  # grasp synthesis, once
            if self._search is not None:
                self._search.whereabouts.motion.begin(time)
        else:
            result = self._follow(grey, time, self._reference, self._search, self._belief)
        latency = 1e3 * (clock.perf_counter() - started)
        told = TrackResult(frame=self._frame, time=time, latency_ms=latency, **result)
        return told if self._lens is None else self._lens.result(told)

    def _begin(self, *, masked: bool) -> dict[str, Any]:
        """Choose the object and a grasp on it."""
        try:
            found = self._observer.first(masked, self._object_at, self._box)
        except ObservationError as error:
            return {"status": "searching", "reason": str(error)}
        candidate = self._chosen(found)
        if candidate is None:
            return {"status": "searching", "reason": "the object that needs a new grasp is not where it was"}
        grey = self._observer.choose(candidate)
        if self._given is not None:
            grasps = [self._given.snapped(candidate.view)]
        elif self._choose is not None:
            grasps = list(self._choose(candidate.view))
            if not grasps:
                reason = "no stable grasp: the choice that was given made none"
                return {"status": "searching", "reason": reason, "view": candidate.view}
            if any(len(grasp) != self.fingers for grasp in grasps):
                raise GraspError(f"a grasp of {self.fingers} contacts is to be chosen", fingers=self.fingers)
        else:
            beside = [c.view for c in apart([candidate, *found])[1:]]
            grasps, reason = choice.grasps(
                candidate.view, self.strategy, self.fingers, self.friction, self._hand, beside
            )
            if not grasps:
                return {"status": "searching", "reason": f"no stable grasp: {reason}", "view": candidate.view}
        for grasp in grasps:
            try:
                reference = Reference(
                    grasp,
                    candidate.view,
                    grey,
                    self.strategy,
                    candidate.polarity,
                    self.friction,
                    self._observer.hidden,
                )
            except TransferError as error:
                self._reasons.append(str(error))
                continue
            if self._object_at is not None or self._box is not None:
                found = self._observer.first(masked)
            return self._start(reference, candidate, choice.others(found, candidate))
        reason = f"no grasp that {self.strategy} can carry: {self._reasons[0]}"
        return {"status": "searching", "reason": reason, "view": candidate.view}

    def _start(self, reference: Reference, candidate: Candidate, others: list[Candidate]) -> dict[str, Any]:
        self._reference = reference
        self._grasp_id += 1
        self._search = Search(self._observer, reference, others)
        self._belief = Belief(reference, self._search)
        grasp, analysis = reference.grasp, reference.analysis
        # here, where a grasp is chosen anyway: for three fingers it takes some tens of ms
        self._regions = regions_of(grasp, reference.view, reference.friction, reference.width)
        return {
            "status": "tracked" if analysis.stable else "unstable",
            "reason": analysis.reason,
            "strategy": reference.carriers[0].name,
            "grasp_id": self._grasp_id,
            "contacts": grasp.contacts,
            "seen": np.ones(len(grasp)),
            "analysis": analysis,
            "confidence": 1.0,
            "chance": 1.0 if analysis.stable else 0.0,
            "homography": np.eye(3),
            "view": candidate.view,
        }

    def _follow(
        self, grey: Grey, time: float | None, reference: Reference, search: Search, belief: Belief
    ) -> dict[str, Any]:
        """Contour and transfer, analysis, accept or refuse."""
        found = belief.find(grey, time)
        if found is None:
            search.lost(grey)
            return self._refused(lost(next(iter(belief.reasons), "the object was not found in this image")))
        try:
            analysis = reference.carried_back(found.carried.transfer.grasp.contacts, found.homography)
        except (GraspError, ConditioningError) as error:
            search.lost(grey)
            return self._refused(lost(str(error)))
        belief.accept(found)
        chance = self._chance(found)
        return self._accepted(found, judge(found.support, analysis, found.risk, chance), analysis, chance)

    def _chance(self, found: Believed) -> float:
        """The least chance that the grasp closes although its contacts may be off."""
        assert self._regions is not None
        fused = found.carried.fused
        covariance = found.support.covariance if fused is None else fused.covariance
        return chance_of_closing(self._regions, covariance, found.homography, found.carried.transfer.grasp.contacts)

    # --- answers ---------------------------------------------------------------------------------

    def _accepted(self, found: Believed, verdict: Verdict, analysis: Any, chance: float) -> dict[str, Any]:
        answer = {
            "status": verdict.status,
            "reason": verdict.reason,
            "strategy": found.carried.strategy,
            "grasp_id": self._grasp_id,
            "contacts": found.carried.transfer.grasp.contacts,
            "seen": found.support.seen,
            "analysis": analysis,
            "confidence": verdict.confidence,
            "chance": chance,
            "homography": found.homography,
            "homography_covariance": None if (fused := found.carried.fused) is None else fused.homography_covariance,
            "covariance": found.support.covariance,
            "view": found.carried.view,
        }
        if not analysis.stable and self._resynthesize:  # another grasp makes what is seen no surer
            self._reference = None
            self._given = self._object_at = self._box = None
            self._unstable = found.carried.view
        return answer

    def _refused(self, verdict: Verdict) -> dict[str, Any]:
        return {"status": verdict.status, "reason": verdict.reason, "grasp_id": self._grasp_id}

    # --- the first view --------------------------------------------------------------------------

    def _straight(self, image: NDArray[Any], mask: NDArray[Any] | None) -> tuple[NDArray[Any], NDArray[Any] | None]:
        """The image and its mask without the lens's distortion, where the camera is known."""
        if self._camera is None:
            return image, mask
        if self._lens is None:
            height, width = to_bgr(image).shape[:2]
            self._lens = Undistortion(self._camera, width, height)
            given = None if self._given is None else self._given.contacts
            told = Told(given, self._object_at, self._box, self._ignore).straight(self._lens)
            self._given = None if told.contacts is None else Grasp(told.contacts)
            self._object_at, self._box, self._ignore = told.object_at, told.box, told.ignore
        return self._lens.image(image), None if mask is None else self._lens.mask(mask)

    def _prepare(self, image: NDArray[Any], mask: NDArray[Any] | None) -> Grey:
        colours = to_bgr(image)
        height, width = colours.shape[:2]
        if self._shape is None:
            self._shape = height, width
            if self._ignore is not None:
                self._observer = Observer(grow(to_mask(self._ignore, self._shape, "ignore mask")))
        if (height, width) != self._shape:
            raise SourceError(
                f"image {self._frame + 1} is {width}x{height} px, but the first was "
                f"{self._shape[1]}x{self._shape[0]}; all must have one size",
                shape=(height, width),
            )
        return self._observer.look(colours if mask is None else as_scene(to_mask(mask, self._shape, "mask")))

    def _chosen(self, found: list[Candidate]) -> Candidate | None:
        """The object that is meant: the given contacts', the one whose grasp was refused, or the most outstanding."""
        if self._given is not None:
            return choice.holding(found, self._given)
        return found[0] if self._unstable is None else choice.same(found, self._unstable)
