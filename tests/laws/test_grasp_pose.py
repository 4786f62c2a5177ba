# SPDX-License-Identifier: Apache-2.0
"""Where the grasp is in metres: covariances follow the derivatives, what cannot be told is told to be unknown, and noise that
lasts is not averaged away."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.servo.camera import HandCamera, apply_twist, pose_of, rotation_matrix, rotation_vector
from grasptrack.servo.estimate import Estimate, Origin, Prior, Search, refine_estimate
from grasptrack.servo.grasp_pose import GraspPose, grasp_pose
from grasptrack.servo.model import PLACE, POSE, SHAPE, SPEED, Placed, pack_state, retract_state
from grasptrack.servo.observation import Observation
from grasptrack.servo.trust import Trust, lasting_covariance

SEEDS = st.integers(0, 10_000)
STEP = 1e-6


def scene(seed: int, k: int = 2) -> tuple[Estimate, np.ndarray]:
    """An estimate of a camera that looks down at an object, and the hand."""
    rng = np.random.default_rng(seed)
    turn = rotation_matrix((0.0, 0.0, rng.uniform(-3.0, 3.0))) @ rotation_matrix((*rng.uniform(-0.2, 0.2, 2), 0.0))
    camera = HandCamera(rng.uniform(400.0, 900.0), np.array([319.5, 239.5]), turn, rng.uniform(-0.1, 0.1, 3))
    hand = pose_of(rotation_matrix(rng.normal(size=3)), rng.normal(size=3))
    points = rng.uniform(-0.03, 0.03, (k + 4, 2))
    points[0], points[1] = (-0.03, rng.uniform(-0.01, 0.01)), (0.03, rng.uniform(-0.01, 0.01))
    facing = hand[:3, :3] @ rotation_matrix(rng.normal(0.0, 0.1, 3))
    place = hand[:3, :3] @ (camera.offset + rng.uniform(0.2, 0.4) * camera.turn[:, 2]) + hand[:3, 3]
    object_ = Placed(points, facing, place, rng.normal(0.0, 0.05, 3), facing * (1.0, 1.0, 0.01))
    n = SHAPE + points.size
    root = 1e-3 * rng.normal(size=(n, n))
    return Estimate(pack_state(camera, object_), root @ root.T, 1.0), hand


def slopes(known: Estimate, function: Callable[[Estimate], np.ndarray]) -> np.ndarray:
    """Central differences of a vector by all unknowns."""
    state, n = pack_state(known.camera, known.object), len(known.covariance)
    out = []
    for i in range(n):
        step = np.zeros(n)
        step[i] = STEP
        there, back = (Estimate(retract_state(state, s), known.covariance, known.time) for s in (step, -step))
        out.append((function(there) - function(back)) / (2.0 * STEP))
    return np.array(out).T


@given(seed=SEEDS, dof=st.sampled_from([4, 6]), k=st.sampled_from([2, 3]))
def test_covariances_of_a_grasp_follow_its_derivatives(seed: int, dof: int, k: int) -> None:
    known, hand = scene(seed, k)
    found = grasp_pose(known, k, hand, known.time, dof)

    def six(e: Estimate) -> np.ndarray:
        other = grasp_pose(e, k, hand, e.time, dof)
        return np.concatenate([other.position, rotation_vector(other.rotation @ found.rotation.T)])

    J = slopes(known, six)
    assert np.allclose(found.covariance, J @ known.covariance @ J.T, rtol=1e-4, atol=1e-12)
    for i in range(k):
        J = slopes(known, lambda e, i=i: grasp_pose(e, k, hand, e.time, dof).contacts[i])  # type: ignore[misc]
        assert np.allclose(found.contact_covariance[i], J @ known.covariance @ J.T, rtol=1e-4, atol=1e-12)
    J = slopes(known, lambda e: np.array([grasp_pose(e, k, hand, e.time, dof).opening]))
    assert found.opening_sd == pytest.approx(float(np.sqrt((J @ known.covariance @ J.T)[0, 0])), rel=1e-4)


@given(seed=SEEDS, dof=st.sampled_from([4, 6]), k=st.sampled_from([2, 3]))
def test_a_grasp_has_the_axes_of_a_hand_that_grasps_there(seed: int, dof: int, k: int) -> None:
    known, hand = scene(seed, k)
    found = grasp_pose(known, k, hand, known.time, dof)
    assert np.allclose(found.rotation @ found.rotation.T, np.eye(3), atol=1e-9) and np.linalg.det(found.rotation) > 0.0
    assert np.allclose(found.rotation[:, 0], found.closing) and np.allclose(found.rotation[:, 2], found.approach)
    assert found.approach @ hand[:3, 2] > 0.0
    assert np.allclose(found.contacts, known.object.in_base()[:k]) and np.allclose(
        found.position, found.contacts.mean(axis=0)
    )
    assert found.opening == pytest.approx(float(np.linalg.norm(found.contacts[0] - found.contacts[1])))
    if dof == 4:
        assert np.allclose(found.approach, hand[:3, 2])
        assert np.allclose(
            found.covariance[3:, 3:], np.outer(found.approach, found.approach) * np.trace(found.covariance[3:, 3:])
        )
    assert np.allclose(found.pose()[:3, 3], found.position)


@given(seed=SEEDS, later=st.floats(0.0, 0.5))
def test_a_grasp_goes_on_with_the_object(seed: int, later: float) -> None:
    known, hand = scene(seed)
    now, then = (grasp_pose(known, 2, hand, known.time + t, 4) for t in (0.0, later))
    assert np.allclose(then.position - now.position, later * known.object.velocity())
    assert np.linalg.eigvalsh(then.covariance[:3, :3]).min() >= -1e-12
    assert known.time == 1.0 and then.time == 1.0 + later
    before = grasp_pose(known, 2, hand, known.time - 0.1, 4)
    assert np.allclose(before.position, now.position - 0.1 * known.object.velocity())


@given(seed=SEEDS)
def test_a_grasp_does_not_depend_on_the_choice_of_the_base(seed: int) -> None:
    known, hand = scene(seed)
    rng = np.random.default_rng(seed + 1)
    R, t, o = rotation_matrix(rng.normal(size=3)), rng.normal(size=3), known.object
    there = Placed(o.points, R @ o.turn, R @ o.place + t, o.speed, R @ o.axes)
    C = known.covariance.copy()
    turned = np.eye(len(C))
    turned[PLACE, PLACE] = R
    moved = Estimate(pack_state(known.camera, there), turned @ C @ turned.T, known.time)
    for dof in (4, 6):
        a, b = grasp_pose(known, 2, hand, 1.0, dof), grasp_pose(moved, 2, pose_of(R, t) @ hand, 1.0, dof)
        both = np.kron(np.eye(2), R)
        assert np.allclose(b.position, R @ a.position + t) and np.allclose(b.rotation, R @ a.rotation)
        assert np.allclose(b.covariance, both @ a.covariance @ both.T, atol=1e-15)


def test_a_grasp_shows_itself_and_is_compared_by_value() -> None:
    known, hand = scene(3)
    one, other = (grasp_pose(known, 2, hand, 1.0, 6) for _ in range(2))
    assert one == other and hash(one) == hash(other) and one != grasp_pose(known, 2, hand, 1.1, 6)
    assert repr(one).startswith("GraspPose(at ") and "opening" in repr(one)
    told = one.to_dict()
    assert set(told) == set(GraspPose.__dataclass_fields__) and len(told["contacts"]) == 2


def sightings(seed: int, noise: float, lasting: float, images: int = 40) -> tuple[Origin, list[Observation], Estimate]:
    """A hand that goes about above an object at rest; errors of images, of which some last for ever."""
    rng = np.random.default_rng(seed)
    known, hand = scene(seed)
    o = known.object
    truth = Estimate(
        pack_state(known.camera, Placed(o.points, o.turn, o.place, np.zeros(3), o.axes)), known.covariance, 0.0
    )
    same, seen = rng.normal(0.0, lasting, (6, 2)), []
    for i in range(images):
        twist = np.array([0.3, 0.25, -0.4, 0.0, 0.0, 1.5]) * np.sin(i * np.array([0.3, 0.5, 0.2, 1.0, 1.0, 0.4]))
        hand = apply_twist(hand, 0.5 * twist, 0.04)
        points = truth.camera.project(truth.in_hand(hand)) + same + rng.normal(0.0, noise, (6, 2))
        seen.append(Observation(0.04 * i, hand, points, np.broadcast_to(0.2**2 * np.eye(2), (6, 2, 2)).copy(), 2))
    prior = Prior().prior_covariance(truth.camera, truth.object, seen[0].hand)
    return Origin(truth.camera, truth.object, prior, 0.0), seen, truth


@cache
def _refined(lasting: float) -> tuple[Origin, list[Observation], Estimate, Search]:
    origin, seen, _ = sightings(5, 0.02, lasting)
    return (origin, seen, *refine_estimate(origin, seen, None, 20))


def test_many_images_that_err_alike_tell_less_than_the_filter_believes() -> None:
    origin, seen, found, search = _refined(0.2)
    told = lasting_covariance(origin, origin.covariance, seen, search)
    assert np.linalg.eigvalsh(told).min() > -1e-12 and np.allclose(told, told.T)
    middle = slice(PLACE.start, PLACE.stop)
    assert np.trace(told[middle, middle]) > np.trace(found.covariance[middle, middle])
    assert np.trace(told[PLACE, PLACE]) <= np.trace(origin.covariance[PLACE, PLACE]) * 1.01
    twice = [*seen, *(Observation(s.time, s.hand, s.points, s.noise, s.contacts) for s in seen)]
    again = lasting_covariance(origin, origin.covariance, twice, search)
    assert np.trace(again[PLACE, PLACE]) > 0.8 * np.trace(told[PLACE, PLACE])  # the same images once more


def test_what_a_search_has_not_reached_counts_as_unknown() -> None:
    origin, seen, _ = sightings(5, 0.02, 0.2)
    _, early = refine_estimate(origin, seen, Search(retract_state(origin.packed_state, 0.02 * np.ones(28))), 1)
    _, late = refine_estimate(origin, seen, None, 20)
    far, near = (lasting_covariance(origin, origin.covariance, seen, s) for s in (early, late))
    assert np.trace(far) > np.trace(near)


def test_trust_goes_on_through_a_displacement() -> None:
    origin, seen, found, search = _refined(0.2)
    trust = Trust()
    first = trust.with_true_covariance(found, origin, seen, search)
    assert np.array_equal(pack_state(first.camera, first.object), pack_state(found.camera, found.object))
    assert np.trace(first.covariance) > np.trace(found.covariance)
    moved = Estimate(pack_state(found.camera, found.object), found.covariance.copy(), found.time)
    moved.release_object(found.time)
    after = trust.with_true_covariance(moved, origin, seen, search)
    assert np.linalg.eigvalsh(after.covariance - moved.covariance).min() > -1e-9
    assert after.displaced_at == moved.displaced_at
    assert np.array_equal(Trust().with_true_covariance(found, None, [], None).covariance, found.covariance)
    assert POSE.stop == SPEED.start
