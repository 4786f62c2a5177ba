# SPDX-License-Identifier: Apache-2.0
"""A serial arm of six hinges that hangs over the table: its measures, where its base is, and its kinematics both ways.

Yaw, pitch and pitch carry the point in which the wrist's three axes meet, so that place and turn come apart (D. L. Pieper 1968)
and the inverse is closed: two ways round the base, elbow above or below, the wrist straight or turned over. The wrist is
pitch, yaw and roll: it is singular where the hand points along the arm's pitch axes, which one that points down never does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack.errors import InputError
from grasptrack.geometry.homographies import rotation_about_z
from grasptrack.typing import Floats
from grasptrack_bench.physics import frames

JOINTS = ("base", "shoulder", "elbow", "wrist_pitch", "wrist_yaw", "wrist_roll")
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "1 0 0", "0 0 1")
"""Of the joints in the base's frame when all are at 0: the arm stretched along x, the hand down."""
UPPER, FORE = 0.85, 0.75
"""m from shoulder to elbow and from there to the wrist's centre."""
WRIST: Floats = np.array([0.0, 0.034, -0.44])
"""(3,) m, the wrist's centre in the frame of the hand: behind its palm."""
COLUMN, FLANGE = 1.5, 0.105
"""m of the column above the shoulder, and from the wrist's centre to where the hand begins."""
RADII = (0.085, 0.065, 0.05, 0.035)
"""m of column, upper arm, forearm and flange."""
LOWEST: Floats = np.radians([-180.0, -180.0, 12.0, -360.0, -80.0, -360.0])
HIGHEST: Floats = np.radians([180.0, 180.0, 160.0, 360.0, 80.0, 360.0])
"""(6,) rad: the elbow stays up and stops before the arm is stretched, the wrist's yaw before it is singular."""
SPEED: Floats = np.radians([120.0, 120.0, 150.0, 210.0, 210.0, 210.0])
"""(6,) rad/s at most."""
TORQUE: Floats = np.array([700.0, 700.0, 350.0, 100.0, 100.0, 100.0])
"""(6,) N m at most."""
REST: Floats = np.array([0.0, -0.5, 1.6, -1.1, 0.0, 0.0])
"""(6,) rad, elbow up and hand down: of all ways to reach a pose the nearest to this is taken."""
HIGH = 1.0
"""m of the shoulder above the table: with the elbow up no link is lower than the hand's camera, which looks down."""
ASIDE = 0.95
"""m of the base beside a part that rests, on the side to which the hand's back is turned."""
AHEAD, BESIDE = 1.15, 0.45
"""m of the base down a belt and beside it: most of the reach is then before the part, and no place below the base."""

ZERO: Floats = rotation_about_z(-math.pi / 2.0) @ frames.DOWN
"""Of the hand when all joints are at 0: its back, where palm and wrist stand, toward the base."""


def base_for(hand: Floats, part: Floats, belt: Floats) -> Floats:
    """(4, 4) of the arm's base: beside the part (2,) m on the hand's back side, its x toward the hand (4, 4) at the start.

    Where the table moves, by `belt` (2,) m/s, it stands beside the belt's way, further down.
    """
    back = hand[:2, 1]
    speed = float(np.hypot(*belt))
    if speed > 0.0:
        along = belt / speed
        across = np.array([-along[1], along[0]])
        at = part + AHEAD * along + math.copysign(BESIDE, float(across @ back)) * across
    else:
        at = part + ASIDE * back / max(float(np.hypot(*back)), 1e-9)
    centre = hand[:3, :3] @ WRIST + hand[:3, 3]
    way = centre[:2] - at
    return frames.pose_of(rotation_about_z(math.atan2(way[1], way[0])), np.array([*at, HIGH]))


def forward_kinematics(joints: Floats) -> Floats:
    """(4, 4) of the hand in the base, from the joints (6,) rad."""
    yaw, shoulder, elbow, pitch, aside, roll = (float(q) for q in joints)
    flat = np.array([
        UPPER * math.cos(shoulder) + FORE * math.cos(shoulder + elbow),
        0.0,
        -UPPER * math.sin(shoulder) - FORE * math.sin(shoulder + elbow),
    ])  # fmt: skip
    turn = rotation_about_z(yaw)
    wrist = frames.about_y(shoulder + elbow + pitch) @ frames.about_x(aside) @ rotation_about_z(roll)
    R = turn @ wrist @ ZERO
    return frames.pose_of(R, turn @ flat - R @ WRIST)


def inverse_kinematics(hand: Floats) -> list[Floats]:
    """All joints (6,) rad, within a turn about 0, that bring the hand to a pose (4, 4) in the base; none out of reach."""
    R = hand[:3, :3]
    centre = R @ WRIST + hand[:3, 3]
    out, up = float(np.hypot(centre[0], centre[1])), float(centre[2])
    cosine = (out * out + up * up - UPPER**2 - FORE**2) / (2.0 * UPPER * FORE)
    if abs(cosine) > 1.0 + 1e-9:  # the rest is rounding, of an arm that is stretched
        return []
    angle = math.acos(min(1.0, max(-1.0, cosine)))
    found = []
    for front in (1.0, -1.0):
        yaw = math.atan2(front * centre[1], front * centre[0])
        left = rotation_about_z(yaw).T @ R @ ZERO.T  # what the pitches, the wrist's yaw and its roll have to do
        pitch = math.atan2(left[0, 2], left[2, 2])
        # after that pitch, whatever it is: where the wrist is singular, pitch and roll share one turn
        rest = frames.about_y(pitch).T @ left
        aside, roll = math.atan2(-rest[1, 2], rest[2, 2]), math.atan2(-rest[0, 1], rest[0, 0])
        for bent in (angle, -angle):
            shoulder = math.atan2(-up, front * out) - math.atan2(FORE * math.sin(bent), UPPER + FORE * math.cos(bent))
            for over in (0.0, math.pi):
                a = aside if over == 0.0 else math.pi - aside
                found.append(
                    _wrap_angles(np.array([yaw, shoulder, bent, pitch + over - shoulder - bent, a, roll + over]))
                )
    return found


def start_joints(hand: Floats) -> Floats:
    """Joints (6,) rad for a pose (4, 4) in the base, within their limits and nearest to REST."""
    ways = [q for q in inverse_kinematics(hand) if ((q > LOWEST) & (q < HIGHEST)).all()]
    if not ways:
        far = float(np.linalg.norm(hand[:3, :3] @ WRIST + hand[:3, 3]))
        raise InputError(
            f"the arm does not reach the hand's pose: its wrist would be {far:.2f} m from the shoulder, and "
            f"{UPPER + FORE:.2f} m is the farthest",
            far=far,
        )
    return min(ways, key=lambda q: float(((q - REST) ** 2).sum()))


class Rod(NamedTuple):
    """A link with round ends: both of them (3,) and its radius, m."""

    start: Floats
    end: Floats
    radius: float


def link_rods(joints: Floats) -> list[Rod]:
    """The links as rods in the base's frame."""
    yaw, shoulder, elbow, *_ = (float(q) for q in joints)
    turn = rotation_about_z(yaw)
    bend = turn @ frames.about_y(shoulder) @ np.array([UPPER, 0.0, 0.0])
    centre = bend + turn @ frames.about_y(shoulder + elbow) @ np.array([FORE, 0.0, 0.0])
    palm = centre + FLANGE * forward_kinematics(joints)[:3, 2]
    origin = np.zeros(3)
    ends = [(np.array([0.0, 0.0, COLUMN]), origin), (origin, bend), (bend, centre), (centre, palm)]
    return [Rod(a, b, r) for (a, b), r in zip(ends, RADII, strict=True)]


def _wrap_angles(q: Floats) -> Floats:
    return np.asarray((q + math.pi) % (2.0 * math.pi) - math.pi, dtype=np.float64)


LENGTH = 0.3
"""m to a rad: how much a turn counts beside a way."""
NEAR, DAMPING = 0.04, 0.04
"""Least singular value below which rates are damped, and the damping where it is 0."""
BRAKE_S = 0.1
"""s: a joint comes no nearer to its limit than it could go in this time at its present rate."""


def joint_rates(jacobian: Floats, twist: Floats, joints: Floats) -> Floats:
    """Rates (6,) rad/s that move the hand by a twist as nearly as the arm can.

    Damped least squares (C. W. Wampler 1986; Y. Nakamura and H. Hanafusa 1986), the damping growing from 0 as the least
    singular value falls below NEAR, so that elsewhere the twist is met exactly. What would exceed a joint's speed, or run it
    into its limit, is slowed as a whole: the hand goes the same way, less fast.

    Args:
        jacobian: (6, 6) from rates to the twist.
        twist: (6,) m/s and rad/s, in any frame that is the Jacobian's too.
        joints: (6,) rad, where they are.
    """
    weight = np.array([1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH])
    U, s, Vt = np.linalg.svd(weight[:, None] * jacobian)
    damped = DAMPING**2 * max(0.0, 1.0 - (float(s[-1]) / NEAR) ** 2)
    rates = Vt.T @ (s / (s**2 + damped) * (U.T @ (weight * twist)))
    room = np.maximum(0.0, np.where(rates > 0.0, HIGHEST - joints, joints - LOWEST)) / BRAKE_S
    share = np.minimum(SPEED, room) / np.maximum(np.abs(rates), 1e-12)
    return np.asarray(rates * min(1.0, float(share.min())), dtype=np.float64)
