# SPDX-License-Identifier: Apache-2.0
"""All that changes from frame to frame, and nothing else does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasptrack.tracking.numbers import Numbers
from grasptrack.tracking.target import Grey, Target

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Look:
    """An image in which the object was located, or looked for.

    Attributes:
        levels: the image and its halves.
        G: (3, 3) work px -> px.
    """

    levels: list[Grey]
    G: Floats


@dataclass
class TrackState:
    """Where the object is, what is known of camera and part, and how sure that is.

    Attributes:
        last: the last image, with the best pose found in it.
        velocity: (8,) the pose's change in a usual interval, work px at the half size; None where it is not known.
        velocity_P: (8, 8) covariance of its error.
        P: (8, 8) covariance of the pose's error, work px^2 at the half size.
        presence: probability that the object is there.
        theta, theta_covariance: (3,), (3, 3) log of the focal length over the image's width, first normal.
        thickness, thickness_variance: work px, work px^2.
        inner_spread: grey levels, see `Numbers.other_spread`.
        edge_width: work px, standard deviation of an edge at rest: how far the image is out of focus.
        blur_share: half of an edge's blur, of what moved across it since the last image: how long the shutter is open.
        blur: work px, half of what blurred most edges of late.
        located: the last image in which the object was located.
        light: gain and bias of the surface there, from the first view on.
        lost: images since.
        time, interval: s, of the last image; a usual time between images.
        usual: of each patch of the three finest levels: its correlation of late.
        accepted: images in which the object was located.
        strange: usual strangeness of the outline: edges that no light shows, or not where the first view had them.
        elsewhere: share of the outline whose edge lies elsewhere although a second solution was tried.
        confirmed: strangeness of the last image, if other hypotheses led to the same answer there.
        agility: mean square by which even motion was off of late, in process noise; moves: how often that was measured.
        expected: (3, 3) where it was located, carried by the ground since then.
        anchored: the ground carried it ever since, so that the last look is where it is expected.
        wander: how far it left its place on the ground of late, a frame, in `Numbers.travel`; wanders: how often that was
            measured.
        unseen: how far it may have gone since it was located, likewise.
        slope: sd of the change of depth over half the object, as a share, when it was located.
        adrift: frames since the ground last told how far the camera is, or the object itself.
        gone: since it was located its place was seen without it.
        exchanged: the last image showed something else in its place.
        lookalike: something just like it was seen elsewhere.
        sighted: (3, 3) where something like it was seen in the last image, but not believed to be it; None where nothing was.
    """

    last: Look
    velocity: Floats | None
    velocity_P: Floats
    P: Floats
    presence: float
    theta: Floats
    theta_covariance: Floats
    thickness: float
    thickness_variance: float
    inner_spread: float
    edge_width: float
    blur_share: float
    located: Look
    blur: float
    light: tuple[float, float]
    lost: int
    time: float | None
    interval: float | None
    usual: list[Floats]
    accepted: int
    strange: float
    elsewhere: float
    confirmed: float
    agility: float
    moves: int
    expected: Floats
    anchored: bool
    wander: float
    wanders: int
    unseen: float
    slope: float
    adrift: float
    gone: bool
    exchanged: bool
    lookalike: bool
    sighted: Floats | None


FIRST_SPREAD = 12.0
"""Grey levels; measured from the first image on."""


def initial_state(target: Target, levels: list[Grey], numbers: Numbers) -> TrackState:
    """The state in the first image, where the pose is known by definition."""
    look = Look(levels, target.A)
    return TrackState(
        last=look,
        velocity=None,
        velocity_P=np.zeros((8, 8)),
        P=np.eye(8) * 0.05**2,
        presence=1.0 - 1e-6,
        theta=np.zeros(3),
        theta_covariance=np.diag([numbers.focal_sd, numbers.normal_sd, numbers.normal_sd]) ** 2,
        thickness=0.0,
        thickness_variance=(numbers.thickness_sd * target.size) ** 2,
        inner_spread=FIRST_SPREAD,
        edge_width=target.edge_width,
        blur_share=numbers.blur_share,
        located=look,
        blur=0.0,
        light=(1.0, 0.0),
        lost=0,
        time=None,
        interval=None,
        accepted=0,
        strange=0.0,
        elsewhere=0.0,
        confirmed=0.0,
        agility=1.0,
        moves=0,
        anchored=True,
        wander=1.0,
        wanders=0,
        unseen=0.0,
        slope=0.0,
        adrift=0.0,
        gone=False,
        exchanged=False,
        lookalike=False,
        sighted=None,
        expected=target.A,
        usual=[np.zeros(n) for n in target.counts],
    )
