# SPDX-License-Identifier: Apache-2.0
"""The answer of an update: status, reason and figures of a grasp that was judged where its object is located."""

from __future__ import annotations

import math
import time as clock
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.errors import ConditioningError, GraspError
from grasptrack.geometry.contours import View
from grasptrack.grasp.closure_probability import CHANCE, ClosureCheck, Judgement
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import FINGER_WIDTH
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.messages import StatusReason
from grasptrack.tracking.plane import UNKNOWN, Distance, Ruler
from grasptrack.tracking.pose import PoseEstimate
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.strategies import Carrier, Moved
from grasptrack.typing import Floats, Status


@dataclass(frozen=True)
class Track:
    """A grasp that was chosen.

    Attributes:
        number: of the grasp, from 1.
        closure: whether it closes.
        carrier: takes it from image to image.
        follower: knows where the object is.
        ruler: tells how far it is; None where nobody said how long the object is, or it is cut off in the first view.
    """

    number: int
    closure: ClosureCheck
    carrier: Carrier
    follower: Follower
    ruler: Ruler | None = None

    def distance_in(self, homography: Floats, covariance: Floats) -> Distance:
        """Of the object in a view, of H_current_reference (3, 3) and the covariance (9, 9) of its entries."""
        return UNKNOWN if self.ruler is None else self.ruler.distance_in(homography, covariance)


class Moment(NamedTuple):
    """Of an update.

    Attributes:
        frame: index of its image.
        time: s, when that was taken, or None.
        started: s, when the update began.
        repeated: the image is that of the update before.
        sure: as `object_sure` of a result.
        probability: as `object_probability` of a result.
    """

    frame: int
    time: float | None
    started: float
    repeated: bool
    sure: bool
    probability: float


def judged_status(judged: Judgement, chance: float, told: bool) -> tuple[Status, StatusReason | None]:
    """Whether a grasp is stable, and why not or by how much that is open; `told` as of `Rectifications`.

    What no view has told yet is no reason to refuse a grasp, and is said.
    """
    figures = {"chance": chance}
    if not judged.analysis.stable:
        return "unstable", StatusReason("not-closing", detail=judged.analysis.reason)
    if told and judged.closes < CHANCE:
        return "unstable", StatusReason("open-margin", figures)
    if (chance if told else judged.stays) < CHANCE:
        return "unstable", StatusReason("slips", figures)
    return "tracked", StatusReason("tilt-open", figures) if chance < CHANCE else None


def needs_another(judged: Judgement, told: bool) -> bool:
    """Whether a grasp is refused for good: another one makes what is seen no surer, and later views may make this one so."""
    if not told:
        return not judged.analysis.stable
    return judged.closes < 1.0 - CHANCE or (judged.closes < CHANCE and judged.settled)


def located_result(moment: Moment, track: Track, judged: Judgement, H: Floats, C: Floats, **found: Any) -> TrackResult:
    """The result where the contacts are located.

    Args:
        moment: of the update.
        track: the grasp.
        judged: whether it closes.
        H: (3, 3) H_current_reference.
        C: (9, 9) of its entries.
        **found: what else the result has.
    """
    plane, chance = track.follower.state.plane, judged.closure_probability
    tilt, distance = plane.tilt_in(H, C), track.distance_in(H, C)
    status, reason = judged_status(judged, chance, plane.rectifications.told)
    state, contacts = track.follower.state, found["contacts"]
    if status == "tracked" and state.sightings.are_stale(contacts, state.numbers):
        reason = StatusReason("contact-unseen")
    elif status == "tracked" and state.shows_sides(tilt.angle):
        reason = reason or StatusReason("not-flat", {"thickness": state.thickness})
    if plane.is_squeezed:
        reason = reason or StatusReason("not-pinhole", {"aspect": plane.aspect})
    return make_result(
        moment,
        status,
        reason,
        strategy=track.carrier.name,
        grasp_id=track.number,
        analysis=judged.analysis,
        chance=chance,
        margin_sd=judged.margin_sd,
        margin_image=judged.margin_image,
        tilt=tilt.angle,
        tilt_sd=tilt.sd,
        rectification=plane.rectifications.best,
        distance=distance.value,
        distance_sd=distance.sd,
        homography=H,
        last_seen=moment.frame - state.sightings.images,
        **found,
    )


def first_result(moment: Moment, track: Track, grasp: Grasp, view: View) -> TrackResult:
    """The result of the view in which a grasp is begun to be followed."""
    follower = track.follower
    return located_result(
        moment,
        track,
        track.closure.judge_first(follower.state.plane.rectifications),
        np.eye(3),
        np.zeros((9, 9)),
        contacts=grasp.contacts,
        seen=np.ones(len(grasp)),
        edge=1.0,
        surface=float(sum(follower.target.counts) > 0),
        confidence=1.0,
        view=view,
    )


def judge_moved(moment: Moment, track: Track, moved: Moved, friction: float) -> tuple[TrackResult, Judgement | None]:
    """The result of a later image, and whether the grasp closes there; None where it is not located."""
    estimate, contacts, view = moved.decision.estimate, moved.contacts, moved.view
    if estimate is None or contacts is None or moved.homography is None or view is None or moved.covariance is None:
        sure = moved.decision.confidence
        return make_result(moment, "lost", moved.reason, grasp_id=track.number, confidence=sure), None
    target, plane = track.follower.target, track.follower.state.plane
    H, homography_covariance = target.homography_and_covariance(estimate.G, moved.covariance)
    covariance = target.handle.placed(estimate.G, moved.covariance)[1]
    try:
        judged = track.closure.judge(contacts, friction, moved.homography, H, covariance, plane.rectifications)
    except (GraspError, ConditioningError) as error:
        reason = StatusReason("off-outline", detail=str(error))
        return make_result(moment, "lost", reason, grasp_id=track.number), None
    if contacts is not estimate.contacts:
        covariance = covariance + offset_covariance(contacts, estimate)
    found = located_result(
        moment,
        track,
        judged,
        H,
        homography_covariance,
        contacts=contacts,
        seen=target.contact_visibility(estimate.visible),
        edge=float(np.mean(estimate.visible)) if len(estimate.visible) else 0.0,
        surface=estimate.texture_agreeing,
        confidence=moved.decision.confidence,
        homography_covariance=homography_covariance,
        covariance=covariance,
        view=view,
        switch=moved.switch,
    )
    return found, judged


def make_closure_check(grasp: Grasp, view: View, friction: float) -> ClosureCheck:
    """Judges a grasp on an outline."""
    width = FINGER_WIDTH * math.sqrt(kernels.polygon_moments(view.points, view.offsets).area)
    return ClosureCheck(grasp, view, friction, width)


def make_result(moment: Moment, status: Status, reason: StatusReason | None, **found: Any) -> TrackResult:
    """The result of an update, which is over."""
    latency_ms, reason = 1000 * (clock.perf_counter() - moment.started), reason or StatusReason()
    if status == "tracked":  # nothing refuses it
        sentence, code, notice = "", "", reason.code
    else:
        sentence, code, notice = reason.sentence, reason.code, ""
    return TrackResult(
        moment.frame,
        moment.time,
        status,
        sentence,
        reason_code=code,
        notice=notice,
        latency_ms=latency_ms,
        object_sure=moment.sure,
        object_probability=moment.probability,
        repeated=moment.repeated,
        **found,
    )


def offset_covariance(contacts: Floats, estimate: PoseEstimate) -> Floats:
    """(k, 2, 2) px^2 that contacts (k, 2) are off on average for lying elsewhere than an estimate has them."""
    away = contacts - estimate.contacts
    return np.asarray(away[:, :, None] * away[:, None, :], dtype=np.float64)
