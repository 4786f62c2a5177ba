# SPDX-License-Identifier: Apache-2.0
"""The core's kernel: the compiled one equals its definition, and what both make of nonsense."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import reference
from posed import (
    CENTRE,
    CONTACTS,
    FEW,
    HEIGHT,
    SEEDS,
    WIDTH,
    A,
    both,
    draw,
    ingredients,
    known,
    native,
    outline,
    pyramid,
    question,
    same,
    view,
)

# --- equal ------------------------------------------------------------------------------------------


# the same cases each time: in one of some hundreds rounding decides between steps, and both differ by 1e-6 and more
@settings(FEW, derandomize=True)
@given(
    SEEDS,
    st.sampled_from([0, 12, 40, 80, 140]),
    st.sampled_from([0.0, 0.5, 5.0, 14.0, 5000.0]),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)
def test_poses(seed: int, n: int, reach: float, textured: bool, fast: bool, covered: bool) -> None:
    rng = np.random.default_rng(seed)
    made = both(seed, n, textured=textured)
    G, patch = view(rng, rng.uniform(0.2, 2.0)), None
    if covered:
        patch = CENTRE + rng.uniform(-40.0, 40.0, 2) + rng.uniform(-25.0, 25.0, (3, 2)), rng.choice([70.0, 165.0, 30.0])
    levels = pyramid(draw(G, seed, blur=rng.uniform(0.6, 4.0), noise=rng.uniform(0.5, 4.0), patch=patch))
    mixed = np.eye(4) + np.tril(0.2 * rng.normal(size=(4, 4)), -1)
    asked = question(
        levels,
        reach=reach,
        last=view(rng, 8.0) if fast else A,
        nuisance=np.array([rng.uniform(0.0, 4.0), *rng.uniform(-0.4, 0.4, 3)]),
        nuisance_covariance=mixed @ np.diag(rng.uniform([0.5, 0.01, 0.01, 0.01], [9.0, 0.16, 0.25, 0.25])) @ mixed.T,
        sides=rng.uniform(0.0, 1.0),
        gain=rng.uniform(0.5, 1.5),
        bias=rng.uniform(-40.0, 40.0),
        edge_width=rng.choice([0.3, 1.0, 2.7, 5.0, 40.0, np.nan]),
        blur_share=rng.choice([0.0, 0.45, 1.0]),
        bend=rng.normal(0.0, 0.4, (3, 8)),
        readout=rng.choice([0.0, rng.uniform(-1.0, 1.0)]),
    )
    if rng.random() < 0.3:
        hidden = [np.zeros(level.shape, np.uint8) for level in levels]
        hidden[0][: HEIGHT // 2, : WIDTH // 2] = 255
        for one in made:
            one.hide(hidden)
    same(made[0].solve(*asked), made[1].solve(*asked))


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_poses_in_images_of_nothing_but_noise(seed: int) -> None:
    """More edges on every normal than are kept."""
    rng = np.random.default_rng(seed)
    levels = pyramid(rng.integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8))
    first, second = both(seed, 60)
    asked = question(levels, view(rng), reach=20.0)
    same(first.solve(*asked), second.solve(*asked))


@FEW
@given(SEEDS, st.integers(0, 40), st.lists(st.sampled_from([1.0, 2.0, 4.0, 3.3]), max_size=4))
def test_flows(seed: int, m: int, strides: list[float]) -> None:
    rng = np.random.default_rng(seed)
    first, second = both(seed, 0)
    before, now = (pyramid(draw(G, seed)) for G in (A, view(rng)))
    places = CENTRE + rng.uniform(-30.0, 30.0, (m, 2))
    asked = before, A, now, view(rng, 0.3), known(4.0, 2.0), places, np.array(strides)
    same(first.follow(*asked), second.follow(*asked))


@FEW
@given(SEEDS, st.floats(0.1, 50.0))
def test_moves_and_pinholes(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    first, second = both(0, 30)
    G, d, theta = view(rng, size), size * rng.normal(size=8), rng.uniform(-1.0, 1.0, 3)
    same(first.moved(G, d), second.moved(G, d))
    same(first.pinhole(G, theta, WIDTH, HEIGHT), second.pinhole(G, theta, WIDTH, HEIGHT), atol=1e-7)


@FEW
@given(SEEDS, st.floats(0.1, 50.0))
def test_what_is_told_of_poses(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    first, second = both(0, 30)
    G, other = view(rng, size), view(rng, size)
    P, Q = (spread @ spread.T + 0.01 * np.eye(8) for spread in rng.normal(size=(2, 8, 8)))
    same(first.difference(G, other), second.difference(G, other))
    same(first.placed(G, P), second.placed(G, P))
    same(first.joined(G, P, other, Q), second.joined(G, P, other, Q))
    points = CENTRE + rng.uniform(-400.0, 400.0, (int(rng.integers(0, 9)), 2))
    same(native.seen_area(G, points), reference.seen_area(G, points))


def test_what_cannot_be_told_of_poses() -> None:
    none, P = np.zeros((3, 3)), np.eye(8)
    for made in both(0, 30):
        assert np.isnan(made.difference(none, A)).all() and np.isnan(made.difference(A, none)).all()
        distance, G, kept = made.joined(A, P, A, -P)
        assert distance == np.inf and (G == A).all() and (kept == P).all()
    for module in (native, reference):
        behind = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
        assert np.isnan(module.seen_area(behind, np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]])))
        assert np.isnan(module.seen_area(np.full((3, 3), np.nan), CONTACTS))
        with pytest.raises(ValueError, match="shape"):
            module.seen_area(A, np.zeros(4))


@FEW
@given(SEEDS, st.lists(st.integers(0, 300), max_size=3), st.integers(1, 30))
def test_evidence_of_surfaces(seed: int, counts: list[int], m: int) -> None:
    rng = np.random.default_rng(seed)
    r = [np.where(rng.random(n) < 0.2, np.nan, rng.uniform(-1.0, 1.0, n)) for n in counts]
    usual = [rng.uniform(-0.2, 1.2, n) for n in counts]
    asked = r, usual, rng.uniform(0.0, 1.0, m), np.log(rng.uniform(0.01, 1.0, m)), 0.18, 0.33, 3.0
    same(native.surface_evidence(*asked), reference.surface_evidence(*asked))
    for module in (native, reference):
        for wrong in ([*usual, np.zeros(1)], [np.zeros(len(u) + 1) for u in usual] or [np.zeros(1)]):
            with pytest.raises(ValueError, match="usual"):
                module.surface_evidence(r, wrong, *asked[2:])
        with pytest.raises(ValueError, match="prior"):
            module.surface_evidence(r, usual, asked[2], np.zeros(m + 1), *asked[4:])


@FEW
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
    for module in (native, reference):
        assert module.PoseTarget(*ingredients(0, 30, {})).add_texture(levels, places, 1.0) == 3


# --- nonsense ---------------------------------------------------------------------------------------

ODD = (np.nan, np.inf, -np.inf, 0.0, -1.0)
HUGE = (1e300, -1e300, 1e12)


def answer(function: Any, *arguments: Any) -> Any:
    try:
        return function(*arguments)
    except (ValueError, TypeError):
        return None


def spoiled(rng: np.random.Generator, arguments: list[Any], values: tuple[float, ...]) -> list[Any]:
    """The same with one argument, or a few entries of one, that are none."""
    out = list(arguments)
    at = int(
        rng.choice([i for i, a in enumerate(out) if isinstance(a, float) or (isinstance(a, np.ndarray) and a.size)])
    )
    if isinstance(out[at], float):
        out[at] = float(rng.choice(values))
    else:
        out[at] = out[at].copy()
        out[at].ravel()[rng.integers(0, out[at].size, 3)] = rng.choice(values)
    return out


def answers(module: Any, made: list[Any], texture: list[Any], solve: list[Any], follow: list[Any]) -> list[Any]:
    found = answer(module.PoseTarget, *made)
    if found is None:
        return [None]
    return [answer(found.add_texture, *texture), answer(found.solve, *solve), answer(found.follow, *follow)]


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.integers(0, 4), st.sampled_from([ODD, HUGE]))
def test_whatever_numbers_are_given_both_answer_or_refuse(seed: int, which: int, values: tuple[float, ...]) -> None:
    """Alike, but where numbers are so large that rounding is all that is left of the others."""
    rng = np.random.default_rng(seed)
    levels = pyramid(draw(view(rng), 3))
    places = CENTRE + rng.uniform(-20.0, 20.0, (12, 2))
    given_ = [
        ingredients(3, 40, {}),
        [pyramid(draw(A, 3)), places, 1.0],
        question(levels, reach=float(rng.choice([0.0, 6.0]))),
        [levels, A, levels, A, known(3.0, 1.0), places, np.array([1.0, 2.0])],
    ]
    if which < 4:
        given_[which] = spoiled(rng, given_[which], values)
    else:
        numbers = dict(given_[0][0])
        numbers[str(rng.choice(list(numbers)))] = float(rng.choice(values))
        given_[0] = [numbers, *given_[0][1:]]
    found, wanted = answers(native, *given_), answers(reference, *given_)
    assert [one is None for one in found] == [one is None for one in wanted]
    if values is ODD:
        same(
            [one for one in found if one is not None], [one for one in wanted if one is not None], rtol=1e-5, atol=1e-6
        )


@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (1, 50), (50, 1), (2, 2), (5, 4)])
def test_the_smallest_images(shape: tuple[int, int]) -> None:
    image, points = np.zeros(shape, np.uint8), outline(30)
    fine = pyramid(draw(A, 0))
    for levels in ([image], [fine[0], image], [image, fine[0]]):
        first, second = both(0, 40)
        asked = question(levels)
        same(first.solve(*asked), second.solve(*asked))
        flow = levels, A, levels, A, known(3.0, 1.0), points[0], np.array([1.0, 2.0])
        same(first.follow(*flow), second.follow(*flow))
        asked_edges = levels, A, *points, 1.5, 4, 2
        same(native.strongest_edges(*asked_edges), reference.strongest_edges(*asked_edges))


def test_a_pose_before_that_is_none_says_nothing_of_the_speed() -> None:
    """The half width of the filter was that of NaN."""
    levels = pyramid(draw(A, 0))
    for made in both(0):
        still, unknown = (made.solve(*question(levels, last=last)) for last in (A, np.full((3, 3), np.nan)))
        del still["edge_width"], unknown["edge_width"]  # of edges that may be blurred
        same(unknown, still)


def test_a_camera_that_does_not_show_the_reference_has_no_misfit() -> None:
    for made in both(0, 30):
        misfit, by_pose, by_camera = made.pinhole(A, np.array([0.0, 1e3, 0.0]), 1000.0, 120.0)
        assert np.isnan(misfit).all() and not by_pose.any() and not by_camera.any()


def test_both_refuse_the_same() -> None:
    made, levels = ingredients(0, 40, {}), pyramid(draw(A, 0))
    for module in (native, reference):
        for at in range(1, len(made)):
            if isinstance(made[at], np.ndarray) and at != 13:  # contacts are as many as they are
                with pytest.raises(ValueError):
                    module.PoseTarget(*made[:at], np.ascontiguousarray(made[at][:-1]), *made[at + 1 :])
        for name in reference_names():
            with pytest.raises(ValueError, match=name):
                module.PoseTarget({k: v for k, v in made[0].items() if k != name}, *made[1:])
        for radius in (0.0, -1.0, np.nan, np.inf):
            with pytest.raises(ValueError, match="radius"):
                module.PoseTarget(*made[:3], radius, *made[4:])
        good = module.PoseTarget(*made)
        for at, bad in (
            (1, np.eye(2)), (2, np.eye(9)), (3, np.eye(4)), (4, np.zeros(8)), (6, np.zeros(2)), (7, np.zeros(8)), (0, []),
        ):  # fmt: skip
            asked = question(levels)
            asked[at] = bad
            with pytest.raises(ValueError):
                good.solve(*asked)
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
            good.solve(*question([np.zeros((4, 4, 3), np.uint8)]))  # type: ignore[list-item]
        for reach in (-1, 1001, -(2**31), 2**31 - 1):
            with pytest.raises(ValueError, match="reach"):
                module.strongest_edges(levels, A, *outline(9), 1.5, reach, 2)
        for half in (-1, 1, 13, 2**31 - 1):
            with pytest.raises(ValueError, match="width"):
                module.strongest_edges(levels, A, *outline(9), 1.5, 4, half)
        with pytest.raises(ValueError):
            module.strongest_edges(levels, A, outline(9)[0], outline(8)[1], 1.5, 4, 2)
        good.hide([np.zeros((3, 3), np.uint8)])
        with pytest.raises(ValueError, match="hidden"):
            good.solve(*question(levels))


def reference_names() -> tuple[str, ...]:
    from reference.registration.pose import NAMES

    return NAMES
