# SPDX-License-Identifier: Apache-2.0
"""Patches of the first view that are none of the object: what lies over the image stays there when the object has moved on."""

import math

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.geometry.homographies import apply_homography
from grasptrack.kernels import PATCH_SIDE
from grasptrack.kernels.results import SurfaceEvidence
from grasptrack.tracking.estimator import FIRST_POSE_SD, estimate_pose
from grasptrack.tracking.evidence import (
    OUTLINE_PRIOR,
    outline_evidence,
    surface_evidence,
    texture_evidence,
)
from grasptrack.tracking.pose import Hypothesis, PoseEstimate, carried_in_front, changed_estimate, mixed_estimate
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey, as_grey
from grasptrack.typing import Bools, Floats

ALONE = 0.5
"""Share of a frame's motion, as a standard deviation, by which the outline alone may leave the joint answer. With all of it so
many edges come into question everywhere that none is believed."""
MOST_MOVED = 0.5
"""Share of the patches in question that have moved by their own size, from which on they are asked."""


def forget_fixed_patches(state: TrackState) -> None:
    """Drop the patches that the last image still shows where the first one had them, though the object has moved on.

    A crosshair, a watermark, dirt or a lamp's reflection. Each is asked once, when it has moved by its own size, so that
    nothing of the object's own is left there; and only together with most of the others, for chance makes one alone alike.
    """
    target, numbers, look = state.target, state.numbers, state.located
    if look is not state.last:  # where the object is now is not sure
        return
    asked = [left & far for left, far in zip(state.unasked, _moved_patches(state, look.G), strict=True)]
    if sum(map(np.count_nonzero, asked)) <= MOST_MOVED * sum(map(np.count_nonzero, state.unasked)):
        return
    at_rest = estimate_at_rest(state, look.levels)
    if at_rest is None:
        return
    shown = [np.where(which, r, np.nan) for which, r in zip(asked, at_rest.correlation, strict=True)]
    state.unasked = [left & ~which for left, which in zip(state.unasked, asked, strict=True)]
    found: SurfaceEvidence = surface_evidence(shown, state.usual, numbers)
    if numbers.temper * found.log_odds < -math.log(numbers.fixed):
        return
    spreads = numbers.match_spread, numbers.chance_spread
    own = [~(fixed > 0.5) for fixed in kernels.surface_probability(shown, state.usual, *spreads)]
    state.target = target.with_patches(own)
    state.usual = [usual[kept] for usual, kept in zip(state.usual, own, strict=True)]
    state.unasked = [left[kept] for left, kept in zip(state.unasked, own, strict=True)]


def estimate_at_rest(state: TrackState, levels: list[Grey]) -> PoseEstimate | None:
    """What an image shows of the object where the first one had it; None where that is nowhere."""
    first = Hypothesis("first", state.target.A, FIRST_POSE_SD**2 * np.eye(8))
    return estimate_pose(state, levels, first, still=True, surface=False)


def against_fixed_surface(
    state: TrackState, levels: list[Grey], estimate: PoseEstimate, at_rest: PoseEstimate, *, still: bool
) -> PoseEstimate:
    """An estimate, or what the outline says alone, as far as all of the surface may be fixed in the image.

    An outline that fits itself in more ways than one goes with any surface. By Laplace's approximation of the evidence of both:
    where the outline alone leaves much open, a surface of the object's own seldom shows by chance just where it was at first.

    Args:
        state: of the object.
        levels: the image's pyramid.
        estimate: by outline and surface together.
        at_rest: as of `estimate_at_rest`.
        still: as of `estimate_pose`.
    """
    target, numbers = state.target, state.numbers
    hypothesis = Hypothesis(estimate.origin, estimate.G, estimate.P + ALONE**2 * target.noise_of_motion)
    alone = estimate_pose(state, levels, hypothesis, still=still, surface=False)
    if alone is None:
        return estimate
    surface = texture_evidence(state, at_rest) - texture_evidence(state, estimate)
    outline = outline_evidence(alone, numbers) - outline_evidence(estimate, numbers)
    volume = 0.5 * float(np.linalg.slogdet(alone.P)[1] - np.linalg.slogdet(estimate.P)[1])
    odds = math.log(numbers.fixed) + numbers.temper * surface + outline + volume
    found = mixed_estimate(target, [estimate, alone], [0.0, odds])
    return changed_estimate(found, confirmed=estimate.confirmed)


def false_piece_log_odds(state: TrackState, levels: list[Grey], G: Floats, samples: Bools) -> float:
    """Log odds that a piece of the outline that differs is none of the object's, but was taken in; -inf if nothing tells.

    Either most of it lay at a glare: one edge is as probable as the other, until views in which the object moved have mostly
    shown the piece. Or it is fixed in the image: it lies where the first image had it, though nothing of the object's own
    outline is left in the patches there, as that has moved on, and not along an edge of its own.

    Args:
        state: of the object.
        levels: the image's pyramid.
        G: (3, 3) a pose.
        samples: (n,) which of the outline's the piece is.
    """
    target, numbers, half, image = state.target, state.numbers, PATCH_SIDE // 2, levels[0]
    first_image = target.recipe.textures[0][0][0]
    if not samples.any() or first_image.shape != image.shape:  # that of a part on file
        return -math.inf
    first, now = (apply_homography(H, target.points) for H in (target.A, G))
    shown, looked = (each if len(each) else np.zeros(len(samples)) for each in (state.shown, state.shown_in))
    against = math.log(numbers.share_other)  # by each sample that was seen elsewhere
    glare = -math.inf
    if 2 * np.count_nonzero(samples & target.at_glare) > np.count_nonzero(samples):
        glare = min(0.0, against * float((2.0 * shown - (looked > 0.0))[samples].sum()))
    left = np.hypot(*(first[samples][:, None] - now[None]).T).min(axis=0) >= PATCH_SIDE / math.sqrt(2.0)
    there = np.rint(first[samples][left]).astype(int)
    there = there[(there >= half).all(axis=1) & (there < np.array(image.shape[::-1]) - half).all(axis=1)]
    if not len(there):
        return glare
    agreeing = []
    for x, y in there.tolist():
        window = slice(y - half, y + half + 1), slice(x - half, x + half + 1)
        patches = as_grey(image[window]), as_grey(first_image[window])
        agreeing.append(float(cv2.matchTemplate(*patches, cv2.TM_CCOEFF_NORMED)[0, 0]))
    found: SurfaceEvidence = surface_evidence([np.array(agreeing)], [np.ones(len(agreeing))], numbers, OUTLINE_PRIOR)
    fixed = math.log(numbers.misled) + found.log_odds + against * float(shown[samples][left].sum())
    return float(np.logaddexp(glare, fixed))


def _moved_patches(state: TrackState, G: Floats) -> list[Bools]:
    """Which patches of each level lie, at a pose (3, 3), farther than their own size from where the first image had them."""
    target, found = state.target, list[Bools]()
    scale = math.sqrt(abs(float(np.linalg.det(target.A[:2, :2]))))
    for (_, places, stride), count in zip(target.recipe.textures, target.counts, strict=False):
        if len(places) != count:  # which of them the image showed is not known
            found.append(np.zeros(count, dtype=bool))
            continue
        away = np.hypot(*(carried_in_front(G, places) - carried_in_front(target.A, places)).T)
        found.append(np.asarray(away > PATCH_SIDE * stride * scale))
    return found
