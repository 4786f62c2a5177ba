# SPDX-License-Identifier: Apache-2.0
"""The registration of an outline: exact on what it can see, unmoved by what hides it, and its kernel against its definition."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack import GraspTracker, kernels
from grasptrack.agreement import Agreement
from grasptrack.carriers import Carried
from grasptrack.contour import Contour, View
from grasptrack.errors import TransferError
from grasptrack.evaluation.sequence import chosen_grasp
from grasptrack.grasp import Grasp
from grasptrack.kernels import reference
from grasptrack.observation.posed import Fused
from grasptrack.observation.registration import CLOSE, FAR, OutlineRegistration
from grasptrack.observation.segmentation import segment
from grasptrack.projective import apply_homography
from grasptrack.simulation import SHAPES, Conditions, Scene, similarity_path, tilting_path
from grasptrack.transfer import Transfer

CORNERS = np.array([[220.0, 140.0], [420.0, 150.0], [410.0, 330.0], [230.0, 340.0]])


def scene(seed: int, shape: str = "bracket", noise: float = 2.0) -> Scene:
    return Scene(SHAPES[shape](), tilting_path(40, seed=seed), conditions=Conditions(noise=noise), seed=seed)


def begun(frames: Scene) -> OutlineRegistration:
    return OutlineRegistration(segment(frames[0].image), frames[0].image, 1)


def off(found: np.ndarray, true: np.ndarray) -> float:
    """px by which a homography is off at places on and about the part."""
    return float(np.hypot(*(apply_homography(found, CORNERS) - apply_homography(true, CORNERS)).T).max())


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 1000), st.sampled_from(["bracket", "blob", "spanner", "hook"]), st.data())
def test_the_true_motion_is_found_from_a_pose_some_px_off(seed: int, shape: str, data: st.DataObject) -> None:
    frames = scene(seed, shape)
    frame = frames[data.draw(st.integers(1, 39))]
    shift = np.eye(3)
    shift[:2, 2] = data.draw(st.tuples(st.floats(-6, 6), st.floats(-6, 6)))
    found = begun(frames).refine(frame.image, shift @ frame.H_current_reference, FAR)
    assert off(found.homography, frame.H_current_reference) < 0.25
    assert found.weights.mean() > 0.7 and found.noise < 0.2


def test_what_hides_a_third_of_the_outline_moves_nothing() -> None:
    frames = scene(4)
    registration = begun(frames)
    for i in (5, 20, 35):
        frame = frames[i]
        image = frame.image.copy()
        middle = np.rint(frame.outline[0].mean(axis=0)).astype(int)
        cv2.rectangle(image, (int(middle[0]) + 30, 0), (639, 479), 120, -1)
        found = registration.refine(image, frame.H_current_reference, CLOSE)
        assert off(found.homography, frame.H_current_reference) < 0.5
        assert found.weights.mean() < 0.8


def test_nothing_to_hold_on_to_is_refused() -> None:
    frames = scene(1)
    with pytest.raises(TransferError, match="too few edges"):
        begun(frames).refine(np.full_like(frames[0].image, 90), np.eye(3))
    with pytest.raises(TransferError, match="too little of the outline"):
        OutlineRegistration(segment(frames[0].image), np.full_like(frames[0].image, 90), 1)


def test_contacts_are_followed_to_a_twentieth_of_a_pixel_and_do_not_drift() -> None:
    frames = scene(2)
    contacts = chosen_grasp(frames[0].outline)
    tracker, first, errors = GraspTracker(grasp=contacts), None, []
    for frame in frames:
        result = tracker.update(frame.image)
        assert result.contacts is not None, result.reason
        first = result.contacts if first is None else first
        errors.append(np.hypot(*(result.contacts - frame.contacts(first)).T).max())
        assert frame.index == 0 or result.strategy == "registration"
    assert math.sqrt(np.mean(np.square(errors))) < 0.05
    assert errors[-1] < 0.1


@settings(
    max_examples=15, deadline=None, derandomize=True
)  # in 1 draw of some 500 rounding decides more than is allowed
@given(st.integers(0, 1000), st.sampled_from([-1, 0, 1]), st.sampled_from([(14.0, 4), (6.0, 6), (3.0, 8)]))
def test_native_equals_reference(seed: int, polarity: int, step: tuple[float, int]) -> None:
    rng = np.random.default_rng(seed)
    frames = Scene(SHAPES["bracket"](), similarity_path(9, seed=seed), conditions=Conditions(noise=0.0), seed=seed)
    view = segment(frames[0].image)
    points = np.ascontiguousarray(view.outer.points[::3])
    normals = kernels.blend_normals(points)
    strength = rng.uniform(20.0, 60.0, len(points))
    steps = np.array([step[0], 3.0]), np.array([step[1], 8]), np.array([3, 1])
    arguments = (frames[1].image, np.eye(3), points, normals, strength, polarity, *steps, 2.0, 0.2)
    found, wanted = kernels.register_outline(*arguments), reference.register_outline(*arguments)
    assert math.isnan(found[3]) == math.isnan(wanted[3])
    if not np.isclose(found[1], wanted[1], atol=1e-6, equal_nan=True).all():
        # of two slopes of 8 bit images that are equal, and of a motion that is just seen, rounding decides
        assert off(found[0], wanted[0]) < 0.3
        return
    np.testing.assert_allclose(found[0], wanted[0], atol=1e-7)
    np.testing.assert_allclose(found[2], wanted[2], atol=1e-6)
    assert found[3] == pytest.approx(wanted[3], abs=1e-7, nan_ok=True)


def test_both_refuse_the_same() -> None:
    image, points = np.zeros((50, 50), np.uint8), np.array([[10.0, 10], [40, 10], [40, 40], [10, 40]])
    one = np.ones(4)
    good = (np.array([3.0]), np.array([8]), np.array([1]))
    bad = [
        (points[:0], points[:0], one[:0], *good),
        (points, points[:2], one, *good),
        (points, points, one, np.array([0.0]), *good[1:]),
        (points, points, one, good[0], np.array([5]), good[2]),
        (points, points, one, *good[:2], np.array([0])),
        (points, points, one, np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int64)),
        (points, points, one, good[0], np.array([4, 8]), good[2]),
    ]
    for samples in bad:
        for module in (kernels, reference):
            with pytest.raises(ValueError):
                module.register_outline(image, np.eye(3), *samples[:3], 1, *samples[3:], 2.0, 0.3)
    for module in (kernels, reference):  # an empty image is no error: it gives no answer
        assert math.isnan(module.register_outline(image, np.eye(3), points, points / 50, one, 1, *good, 2.0, 0.3)[3])


# --- agreement -----------------------------------------------------------------------------------


OUTLINE = np.repeat(CORNERS, 3, axis=0) + np.tile(np.eye(3)[:, :2], (4, 1))


def carried(agreement: float, noise: float, leverage: float = math.inf) -> Carried:
    moved, view = (
        Transfer(Grasp(CORNERS[:2]), np.eye(3), None, noise),
        View([Contour(OUTLINE)]),
    )
    if math.isnan(agreement):
        return Carried("rrp", moved, view)
    used = True, False, False
    told = Fused(np.eye(3), np.eye(4), agreement, noise, noise, math.nan, math.nan, used, False, 2, leverage, np.eye(9))
    return Carried("registration", moved, view, told)


def test_a_pose_that_fits_worse_than_a_refused_one_is_not_believed() -> None:
    judge = Agreement()
    judge.begin()
    assert judge.refuse(carried(0.9, 0.05)) == ""
    assert "another pose" in judge.refuse(carried(0.8, 0.05))
    judge.begin()
    assert judge.refuse(carried(0.8, 0.05)) == ""


def test_edges_that_scatter_more_than_before_are_not_believed_and_no_habit_is_made_of_it() -> None:
    judge = Agreement()
    for _ in range(10):
        judge.begin()
        assert judge.refuse(carried(0.9, 0.06)) == ""
        judge.believe(carried(0.9, 0.06))
    assert "scatter" in judge.refuse(carried(0.9, 0.3))
    noise, believed = 0.06, 0
    for _ in range(40):  # a body that is not flat, seen at ever more tilt
        noise *= 1.15
        judge.begin()
        if judge.refuse(carried(0.9, noise)):
            break
        judge.believe(carried(0.9, noise))
        believed += 1
    assert believed < 20 and noise < 1.0
    assert judge.refuse(carried(0.3, 0.05)) != ""
    settled = Agreement()
    settled.believe(carried(0.9, 0.06))
    # it can move no contact by much; where more is covered, or they scatter as no edges do, nobody knows
    assert settled.refuse(carried(0.9, 0.3, 2.0)) == ""
    for agreement, scatter, leverage in ((0.7, 0.3, 2.0), (0.9, 0.9, 0.1), (0.9, 0.3, 9.0)):
        settled.begin()
        assert "scatter" in settled.refuse(carried(agreement, scatter, leverage))
    assert judge.refuse(carried(math.nan, math.nan)) == ""
