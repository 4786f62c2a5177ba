# SPDX-License-Identifier: Apache-2.0
"""What the tracker says of one frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from grasptrack.equality import compared_by_value
from grasptrack.geometry.contours import View
from grasptrack.grasp.force_closure import GraspAnalysis
from grasptrack.presentation import format_confidence
from grasptrack.typing import Status


@compared_by_value
@dataclass(frozen=True, slots=True)
class TrackResult:
    """One frame's answer. Two are equal where all but `latency_ms` is.

    Attributes:
        frame: index of the update, from 0.
        time: s, or None where the source has no times.
        status: searching (no object or no stable grasp yet), tracked (located, believed, stable), unstable (located and
            believed, but the analysis refuses it), lost (not found, or not believed: no contacts).
        reason: a short sentence; empty when tracked.
        strategy: the transfer that gave the contacts; empty when none did.
        grasp_id: number of the grasp, from 1; None before there is one.
        contacts: (k, 2) px in the order of the grasp; None unless tracked or unstable.
        seen: (k,) 0 to 1, how much of the outline at each contact was observed; None with the contacts.
        edge: 0 to 1, the share of the whole outline whose own edge was observed; NaN without contacts.
        surface: 0 to 1, the share of the surface's patches that agree with the answer; 0 of a plain one, NaN without contacts.
        analysis: the grasp's analysis, in the object's own plane; None with the contacts.
        confidence: 0 to 1, the complement of the probability that a contact is off by more than the tolerance, 3 px and 4 % of
            sqrt(area) unless another is asked for, or on another object. Lost frames tell that of the best guess, which was not
            sure enough to be given: at most 1 - risk, and 0 where there is none. Never beyond what runs of scenes have shown
            (`untested` in docs/tables/numbers.md); 1 in the first view, by definition.
        chance: probability, 0 to 1, that the grasp closes although the contacts may be off by their covariance, the least that
            it is (`closure_probability.chance_of_closing`), and the object's plane tilted otherwise; NaN where none is known.
        homography: (3, 3) H_current_reference where the transfer gives one.
        homography_covariance: (9, 9) of its entries, row by row, the last one being 1, where it is known.
        covariance: (k, 2, 2) px^2 of the contacts where it is known.
        view: the outline that was observed, for drawing; None when nothing was.
        latency_ms: time that the update took; equal results may differ in it.
        margin_sd: rad, standard deviation of the analysis's margin, by what is not known of the object's plane and outline.
        margin_image: rad, the margin in the image as it is, where perspective bends friction cones.
        tilt: rad, between the optical axis and the normal of the object's plane, by all views so far.
        tilt_sd: rad, its standard deviation.
        rectification: (3, 3) px of the reference view to the object's own plane, up to a similarity, in which it is judged.
        distance: from the camera to the object's plane, along the line of sight to the grasp's middle, in the unit in which its
            length was told; NaN where it was not.
        distance_sd: its standard deviation.
        reason_code: the reason in one word, see `messages.SENTENCES`; empty with the reason.
        notice: what is to be known of a tracked frame, in one word: "tilt-open" where no view has told yet how the object's
            plane is tilted, and whether the grasp closes depends on it; "contact-unseen" where neither the outline at a contact
            nor the surface beside it was seen for half a second in which the object moved; "not-flat" where views show sides
            so high that a contact on a lower edge is off; "not-pinhole" where they fit pixels that are not square; else empty.
        object_sure: the choice of the object in the first view is sure, or a person took its outline or a candidate; a pixel,
            a box or contacts say where it is, not which outline it has.
        object_probability: 0 to 1, of the outline that was chosen in the first view; NaN where no choice was made.
        last_seen: (k,) index of the last update in which each contact was seen itself, by the outline under the finger or the
            surface beside it; None with the contacts.
        repeated: the image has the very pixels of the one before: a camera that hangs gives its last image again, and such an
            answer is no news of the scene.
        instance_id: number of the instance in a `SceneTracker`, from 1; None of a tracker of one object.
        part_id: name of its part; empty of a tracker of one object.
        switch: where `strategy` is another than that of the answer before, both names and why; else empty.
    """

    frame: int
    time: float | None
    status: Status
    reason: str
    strategy: str = ""
    grasp_id: int | None = None
    contacts: NDArray[np.float64] | None = None
    seen: NDArray[np.float64] | None = None
    analysis: GraspAnalysis | None = None
    confidence: float = 0.0
    homography: NDArray[np.float64] | None = None
    covariance: NDArray[np.float64] | None = None
    view: View | None = None
    chance: float = math.nan
    latency_ms: float = field(default=math.nan, compare=False)
    homography_covariance: NDArray[np.float64] | None = None
    reason_code: str = ""
    margin_sd: float = math.nan
    margin_image: float = math.nan
    tilt: float = math.nan
    tilt_sd: float = math.nan
    rectification: NDArray[np.float64] | None = None
    distance: float = math.nan
    distance_sd: float = math.nan
    notice: str = ""
    object_sure: bool = True
    object_probability: float = math.nan
    edge: float = math.nan
    surface: float = math.nan
    repeated: bool = False
    last_seen: NDArray[np.int64] | None = None
    instance_id: int | None = None
    part_id: str = ""
    switch: str = ""

    def __repr__(self) -> str:
        at = "" if self.contacts is None else ", " + " ".join(f"{x:.2f},{y:.2f}" for x, y in self.contacts.tolist())
        why = f" ({self.reason_code})" if self.reason_code else ""
        sure = f"{self.confidence:.3f}" if self.located else format_confidence(self.confidence)
        return f"TrackResult(frame {self.frame}: {self.status}{why}{at}, confidence {sure})"

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        from grasptrack.presentation import to_dict

        return to_dict(self)

    def _repr_png_(self) -> bytes:
        from grasptrack.presentation import png_of

        return png_of(self)

    @property
    def located(self) -> bool:
        """Whether contacts are given.

        Of what `GraspTracker.update` returns, type checkers learn it from the status too; mypy also from this property, pyright
        from `result.located is True`.
        """
        return self.contacts is not None

    @property
    def margin_deg(self) -> float:
        """The analysis's margin in degrees; NaN without contacts."""
        return math.nan if self.analysis is None else self.analysis.margin_deg

    @property
    def margin_sd_deg(self) -> float:
        """`margin_sd` in degrees."""
        return math.degrees(self.margin_sd)

    @property
    def margin_image_deg(self) -> float:
        """`margin_image` in degrees."""
        return math.degrees(self.margin_image)

    @property
    def tilt_deg(self) -> float:
        """`tilt` in degrees."""
        return math.degrees(self.tilt)

    @property
    def tilt_sd_deg(self) -> float:
        """`tilt_sd` in degrees."""
        return math.degrees(self.tilt_sd)


if TYPE_CHECKING:

    class LocatedResult(TrackResult):
        """A result with contacts, as type checkers see it."""

        status: Literal["tracked", "unstable"]
        grasp_id: int
        contacts: NDArray[np.float64]
        seen: NDArray[np.float64]
        analysis: GraspAnalysis
        homography: NDArray[np.float64]
        view: View

        @property
        def located(self) -> Literal[True]:
            """It is."""

    class UnlocatedResult(TrackResult):
        """A result without contacts, as type checkers see it."""

        status: Literal["searching", "lost"]
        contacts: None
        seen: None
        analysis: None

        @property
        def located(self) -> Literal[False]:
            """It is not."""

else:
    LocatedResult = UnlocatedResult = TrackResult
