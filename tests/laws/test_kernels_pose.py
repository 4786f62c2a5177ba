# SPDX-License-Identifier: Apache-2.0
"""The pose estimator makes its objective least; what is told of poses equals its definition; and what it makes of nonsense."""

import math
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import reference
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
    definition,
    draw,
    ingredients,
    known,
    native,
    objective,
    outline,
    pyramid,
    question,
    same,
    target,
    told,
    view,
    what_is_left,
)
from reference.registration.edges import Light
from reference.registration.estimate import fuse_predictions, project_contacts
from reference.registration.objective import outline_evidence
from reference.registration.target import Target

# --- the objective ------------------------------------------------------------------------------------


def test_answers_make_their_objective_least_and_have_its_curvature() -> None:
    """What does not settle, as where a cover may be the object's edge, says so by its covariance."""
    left = [what_is_left(seed) for seed in range(4)]
    assert all(one.agrees for one in left) and max(one.deviations for one in left) < 3.0
    assert np.median([one.px for one in left]) < 0.02
    assert 0.9 < np.median([one.narrow for one in left]) < 1.1


@pytest.mark.slow
def test_dozens_of_answers_make_their_objective_least() -> None:
    left = [what_is_left(seed) for seed in range(0, 800, 10)]
    px, deviations, narrow = np.array(left).T
    assert np.mean([one.agrees for one in left]) > 0.88
    assert np.median(px) < 0.015 and np.quantile(px, 0.95) < 0.5
    assert np.quantile(deviations, 0.98) < 3.5
    assert 0.9 < np.median(narrow) < 1.05 and np.quantile(narrow, 0.01) > 0.4


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(3))
def test_derivatives_of_the_objective_are_those_of_what_is_measured(seed: int) -> None:
    """Each term moves with the pose as its J says: by finite differences of images, not of the model."""
    rng = np.random.default_rng(seed)
    made, about = target(native, seed, normal_noise=0.0), definition(seed)
    asked = question(pyramid(draw(view(rng, 0.4), seed, noise=0.5)), readout=0.2, bend=rng.normal(0.0, 0.1, (3, 8)))
    here = objective(about, asked, made.solve(**asked).G)
    for name, rtol in (("prior", 0.05), ("perspective", 0.05), ("pinhole", 0.05), ("texture", 0.25), ("edges", 0.25)):
        J, W = here.terms[name].J[:, :8], here.terms[name].W
        moves = 0.15 * rng.normal(size=(8, 8))
        change, wanted = [], []
        for d in moves:
            away = [here.measured(name, about.moved(here.G, way * d)) for way in (1.0, -1.0)]
            change.append(J.T @ W @ (away[0] - away[1]) / 2.0)
            wanted.append(-J.T @ W @ J @ d)
        off = np.linalg.norm(np.subtract(change, wanted)) / np.linalg.norm(wanted)
        assert off < rtol, (name, off)


@settings(max_examples=5)
@given(SEEDS, st.booleans())
def test_evidence_of_an_outline(seed: int, covered: bool) -> None:
    """Of a part without thickness, at the answer: from the answer alone."""
    rng = np.random.default_rng(seed)
    middle = CENTRE + rng.uniform(-40.0, 40.0, 2)
    patch = (middle + rng.uniform(-25.0, 25.0, (3, 2)), 30.0) if covered else None
    levels = pyramid(draw(view(rng, 0.5), seed, patch=patch))
    spread = NUISANCE_COVARIANCE.copy()
    spread[0, 0] = 1e-12
    asked = question(levels, nuisance_covariance=spread)
    found = target(native, seed).solve(**asked)
    about = objective(definition(seed), asked, found.G)
    about.light = Light(*found.light)  # that of the last step
    wanted = outline_evidence(about, found.P)
    same([getattr(found, name) for name in wanted._fields], wanted, rtol=1e-4, atol=1e-4)


@NOISY
def test_edges_are_as_wide_as_they_are_drawn(seed: int) -> None:
    G = view(np.random.default_rng(seed), 0.2)
    made = target(native, seed, textured=False)
    for blur in (0.8, 1.2):
        levels = pyramid(draw(G, seed, blur=blur, noise=0.5, textured=False))
        still = made.solve(**question(levels, last=G, edge_width=blur))
        assert still.edge_width == pytest.approx(np.hypot(blur, 0.6), rel=0.1)  # pixels are wide themselves
        assert still.look < 6.0


@settings(max_examples=5)
@given(SEEDS)
def test_a_surface_that_lags_weighs_less(seed: int) -> None:
    """All its patches share an error: the more of that, the less they tell."""
    levels, made = pyramid(draw(view(np.random.default_rng(seed), 0.4), seed)), target(native, seed)
    exact, nearly, some, much = (made.solve(**question(levels, lag=np.full(8, v))) for v in (0.0, 1e-12, 0.1, 1e9))
    same([nearly.G, nearly.P], [exact.G, exact.P], rtol=1e-6, atol=1e-8)
    sizes = [np.trace(e.covariance.sum(axis=0)) for e in (exact, some, much)]
    assert sizes[0] < min(sizes[1:])


@settings(max_examples=5)
@given(SEEDS, st.floats(-6.0, 6.0), st.floats(2.0, 6.0))
def test_what_an_encoder_left_as_it_was(seed: int, right: float, down: float) -> None:
    """It is told by how far it ought to have moved; a new exposure repeats nothing, and what rests cannot tell."""
    before, made = pyramid(draw(A, seed, noise=0.5)), target(native, seed)
    G = np.array([[1.0, 0.0, right], [0.0, 1.0, down], [0.0, 0.0, 1.0]]) @ A
    change, way = made.repeats(before, A, before, G)
    assert change > 0 and way == pytest.approx(change * (right**2 + down**2))
    assert made.repeats(before, A, pyramid(draw(G, seed, noise=2.5)), G).way == 0.0
    assert made.repeats(before, A, before, A) == (0.0, 0.0)
    with pytest.raises(ValueError, match="size"):
        made.repeats(before[1:], A, before, G)


# --- what is told of poses ----------------------------------------------------------------------------


@given(SEEDS, st.floats(0.1, 50.0))
def test_moves(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    made, about = target(native, 0, 30), definition(0, 30)
    G, other, d = view(rng, size), view(rng, size), size * rng.normal(size=8)
    P, Q = (spread @ spread.T + 0.01 * np.eye(8) for spread in rng.normal(size=(2, 8, 8)))
    same(made.moved(G, d), about.moved(G, d))
    same(made.difference(G, other), about.difference(G, other))
    same(made.placed(G, P), project_contacts(about, G, P))
    same(made.joined(G, P, other, Q), fuse_predictions(about, G, P, other, Q))
    points = CENTRE + rng.uniform(-400.0, 400.0, (int(rng.integers(0, 9)), 2))
    same(native.seen_area(G, points), reference.seen_area(G, points))


def test_what_cannot_be_told_of_poses() -> None:
    none, P, made = np.zeros((3, 3)), np.eye(8), target(native, 0, 30)
    assert np.isnan(made.difference(none, A)).all() and np.isnan(made.difference(A, none)).all()
    distance, G, kept = made.joined(A, P, A, -P)
    assert distance == np.inf and (G == A).all() and (kept == P).all()
    behind = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
    assert np.isnan(native.seen_area(behind, np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]])))
    assert np.isnan(native.seen_area(np.full((3, 3), np.nan), CONTACTS))
    with pytest.raises(ValueError, match="shape"):
        native.seen_area(A, np.zeros(4))


@given(SEEDS, st.lists(st.integers(0, 300), max_size=3), st.integers(1, 30))
def test_evidence_of_surfaces(seed: int, counts: list[int], m: int) -> None:
    rng = np.random.default_rng(seed)
    r = [np.where(rng.random(n) < 0.2, np.nan, rng.uniform(-1.0, 1.0, n)) for n in counts]
    usual = [rng.uniform(-0.2, 1.2, n) for n in counts]
    asked = r, usual, rng.uniform(0.0, 1.0, m), np.log(rng.uniform(0.01, 1.0, m)), 0.18, 0.33, 3.0
    same(native.surface_evidence(*asked), reference.surface_evidence(*asked))
    same(native.surface_probability(r, usual, 0.18, 0.33), reference.surface_probability(r, usual, 0.18, 0.33))
    for module in (native, reference):
        for wrong in ([*usual, np.zeros(1)], [np.zeros(len(u) + 1) for u in usual] or [np.zeros(1)]):
            with pytest.raises(ValueError, match="usual"):
                module.surface_evidence(r, wrong, *asked[2:])
            with pytest.raises(ValueError, match="usual"):
                module.surface_probability(r, wrong, 0.18, 0.33)
        with pytest.raises(ValueError, match="prior"):
            module.surface_evidence(r, usual, asked[2], np.zeros(m + 1), *asked[4:])


@given(SEEDS, st.integers(0, 40), st.sampled_from([0, 1, 4, 30]), st.booleans())
def test_edges(seed: int, n: int, reach: int, plain: bool) -> None:
    rng = np.random.default_rng(seed)
    image = draw(A, seed) if plain else rng.integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)
    points, normals = outline(n)
    asked = pyramid(image), view(rng, 4.0), points + rng.normal(0.0, 2.0, (n, 2)), normals, rng.uniform(0.0, 5.0), reach
    asked = *asked, int(rng.integers(2, 13))
    same(native.strongest_edges(*asked), reference.strongest_edges(*asked))


def test_texture_counts_what_is_whole_in_view() -> None:
    levels = pyramid(draw(A, 0))
    places = np.array([[60.0, 50.0], [-17.0, 50.0], [-14.0, 50.0], [60.0, 103.0], [60.0, 104.0], [np.nan, 0.0]])
    assert native.PoseTarget(*ingredients(0, 30, {})).add_texture(levels, places, 1.0) == 3


# --- nonsense ---------------------------------------------------------------------------------------

ODD = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e300, -1e300, 1e12)


def spoiled(rng: np.random.Generator, arguments: list[Any]) -> list[Any]:
    """The same with one argument, or a few entries of one, that are none."""
    out = list(arguments)
    numbers = [i for i, a in enumerate(out) if isinstance(a, float) or (isinstance(a, np.ndarray) and a.size)]
    at = int(rng.choice(numbers))
    if isinstance(out[at], float):
        out[at] = float(rng.choice(ODD))
    else:
        out[at] = out[at].copy()
        out[at].ravel()[rng.integers(0, out[at].size, 3)] = rng.choice(ODD)
    return out


@given(SEEDS, st.integers(0, 4))
def test_whatever_numbers_are_given_the_answer_is_a_pose_none_or_a_refusal(seed: int, which: int) -> None:
    rng = np.random.default_rng(seed)
    levels = pyramid(draw(view(rng), 3))
    places = CENTRE + rng.uniform(-20.0, 20.0, (12, 2))
    made = ingredients(3, 40, {})
    texture = [pyramid(draw(A, 3)), places, 1.0]
    solve = list(question(levels, reach=float(rng.choice([0.0, 6.0]))).values())
    follow = [levels, A, levels, A, known(3.0, 1.0), places, np.array([1.0, 2.0])]
    if which == 4:
        made[0] = made[0] | {str(rng.choice(list(made[0]))): float(rng.choice(ODD))}
    else:
        spoilt = (made, texture, solve, follow)[which]
        spoilt[:] = spoiled(rng, spoilt)
    try:
        handle = native.PoseTarget(*made)
        handle.add_texture(*texture)
        found = [handle.solve(*solve), handle.follow(*follow)]
    except (ValueError, TypeError):
        return
    assert all(np.isfinite(each.G).all() for each in found if each.valid)


@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (1, 50), (50, 1), (2, 2), (5, 4)])
def test_the_smallest_images(shape: tuple[int, int]) -> None:
    image, points = np.zeros(shape, np.uint8), outline(30)
    fine = pyramid(draw(A, 0))
    for levels in ([image], [fine[0], image], [image, fine[0]]):
        made = target(native, 0, 40)
        found = made.solve(**question(levels))
        assert np.isfinite(found.G).all()
        assert len(levels) == 2 or not found.visible.any()
        flow = made.follow(levels, A, levels, A, known(3.0, 1.0), points[0], np.array([1.0, 2.0]))
        assert len(levels) == 2 or not flow.valid
        asked = levels, A, *points, 1.5, 4, 2
        same(native.strongest_edges(*asked), reference.strongest_edges(*asked))


def test_a_pose_before_that_is_none_says_nothing_of_the_speed() -> None:
    """The half width of the filter was that of NaN."""
    levels, made = pyramid(draw(A, 0)), target(native, 0)
    still, unknown = (told(made.solve(**question(levels, last=last))) for last in (A, np.full((3, 3), np.nan)))
    del still["edge_width"], unknown["edge_width"]  # of edges that may be blurred
    same(unknown, still)


def test_what_is_refused() -> None:
    made, levels = ingredients(0, 40, {}), pyramid(draw(A, 0))
    for at in range(1, len(made)):
        if isinstance(made[at], np.ndarray) and at != 13:  # contacts are as many as they are
            with pytest.raises(ValueError):
                native.PoseTarget(*made[:at], np.ascontiguousarray(made[at][:-1]), *made[at + 1 :])
    for name in native.POSE_NUMBERS:
        with pytest.raises(ValueError, match=name):
            native.PoseTarget({k: v for k, v in made[0].items() if k != name}, *made[1:])
    for radius in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="radius"):
            native.PoseTarget(*made[:3], radius, *made[4:])
    good = native.PoseTarget(*made)
    for wrong in (
        {"G": np.eye(2)}, {"P": np.eye(9)}, {"last": np.eye(4)}, {"bend": np.zeros(8)}, {"nuisance": np.zeros(2)},
        {"nuisance_covariance": np.zeros(8)}, {"levels": []}, {"lag": np.zeros(7)}, {"lag": np.full(8, np.nan)},
        {"aspect": 0.0},
    ):  # fmt: skip
        with pytest.raises(ValueError):
            good.solve(**question(levels) | wrong)
    for stride in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="stride"):
            good.add_texture(levels, CONTACTS, stride)
        with pytest.raises(ValueError, match="stride"):
            good.follow(levels, A, levels, A, known(3.0, 1.0), CONTACTS, np.array([1.0, stride]))
    with pytest.raises(ValueError):
        good.add_texture(levels, np.zeros((2, 3)), 1.0)
    with pytest.raises(ValueError):
        good.moved(A, np.zeros(7))
    with pytest.raises((ValueError, TypeError)):
        good.solve(**question([np.zeros((4, 4, 3), np.uint8)]))  # type: ignore[list-item]
    for reach in (-1, 1001, -(2**31), 2**31 - 1):
        with pytest.raises(ValueError, match="reach"):
            native.strongest_edges(levels, A, *outline(9), 1.5, reach, 2)
    for half in (-1, 1, 13, 2**31 - 1):
        with pytest.raises(ValueError, match="width"):
            native.strongest_edges(levels, A, *outline(9), 1.5, 4, half)
    with pytest.raises(ValueError):
        native.strongest_edges(levels, A, outline(9)[0], outline(8)[1], 1.5, 4, 2)
    good.hide([np.zeros((3, 3), np.uint8)])
    with pytest.raises(ValueError, match="hidden"):
        good.solve(**question(levels))


# --- laws of the solver ---------------------------------------------------------------------------


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
    assert notch.other_shape == max(notch.closed_piece.log_odds, notch.open_piece.log_odds)
    gone = np.linalg.norm(np.asarray(ingredients(seed, 60, {}, False)[7]) - middle, axis=1) < 6.0
    assert notch.closed_piece.samples[gone].mean() > 0.6 > 0.1 > notch.closed_piece.samples[~gone].mean()
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
