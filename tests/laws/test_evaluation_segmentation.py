# SPDX-License-Identifier: Apache-2.0
"""Measures of masks: their definitions and laws; and the baselines find what anything would find."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.path import Path as Polygon

from grasptrack.geometry.contours import Contour, View
from grasptrack_bench.metrics.mask_agreement import (
    band_iou,
    boundary_f,
    intersection_over_union,
    mask_boundary,
    mask_of,
)
from grasptrack_bench.simulation.coverage import pixel_coverage
from research.studies.segmentation import METHODS, largest_outline
from synthesis_shapes import circle

SHAPE = (120, 160)
Y, X = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]]

seeds = st.integers(0, 2**32 - 1)


def disc(x: float, y: float, radius: float) -> np.ndarray:
    return (X - x) ** 2 + (Y - y) ** 2 <= radius * radius


def star(random: np.random.Generator) -> np.ndarray:
    """A polygon that reaches beyond the image on some draws."""
    angle = np.sort(random.uniform(0.0, 2.0 * math.pi, random.integers(8, 30)))
    radius = random.uniform(10.0, 80.0, len(angle))
    return random.uniform(40, 90, 2) + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def blobs(random: np.random.Generator) -> np.ndarray:
    mask = np.zeros(SHAPE, dtype=bool)
    for _ in range(random.integers(1, 4)):
        mask |= disc(random.uniform(0, 160), random.uniform(0, 120), random.uniform(3, 40))
    return mask


@given(seeds)
def test_a_mask_holds_the_pixels_whose_centres_lie_inside(seed: int) -> None:
    polygon = star(np.random.default_rng(seed))
    centres = np.column_stack([X.ravel(), Y.ravel()])
    expected = Polygon(polygon).contains_points(centres).reshape(SHAPE)
    assert (mask_of(Contour.trusted(polygon), SHAPE) == expected).all()


def test_a_mask_has_no_bias_of_the_edge_and_leaves_holes_out() -> None:
    ring = View([Contour(circle(80.3, 60.2, 40.0, 720)), Contour(circle(85.1, 57.7, 15.0, 720), hole=True)])
    mask = mask_of(ring, SHAPE)
    assert mask.sum() == pytest.approx(math.pi * (40.0**2 - 15.0**2), rel=0.005)  # a pixel's half more: 4 %
    assert intersection_over_union(mask, disc(80.3, 60.2, 40.0) & ~disc(85.1, 57.7, 15.0)) > 0.998


def test_overlap_of_two_rectangles() -> None:
    a, b = (X < 40) & (Y < 30), (X >= 20) & (X < 60) & (Y < 30)
    assert intersection_over_union(a, b) == pytest.approx(1.0 / 3.0)
    assert intersection_over_union(a, ~a) == 0.0


@given(seeds, st.floats(0.0, 8.0))
def test_measures_are_symmetric_within_bounds_and_one_for_equals(seed: int, tolerance: float) -> None:
    random = np.random.default_rng(seed)
    a, b = blobs(random), blobs(random)
    for measure in (intersection_over_union, lambda p, q: boundary_f(p, q, tolerance)):
        assert measure(a, b) == pytest.approx(measure(b, a), abs=1e-12)
        assert 0.0 <= measure(a, b) <= 1.0
        assert measure(a, a) == 1.0


@given(seeds, st.integers(-6, 6), st.integers(-6, 6))
def test_a_shift_within_the_tolerance_costs_nothing(seed: int, dx: int, dy: int) -> None:
    mask = blobs(np.random.default_rng(seed)) & disc(80, 60, 45)
    f = boundary_f(mask, np.roll(mask, (dy, dx), axis=(0, 1)), tolerance=math.hypot(dx, dy))
    assert f == 1.0


def test_beyond_the_tolerance_the_edges_agree_less_and_less() -> None:
    mask = disc(60, 60, 30)
    values = [boundary_f(mask, np.roll(mask, shift, axis=1)) for shift in (4, 6, 9, 15, 30)]
    assert values[0] == 1.0
    assert all(later < earlier for earlier, later in pairwise(values))
    assert values[-1] < 0.3


def test_precision_and_recall_both_count() -> None:
    near, far = disc(35, 60, 20), disc(120, 60, 20)
    edges = mask_boundary(near).sum(), mask_boundary(far).sum()
    recall = edges[0] / sum(edges)
    assert boundary_f(near | far, near) == pytest.approx(2.0 * recall / (1.0 + recall))


def test_an_empty_mask_agrees_with_an_empty_one_only() -> None:
    empty, some = np.zeros(SHAPE, dtype=bool), disc(60, 60, 20)
    assert intersection_over_union(empty, empty) == boundary_f(empty, empty) == 1.0
    assert intersection_over_union(empty, some) == boundary_f(empty, some) == boundary_f(some, empty) == 0.0


@pytest.mark.parametrize("measure", [intersection_over_union, boundary_f])
def test_masks_of_two_sizes_are_refused(measure: object) -> None:
    with pytest.raises(ValueError, match="one size"):
        measure(np.ones((4, 5), dtype=bool), np.ones((5, 4), dtype=bool))  # type: ignore[operator]


def test_the_band_of_a_disc_is_that_of_its_radii() -> None:
    eroded, dilated = band_iou(disc(80, 60, 40), 2)
    assert eroded == pytest.approx((38 / 40) ** 2, abs=0.01)
    assert dilated == pytest.approx((40 / 42) ** 2, abs=0.01)


@pytest.mark.parametrize("hint", [None, (80.0, 60.0)])
@pytest.mark.parametrize(("ground", "object_"), [(190, 40), (40, 190)])
@pytest.mark.parametrize("name", ["Otsu", "adaptive", "GrabCut"])
def test_baselines_find_a_disc(name: str, ground: int, object_: int, hint: tuple[float, float] | None) -> None:
    share = pixel_coverage([circle(80.0, 60.0, 30.0, 720)], SHAPE[1], SHAPE[0], 0.8)[:, :, None]
    noise = np.random.default_rng(3).normal(0.0, 2.0, (*SHAPE, 3))
    image = np.clip(ground + (object_ - ground) * share + noise, 0, 255).astype(np.uint8)
    mask = METHODS[name](image, hint)
    assert boundary_f(mask, disc(80.0, 60.0, 30.0)) > 0.95
    assert intersection_over_union(mask, disc(80.0, 60.0, 30.0)) > 0.85


def test_a_baseline_takes_the_largest_outline_clear_of_the_border_or_the_one_at_the_hint() -> None:
    large, small, cut = disc(60, 60, 20), disc(110, 60, 10), disc(150, 60, 20)
    both = [(large | small | cut).astype(np.uint8)]
    assert (largest_outline([(large | cut).astype(np.uint8)]) == large).all()
    assert (largest_outline([(large | disc(110, 60, 8)).astype(np.uint8)], (110.0, 60.0)) == disc(110, 60, 8)).all()
    assert (largest_outline(both, (155.0, 60.0)) == cut).all()
    assert not largest_outline(both, (10.0, 10.0)).any()
    assert not largest_outline([cut.astype(np.uint8)]).any()
