# SPDX-License-Identifier: Apache-2.0
"""Prediction: powers of homographies by their laws, and time stamps that let dropped frames do no harm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import GraspTracker
from grasptrack.errors import ConditioningError
from grasptrack.motion import CARRIED, LONGEST, Motion, power
from grasptrack.projective import FEW, applied, apply_homography, normalised
from grasptrack.simulation import SHAPES
from grasptrack.simulation.disturbances import DISTURBANCES

PLACE = (320.0, 240.0)


@st.composite
def steps(draw: st.DrawFn) -> np.ndarray:
    """A motion from one frame to the next, about the middle of the image."""
    small = st.floats(-0.08, 0.08)
    linear = np.eye(2) + np.array([[draw(small), draw(small)], [draw(small), draw(small)]])
    H = np.eye(3)
    H[:2, :2] = linear
    H[2, :2] = draw(st.floats(-1e-4, 1e-4)), draw(st.floats(-1e-4, 1e-4))
    back, there = np.eye(3), np.eye(3)
    back[:2, 2], there[:2, 2] = np.add(PLACE, (draw(st.floats(-25, 25)), draw(st.floats(-25, 25)))), np.negative(PLACE)
    return normalised(back @ H @ there)


@given(steps(), st.floats(0, 2), st.floats(0, 2))
def test_powers_add_up(H: np.ndarray, a: float, b: float) -> None:
    def to(exponent: float) -> np.ndarray:
        return normalised(power(H, exponent, PLACE))

    np.testing.assert_allclose(to(0.0), np.eye(3), atol=1e-9)
    np.testing.assert_allclose(to(1.0), H, atol=1e-9)
    np.testing.assert_allclose(to(3.0), normalised(H @ H @ H), atol=1e-5)
    for whole in (1.0, 2.0):  # where no series is needed
        np.testing.assert_allclose(to(whole), to(whole + 1e-8), rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(normalised(to(a) @ to(b)), to(a + b), atol=2e-3)


@given(steps(), st.integers(1, CARRIED), st.booleans())
def test_what_moved_before_a_loss_may_have_gone_on(H: np.ndarray, missed: int, timed: bool) -> None:
    motion = Motion(PLACE)
    motion.begin(0.0 if timed else None)
    motion.look(0.1 if timed else None)
    motion.found(H)
    for k in range(missed):
        assert motion.missed == k and (motion.carried is None) == (k == 0)
        motion.look(0.1 * (k + 2) if timed else None)
        motion.lost()
    motion.look(0.1 * (missed + 2) if timed else None)
    np.testing.assert_allclose(motion.predict(), normalised(H), atol=1e-9)
    carried = motion.carried
    assert carried is not None
    wanted = normalised(np.linalg.matrix_power(H, missed + 2))
    np.testing.assert_allclose(
        apply_homography(carried, np.array([PLACE])), apply_homography(wanted, np.array([PLACE]))
    )
    motion.found(carried)
    motion.look(0.1 * (missed + 3) if timed else None)
    motion.lost()
    assert motion.carried is None  # how it moved is not known after a gap
    motion.coast(H)
    assert motion.carried is None


@given(steps(), st.integers(1, FEW), st.integers(0, 2))
def test_few_points_are_carried_as_many_are(H: np.ndarray, count: int, behind: int) -> None:
    points = np.random.default_rng(count).uniform(0, 640, (count, 2))
    if behind:  # some of them, or all
        H = H.copy()
        H[2, :2] -= np.array([1.0, 0.0]) * (1.5 / points[:, 0].max() if behind == 1 else 10.0)
    many = np.concatenate([points] * (FEW + 1))
    try:
        wanted = apply_homography(H, many)
    except ConditioningError:
        with pytest.raises(ConditioningError):
            apply_homography(H, points)
        return
    np.testing.assert_allclose(apply_homography(H, points), wanted[:count], rtol=1e-12)
    assert applied(H, *points[0]) == pytest.approx(tuple(wanted[0]), rel=1e-12)


@given(steps(), st.floats(0.1, LONGEST))
def test_a_gap_in_time_is_bridged_by_the_motion_of_so_long(H: np.ndarray, gap: float) -> None:
    motion = Motion(PLACE)
    motion.begin(5.0)
    for k, time in enumerate((5.1, 5.2)):
        motion.look(time)
        motion.found(np.linalg.matrix_power(H, k + 1))
    motion.look(5.2 + 0.1 * gap)
    centre = power(H, 2.0, PLACE) @ np.array([*PLACE, 1.0])
    place = float(centre[0] / centre[2]), float(centre[1] / centre[2])
    np.testing.assert_allclose(motion.predict(), normalised(power(H, gap, place) @ H @ H), atol=1e-6)


@pytest.mark.parametrize("times", [(None, None, None), (0.0, 0.0, 0.0), (3.0, 2.0, 1.0), (0.0, 0.1, 0.1)])
def test_without_times_that_tell_anything_frames_are_counted(times: tuple[float | None, ...]) -> None:
    H = np.eye(3)
    H[0, 2] = 7.0
    motion = Motion(PLACE)
    motion.begin(times[0])
    motion.look(times[1])
    motion.found(H)
    motion.look(times[2])
    np.testing.assert_allclose(motion.predict(), H @ H, atol=1e-9)


def test_a_very_long_gap_is_not_bridged_and_a_loss_rests() -> None:
    H = np.eye(3)
    H[0, 2] = 2.0
    motion = Motion(PLACE)
    motion.begin(0.0)
    motion.look(1.0)
    motion.found(H)
    motion.look(100.0)
    assert motion.predict()[0, 2] == pytest.approx(2.0 + 2.0 * LONGEST)
    motion.lost()
    motion.look(101.0)
    assert motion.predict()[0, 2] == pytest.approx(2.0)


def test_dropped_frames_are_survived() -> None:
    scene = DISTURBANCES["fast"].scene(SHAPES["bracket"](), 60, 1)
    order = [i for i in range(60) if i < 4 or i % 5 in (0, 1)]  # two of five arrive
    tracker = GraspTracker()
    found = [tracker.update(scene[i].image, time=scene[i].time).located for i in order]
    assert all(found)
