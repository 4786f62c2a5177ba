# SPDX-License-Identifier: Apache-2.0
"""The core's kernel: the compiled one equals its definition, the laws of both, and what they make of nonsense."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.kernels import reference
from grasptrack.kernels.reference_pose_target import Target
from grasptrack.tracking.numbers import NUMBERS

native = pytest.importorskip("grasptrack._native")

Floats = NDArray[np.float64]
Grey = NDArray[np.uint8]

FEW = settings(max_examples=30, deadline=None)
SEEDS = st.integers(0, 2**32 - 1)
NOISY = pytest.mark.parametrize("seed", range(8))
"""Of laws that noise may break now and then: how close an answer comes, and what it tells."""
WIDTH, HEIGHT = 160, 120
A = np.array([[1.0, 0.0, 20.0], [0.0, 1.0, 10.0], [0.0, 0.0, 1.0]])
"""Work px to px of the reference image."""
CENTRE, RADIUS = np.array([60.0, 50.0]), 30.0
CONTACTS = np.array([[30.0, 50.0], [90.0, 50.0]])
THETA, NUISANCE_COVARIANCE = np.zeros(3), np.diag([2.0, 0.4, 0.5, 0.5]) ** 2
FREE = {"pinhole_sd": 1e6}
"""A camera of which nothing is known."""


# --- scenes -----------------------------------------------------------------------------------------


def outline(n: int) -> tuple[Floats, Floats]:
    """Samples (n, 2) in work px and outward normals, of a shape with no symmetry."""

    def at(angle: Floats) -> Floats:
        radius = 34.0 * (1.0 + 0.18 * np.cos(3.0 * angle + 0.5) + 0.08 * np.sin(5.0 * angle))
        return CENTRE + np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])

    angle = 2.0 * np.pi * np.arange(n) / max(n, 1)
    along = at(angle + 1e-4) - at(angle - 1e-4)
    return at(angle), np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(*along.T)[:, None]


def draw(
    G: Floats,
    seed: int,
    *,
    noise: float = 1.5,
    blur: float = 0.8,
    light: tuple[float, float] = (1.0, 0.0),
    textured: bool = True,
    patch: tuple[Floats, float] | None = None,
) -> Grey:
    """The object seen through G (3, 3), with blobs on it, and a polygon (n, 2) of another grey laid over it."""
    fine = 4
    image = np.full((fine * HEIGHT, fine * WIDTH), 70, np.uint8)

    def fill(points: Floats, level: float) -> None:
        seen = (np.column_stack([points, np.ones(len(points))]) @ G.T).T
        at = fine * (seen[:2] / seen[2]).T + (fine - 1) / 2.0
        cv2.fillPoly(image, [np.round(256.0 * at).astype(np.int32)], int(level), shift=8, lineType=cv2.LINE_AA)

    fill(outline(240)[0], 165)
    rng = np.random.default_rng(seed)
    turn = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    for _ in range(40 if textured else 0):
        middle, size, level = CENTRE + rng.uniform(-15.0, 15.0, 2), rng.uniform(1.5, 4.0), rng.uniform(120.0, 210.0)
        fill(middle + size * np.column_stack([np.cos(turn), np.sin(turn)]), level)
    if patch is not None:
        fill(*patch)
    small = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float64)
    lit = light[0] * cv2.GaussianBlur(small, (0, 0), blur) + light[1]
    return np.asarray(np.clip(np.round(lit + rng.normal(0.0, noise, lit.shape)), 0, 255), np.uint8)


def pyramid(image: Grey) -> list[Grey]:
    levels = [np.ascontiguousarray(image)]
    while min(levels[-1].shape) >= 40:
        levels.append(np.asarray(cv2.pyrDown(levels[-1]), np.uint8))
    return levels


def view(rng: np.random.Generator, size: float = 1.0) -> Floats:
    """A pose near that of the reference image."""
    H = np.eye(3)
    H[:2, :2] += size * rng.normal(0.0, 0.02, (2, 2))
    H[:2, 2] = size * rng.uniform(-3.0, 3.0, 2)
    H[2, :2] = size * rng.normal(0.0, 1e-4, 2)
    return H @ A / (H @ A)[2, 2]


def ingredients(seed: int, n: int, numbers: dict[str, float], textured: bool = True) -> list[Any]:
    """All that a target is made from."""
    levels = pyramid(draw(A, seed, textured=textured))
    points, normals = outline(n)
    offset, contrast, inner, _ = reference.strongest_edges(levels, A, points, normals, 1.5, 4, 2)
    found = np.isfinite(offset)
    points, normals = points[found] + offset[found, None] * normals[found], normals[found]
    rng = np.random.default_rng(seed)
    surface = np.round(CENTRE + rng.uniform(-20.0, 20.0, (80, 2)))
    depth = np.linspace(2.0, 20.0, 16)

    def beside(way: float) -> Floats:
        at = np.round(points[:, None] + way * depth[:, None] * normals[:, None] + A[:2, 2]).astype(int)
        return levels[0][at[..., 1], at[..., 0]].astype(np.float64)

    inside = np.where(rng.random((len(points), 16)) < 0.1, np.nan, beside(-1.0))
    value = levels[0][tuple((surface + A[:2, 2]).astype(int).T[::-1])].astype(np.float64)
    return [
        NUMBERS.table() | numbers, A, CENTRE, RADIUS, 1.5, 2.0, points, normals, contrast[found], inner[found], surface, value,
        CONTACTS, depth, inside, (rng.random((len(points), 16)) < 0.9).astype(np.float64),
    ]  # fmt: skip


def target(module: Any, seed: int, n: int = 80, *, textured: bool = True, **numbers: float) -> Any:
    """A target of one of the two backends."""
    made = module.PoseTarget(*ingredients(seed, n, numbers, textured))
    rng = np.random.default_rng(seed)
    levels = pyramid(draw(A, seed, textured=textured))
    for stride in (1.0, 2.0, 4.0):
        made.add_texture(levels, np.round(CENTRE + rng.uniform(-18.0, 18.0, (30, 2))), stride)
    return made


def both(seed: int, n: int = 80, **more: Any) -> tuple[Any, Any]:
    return target(native, seed, n, **more), target(reference, seed, n, **more)


def known(drift: float, shape: float) -> Floats:
    """(8, 8) covariance of a pose's error by work px of shift and of shape."""
    return np.diag([drift] * 2 + [shape] * 6) ** 2


def question(levels: list[Grey], start: Floats = A, **other: Any) -> list[Any]:
    """Arguments of `solve`."""
    given_ = {
        "levels": levels, "G": start, "P": known(3.0, 1.0), "last": start, "nuisance": np.array([0.0, *THETA]),
        "nuisance_covariance": NUISANCE_COVARIANCE, "sides": 0.9, "inner_spread": 12.0,
        "gain": 1.0, "bias": 0.0, "reach": 0.0, "edge_width": 0.8, "blur_share": 0.45,
    }  # fmt: skip
    return list((given_ | other).values())


def carried(G: Floats, points: Floats) -> Floats:
    seen = (np.column_stack([points, np.ones(len(points))]) @ G.T).T
    return np.asarray((seen[:2] / seen[2]).T)


def same(found: Any, wanted: Any, *, rtol: float = 1e-7, atol: float = 1e-8) -> None:
    """Equal up to rounding, whatever they are made of."""
    if isinstance(wanted, dict):
        assert list(found) == list(wanted)
        found, wanted = list(found.values()), list(wanted.values())
    if isinstance(wanted, list | tuple):
        assert len(found) == len(wanted)
        for one, other in zip(found, wanted, strict=True):
            same(one, other, rtol=rtol, atol=atol)
        return
    assert np.shape(found) == np.shape(wanted)
    np.testing.assert_allclose(found, wanted, rtol=rtol, atol=atol)


# --- equal ------------------------------------------------------------------------------------------


@FEW
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


# --- laws -------------------------------------------------------------------------------------------


@NOISY
@pytest.mark.parametrize("textured", [True, False])
def test_a_pose_is_found_where_the_object_is(seed: int, textured: bool) -> None:
    G = view(np.random.default_rng(seed), 0.4)
    found = target(native, seed, textured=textured).solve(*question(pyramid(draw(G, seed, textured=textured))))
    assert found["valid"] and found["edge_share"] > 0.9
    assert np.abs(carried(found["G"], CONTACTS) - carried(G, CONTACTS)).max() < 0.25


@FEW
@given(SEEDS, st.integers(-15, 15), st.integers(-8, 8))
def test_a_pose_goes_with_its_image(seed: int, right: int, down: int) -> None:
    """By whole px; of the camera, which has a middle, nothing is known."""
    rng, wide = np.random.default_rng(seed), 50
    made, shift = target(native, seed, **FREE), np.array([[1.0, 0.0, right], [0.0, 1.0, down], [0.0, 0.0, 1.0]])
    image = np.pad(draw(view(rng), seed), wide, mode="edge")  # no border within reach
    start = np.array([[1.0, 0.0, wide], [0.0, 1.0, wide], [0.0, 0.0, 1.0]]) @ A
    away = np.roll(image, (down, right), axis=(0, 1))
    asked = question([image], start, nuisance_covariance=np.diag([1e-9, *np.diag(NUISANCE_COVARIANCE)[1:]]))
    there = question([away], shift @ start, nuisance_covariance=np.diag([1e-9, *np.diag(NUISANCE_COVARIANCE)[1:]]))
    here, moved = made.solve(*asked), made.solve(*there)
    assert here["valid"]
    same(moved.pop("G"), shift @ here.pop("G"), atol=1e-5)
    same(moved, here, rtol=1e-4, atol=1e-5)


@NOISY
@pytest.mark.parametrize(("gain", "bias"), [(0.7, 20.0), (0.9, -20.0), (1.1, 20.0)])
def test_light_does_not_move_a_pose(seed: int, gain: float, bias: float) -> None:
    made, G = target(native, seed), view(np.random.default_rng(seed), 0.4)
    plain, lit = (
        made.solve(*question(pyramid(draw(G, seed, noise=0.5, light=light)))) for light in ((1.0, 0.0), (gain, bias))
    )
    assert np.abs(carried(plain["G"], CONTACTS) - carried(lit["G"], CONTACTS)).max() < 0.05
    assert lit["gain"] / plain["gain"] == pytest.approx(gain, rel=0.02)
    assert lit["edge_share"] == pytest.approx(plain["edge_share"], abs=0.01)


@FEW
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
    same(made.solve(*question([other])), made.solve(*question([image])), rtol=0.0, atol=0.0)


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
        made.solve(*question(pyramid(draw(A, seed, textured=False, patch=(square, level))))) for level in (235.0, 70.0)
    )
    assert cover["valid"] and notch["valid"]
    assert notch["other_shape"] > 1.0 > 0.0 > cover["other_shape"]
    gone = np.linalg.norm(np.asarray(ingredients(seed, 60, {}, False)[6]) - middle, axis=1) < 6.0
    assert cover["visible"][gone].mean() < 0.3 and cover["visible"][~gone].mean() > 0.7


@NOISY
def test_flow_finds_what_moved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, G = pyramid(draw(A, seed)), view(rng)
    places = CENTRE + rng.uniform(-20.0, 20.0, (50, 2))
    made = target(native, seed, 0)
    found = made.follow(before, A, pyramid(draw(G, seed)), A, known(6.0, 3.0), places, np.array([1.0, 2.0, 4.0]))
    assert found["valid"] and found["agreeing"] > 0.5
    assert np.abs(carried(found["G"], CENTRE[None]) - carried(G, CENTRE[None])).max() < 0.15


@FEW
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


@FEW
@given(SEEDS)
def test_a_pinholes_view_of_a_plane_has_no_misfit(seed: int) -> None:
    """Turn and shift a camera before a plane: cosine and ratio of its axes stay; derivatives are those of the misfit."""
    rng = np.random.default_rng(seed)
    made, theta = target(native, 0, 30), rng.uniform(-0.4, 0.4, 3)
    f = WIDTH * np.exp(theta[0])
    K = np.array([[f, 0.0, WIDTH / 2], [0.0, f, HEIGHT / 2], [0.0, 0.0, 1.0]])
    normal = np.array([theta[1], theta[2], 1.0])
    R = cv2.Rodrigues(rng.uniform(-0.3, 0.3, 3))[0]
    G = K @ (R + np.outer(rng.uniform(-0.1, 0.1, 3), normal)) @ np.linalg.inv(K) @ A
    G /= G[2, 2]
    misfit, by_pose, by_camera = made.pinhole(G, theta, WIDTH, HEIGHT)
    assert np.abs(misfit).max() < 1e-9

    def off(d: Floats, change: Floats) -> Floats:
        return np.asarray(made.pinhole(made.moved(G, d), theta + change, WIDTH, HEIGHT)[0])

    none, h = np.zeros(8), 1e-2
    for found, step, shifts in (
        (by_pose, 0.1, [(h * e, np.zeros(3)) for e in np.eye(8)]),
        (by_camera, 1e-3, [(none, h * e) for e in np.eye(3)]),
    ):
        ahead, behind = (np.array([off(way * d, way * c) for d, c in shifts]).T for way in (1.0, -1.0))
        first, second = (ahead - behind) / (2.0 * h), (ahead + behind - 2.0 * misfit[:, None]) / h**2
        # the kernel's differences are forward ones: half a step of curvature is left in them
        same(found, first + 0.5 * step * second, rtol=0.0, atol=2e-3 * np.abs(first).max())


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
            if isinstance(made[at], np.ndarray) and at != 12:  # contacts are as many as they are
                with pytest.raises(ValueError):
                    module.PoseTarget(*made[:at], np.ascontiguousarray(made[at][:-1]), *made[at + 1 :])
        for name in reference_names():
            with pytest.raises(ValueError, match=name):
                module.PoseTarget({k: v for k, v in made[0].items() if k != name}, *made[1:])
        for radius in (0.0, -1.0, np.nan, np.inf):
            with pytest.raises(ValueError, match="radius"):
                module.PoseTarget(*made[:3], radius, *made[4:])
        good = module.PoseTarget(*made)
        for at, bad in ((1, np.eye(2)), (2, np.eye(9)), (3, np.eye(4)), (4, np.zeros(2)), (5, np.zeros(8)), (0, [])):
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
    from grasptrack.kernels.reference_pose import NAMES

    return NAMES


def test_the_backend_that_runs_is_one_of_the_two() -> None:
    assert kernels.PoseTarget in (native.PoseTarget, reference.PoseTarget)
