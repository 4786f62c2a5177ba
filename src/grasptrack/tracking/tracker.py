# SPDX-License-Identifier: Apache-2.0
"""The grasp tracking procedure of Fig. 3: synthesise once, then contour, transfer and analysis for each image."""

from __future__ import annotations

import math
import threading
import time as clock
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack import arguments
from grasptrack.errors import GraspError, InputError, SourceError, StrategyError
from grasptrack.first_image import DEFAULT_SURE, FIRST_IMAGE_CHECKS, FirstImage
from grasptrack.geometry.cameras import Camera
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import DEFAULT_FRICTION, check_count, check_friction
from grasptrack.grasp.hand import Hand, Length, checked_length
from grasptrack.images import Grey
from grasptrack.segmentation.candidate import Candidate, distinct_candidates
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.segmentation.segmenters import OneMask, segmenter_for
from grasptrack.tracking.answer import (
    Moment,
    Track,
    first_result,
    judge_moved,
    make_closure_check,
    make_result,
    needs_another,
)
from grasptrack.tracking.camera import Beforehand, rectifying_view
from grasptrack.tracking.follower import AUTO
from grasptrack.tracking.initialization import FirstScene, Wish, first_view, image_size, mask_as_scene, start_tracking
from grasptrack.tracking.messages import StatusReason
from grasptrack.tracking.numbers import DEFAULT_RISK, NUMBERS, check_risk
from grasptrack.tracking.plane import make_ruler
from grasptrack.tracking.redetection import check_search_ms
from grasptrack.tracking.result import LocatedResult, TrackResult, UnlocatedResult
from grasptrack.tracking.strategies import Moved
from grasptrack.transfer import check_strategy
from grasptrack.typing import StrategyName
from grasptrack.undistortion import Undistortion

KEPT_ROWS = 4
"""Every so many rows of an image are kept, to see whether the next one is another: no camera's noise leaves them alone."""


class GraspTracker:
    """Chooses a grasp in the first view and finds the same physical contacts in every image that follows.

    Args:
        fingers: number of contacts to synthesise, 2 or 3.
        strategy: "auto", "rrp", "grasp-line", "homography", "paper": the cheapest of these three that suffices, chosen anew in
            each image by `choose_strategy`; or one that a package registered as `grasptrack.strategies`.
        friction: Coulomb coefficient for synthesis and analysis.
        grasp: (k, 2) px contacts in the first image, in place of synthesis; they choose the object.
        object_at: (x, y) px of the object in the first image, or several, all on it.
        box: left, top, width and height of it, px, in the place of a pixel.
        ignore: (H, W) nonzero where nothing belongs to the scene.
        resynthesize: choose a new grasp, with a new grasp_id, when the present one is refused for good.
        hand: opening and fingers that a synthesised grasp must suit; default fingers in proportion to the object.
        choose: your own choice in the place of synthesis: given the object's outline in the first view, the grasps to try, the
            best first, of so many fingers each.
        segmenter: where regions of the first image come from beside this package's own search, as `segmenter_for` takes it.
            One with `segment(image)`, or a function, is your own segmentation in the place of this one: it is asked for a
            mask of every image that comes without one.
        not_at: (x, y) px, or several, beside the object.
        outline: (n, 2) px of a rough polygon round the object: any object that a person can see is had with it.
        background: an image of the same bench without the object, taken from where the first image is, up to a few px; the
            light may differ.
        number: of the candidate that a person took, 1 being the likeliest; see `first_look` and `distinct_candidates`.
        more: images that follow the first one. Where its choice of the object is not sure and no person said which is meant, up
            to four of them are asked, see `first_look`; they are not tracked.
        sure: probability from which the choice of the object is sure, where no person said which is meant: results of a
            less likely one have `object_sure` False, and a servo does not move. 0 takes the likeliest without a question.
        first_look_ms: work that the search for the object may do, see `first_look`.
        camera: its calibration. Images are made straight before anything is looked at, and the focal length is known.
            Everything that goes in and comes out stays in px of the images as they are, but for the homography, which is in
            ideal px.
        risk: probability, between 0 and 1, below which an answer may be wrong: contacts are given where one is off by more
            than 3 px and 4 % of sqrt(area) (`tolerance`), or on another object, with less than this. Smaller means fewer and
            surer answers.
        length: of the object, in any unit: the longer side of the smallest rectangle round its outline, as a caliper measures
            it. Results then tell their `distance` in this unit.
        pixel_aspect: width of a pixel over its height, as of an image that was squeezed; a calibration says it itself. Without
            it views that differ tell, and the notice "not-pinhole".
        belt: (x, y) px/s, how a belt that carries the object moves in the first image, before a camera at rest. The object is
            expected where it has gone by then, after any gap; without it every view has to show how it moves.
        tolerance: by which a contact may be off, in their place: px, a Length or a text such as
            "5%"; mm need the scale of `hand`. It is one on the object, as the image shows that in which the grasp is chosen,
            and goes with its size.
        wait: begin only when an object lies whole in view and its choice is sure; until then results are searching,
            "waiting".
        next_object: when the object has left the image, go on with the next one that lies whole in view, by a new grasp_id.
            What is said of the first image, but for `ignore` and `background`, is of the first object alone. One that comes
            back is a new one. What is hidden, blurred or lost in plain view is not given up.
        search_ms: work that the search for a lost object may do in an image beside where motion and ground have it, ms on the
            machine of the benchmarks, as for `first_look_ms`. What does not fit waits for the next images, that which has
            waited longest is done in any case: less makes images of a loss faster and may find the object later. What
            speaks against an answer is looked for without a bound. None does all that is due.

    Attributes:
        candidates: up to three objects that the first look may take, the likeliest first, with `view` and `probability`; empty
            before. `number` chooses among them.
        object_sure: a person said which outline is meant, or its choice is sure; True before there is one.

    Raises:
        StrategyError: unknown strategy, or more fingers than it can carry.
        GraspError: contacts that are none, fewer than two fingers, or more than 8.
        InputError: friction not positive, a risk or probability out of range, both a pixel and a box, both a grasp and a
            choice, both a calibration and an aspect, a length, an aspect or a bound not above 0, or a number below 1.
    """

    @arguments.checked(
        fingers=arguments.whole,
        strategy=arguments.text,
        friction=arguments.number,
        grasp=arguments.optional(arguments.array(unbounded=True)),
        **FIRST_IMAGE_CHECKS,
        hand=arguments.optional(arguments.instance(Hand)),
        choose=arguments.optional(arguments.function),
        camera=arguments.optional(arguments.instance(Camera)),
        risk=arguments.number,
        length=arguments.optional(arguments.number),
        pixel_aspect=arguments.optional(arguments.number),
        number=arguments.optional(arguments.whole),
        more=arguments.several,
        sure=arguments.number,
        first_look_ms=arguments.optional(arguments.number),
        resynthesize=arguments.truth,
        wait=arguments.truth,
        next_object=arguments.truth,
        belt=arguments.optional(arguments.array(2)),
        search_ms=arguments.optional(arguments.number),
    )
    def __init__(
        self,
        *,
        fingers: int = 2,
        strategy: StrategyName | str = AUTO,
        friction: float = DEFAULT_FRICTION,
        grasp: ArrayLike | None = None,
        object_at: ArrayLike | None = None,
        box: tuple[float, float, float, float] | None = None,
        ignore: NDArray[Any] | None = None,
        resynthesize: bool = False,
        hand: Hand | None = None,
        choose: Callable[[View], Sequence[Grasp]] | None = None,
        segmenter: Any = None,
        camera: Camera | None = None,
        risk: float = DEFAULT_RISK,
        length: float | None = None,
        pixel_aspect: float | None = None,
        not_at: ArrayLike | None = None,
        outline: ArrayLike | None = None,
        background: NDArray[Any] | None = None,
        number: int | None = None,
        more: Iterable[NDArray[Any]] = (),
        sure: float = DEFAULT_SURE,
        first_look_ms: float | None = None,
        tolerance: Length | float | str | None = None,
        wait: bool = False,
        next_object: bool = False,
        belt: ArrayLike | None = None,
        search_ms: float | None = None,
    ) -> None:
        given = None if grasp is None else Grasp(grasp)  # before the number of fingers, which it sets
        self.fingers = _checked_fingers(fingers if given is None else len(given), strategy, given)
        check_friction(friction)
        if object_at is not None and box is not None:
            raise InputError("a pixel and a box both say which object is meant: give one of them")
        if given is not None and choose is not None:
            raise InputError("a grasp and a choice of one both say which grasp is meant: give one of them")
        if length is not None and not 0.0 < length < math.inf:
            raise InputError(f"the object's length must be a positive number, not {length:g}", length=length)
        if pixel_aspect is not None and not 0.0 < pixel_aspect < math.inf:
            raise InputError(
                f"pixel_aspect is the width of a pixel over its height, above 0, not {pixel_aspect:g}",
                pixel_aspect=pixel_aspect,
            )
        if pixel_aspect is not None and camera is not None:
            raise InputError("a calibration says how wide pixels are: leave out pixel_aspect")
        self.length, self.pixel_aspect = length, pixel_aspect
        self.strategy, self.friction, self.risk = strategy, friction, check_risk(risk)
        allowed = None if tolerance is None else _checked_tolerance(tolerance, hand)
        if next_object and self.fingers > 3:
            raise StrategyError(
                f"the next object's grasp is synthesised, for 2 or 3 fingers, not {self.fingers}; give 2 or 3 contacts",
                fingers=self.fingers,
            )
        regions = segmenter_for(segmenter)
        self._masks = regions if isinstance(regions, OneMask) else None
        said = FirstImage.of(
            object_at,
            not_at=not_at,
            box=box,
            outline=outline,
            grasp=grasp,
            number=number,
            ignore=ignore,
            background=background,
            more=more,
            sure=sure,
            first_look_ms=first_look_ms,
        )
        self.search_ms = check_search_ms(search_ms)
        self._wish = Wish(said, self.fingers, strategy, friction, hand, choose, regions, self.risk, allowed, wait)
        self._belt = None if belt is None else np.asarray(belt, dtype=np.float64)
        self._resynthesize, self._next, self._camera = resynthesize, next_object, camera
        self._lens: Undistortion | None = None
        self._shape: tuple[int, ...] | None = None
        self._observer = OutlineDetector()
        self.candidates: list[Candidate] = []
        self.object_sure = True
        self._object_probability = math.nan
        self._frame = -1
        self._grasps = 0
        self._track: Track | None = None
        self._turn = threading.Lock()
        self._plane: Beforehand | None = None  # of another grasp: what the one before has told
        self._scene: FirstScene | None = None  # of the update before
        self._rows: NDArray[Any] | None = None  # of the image before
        self._void: StatusReason | None = None  # why contacts that were given are those of no object
        self._latest, self._told_of_time = -math.inf, False

    def __getstate__(self) -> dict[str, Any]:
        """All but the lock, which has no copy, and the image of a choice that was made just now."""
        return {name: value for name, value in self.__dict__.items() if name not in ("_turn", "_scene")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """A copy has a lock of its own."""
        if not vars(GraspTracker()).keys() - {"_turn", "_scene"} <= state.keys():
            raise InputError("this is no tracker of this version of grasptrack: track anew")
        self.__dict__.update(state, _turn=threading.Lock(), _scene=None)

    # --- Fig. 3 ----------------------------------------------------------------------------------

    @arguments.checked(
        image=arguments.array(unbounded=True),
        time=arguments.optional(arguments.finite),
        mask=arguments.optional(arguments.array(unbounded=True)),
    )
    def update(
        self, image: NDArray[Any], time: float | None = None, mask: NDArray[Any] | None = None
    ) -> LocatedResult | UnlocatedResult:
        """Look at the next image.

        Args:
            image: 8 or 16 bit, grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4).
            time: s, at which it was taken; the motion is carried on for as long, so that dropped frames do no harm. None
                counts frames.
            mask: (H, W) the user's segmentation of this image, nonzero on the object; it takes the image's place.

        Raises:
            SourceError: an image of another size than the first, or one that cannot be used.
            GraspError: given contacts that are not on an object.
            InputError: a mask of another size than the image, a time that is no finite number, or another thread's update of
                this tracker is not over. Trackers in different threads do not mind each other.
        """
        started = clock.perf_counter()
        if not self._turn.acquire(blocking=False):
            raise InputError("a tracker looks at one image after another: call update from one thread at a time")
        try:
            return cast("LocatedResult | UnlocatedResult", self._track_image(image, time, mask, started))
        finally:
            self._turn.release()

    def _track_image(
        self, image: NDArray[Any], time: float | None, mask: NDArray[Any] | None, started: float
    ) -> TrackResult:
        """The same, `started` at a time of the clock in s."""
        if time is not None:
            self._mind_time(time)
        mask = self._masks.segment(image) if mask is None and self._masks else mask
        grey, self._scene = self._prepare_image(image, mask), None
        repeated = self._is_repeated(np.asarray(image if mask is None else mask))
        moment = Moment(self._frame, time, started, repeated, self.object_sure, self._object_probability)
        if self._track is None:
            result = self._begin_tracking(moment, masked=mask is not None)  # grasp synthesis, once
        else:
            # contour extraction, grasp transfer, and whether to believe it
            moved = self._track.carrier.move(grey, time)
            result = self._analyzed_result(moment, self._track, moved)
        return result if self._lens is None else self._lens.result_seen(result)

    def _mind_time(self, time: float) -> None:
        """Say once that a time lies before that of an earlier update."""
        if time < self._latest and not self._told_of_time:
            self._told_of_time = True
            warnings.warn(
                f"update {self._frame + 1} was given the time {time:g} s, after one of {self._latest:g} s: until times go on, "
                "images count as taken one frame after another (give every image the s at which it was taken, or no time)",
                stacklevel=5,
            )
        self._latest = max(self._latest, time)

    def _is_repeated(self, image: NDArray[Any]) -> bool:
        """Whether the rows that are kept of the image before are the same in this one."""
        before, self._rows = self._rows, image[::KEPT_ROWS].copy()
        # those of another image differ in the first one already
        return before is not None and np.array_equal(before[0], self._rows[0]) and np.array_equal(before, self._rows)

    def _begin_tracking(self, moment: Moment, *, masked: bool) -> TrackResult:
        """Choose the object and a grasp on it."""
        if self._void is not None:
            return make_result(moment, "searching", self._void)
        before, self._plane = self._known_beforehand(), None
        wish = replace(self._wish, friction=self.friction)
        first = first_view(self._observer, wish, masked)
        self._wish = replace(self._wish, plane=None, said=replace(wish.said, more=()))  # later they would lie otherwise
        self.candidates = self._seen_candidates(first.found)
        candidate, reason = first.candidate, first.reason
        if candidate is None:
            return make_result(moment, "searching", self._reason_for_good(reason))
        self._scene = FirstScene(self._observer.colours, masked, first, wish, before)
        if self._wish.before is None:
            self.object_sure = masked or wish.is_sure_of(candidate)
            self._object_probability = candidate.probability
            moment = moment._replace(sure=self.object_sure, probability=self._object_probability)
        grey = self._observer.choose_object(candidate)
        start = start_tracking(first, wish, grey, self._observer, moment.time, before)
        if start.carrier is None or start.grasp is None:
            if start.refusal:
                reason = StatusReason("no-description", detail=start.refusal)
            return make_result(moment, "searching", reason, view=candidate.view)
        self._grasps += 1
        grasp, follower = start.grasp, start.carrier.follower
        follower.search_ms = self.search_ms
        closure = make_closure_check(grasp, candidate.view, self.friction)
        plane = follower.state.plane
        ruler = None if self.length is None else make_ruler(follower.target, plane, self.length)
        self._track = track = Track(self._grasps, closure, start.carrier, follower, ruler)
        return first_result(moment, track, grasp, candidate.view)

    def _reason_for_good(self, reason: StatusReason) -> StatusReason:
        """Why no object was made out; for good where contacts were given, which are those of this image."""
        wish = self._wish
        if wish.said.grasp is not None and not wish.waits and wish.before is None:
            detail = f"{reason.detail}: give contacts in an image that shows the object, for in later ones they lie elsewhere"
            self._void = reason = replace(reason, detail=detail)
        return reason

    def _request_another_grasp(self, view: View, plane: Beforehand) -> None:
        """Another grasp is to be chosen in the next image, on the object that has this outline and lies in this plane."""
        height, width = self._shape or (0, 0)
        self._track, self._plane = None, plane
        self._wish = self._wish.for_another(
            view, partial(rectifying_view, plane.theta, width=width, height=height, aspect=plane.aspect or 1.0)
        )

    def _analyzed_result(self, moment: Moment, track: Track, moved: Moved) -> TrackResult:
        """Analysis of what is believed."""
        result, judged = judge_moved(moment, track, moved, self.friction)
        plane = track.follower.state.plane
        if self._next and track.follower.state.has_left:
            self._track, self._wish = None, self._wish.for_next()
        again = judged is not None and self._resynthesize and needs_another(judged, plane.rectifications.told)
        H, covariance = result.homography, result.homography_covariance
        if again and result.view is not None and H is not None and covariance is not None:
            self._request_another_grasp(result.view, plane.as_prior(H, covariance))
        return result

    @property
    def wish(self) -> Wish:
        """What is asked of the image in which an object is chosen, for `trackability.inspect`."""
        return self._wish

    @property
    def first_scene(self) -> FirstScene | None:
        """What the last update chose an object in, for `trackability.inspect_scene`; None where it chose none."""
        return self._scene

    # --- images ----------------------------------------------------------------------------------

    def _prepare_image(self, image: NDArray[Any], mask: NDArray[Any] | None) -> Grey:
        """The image, or the mask in its place, as everything that follows sees it."""
        if self._camera is not None:
            image, mask = self._undistort_image(image, mask, self._camera)
        said = self._wish.said
        if self._frame < 0:
            said = said.within(image_size(image))
            self._observer = OutlineDetector(said.hidden)
        grey = self._observer.set_image(image if mask is None else mask_as_scene(mask, image_size(image)))
        self._shape = self._shape or grey.shape
        if grey.shape != self._shape:
            (height, width), (first_height, first_width) = grey.shape, self._shape
            raise SourceError(
                f"image {self._frame + 2} is {width}x{height} px, but the first was "
                f"{first_width}x{first_height}; all must have one size",
                shape=grey.shape,
            )
        if self._frame < 0:
            self._wish = replace(self._wish, said=said)
        self._frame += 1
        return grey

    def _known_beforehand(self) -> Beforehand:
        """What is known of camera and tilt, by the grasp before or by the calibration, and of the belt."""
        told = None if self._lens is None else Beforehand.by_calibration(self._lens.focal, NUMBERS)
        before = told or replace(Beforehand.of_unknown(NUMBERS), aspect=self.pixel_aspect)
        return replace(self._plane or before, belt=self._belt)

    def _seen_candidates(self, found: list[Candidate]) -> list[Candidate]:
        """Candidates in px of the images as they are, those that a person would tell apart."""
        lens = self._lens
        apart = distinct_candidates(found)
        return apart if lens is None else [c._replace(view=lens.view_seen(c.view)) for c in apart]

    def _undistort_image(
        self, image: NDArray[Any], mask: NDArray[Any] | None, camera: Camera
    ) -> tuple[NDArray[Any], NDArray[Any] | None]:
        """The image and its mask without the lens's distortion."""
        if self._lens is None:
            height, width = image_size(image)
            self._lens = Undistortion(camera, width, height)
            self._wish = replace(self._wish, said=self._wish.said.without_distortion(self._lens))
        return self._lens.straight_image(image), None if mask is None else self._lens.straight_mask(mask)


def _checked_fingers(fingers: int, strategy: str, given: Grasp | None) -> int:
    """The number of fingers.

    Raises:
        StrategyError, GraspError: what cannot be synthesised or carried.
    """
    check_strategy(strategy)
    if fingers < 2:
        raise GraspError(f"a grasp has at least 2 fingers, not {fingers}", fingers=fingers)
    if strategy == "grasp-line" and fingers != 2:
        raise StrategyError(f"grasp-line carries 2 fingers, not {fingers}; use rrp or homography", fingers=fingers)
    if given is None and fingers > 3:
        raise StrategyError(
            f"grasps are synthesised for 2 or 3 fingers, not {fingers}; give the contacts", fingers=fingers
        )
    check_count(fingers)
    return fingers


def _checked_tolerance(given: Length | float | str, hand: Hand | None) -> Length:
    """By how much a contact may be off, in px or as a share of the object's size.

    Raises:
        InputError: no positive length, or one in mm of a hand without scale.
    """
    length = checked_length(given, "tolerance")
    if not 0.0 < length.value < math.inf:
        raise InputError(f"tolerance must be a positive length, not {given!r}", tolerance=repr(given))
    scale = None if hand is None else hand.px_per_mm
    return length if length.unit == "size" else Length(length.in_px(1.0, scale))
