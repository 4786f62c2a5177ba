# SPDX-License-Identifier: Apache-2.0
"""The snake on rendered images with known motion: right, or not ok."""

import math
from functools import lru_cache

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from grasptrack.errors import InputError, ObservationError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.snake.active_contour import Snake, SnakeFit
from grasptrack.transfer import rrp
from grasptrack.typing import Floats
from grasptrack_bench.simulation.coverage import subdivide_polygon

SIZE = (640, 480)
FINE = 4


def part() -> View:
    """A part with corners, a notch and a hole, some 200 px across."""
    corners = np.array(
        [[230, 170], [400, 160], [430, 240], [385, 262], [420, 300], [400, 330], [250, 325], [215, 260]], dtype=float
    )
    outer = Contour(subdivide_polygon(corners, 1.5))
    t = np.arange(60) * (2 * math.pi / 60)
    return View([outer, Contour(np.column_stack([300 + 28 * np.cos(t), 245 + 22 * np.sin(t)]), hole=True)])


PART = part()


def coverage(curves: list[Floats]) -> Floats:
    """(H, W) share of each pixel inside the curves, by supersampling."""
    fine = np.zeros((SIZE[1] * FINE, SIZE[0] * FINE), np.uint8)
    scaled = [np.round(((c + 0.5) * FINE - 0.5) * 256).astype(np.int32) for c in curves]
    cv2.fillPoly(fine, scaled, 255, shift=8)
    return np.asarray(cv2.resize(fine, SIZE, interpolation=cv2.INTER_AREA) / 255.0)


@lru_cache(maxsize=2)
def ground(seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    grain = cv2.GaussianBlur(rng.normal(0, 40, SIZE[::-1]), (0, 0), 3.0)
    return np.asarray(190 + grain)


def render(
    view: View | None, H: Floats, seed: int, dark: bool = True, cover: Floats | None = None
) -> NDArray[np.uint8]:
    rng = np.random.default_rng(seed)
    image = ground(5)
    if view is not None:
        a = coverage([apply_homography(H, c.points) for c in view.contours])
        image = image * (1 - a) + 60.0 * a
    if cover is not None:
        a = coverage([cover])
        image = image * (1 - a) + 120.0 * a
    if not dark:
        image = 255.0 - image
    image = cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0, 4, image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def similar(scale: float, angle: float, x: float, y: float) -> Floats:
    """About the part's middle."""
    c, s = scale * math.cos(angle), scale * math.sin(angle)
    M = np.array(((c, -s), (s, c)))
    H = np.eye(3)
    H[:2, :2] = M
    H[:2, 2] = np.array((320 + x, 245 + y)) - M @ (320, 245)
    return H


def path(k: int) -> Floats:
    t = k / 60
    return similar(1 + 0.2 * math.sin(3 * t), 0.5 * math.sin(5 * t), 60 * math.sin(4 * t), 40 * math.sin(7 * t))


def begun(contacts: ArrayLike | None = None) -> Snake:
    """A snake on the part at rest."""
    return Snake(PART, render(PART, np.eye(3), 0), contacts=contacts)


def step(snake: Snake, image: NDArray[np.uint8]) -> SnakeFit:
    """What it makes of the next image."""
    snake.predict()
    return snake.update(image)


def error(snake: Snake, fit: SnakeFit, H: Floats) -> float:
    """px, largest error of two contacts carried by RRP on the snake's samples."""
    grasp = Grasp(np.array([[245.0, 168.0], [330.0, 328.5]])).snapped(snake.template)
    carried = rrp.apply(rrp.describe(grasp, snake.template), snake.view(fit)).grasp
    return float(np.hypot(*(carried.contacts - apply_homography(H, grasp.contacts)).T).max())


@pytest.mark.sampled(1)
def test_contacts_over_sixty_frames() -> None:
    snake = begun()
    errors = []
    for k in range(60):
        if k:
            snake.predict()
        fit = snake.update(render(PART, path(k), k))
        assert fit.ok, f"frame {k}: {fit.reason}"
        errors.append(error(snake, fit, path(k)))
    assert max(errors) < 0.2, max(errors)
    assert np.sqrt(np.mean(np.square(errors))) < 0.12


def test_the_light_may_fade_slowly() -> None:
    snake = begun()
    for k in range(1, 60):
        faded = (render(PART, path(k), k) * (1.0 - 0.011 * k)).astype(np.uint8)
        fit = step(snake, faded)
        assert fit.ok, f"frame {k}: {fit.reason}"
    assert error(snake, fit, path(59)) < 0.3


def test_fast_motion_after_warming_up() -> None:
    snake = begun()
    x = 0.0
    for k in range(1, 30):
        x += (1 if (k // 12) % 2 == 0 else -1) * min(15.0, 3.0 * (k % 12 + 1))
        H = similar(1.0, 0.01 * k, x, -0.3 * x)
        fit = step(snake, render(PART, H, k))
        if fit.ok:
            assert error(snake, fit, H) < 0.3
        assert fit.ok or k in (12, 24), f"frame {k}: {fit.reason}"


SHIFT = st.floats(-10, 10)


@given(st.floats(0.85, 1.15), st.floats(-0.06, 0.06), SHIFT, SHIFT, st.integers(0, 99), st.booleans())
def test_one_step_of_any_direction(scale: float, angle: float, x: float, y: float, seed: int, dark: bool) -> None:
    snake = Snake(PART, render(PART, np.eye(3), seed, dark))
    H = similar(scale**0.5, angle, x, y)
    fit = step(snake, render(PART, H, seed + 1, dark))
    assert fit.ok and error(snake, fit, H) < 0.25


def bar(x: float, width: float, tilt: float) -> Floats:
    box = np.array([[-width / 2, -400], [width / 2, -400], [width / 2, 400], [-width / 2, 400]])
    c, s = math.cos(tilt), math.sin(tilt)
    return np.asarray(box @ np.array(((c, s), (-s, c))) + (x, 245))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("tilt", [0.0, 0.5, 1.5708])
def test_a_bar_over_a_quarter_is_survived_or_admitted(tilt: float) -> None:
    snake = begun()
    believed = 0
    for k in range(1, 40):
        fit = step(snake, render(PART, path(k), k, cover=bar(90 + 13 * k, 50, tilt)))
        believed += fit.ok
        if fit.ok:
            assert error(snake, fit, path(k)) < 0.5, f"frame {k}"
    assert believed >= 25


def test_gone_and_back() -> None:
    snake = begun()
    for k in range(1, 12):
        fit = step(snake, render(None, np.eye(3), k))
        assert not fit.ok and "edges" in fit.reason
    there = similar(1.3, 1.0, 40.0, -20.0)
    snake.reseed(there @ similar(1.01, 0.01, 1.0, 2.0))
    fit = snake.update(render(PART, there, 50))
    assert fit.ok and error(snake, fit, there) < 0.2


def test_out_of_the_image_is_unobserved_not_wrong() -> None:
    snake = begun()
    for k in range(1, 61):
        H = similar(1.0, 0.1 * math.sin(k / 9), -6.0 * k, 0.0)
        fit = step(snake, render(PART, H, k))
        outside = float((fit.points < 0.0).any(axis=1).mean())
        if fit.ok:
            assert error(snake, fit, H) < 0.7, f"frame {k}"
        else:
            break
    assert outside > 0.4 and k > 45


def test_tilt_is_admitted_and_measured() -> None:
    """What a similarity cannot follow shows in `misfit`, and is not called ok for long."""
    snake = begun()
    to_middle = np.array(((1, 0, -320), (0, 1, -245), (0, 0, 1.0)))
    for k in range(1, 40):
        H = np.linalg.inv(to_middle) @ np.array(((1, 0, 0), (0, 1, 0), (2.5e-5 * k, 0, 1.0))) @ to_middle
        fit = step(snake, render(PART, H, k))
        off = apply_homography(fit.homography, snake.template.points) - apply_homography(H, snake.template.points)
        rms = math.sqrt(np.square(off).sum(axis=1).mean())
        if fit.ok:
            assert rms < 1.5, f"frame {k}"
        if rms < 3.0:
            assert fit.misfit == pytest.approx(rms, abs=0.35)
    assert not fit.ok


def test_samples_follow_the_outline_and_keep_their_counts() -> None:
    snake = begun(contacts=[[245.0, 169.1]])
    assert snake.rms < 0.3
    assert len(snake.template.contours) == 2 and all(len(c) % 6 == 0 for c in snake.template.contours)
    assert [len(c) for c in snake.view().contours] == [len(c) for c in snake.template.contours]
    assert np.allclose(snake.view().points, snake.template.points)


def test_refusals() -> None:
    image = render(PART, np.eye(3), 0)
    with pytest.raises(ObservationError):
        Snake(PART, render(None, np.eye(3), 0))
    with pytest.raises(InputError):
        Snake(PART, np.dstack([image] * 3))
    with pytest.raises(InputError):
        Snake(PART, image).update(np.dstack([image] * 3))
