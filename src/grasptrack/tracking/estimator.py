# SPDX-License-Identifier: Apache-2.0
"""Hypotheses of the pose made exact (`kernels.PoseTarget.solve`), and the state in the first image."""

import math

import numpy as np

from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.plane import Plane
from grasptrack.tracking.pose import Hypothesis, Look, PoseEstimate, sane_area
from grasptrack.tracking.state import NO_BEND, ContactSightings, Shutter, TrackState, nothing_visible
from grasptrack.tracking.target import Grey, Target
from grasptrack.typing import Floats

UNKNOWN_POSE: Floats = np.full((3, 3), np.nan)
"""The last pose, where none tells what moved."""
WHOLE_WAY = 1.0
"""Half the blur of what began to move since the last image, while the shutter was open all the time: as far as it went."""
SHARP = 0.0
"""The same of a shutter that is open but for a moment."""
NO_WITNESS: Floats = np.full(8, np.inf)
"""Variances of what the surface tells where it is not asked."""
FIRST_POSE_SD = 0.05
"""Work px, of the pose's error in the first image, which defines it."""


def estimate_pose(
    state: TrackState,
    levels: list[Grey],
    hypothesis: Hypothesis,
    *,
    blur_share: float | None = None,
    still: bool = False,
    surface: bool = True,
) -> PoseEstimate | None:
    """The pose near a hypothesis that image, prior and camera model agree on; None where there is none.

    Args:
        state: of the object.
        levels: the image's pyramid.
        hypothesis: where it may be.
        blur_share: half of an edge's blur, of what moved across it since the last image; None takes that which is believed.
        still: the last pose does not tell what moved since.
        surface: False to leave the texture out, which then is looked at only.
    """
    target, readout = state.target, state.shutter.readout
    if not sane_area(target, hypothesis.G):
        return None
    bend = NO_BEND if still else state.shutter_bend(levels, hypothesis.G)
    found: PoseEstimate = target.handle.solve(
        levels,
        hypothesis.G,
        hypothesis.P,
        UNKNOWN_POSE if still else state.last.G,
        bend,
        readout.share,
        readout.variance,
        state.nuisance,
        state.nuisance_covariance,
        state.sides,
        state.inner_spread,
        *state.light,
        hypothesis.reach,
        state.edge_width,
        state.blur_share if blur_share is None else blur_share,
        state.surface_lag if surface else NO_WITNESS,
        state.plane.aspect,
    )
    area = sane_area(target, found.G) if found.valid else 0.0
    if not area:
        return None
    occluded = found.occluded
    found.origin, found.area = hypothesis.origin, area
    found.hidden = float(occluded.sum()) / len(occluded) if len(occluded) else 0.0
    if target.any_turn:
        P = np.linalg.inv(np.linalg.inv(found.P) + target.agreed)
        found = target.handle.known_by(found, P, found.beforehand + target.agreed)
    return found


def first_state(
    target: Target, levels: list[Grey], before: Beforehand | None = None, time: float | None = None
) -> TrackState:
    """The state in the first image, where the pose is known by definition.

    Each patch of the surface is expected to look alike as far as noise allows.

    Args:
        target: the object.
        levels: pyramid of the first image.
        before: what is known of camera and tilt, as for `Plane`.
        time: s, of the image.
    """
    numbers, look, count = target.numbers, Look(levels, target.A), len(target.contacts)
    height, width = levels[0].shape
    before = before or Beforehand.of_unknown(numbers)
    nuisance_covariance = np.diag([(numbers.thickness_sd * target.size) ** 2, 0.0, 0.0, 0.0])
    nuisance_covariance[1:, 1:] = before.scale
    state = TrackState(
        target=target,
        last=look,
        located=look,
        expected=target.A,
        P=np.eye(8) * FIRST_POSE_SD**2,
        shutter=Shutter(target.A, height, numbers),
        nuisance=np.array([0.0, *before.theta]),
        nuisance_covariance=nuisance_covariance,
        plane=Plane(target, width, height, before),
        sightings=ContactSightings(
            places=target.contacts.copy(),
            since_s=np.zeros(count),
            images=np.zeros(count, np.int64),
            first=target.contacts,
            open=np.full(count, True),
            look=look,
            shown=nothing_visible(),
        ),
        sides=numbers.sides,
        edge_width=target.edge_width,
        blur_share=numbers.blur_share,
        usual=[np.zeros(n) for n in target.counts],
        unasked=[np.ones(n, dtype=bool) for n in target.counts],
        time=time,
        belt=before.belt,
        slip=math.log(numbers.witness_fails / (1.0 - numbers.witness_fails)),
        fast=target.contacts,
    )
    own = estimate_pose(state, levels, Hypothesis("first", target.A, state.P))
    if own is not None:
        # V / (V + grain) is what a patch of variance V has with itself, (V - grain) / (V + grain) with another look
        state.usual = [np.clip(2.0 * np.nan_to_num(r) - 1.0, 0.0, 1.0) for r in own.correlation]
    return state
