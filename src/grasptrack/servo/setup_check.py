# SPDX-License-Identifier: Apache-2.0
"""What the exploratory moves show of the set-up: a mirrored image, a z axis that points away, images older than was told.

The moves are few and known, so that each of these makes a pattern of its own (see `self_calibration` for the symbols): a
mirrored view turns against the hand, an object seems to shrink when a hand whose z is turned round comes nearer, and what is
seen of a move comes later than the move. Each is a hypothesis that has to explain the sightings, and the right one must not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grasptrack.servo.first_estimate import NOISE, Signals, fit_moves, signals_of
from grasptrack.servo.observation import FLOOR, Observation
from grasptrack.typing import Floats

MOST = 25.0
"""Squared standard deviations that a sighting counts at most: some are wrong."""
CLEARLY = 25.0
"""So much less is left by the hypothesis that is believed, in squared standard deviations: odds of 1 in 10^5."""
RAISED = 0.004
"""m of the hand's move along the approach direction from which on it tells something."""
LATENESS: Floats = np.arange(-0.06, 0.331, 0.03)
FINER = 0.01
"""s by which images may be older than was told: first in steps that no move lasts, then finer about the best."""
UNNOTICED = 0.012
"""s of lateness that are not corrected: the moves do not show them better."""


def find_fault(found: Signals) -> str:
    """Why these sightings cannot be of a right set-up; empty where they can.

    Args:
        found: the sightings.
    """
    right, mirrored = (_cost_of_view(found, way) for way in (False, True))
    turned = right - mirrored > CLEARLY and right > 4.0 * mirrored
    if not turned:
        return ""
    nearer, away = _costs_of_nearing(found)
    if nearer - away > CLEARLY:  # of a hand that leans, or an object that moves, the size alone tells nothing
        return "the hand's z axis is turned round: it has to point along the fingers, toward the object, as twists go along it"
    if away - nearer > CLEARLY:
        return "the image is mirrored: it turns against the hand"
    return "the image turns against the hand: it is mirrored, or the hand's z axis is turned round"


def find_lateness(
    seen: Sequence[Observation], pose_at: Callable[[float], Floats], base: Floats, centre: Floats
) -> float:
    """s by which the images are older than their sightings say; 0 where the moves do not show it.

    Args:
        seen: the sightings.
        pose_at: the hand's pose (4, 4) at a time, s.
        base, centre: as of `signals_of`.
    """

    def cost(late: float) -> float:
        found = signals_of(delay_sightings(seen, late, pose_at), base, centre)
        return _bounded(fit_moves(found).left / found.noise)

    costs = {late: cost(late) for late in LATENESS.tolist()}
    told = costs[min(costs, key=abs)]
    best = min(costs, key=costs.__getitem__)
    if told - costs[best] < CLEARLY and best == min(costs, key=abs):
        return 0.0
    costs |= {late: cost(late) for late in (best - FINER, best + FINER)}
    best = min(costs, key=costs.__getitem__)
    for late in (best - FINER, best + FINER):
        costs.setdefault(late, cost(late))
    # a hand that leans fits the linear model badly at any delay: lateness is believed only where it explains the misfit
    if told - costs[best] < CLEARLY or told < 4.0 * costs[best] or abs(best) < UNNOTICED:
        return 0.0
    before, at, after = costs[best - FINER], costs[best], costs[best + FINER]
    return float(best + 0.5 * FINER * (before - after) / max(before - 2.0 * at + after, 1e-9))  # of the parabola


def delay_sightings(seen: Sequence[Observation], late: float, pose_at: Callable[[float], Floats]) -> list[Observation]:
    """The same sightings of images that were taken so much earlier, s."""
    return [replace(s, time=s.time - late, hand=pose_at(s.time - late)) for s in seen]


def _cost_of_view(found: Signals, mirrored: bool) -> float:
    """What the moves leave of the sightings, in squared standard deviations: of the middle, and of the segment's turn."""
    if mirrored:
        found = found._replace(s=found.s.conj(), segment=found.segment.conj())
    middle, segment = fit_moves(found).left / found.noise, found.segment
    unturned = segment * np.exp(1j * found.theta)
    angle = np.angle(unturned * np.exp(-1j * np.angle(np.median(unturned.real) + 1j * np.median(unturned.imag))))
    return _bounded(middle) + _bounded(angle / (NOISE * np.sqrt(2.0) / np.abs(segment)))


def _costs_of_nearing(found: Signals) -> tuple[float, float]:
    """What is left of the object's size in the image if it grows where the hand comes nearer, and if it shrinks."""
    z, inverse = found.z - np.median(found.z), 1.0 / found.length
    if float(np.ptp(z)) < RAISED:
        return 0.0, 0.0
    noise = FLOOR / found.length**2
    costs = []
    for sign in (-1.0, 1.0):
        slopes = sign * np.linspace(0.05, 10.0, 60) * float(np.median(inverse))  # 1/m: the object 0.1 to 20 m away
        off = inverse[None] - slopes[:, None] * z[None]
        off = off - np.median(off, axis=1)[:, None]
        costs.append(min(_bounded(row / noise) for row in off))
    return costs[0], costs[1]


def _bounded(off: NDArray[np.generic]) -> float:
    """The sum of squares, each bounded."""
    return float(np.minimum(np.abs(off) ** 2, MOST).sum())
