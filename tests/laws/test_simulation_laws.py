# SPDX-License-Identifier: Apache-2.0
"""Lens, thickness, exposure, shadow, noise, twins: each against the law that it stands for."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edges import bilinear, flat, pan
from grasptrack.errors import InputError
from grasptrack.geometry.homographies import apply_homography
from grasptrack_bench.simulation import (
    SHAPES,
    Bar,
    Conditions,
    Guest,
    Path,
    Pinhole,
    Scene,
    Shadow,
    mirrored_shape,
    near_twin,
    similarity_path,
    stone_texture,
    tilting_path,
)
from grasptrack_bench.simulation.conditions import pooled_noise
from grasptrack_bench.simulation.coverage import pixel_coverage, subdivide_polygon
from grasptrack_bench.simulation.lookalikes import best_fit

WIDTH, HEIGHT = 320, 240


QUIET = Conditions(noise=0.0)
K1, K2 = st.floats(-0.25, 0.3), st.floats(-0.03, 0.06)


@given(k1=K1, k2=K2)
def test_a_lens_is_undone_to_rounding(k1: float, k2: float) -> None:
    camera = Pinhole(k1=k1, k2=k2)
    points = np.random.default_rng(0).uniform([-400, -300], [1040, 780], (200, 2))
    assert np.abs(camera.undistort(camera.distort(points)) - points).max() < 1e-9
    assert np.abs(camera.distort(camera.undistort(points)) - points).max() < 1e-9
    middle = camera.matrix[:2, 2]
    assert camera.distort(middle[None])[0] == pytest.approx(middle)


def test_a_lens_follows_browns_formula() -> None:
    camera = Pinhole(640, 480, 700.0, k1=-0.2, k2=0.03)
    point = np.array([[319.5 + 210.0, 239.5 - 140.0]])
    q = (0.3**2) + (0.2**2)
    scale = 1.0 - 0.2 * q + 0.03 * q * q
    assert camera.distort(point)[0] == pytest.approx([319.5 + 210.0 * scale, 239.5 - 140.0 * scale])
    assert (Pinhole().distort(point) == point).all()


def test_a_lens_that_folds_the_image_is_refused() -> None:
    with pytest.raises(InputError, match="folds"):
        Pinhole(k1=-1.5)


def test_cutting_sides_changes_no_outline() -> None:
    ring = SHAPES["arrow"]().outer
    cut = subdivide_polygon(ring, 0.05)
    assert len(cut) > 5 * len(ring)
    assert {tuple(p) for p in ring} <= {tuple(p) for p in cut}
    assert np.hypot(*(np.roll(cut, -1, axis=0) - cut).T).max() <= 0.05 + 1e-12


@given(height=st.floats(0.01, 0.2), seed=st.integers(0, 30))
def test_a_raised_plane_is_seen_as_a_pinhole_sees_it(height: float, seed: int) -> None:
    path, camera = tilting_path(4, seed=seed), Pinhole()
    low, high = path.table_to_image(camera), path.table_to_image(camera, height)
    # The camera's centre and its axes from the plane homography: K [r1 r2 t], the table's normal toward the camera.
    for a, b in zip(low, high, strict=True):
        M = np.linalg.inv(camera.matrix) @ a
        M /= np.linalg.norm(M[:, 0])
        up = -np.cross(M[:, 0], M[:, 1])
        xy = np.array([[0.3, -0.4], [-0.5, 0.2]])
        points = xy @ M[:, :2].T + M[:, 2] + height * up
        seen = points @ camera.matrix.T
        assert apply_homography(b, xy) == pytest.approx(seen[:, :2] / seen[:, 2:], abs=1e-6)


def test_a_path_between_its_frames() -> None:
    path = tilting_path(30, seed=2)
    for i in (0, 1, 15, 28, 29):
        same = path.between(i, [0.0])
        assert same.target[0] == pytest.approx(path.target[i], abs=1e-12)
        assert same.roll[0] == pytest.approx(path.roll[i])
        assert same.tilt[0] == pytest.approx(path.tilt[i], abs=1e-12)
    after, before = path.between(10, [0.5]), path.between(11, [-0.5])
    assert after.distance == pytest.approx(before.distance, abs=1e-9)
    assert after.target == pytest.approx(before.target, abs=1e-9)
    even = Path(np.column_stack([np.arange(5.0), np.zeros(5)]), np.full(5, 4.0), np.arange(5) * 0.1, *np.zeros((2, 5)))
    for i in range(5):
        assert even.between(i, [-0.4, 0.3]).target[:, 0] == pytest.approx([i - 0.4, i + 0.3])


def test_motion_blur_is_the_mean_over_the_exposure() -> None:
    """A camera that moves evenly: the edge is the lens's, smeared over the way of half a frame, its middle unmoved."""
    frames, step, exposure, sigma = 5, 6.0, 0.5, 0.8
    path = pan(step, frames, Pinhole(WIDTH, HEIGHT))
    scene = Scene(
        SHAPES["square"](),
        path,
        camera=Pinhole(WIDTH, HEIGHT),
        table=flat(200),
        surface=flat(50),
        conditions=Conditions(blur=sigma, noise=0.0, exposure=exposure),
    )
    frame = scene[2]
    x, y = frame.outline[0][:, 0].min(), frame.outline[0][:, 1].mean()
    t = np.arange(-8, 8, 0.1)
    profile = bilinear(frame.image.astype(float), np.column_stack([x + t, np.full(len(t), round(float(y)))]))
    slope = -np.diff(profile)
    at = t[:-1] + 0.05
    centre = (slope * at).sum() / slope.sum()
    spread = math.sqrt((slope * (at - centre) ** 2).sum() / slope.sum())
    assert centre == pytest.approx(0.0, abs=0.01)
    # Bilinear sampling of pixels adds a sixth of a square pixel of variance.
    assert spread == pytest.approx(math.sqrt(sigma**2 + (exposure * step) ** 2 / 12 + 1 / 6), rel=0.03)
    given = {"camera": Pinhole(WIDTH, HEIGHT), "table": stone_texture(1), "surface": flat(50)}
    no_motion = Scene(SHAPES["square"](), path, conditions=QUIET, **given)
    tiny = Scene(SHAPES["square"](), path, conditions=replace(QUIET, exposure=1e-6), **given)
    assert np.abs(no_motion[2].image.astype(int) - tiny[2].image).max() <= 1


def test_a_shadow_multiplies_what_it_falls_on() -> None:
    path = similarity_path(20, reach=0.0, zoom=0.0, turn=0.0)
    shadow = Shadow(start=3, end=16, depth=0.4, softness=9.0, round=True, seed=2)
    given = {"camera": Pinhole(WIDTH, HEIGHT), "table": flat(200), "surface": flat(90)}
    lit = Scene(SHAPES["disc"](), path, conditions=QUIET, **given)[9].image.astype(float)
    scene = Scene(SHAPES["disc"](), path, conditions=replace(QUIET, shadow=shadow), **given)
    light = shadow.light(9, WIDTH, HEIGHT)
    assert light is not None
    assert np.abs(scene[9].image - lit * light).max() <= 1.0
    assert light.min() == pytest.approx(0.6, abs=0.01) and light.max() <= 1.0
    assert (scene[2].image == lit).all() and (scene[17].image == lit).all()
    # its edge is as soft as asked
    assert np.abs(np.diff(light, axis=1)).max() < 0.4 / (9.0 * math.sqrt(2 * math.pi)) * 1.2
    seen = [1.0 - shadow.light(i, WIDTH, HEIGHT).mean() for i in range(3, 17)]  # type: ignore[union-attr]
    assert max(seen) > 0.05 and seen[0] < 0.005 and seen[-1] < 0.005  # it comes from outside and goes there


def test_pooled_noise_is_as_good_as_fresh() -> None:
    drawn = [pooled_noise(np.random.default_rng((5, i)), 200, 300) for i in range(12)]
    for a in drawn:
        assert a.mean() == pytest.approx(0.0, abs=0.02)
        assert a.std() == pytest.approx(1.0, abs=0.02)
        assert abs((a[:, 1:] * a[:, :-1]).mean()) < 0.02
    for a, b in pairwise(drawn):
        assert abs((a * b).mean()) < 0.02
    assert (pooled_noise(np.random.default_rng(7), 200, 300) == pooled_noise(np.random.default_rng(7), 200, 300)).all()
    assert pooled_noise(np.random.default_rng(7), 20, 3000).shape == (20, 3000)


def test_gradient_jumps_and_vignette_multiply_the_light() -> None:
    light = Conditions(gradient=(0.2, 0.0), vignette=0.1, jumps=((5, 0.5), (9, 1.2)))
    fall = light.fall(101, 51)
    assert fall[25, 50] == pytest.approx(1.0)
    assert fall[25, 100] / fall[25, 0] == pytest.approx((1 + 0.2 * 100 / 101) / (1 - 0.2 * 100 / 101), rel=1e-4)
    assert [light.gain(i, 20, 0.0) for i in (0, 4, 5, 8, 9, 19)] == [1.0, 1.0, 0.5, 0.5, 1.2, 1.2]


# --- look-alikes ---------------------------------------------------------------------------------


@pytest.mark.sampled(10)
@pytest.mark.parametrize("name", SHAPES)
def test_a_near_twin_differs_in_one_place_by_a_tenth_of_its_size(name: str) -> None:
    shape = SHAPES[name]()
    twin = near_twin(shape, 1)
    assert (near_twin(shape, 1).outer == twin.outer).all()
    (a,) = [pixel_coverage([p * 60 + 150.0 for p in s.polygons], 300, 300, 0.5) for s in (shape,)]
    b = pixel_coverage([p * 60 + 150.0 for p in twin.polygons], 300, 300, 0.5)
    y, x = np.nonzero(np.abs(a - b) > 0.5)
    span = max(np.ptp(x), np.ptp(y)) + 1
    assert 0.09 * 60 <= span <= 0.25 * 60 + 1.5
    assert 0.006 < np.abs(a - b).sum() / 3600 < 0.03
    assert abs((a - b).sum()) == pytest.approx(np.abs(a - b).sum(), rel=0.1)  # all tab or all notch


def test_twins_differ_by_seed() -> None:
    places = {tuple(np.round(near_twin(SHAPES["rectangle"](), k).outer[0], 3)) for k in range(6)}
    assert len(places) == 6


@given(turn=st.floats(-3.1, 3.1), x=st.floats(-0.2, 0.2), y=st.floats(-0.2, 0.2))
@settings(max_examples=5, deadline=None)
def test_a_rigid_motion_is_found_and_undone(turn: float, x: float, y: float) -> None:
    shape = SHAPES["bracket"]()
    fit = best_fit(shape.moved(turn), shape)
    assert fit.distance < 0.01
    assert math.cos(fit.turn + turn) > 0.999
    assert best_fit(shape.moved(turn, (x, y)), shape).distance < 0.05


def test_a_mirror_image_lies_over_its_part_and_mirrors_back() -> None:
    shape = SHAPES["gasket"]()
    image = mirrored_shape(shape)
    assert best_fit(image, shape).distance > 0.1
    assert best_fit(image.flipped(), shape).distance < 0.01
    assert len(image.holes) == len(shape.holes)


# --- covers and guests ---------------------------------------------------------------------------


def crossings(polygon: np.ndarray, x: float, y: float) -> bool:
    """Even-odd rule, one side after another."""
    odd = False
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if (y0 <= y) != (y1 <= y) and x > x0 + (y - y0) * (x1 - x0) / (y1 - y0):
            odd = not odd
    return odd


def test_visibility_is_that_of_brute_force() -> None:
    from grasptrack_bench.simulation import DISTURBANCES

    bar = Bar(start=0, end=9, width=0.25, angle=0.3)
    hand = DISTURBANCES["hand"].scene(SHAPES["gasket"](), 20, 3).covers[0]
    path = tilting_path(20, seed=4, reach=1.2)
    scene = Scene(SHAPES["gasket"](), path, covers=[bar, hand], conditions=QUIET, table=flat(200), surface=flat(90))
    some = np.random.default_rng(2).uniform([-80, -80], [720, 560], (150, 2))
    for i in (4, 9):
        frame = scene[i]
        expected = [
            0 <= x <= 639 and 0 <= y <= 479 and not any(crossings(cover, x, y) for cover in frame.covers)
            for x, y in some
        ]
        assert frame.visible(some).tolist() == expected
        total = shown = 0.0
        for ring in frame.outline:
            for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                places = a + np.linspace(0.025, 0.975, 20)[:, None] * (b - a)
                total += float(np.hypot(*(b - a)))
                shown += float(np.hypot(*(b - a))) * frame.visible(places).mean()
        assert frame.outline_visible == pytest.approx(shown / total, abs=0.003)


def test_a_part_that_is_taken_away_leaves_the_table() -> None:
    path = similarity_path(6, reach=0.0, zoom=0.0, turn=0.0)
    camera = Pinhole(WIDTH, HEIGHT)
    guests = [Guest(2, 4, None), Guest(4, 5, SHAPES["star"](), flat(10))]
    scene = Scene(
        SHAPES["disc"](), path, camera=camera, table=flat(200), surface=flat(90), guests=guests, conditions=QUIET
    )
    assert (scene[2].image == 200).all() and not scene[3].present
    assert scene[4].image.min() == 10 and not scene[4].present
    assert scene[1].image.min() == 90 and scene[5].present
