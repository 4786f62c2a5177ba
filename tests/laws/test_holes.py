# SPDX-License-Identifier: Apache-2.0
"""Holes of a first outline: ground seen through them, whatever light, blur and noise make of it, and no print."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.geometry.homographies import apply_homography
from grasptrack_bench.simulation import SHAPES
from stages import HEIGHT, WIDTH, pose

WASHER = SHAPES["washer"]()


def image_of(*, dark: float, blur: float, noise: float, ground: float = 190.0, ink: float | None = None) -> np.ndarray:
    """A washer on even ground that a lens darkens towards its corners; printed over instead of pierced, if there is ink."""
    big = np.full((4 * HEIGHT, 4 * WIDTH), ground, np.float32)
    levels = [60.0, ground if ink is None else ink]
    for polygon, level in zip(WASHER.polygons, levels, strict=True):
        at = apply_homography(pose(150.0, 115.0, 20.0, scale=110.0), polygon)
        cv2.fillPoly(big, [np.rint(16.0 * (4.0 * at + 1.5)).astype(np.int32)], level, cv2.LINE_8, 4)
    image = cv2.resize(big, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    y, x = np.mgrid[-1.0 : 1.0 : HEIGHT * 1j, -1.0 : 1.0 : WIDTH * 1j]
    image = cv2.GaussianBlur(image * (1.0 - dark * 0.5 * (x * x + y * y)).astype(np.float32), (0, 0), blur)
    image = image + noise * np.random.default_rng(3).standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@given(dark=st.floats(0.0, 0.5), blur=st.floats(0.6, 2.0), noise=st.floats(0.5, 6.0))
def test_a_hole_is_found_under_vignette_blur_and_noise(dark: float, blur: float, noise: float) -> None:
    found = gt.first_look(image_of(dark=dark, blur=blur, noise=noise))[0].view
    assert len(found.contours) == 2
    truth = apply_homography(pose(150.0, 115.0, 20.0, scale=110.0), WASHER.polygons[1])
    assert found.contours[1].area == pytest.approx(cv2.contourArea(truth.astype(np.float32)), rel=0.1)


@given(dark=st.floats(0.0, 0.5), blur=st.floats(0.6, 1.5), ink=st.floats(95.0, 155.0))
def test_print_of_another_grey_than_the_ground_is_no_hole(dark: float, blur: float, ink: float) -> None:
    assert len(gt.first_look(image_of(dark=dark, blur=blur, noise=1.0, ink=ink))[0].view.contours) == 1


@given(wide=st.integers(5, 9), level=st.integers(90, 140), seed=st.integers(0, 99))
def test_print_on_the_ground_that_touches_a_part_is_none_of_it(wide: int, level: int, seed: int) -> None:
    """Of a region that is plainly two things the greater is first, as long as the other one is a small share of it."""
    image = np.full((HEIGHT, WIDTH), 190, np.uint8)
    cv2.rectangle(image, (80, 90), (200, 160), (50,), -1)
    cv2.rectangle(image, (201, 120), (212, 120 + wide), (level,), -1)
    cv2.rectangle(image, (213, 110), (250, 136), (level,), -1)
    noisy = cv2.GaussianBlur(image, (0, 0), 0.8) + 1.5 * np.random.default_rng(seed).standard_normal(image.shape)
    first = gt.first_look(noisy.clip(0, 255).astype(np.uint8), (140.0, 125.0))[0]
    assert first.view.outer.area == pytest.approx(121.0 * 71.0, rel=0.03)
