# SPDX-License-Identifier: Apache-2.0
"""What a fitted pose, its light, its readout and its evidence obey."""

import math
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posed import (
    CENTRE,
    CONTACTS,
    FREE,
    HEIGHT,
    NOISY,
    NUISANCE_COVARIANCE,
    SEEDS,
    WIDTH,
    A,
    Floats,
    Grey,
    bent,
    carried,
    draw,
    ingredients,
    known,
    native,
    outline,
    pyramid,
    question,
    same,
    target,
    told,
    view,
)
from reference.registration.target import Target


@NOISY
@pytest.mark.parametrize("textured", [True, False])
def test_a_pose_is_found_where_the_object_is(seed: int, textured: bool) -> None:
    G = view(np.random.default_rng(seed), 0.4)
    found = target(native, seed, textured=textured).solve(**question(pyramid(draw(G, seed, textured=textured))))
    assert found.valid and found.edge_share > 0.9
    assert np.abs(carried(found.G, CONTACTS) - carried(G, CONTACTS)).max() < 0.25


@given(SEEDS, st.integers(-15, 15), st.integers(-8, 8))
def test_a_pose_goes_with_its_images(seed: int, right: int, down: int) -> None:
    """By whole px, the first one too: what stood still would be dirt. Of the camera, which has a middle, nothing is known."""
    rng, wide = np.random.default_rng(seed), 50
    shift = np.array([[1.0, 0.0, right], [0.0, 1.0, down], [0.0, 0.0, 1.0]])
    start = np.array([[1.0, 0.0, wide], [0.0, 1.0, wide], [0.0, 0.0, 1.0]]) @ A
    first, image = (np.pad(draw(G, seed), wide, mode="edge") for G in (A, view(rng)))  # no border within reach

    def told_through(S: Floats, x: int, y: int) -> dict[str, Any]:
        made = target(native, seed, shown=[np.roll(first, (y, x), axis=(0, 1))], seen=S, **FREE)
        away = [np.roll(image, (y, x), axis=(0, 1))]
        return told(
            made.solve(**question(away, S, nuisance_covariance=np.diag([1e-9, *np.diag(NUISANCE_COVARIANCE)[1:]])))
        )

    here, moved = told_through(start, 0, 0), told_through(shift @ start, right, down)
    assert here["valid"]
    same(moved.pop("G"), shift @ here.pop("G"), atol=1e-5)
    for name in ("contacts", "middle"):
        same(np.subtract(moved.pop(name), (right, down)), here.pop(name), atol=1e-4)
    same(moved, here, rtol=1e-4, atol=1e-5)


@pytest.mark.sampled(6)
@NOISY
@pytest.mark.parametrize(("gain", "bias"), [(0.7, 20.0), (0.9, -20.0), (1.1, 20.0)])
def test_light_does_not_move_a_pose(seed: int, gain: float, bias: float) -> None:
    made, G = target(native, seed), view(np.random.default_rng(seed), 0.4)
    plain, lit = (
        made.solve(**question(pyramid(draw(G, seed, noise=0.5, light=light)))) for light in ((1.0, 0.0), (gain, bias))
    )
    assert np.abs(carried(plain.G, CONTACTS) - carried(lit.G, CONTACTS)).max() < 0.05
    assert lit.light[0] / plain.light[0] == pytest.approx(gain, rel=0.02)
    assert lit.edge_share == pytest.approx(plain.edge_share, abs=0.01)


@given(SEEDS)
def test_what_is_hidden_does_not_count(seed: int) -> None:
    """But for the pixels at its border, which those beside it are interpolated with."""
    rng = np.random.default_rng(seed)
    made = target(native, seed)
    x, y = rng.integers(20, 100), rng.integers(10, 70)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[y : y + 40, x : x + 40] = 1
    made.hide([mask])
    image = draw(view(rng), seed)
    other = image.copy()
    other[y + 1 : y + 39, x + 1 : x + 39] = rng.integers(0, 256, (38, 38))
    same(made.solve(**question([other])), made.solve(**question([image])), rtol=0.0, atol=0.0)


@NOISY
def test_a_cover_hides_the_outline_and_a_notch_is_another_shape(seed: int) -> None:
    rng = np.random.default_rng(seed)
    made, angle = target(native, seed, 60, textured=False), rng.uniform(0.0, 2.0 * np.pi)
    points, normals = outline(240)
    k = int(240 * angle / (2.0 * np.pi))
    middle, out = points[k], normals[k]
    along = np.array([-out[1], out[0]])
    square = np.array([middle + a * 8.0 * along + b * out for a, b in ((-1, -10), (1, -10), (1, 10), (-1, 10))])
    cover, notch = (
        made.solve(**question(pyramid(draw(A, seed, textured=False, patch=(square, level))))) for level in (235.0, 70.0)
    )
    assert cover.valid and notch.valid
    assert notch.other_shape > 1.0 > 0.0 > cover.other_shape
    gone = np.linalg.norm(np.asarray(ingredients(seed, 60, {}, False)[7]) - middle, axis=1) < 6.0
    assert cover.visible[gone].mean() < 0.3 and cover.visible[~gone].mean() > 0.7


@NOISY
@pytest.mark.parametrize("level", [90.0, 110.0])
def test_what_covers_all_of_a_plain_surface_is_no_light(seed: int, level: float) -> None:
    """The outline's inner side tells: its edges are where they were, though the surface looks as in another light."""
    cover = CENTRE + 0.7 * (outline(60)[0] - CENTRE)
    G = view(np.random.default_rng(seed), 0.4)
    image = draw(G, seed, textured=False, patch=(cover, level))
    found = target(native, seed, textured=False).solve(**question(pyramid(image)))
    assert found.valid and found.edge_share > 0.8
    assert np.abs(carried(found.G, CONTACTS) - carried(G, CONTACTS)).max() < 0.25


@NOISY
def test_dirt_on_the_lens_is_not_of_the_object(seed: int) -> None:
    """What the image shows where the first view had it, though the object has moved on, says nothing of the object."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    dirt = sum(60.0 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / 12.0) for u, v in rng.uniform((70, 50), (90, 70), (3, 2)))

    def photographed(G: Floats) -> list[Grey]:
        return pyramid(np.clip(draw(G, seed, textured=False) + dirt, 0, 255).astype(np.uint8))

    made = target(native, seed, textured=False, shown=photographed(A))
    G = np.array([[1.0, 0.0, 8.0], [0.0, 1.0, -7.0], [0.0, 0.0, 1.0]]) @ A
    found = made.solve(**question(photographed(G), G, P=known(1.0, 0.5), last=A))
    assert found.valid and np.abs(carried(found.G, CONTACTS) - carried(G, CONTACTS)).max() < 0.25
    # coarser patches hold the outline too
    dirty = np.array(made.solve(**question(photographed(A))).correlation[0]) > 0.9
    surface = np.array(found.correlation[0])[dirty]
    assert np.isnan(surface).any() and not (surface < 0.5).any()


@NOISY
def test_flow_finds_what_moved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, G = pyramid(draw(A, seed)), view(rng)
    places = CENTRE + rng.uniform(-20.0, 20.0, (50, 2))
    made = target(native, seed, 0)
    found = made.follow(before, A, pyramid(draw(G, seed)), A, known(6.0, 3.0), places, np.array([1.0, 2.0, 4.0]))
    assert found.valid and found.agreeing > 0.5
    assert np.abs(carried(found.G, CENTRE[None]) - carried(G, CENTRE[None])).max() < 0.15


@NOISY
def test_a_patch_tells_little_along_what_nothing_is_left_of(seed: int) -> None:
    """As of brushed metal under a highlight in the first image, of which later ones show the streaks alone."""
    rng = np.random.default_rng(seed)
    streaks, spots = rng.normal(size=(HEIGHT, 1)), rng.normal(size=(HEIGHT, WIDTH))

    def photographed(share: float) -> list[Grey]:
        image = 120.0 + 60.0 * cv2.GaussianBlur(streaks + share * spots, (0, 0), 1.0)
        return pyramid(np.clip(image + rng.normal(0.0, 2.0, image.shape), 0, 255).astype(np.uint8))

    places, prior, one = CENTRE + rng.uniform(-24.0, 24.0, (60, 2)), known(2.0, 0.5), np.ones(1)
    made, before, rest = target(native, seed, 0), photographed(0.7), np.eye(3)
    there, gone = (made.follow(before, rest, photographed(s), rest, prior, places, one) for s in (0.7, 0.0))
    along, across = (np.sqrt([found.P[k, k] for found in (there, gone)]) for k in (0, 1))
    assert along[1] > 5.0 * along[0] and across[1] < 3.0 * across[0]


@given(SEEDS)
def test_a_move_is_its_derivatives_and_undoes_the_difference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    made = target(native, 0, 30)
    G, d, points = view(rng, 3.0), rng.normal(size=8), CENTRE + rng.uniform(-30.0, 30.0, (6, 2))
    plain = Target(*ingredients(0, 30, {})[1:])
    same(made.moved(G, np.zeros(8)), G)
    h = 1e-4
    change = carried(made.moved(np.eye(3), h * d), points) - carried(made.moved(np.eye(3), -h * d), points)
    same(change / (2.0 * h), plain.jacobian(points) @ d, atol=1e-6)
    moved = made.moved(G, d)
    between = plain.difference(G, moved)
    assert between is not None
    same(between, d, atol=1e-9)


SHARE = 0.6
"""Readout of the images here."""


def bend_of(rng: np.random.Generator) -> Floats:
    """(3, 8) of an object that turns and swells while its rows are read; none of it at the contacts' middle."""
    bend = np.zeros((3, 8))
    bend[1:, 2:6] = rng.uniform(0.5, 1.0, (2, 4)) * rng.choice([-1.0, 1.0], (2, 4))
    return bend


def free(bend: Floats, share: float) -> dict[str, object]:
    """Of a question: nothing is known of the pose's shape nor of the camera."""
    return {"P": known(3.0, 2.0), "bend": bend, "readout": share}


@NOISY
@pytest.mark.parametrize("textured", [True, False])
def test_a_bend_that_is_known_moves_no_pose(seed: int, textured: bool) -> None:
    rng = np.random.default_rng(seed)
    G, bend = view(rng, 0.4), bend_of(rng)
    made = target(native, seed, textured=textured)
    levels = pyramid(draw(G, seed, textured=textured, bend=SHARE * bend))
    known_, unknown = (made.solve(**question(levels, **free(bend, share))) for share in (SHARE, 0.0))
    assert known_.valid and np.abs(carried(known_.G, CONTACTS) - carried(G, CONTACTS)).max() < 0.25
    assert known_.edge_sigma < unknown.edge_sigma


@pytest.mark.sampled(12)
@NOISY
@pytest.mark.parametrize("textured", [True, False])
@pytest.mark.parametrize("share", [-SHARE, 0.0, SHARE])
def test_an_image_tells_the_readout(seed: int, textured: bool, share: float) -> None:
    rng = np.random.default_rng(seed)
    G, bend = view(rng, 0.4), bend_of(rng)
    levels = pyramid(draw(G, seed, textured=textured, bend=share * bend))
    found = target(native, seed, textured=textured).solve(**question(levels, **free(bend, share)))
    assert 0.0 < found.readout_variance < 0.15**2
    assert abs(found.readout - share) < max(0.08, 4.0 * math.sqrt(found.readout_variance))


@NOISY
def test_a_readout_that_is_not_known_yet_is_told_from_none(seed: int) -> None:
    rng = np.random.default_rng(seed)
    G, bend = view(rng, 0.4), bend_of(rng)
    levels = pyramid(draw(G, seed, textured=False, bend=SHARE * bend))
    made, told = target(native, seed, textured=False), 0.0
    for _ in range(5):  # as image after image
        told = made.solve(**question(levels, **free(bend, told))).readout
    assert told == pytest.approx(SHARE, abs=0.15)


def test_how_the_pose_depends_on_the_readout() -> None:
    """Of many images together: samples that contradict the others count less, which makes it less."""
    told, moved = [], []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        G, bend, step = view(rng, 0.4), bend_of(rng), 0.2
        made = target(native, seed, textured=False)
        levels = pyramid(draw(G, seed, noise=0.5, textured=False, bend=SHARE * bend))
        low, here, high = (made.solve(**question(levels, G, **free(bend, SHARE + way))) for way in (-step, 0.0, step))
        J = np.array([[bent_by(k, place) for k in range(8)] for place in CONTACTS]).transpose(0, 2, 1)
        told.append(J @ here.by_readout)
        moved.append(J @ made.difference(low.G, high.G) / (2.0 * step))
    each, found = np.ravel(told), np.ravel(moved)
    assert 0.85 < each @ found / (each @ each) < 1.15
    assert np.corrcoef(each, found)[0, 1] > 0.9


def bent_by(k: int, place: Floats) -> Floats:
    """(2,) derivatives of a place by the pose's error's number k."""
    bend = np.zeros((3, 8))
    bend[0, k] = 1.0
    return bent(bend, place[None])[0]


@given(SEEDS)
def test_what_does_not_bend_tells_nothing(seed: int) -> None:
    """Nor does a bend that a pose's error makes as well."""
    rng = np.random.default_rng(seed)
    made, levels = target(native, seed, **FREE), pyramid(draw(view(rng, 0.4), seed))
    still = made.solve(**question(levels, readout=0.3))
    assert still.readout_variance == math.inf and still.readout == 0.3
    assert not still.by_readout.any()
    bend = np.zeros((3, 8))
    bend[1:, :2] = rng.uniform(-3.0, 3.0, (2, 2))  # a shear
    sheared = made.solve(**question(levels, **free(bend, 0.0)))
    assert sheared.readout_variance > 0.05


def test_a_bend_has_three_times_eight_numbers() -> None:
    made, levels = target(native, 0), pyramid(draw(A, 0))
    with pytest.raises(ValueError, match="bend"):
        made.solve(**question(levels, bend=np.zeros(8)))
