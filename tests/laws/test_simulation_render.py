# SPDX-License-Identifier: Apache-2.0
"""The renderer against the analytic outline: a scene whose edges lie elsewhere than it says measures nothing."""

import math

import numpy as np
import pytest

from grasptrack_bench.simulation import (
    SHAPES,
    Conditions,
    Pinhole,
    Scene,
    bracket_scene,
    plain_texture,
    tilting_path,
)
from grasptrack_bench.simulation.coverage import inside_mask, pixel_coverage
from grasptrack_bench.simulation.outlines import inside_polygons, polygon_moments

WIDTH, HEIGHT, SIGMA = 320, 240, 0.7


def placed(name: str, angle: float = 0.3, scale: float = 62.0) -> list[np.ndarray]:
    turn = scale * np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return [p @ turn.T + [160.31, 119.77] for p in SHAPES[name]().polygons]


@pytest.mark.parametrize("name", SHAPES)
def test_covered_area_and_centroid_are_the_polygons(name: str) -> None:
    polygons = placed(name)
    field = pixel_coverage(polygons, WIDTH, HEIGHT, SIGMA).astype(float)
    area, mx, my = np.sum([polygon_moments(p) for p in polygons], axis=0)
    length = sum(np.hypot(*(np.roll(p, -1, axis=0) - p).T).sum() for p in polygons)
    # Steiner's formula: at a corner that turns by t, blurring by distance adds (t / 2 + tan(t / 2)) sigma^2 / 2.
    sides = [np.roll(p, -1, axis=0) - p for p in polygons]
    before = [np.roll(side, 1, axis=0) for side in sides]
    turns = np.concatenate(
        [np.arctan2(b[:, 0] * s[:, 1] - b[:, 1] * s[:, 0], (b * s).sum(1)) for b, s in zip(before, sides, strict=True)]
    )
    expected = area + 0.5 * SIGMA**2 * (turns / 2 + np.tan(turns / 2)).sum()
    assert (field.sum() - expected) / length == pytest.approx(0.0, abs=0.001)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    assert (field * x).sum() / field.sum() == pytest.approx(mx / area, abs=0.06)
    assert (field * y).sum() / field.sum() == pytest.approx(my / area, abs=0.06)


@pytest.mark.parametrize("name", SHAPES)
def test_half_coverage_separates_inside_from_outside_everywhere(name: str) -> None:
    polygons = placed(name, 0.8)
    field = pixel_coverage(polygons, WIDTH, HEIGHT, SIGMA)
    inside = inside_mask(polygons, WIDTH, HEIGHT)
    assert ((field >= 0.5) == inside).mean() > 0.99999
    some = np.random.default_rng(0).integers(0, [WIDTH, HEIGHT], (2500, 2))
    assert (inside_polygons(polygons, some.astype(float)) == inside[some[:, 1], some[:, 0]]).all()


def test_a_part_that_the_border_cuts_is_the_same_where_it_is_seen() -> None:
    whole = pixel_coverage(placed("bracket"), WIDTH, HEIGHT, SIGMA)
    cut = pixel_coverage([p - [150.0, 110.0] for p in placed("bracket")], WIDTH - 150, HEIGHT - 110, SIGMA)
    assert cut == pytest.approx(whole[110:, 150:], abs=1e-6)


def test_a_part_out_of_view_leaves_no_trace() -> None:
    assert not pixel_coverage([p + 1000.0 for p in placed("disc")], WIDTH, HEIGHT, SIGMA).any()


def test_a_blur_that_would_alias_is_refused() -> None:
    with pytest.raises(ValueError, match="alias"):
        pixel_coverage(placed("disc"), WIDTH, HEIGHT, 0.2)


def test_a_sliding_table_moves_under_a_part_at_rest() -> None:
    still = Conditions(noise=0.0)
    path = tilting_path(2, tilt=0.0, reach=0.0, zoom=0.0, turn=0.0)
    scene = Scene(
        SHAPES["disc"](),
        path,
        camera=Pinhole(WIDTH, HEIGHT),
        conditions=still,
        slide=(0.1, 0.0),
        table=plain_texture(1),
    )
    a, b = (frame.image.astype(float) for frame in scene)
    inside = inside_mask(scene[0].outline, WIDTH, HEIGHT)
    edge = pixel_coverage(scene[0].outline, WIDTH, HEIGHT, 3.0)
    assert np.abs(a - b)[inside & (edge > 0.99)].max() == 0.0
    assert np.abs(a - b)[~inside & (edge < 0.01)].mean() > 0.5


@pytest.mark.slow
def test_the_demonstration_keeps_the_whole_outline_in_view() -> None:
    scene = bracket_scene(30)
    assert scene[0].image.shape == (480, 640, 3)
    assert min(scene[i].outline_visible for i in range(0, 30, 3)) == 1.0
    assert bracket_scene(2, colour=False)[0].image.shape == (480, 640)
