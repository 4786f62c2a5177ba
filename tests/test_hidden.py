# SPDX-License-Identifier: Apache-2.0
"""What is hidden: a camera on a hand sees its own fingers, and what they show is nobody's edge."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack import GraspTracker, kernels
from grasptrack.kernels import reference
from grasptrack.observation.fusion import Fusion
from grasptrack.observation.posed import leverage
from grasptrack.observation.registration import CLOSE, OutlineRegistration
from grasptrack.observation.segmentation import clearance, segment
from grasptrack.observation.surface import shrunk, surfaces
from grasptrack.projective import apply_homography
from grasptrack.simulation import SHAPES, Conditions, Path, Scene, similarity_path
from grasptrack.verdict import RIGHT_PX

FINGER = (300, 0, 44, 480)
"""Left, top, width and height of a bar before the camera; it is marked 4 px wider on each side."""


def finger(image: np.ndarray, grey: int) -> np.ndarray:
    left, top, width, height = FINGER
    out = image.copy()
    cv2.rectangle(out, (left, top), (left + width, top + height), grey, -1)
    return out


def mark() -> np.ndarray:
    left, _, width, _ = FINGER
    out = np.zeros((480, 640), np.uint8)
    out[:, left - 4 : left + width + 5] = 255
    return out


def scene(seed: int, count: int = 9) -> Scene:
    return Scene(SHAPES["bracket"](), similarity_path(count, seed=seed), conditions=Conditions(noise=1.0), seed=seed)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 3), st.sampled_from([0, 90, 255]), st.sampled_from([2, 4]), st.integers(0, 3))
def test_native_equals_reference(seed: int, grey: int, by: int, most: int) -> None:
    frames = scene(seed)
    view, clear = segment(frames[0].image), clearance(mark())
    samples = OutlineRegistration(view, frames[0].image, 1).samples
    image, H = finger(frames[3].image, grey), frames[3].H_current_reference
    rules = (*samples, np.array([6.0, 3.0]), np.array([4, 8]), np.array([2, 1]), 2.0, 0.3, clear)
    found, wanted = kernels.register_outline(image, H, *rules), reference.register_outline(image, H, *rules)
    np.testing.assert_array_equal(np.isnan(found[1]), np.isnan(wanted[1]))
    np.testing.assert_allclose(found[0], wanted[0], atol=1e-7)
    places = surfaces(view, frames[0].image, by, 450)[1:]
    looked = (image, shrunk(image, by), float(by), H, *samples, 3.0, 2.0, 0.3, *places)
    arguments = (*looked, np.ones(3, np.bool_), 2.0, 50.0, 0.02, 0, most, clear)
    found, wanted = kernels.converge(*arguments), reference.converge(*arguments)
    np.testing.assert_allclose(found[0], wanted[0], rtol=1e-7, atol=1e-9)
    for place in (6, 7, 8):
        np.testing.assert_allclose(found[4][place], wanted[4][place], atol=1e-6)
    with pytest.raises(ValueError, match="image's size"):
        kernels.converge(*arguments[:-1], clear[:9])  # type: ignore[index]
    with pytest.raises(ValueError, match="image's size"):
        reference.converge(*arguments[:-1], clear[:9])  # type: ignore[index]
    for module in (kernels, reference):
        with pytest.raises(ValueError, match="image's size"):
            module.register_outline(image, H, *rules[:-1], clear[:9])  # type: ignore[index]


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 3), st.integers(1, 8), st.sampled_from([0, 60, 255]))
def test_whatever_is_hidden_the_pose_is_the_same(seed: int, index: int, grey: int) -> None:
    frames = scene(seed)
    grey_image, clear = frames[0].image, clearance(mark())
    view = segment(grey_image)
    registration = OutlineRegistration(view, grey_image, 1, clear)
    fusion = Fusion(registration, view, grey_image, view.outer.points[::200], mark())
    true, points = frames[index].H_current_reference, view.outer.points[::20]
    for image in (frames[index].image, finger(frames[index].image, grey)):
        for H in (registration.refine(image, true, CLOSE).homography, fusion.refine(image, true).homography):
            assert np.hypot(*(apply_homography(H, points) - apply_homography(true, points)).T).max() < 0.5


@pytest.mark.parametrize("grey", [0, 255])
def test_a_part_is_followed_behind_the_hand_that_reaches_for_it(grey: int) -> None:
    """The reference shows it beside the finger; it then passes behind."""
    count, zero = 22, np.zeros(22)
    target = np.column_stack([np.linspace(0.75, -0.35, count), zero])
    path = Path(target, np.full(count, 4.0), zero + 0.3, zero, zero)
    frames = Scene(SHAPES["bracket"](), path, conditions=Conditions(noise=1.0), seed=3)
    tracker, first, found = GraspTracker(ignore=mark()), None, 0
    for frame in frames:
        result = tracker.update(finger(frame.image, grey))
        if result.contacts is None:
            continue
        first = result.contacts if first is None else first
        assert np.hypot(*(result.contacts - frame.contacts(first)).T).max() < RIGHT_PX
        found += result.status != "lost"
    assert found == len(frames)


@given(st.integers(0, 10_000), st.integers(12, 40))
def test_no_error_of_edges_moves_a_contact_by_more_than_its_leverage(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    A, rows, noise = rng.normal(size=(count, 8)), rng.normal(size=(4, 8)), float(rng.uniform(0.05, 0.5))
    lever = rows @ np.linalg.solve(A.T @ A, A.T)  # of each contact's x and y on each edge
    told = leverage(noise**2 * lever @ lever.T, count, noise)
    errors = rng.normal(size=(50, count))
    errors /= np.sqrt((errors**2).mean(axis=1, keepdims=True))
    for moved in errors @ lever.T:
        assert np.hypot(*moved.reshape(2, 2).T).max() <= told * (1.0 + 1e-9)
    most = max(np.linalg.norm(lever[i : i + 2], 2) for i in (0, 2)) * np.sqrt(count)
    assert told == pytest.approx(most, rel=1e-9)
