# SPDX-License-Identifier: Apache-2.0
"""What is done with a degenerate contour through the public API, and what must hold of it."""

import itertools
import warnings
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog

import grasptrack as gt
from contour_shapes import draw_contour
from grasptrack import kernels
from grasptrack.errors import GraspTrackError
from grasptrack.transfer import STRATEGIES

FRICTION = 0.5
FINGER = 0.1
"""Of the root of the area: as wide as `Hand` has fingers."""
ROUNDING = 1e-9
"""Of the largest coordinate, by which a contact may lie beside its contour; of a second order beside 1e-7 px."""


class Pair(NamedTuple):
    """Points of two contours, and how many fingers: a grasp on the first is carried to the second."""

    first: Any
    second: Any
    fingers: int


def draw_pair(seed: int, index: int) -> Pair:
    """The contours of that number: the second is like the first seen again, deformed, or another one."""
    rng = np.random.default_rng([seed, index])
    with np.errstate(all="ignore"):
        first = draw_contour(rng)
        way = rng.random()
        if way < 0.2:
            second = draw_contour(rng)
        else:
            turn, size = rng.uniform(0, 2 * np.pi), 10.0 ** rng.uniform(-0.3, 0.3)
            c, s = size * np.cos(turn), size * np.sin(turn)
            second = first @ np.array([[c, s], [-s, c]]) + rng.uniform(-50, 50, 2)
            if way < 0.5:
                second = second + rng.normal(0, 10.0 ** rng.uniform(-9, 0.5), second.shape)
    return Pair(first, second, int(rng.choice([2, 2, 2, 3])))


def judge_pair(pair: Pair) -> str:
    """How it ends: "refused" contours, "no grasp", "carried", or what is bad: "bad stability", "bad contact", "internal"."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return _judge(pair)
        except GraspTrackError as error:
            return f"internal: {type(error).__name__} where none is documented: {error}"
        except Exception as error:
            return f"internal: {type(error).__name__}: {error}"


def _judge(pair: Pair) -> str:
    try:
        first = gt.Contour(pair.first)
    except gt.InputError:
        return "refused"
    try:
        second = gt.Contour(pair.second)
    except gt.InputError:
        second = first
    grasps = gt.synthesize(first, pair.fingers, FRICTION, top=3)
    for grasp in grasps:
        if not is_stable(first, grasp):
            return f"bad stability: of {grasp}"
    chosen = grasps[0] if grasps else gt.Grasp(first.points[[0, len(first) // 2]])
    if (chosen.contacts[0] == chosen.contacts[1]).all():
        return "no grasp"
    for strategy in STRATEGIES:
        try:
            carried = gt.transfer(chosen, first, second, strategy)
        except (gt.TransferError, gt.InputError):
            continue
        off = distance_from(second, carried.grasp.contacts)
        allowed = 1e-7 + ROUNDING * float(np.abs(second.points).max())
        if not off <= allowed:
            return f"bad contact: {off:g} px off with {strategy}"
    return "carried" if grasps else "no grasp"


def distance_from(contour: gt.Contour, contacts: np.ndarray) -> float:
    """px from the farthest contact to the contour, segment by segment."""
    start = contour.points
    side = np.roll(start, -1, axis=0) - start
    worst = 0.0
    for contact in contacts:
        square = np.maximum((side**2).sum(axis=1), 1e-300)
        f = np.clip(((contact - start) * side).sum(axis=1) / square, 0.0, 1.0)
        worst = max(worst, float(np.hypot(*(start + f[:, None] * side - contact).T).min()))
        if not np.isfinite(contact).all():
            return float("nan")
    return worst


def is_stable(contour: gt.Contour, grasp: gt.RankedGrasp) -> bool:
    """Whether forces within the friction cones hold any small load: the wrenches of the cones' edges span all, and some
    combination of all of them, none without weight, is 0."""
    moments = kernels.polygon_moments(contour.points, contour.offsets)
    width = FINGER * np.sqrt(moments.area)
    places = kernels.project_to_contour(contour.points, contour.offsets, grasp.contacts)
    normals = kernels.contact_frames(contour.points, contour.offsets, places, width)[:, :2]
    arms = (grasp.contacts - [moments.x, moments.y]) / np.sqrt(moments.area)
    rows = []
    for (x, y), (nx, ny), sign in (
        (a, n, s) for (a, n), s in itertools.product(zip(arms, normals, strict=True), (1, -1))
    ):
        f = np.array([nx - sign * FRICTION * ny, ny + sign * FRICTION * nx])
        rows.append([f[0], f[1], x * f[1] - y * f[0]])
    W = np.array(rows).T
    if not np.isfinite(W).all():
        return False
    # the torques' own size, so that a thin object's count as the others do
    W[2] /= max(np.abs(W[2]).max(), 1e-300)
    if np.linalg.matrix_rank(W, 1e-9) < 3:
        return False
    n = W.shape[1]
    equal = np.vstack([np.hstack([W, np.zeros((3, 1))]), [*np.ones(n), 0.0]])
    less = np.hstack([-np.eye(n), np.ones((n, 1))])
    found = linprog(
        [*np.zeros(n), -1.0], less, np.zeros(n), equal, [0.0, 0.0, 0.0, 1.0], [(0, None)] * n + [(None, None)]
    )
    return bool(found.status == 0 and -found.fun > 1e-12)


def judge_number(seed: int, index: int) -> str:
    """Draw and judge."""
    return judge_pair(draw_pair(seed, index))
