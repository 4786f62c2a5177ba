# SPDX-License-Identifier: Apache-2.0
"""Where the grasp is, in metres in the robot's base, and how sure that is.

All covariances follow from that of the estimate by its derivatives. They are as good as that one: see `servo.trust`.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasptrack.equality import compared_by_value
from grasptrack.presentation import to_dict
from grasptrack.servo.camera import pose_of, skew_matrix
from grasptrack.servo.estimate import Estimate
from grasptrack.servo.features import MIN_DISTANCE_PX
from grasptrack.servo.model import PLACE, POSE, SHAPE
from grasptrack.typing import Floats


@compared_by_value
@dataclass(frozen=True)
class GraspPose:
    """A grasp in the robot's base.

    With 4 degrees of freedom no move tells how high the camera is mounted on the hand, and so how high the object lies in the
    base: along the approach direction the position is hardly known, and its covariance says so. How far the *fingertips*
    have to go is known all the same: `command.height`.

    Attributes:
        time: s, of which it is true; in a command on the clock of `update`.
        contacts: (k, 3) m.
        position: (3,) m, their middle.
        approach: (3,), along which the fingers go down: with 4 degrees of freedom z of the hand, with 6 the normal of the
            object's plane, away from the hand.
        closing: (3,), across the approach, from the first contact toward the middle of the others.
        rotation: (3, 3), a hand's axes as columns: x closing, z approach.
        opening: m between the first two contacts.
        opening_sd: m, its standard deviation.
        covariance: (6, 6), of the position in m and of the turn in rad, about the base's axes. With 4 degrees of freedom the
            approach is not estimated but chosen, and only the turn about it can err.
        contact_covariance: (k, 3, 3) m^2.
    """

    time: float
    contacts: Floats
    position: Floats
    approach: Floats
    closing: Floats
    rotation: Floats
    opening: float
    opening_sd: float
    covariance: Floats
    contact_covariance: Floats

    def pose(self) -> Floats:
        """(4, 4), rotation and position as one: where a hand is whose origin lies between its fingertips."""
        return pose_of(self.rotation, self.position)

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        return to_dict(self)

    def __repr__(self) -> str:
        sd = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        at = " ".join(f"{v:.4f}" for v in self.position.tolist())
        within = " ".join(f"{1e3 * v:.2g}" for v in sd[:3].tolist())
        return f"GraspPose(at {at} m, sd {within} mm, opening {1e3 * self.opening:.1f} mm)"


def grasp_pose(known: Estimate, contacts: int, hand: Floats, time: float, dof: int) -> GraspPose:
    """Where the grasp is.

    Args:
        known: camera and object, with a covariance that is to be believed (`Trust.with_true_covariance`).
        contacts: how many of its points, the first, are contacts; two or more.
        hand: (4, 4), the hand's pose in the base: tells the approach direction, and on which side of the plane the hand is.
        time: s, of which it shall be true. The object goes on until then.
        dof: 4 or 6.
    """
    e = copy.copy(known)
    e.advance(time)  # to the later of both times
    o, k = e.object, contacts
    places = o.predict_after(time - e.time).in_base()[:k]
    J = _contact_slopes(e, k)
    along, across = o.points[1:k].mean(axis=0) - o.points[0], np.zeros((2, J.shape[-1]))  # in the plane
    for i in range(k):
        across[:, SHAPE + 2 * i : SHAPE + 2 * i + 2] = np.eye(2) * (-1.0 if i == 0 else 1.0 / (k - 1))
    way, d_way = o.turn[:, :2] @ along, o.turn[:, :2] @ across
    d_way[:, POSE] -= skew_matrix(way) @ o.turn
    if dof == 4:
        approach = hand[:3, 2]
        flat = way - approach * (approach @ way)
        turn = np.outer(approach, np.cross(approach, flat) @ d_way) / max(float(flat @ flat), MIN_DISTANCE_PX**2)
    else:
        approach = o.turn[:, 2] if hand[:3, 2] @ o.turn[:, 2] > 0.0 else -o.turn[:, 2]
        flat, normal = way, o.turn[:, 2]
        turn = np.outer(normal, np.array([-along[1], along[0]]) @ across) / max(
            float(along @ along), MIN_DISTANCE_PX**2
        )
        turn[:, POSE] += o.turn
    closing = flat / max(float(np.linalg.norm(flat)), MIN_DISTANCE_PX)
    apart = o.points[0] - o.points[1]
    opening = math.hypot(*apart.tolist())
    d_opening = np.zeros(J.shape[-1])
    d_opening[SHAPE : SHAPE + 4] = np.concatenate([apart, -apart]) / max(opening, MIN_DISTANCE_PX)
    six = np.vstack([J.mean(axis=0), turn])
    return GraspPose(
        float(time),
        places,
        places.mean(axis=0),
        approach.copy(),
        closing,
        np.column_stack([closing, np.cross(approach, closing), approach]),
        opening,
        math.sqrt(max(float(d_opening @ e.covariance @ d_opening), 0.0)),
        six @ e.covariance @ six.T,
        J @ e.covariance @ np.swapaxes(J, 1, 2),
    )


def _contact_slopes(known: Estimate, contacts: int) -> Floats:
    """(k, 3, 16 + 2n), of contacts in the base by all unknowns."""
    o = known.object
    out = np.zeros((contacts, 3, SHAPE + 2 * len(o.points)))
    out[:, :, PLACE] = np.eye(3)
    for i, (x, y) in enumerate(o.points[:contacts].tolist()):
        out[i, :, POSE] = -o.turn @ skew_matrix(np.array([x, y, 0.0]))
        out[i, :, SHAPE + 2 * i : SHAPE + 2 * i + 2] = o.turn[:, :2]
    return out
