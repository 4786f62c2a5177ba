# SPDX-License-Identifier: Apache-2.0
"""Targets, images and questions for the kernel that fits poses and for its objective."""

import math
from dataclasses import fields
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
import scipy.linalg
from hypothesis import strategies as st
from numpy.typing import NDArray

import _grasptrack_native as native
import reference
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.typing import Floats
from reference.registration.objective import Objective, Start
from reference.registration.pyramid import Level
from reference.registration.target import Target
from reference.registration.texture import cut_patches

Grey = NDArray[np.uint8]

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
    bend: Floats | None = None,
) -> Grey:
    """The object seen through G (3, 3), with blobs on it, and a polygon (n, 2) of another grey laid over it.

    `bend` is that of a readout of 1, see `bent`.
    """
    fine = 4
    image = np.full((fine * HEIGHT, fine * WIDTH), 70, np.uint8)

    def fill(points: Floats, level: float) -> None:
        points = points if bend is None else points + bent(bend, points)
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


def bent(bend: Floats, points: Floats) -> Floats:
    """(n, 2) work px by which points (n, 2) are seen beside their own places."""
    u, v = ((points - CENTRE) / RADIUS).T
    d = bend[0] + u[:, None] * bend[1] + v[:, None] * bend[2]
    x = d[:, 0] + d[:, 2] * u + d[:, 3] * v + d[:, 6] * u**2 + d[:, 7] * u * v
    y = d[:, 1] + d[:, 4] * u + d[:, 5] * v + d[:, 6] * u * v + d[:, 7] * v**2
    return np.column_stack([x, y])


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
        NUMBERS.kernel_table() | numbers, A, CENTRE, RADIUS, 1.5, 2.0, np.full(len(points), 0.03), points, normals,
        contrast[found], inner[found], surface, value, CONTACTS, depth, inside,
        (rng.random((len(points), 16)) < 0.9).astype(np.float64),
    ]  # fmt: skip


def target(
    module: Any,
    seed: int,
    n: int = 80,
    *,
    textured: bool = True,
    shown: list[Grey] | None = None,
    seen: Floats = A,
    **numbers: float,
) -> Any:
    """A target of a module's class, as a first image shows it through `seen` (3, 3); None takes it as it is drawn."""
    table, _, *rest = ingredients(seed, n, numbers, textured)
    made = module.PoseTarget(table, seen, *rest)
    rng = np.random.default_rng(seed)
    levels = shown or pyramid(draw(A, seed, textured=textured))
    for stride in (1.0, 2.0, 4.0):
        made.add_texture(levels, np.round(CENTRE + rng.uniform(-18.0, 18.0, (30, 2))), stride)
    return made


def definition(seed: int, n: int = 80, *, textured: bool = True, **numbers: float) -> Target:
    """The same for the objective."""
    made = Target(*ingredients(seed, n, numbers, textured)[1:])
    rng = np.random.default_rng(seed)
    levels = seen(pyramid(draw(A, seed, textured=textured)))
    for stride in (1.0, 2.0, 4.0):
        places = np.round(CENTRE + rng.uniform(-18.0, 18.0, (30, 2)))
        made.texture.append(cut_patches(made, levels, A, places, stride))
    return made


def seen(levels: list[Grey]) -> list[Level]:
    """A pyramid as the objective takes it."""
    return [Level(level) for level in levels]


def known(drift: float, shape: float) -> Floats:
    """(8, 8) covariance of a pose's error by work px of shift and of shape."""
    return np.diag([drift] * 2 + [shape] * 6) ** 2


def question(levels: list[Grey], start: Floats = A, **other: Any) -> dict[str, Any]:
    """Arguments of `solve`."""
    return {
        "levels": levels, "G": start, "P": known(3.0, 1.0), "last": start, "bend": np.zeros((3, 8)),
        "readout": 0.0, "readout_variance": 0.0, "nuisance": np.array([0.0, *THETA]),
        "nuisance_covariance": NUISANCE_COVARIANCE, "sides": 0.9, "inner_spread": 12.0,
        "gain": 1.0, "bias": 0.0, "reach": 0.0, "edge_width": 0.8, "blur_share": 0.45, "lag": np.zeros(8),
        "aspect": 1.0,
    } | other  # fmt: skip


def objective(about: Target, asked: dict[str, Any], G: Floats, **numbers: float) -> Objective:
    """What an answer G (3, 3) to a question makes least."""
    start = Start(**{field.name: asked[field.name] for field in fields(Start)})
    return Objective(about, seen(asked["levels"]), start, NUMBERS.kernel_table() | numbers, G)


def fuzzed(seed: int) -> tuple[Any, Target, dict[str, Any]]:
    """A target, compiled and of the objective, and a question: parts may be covered, bent, blurred, thick or lit otherwise."""
    rng = np.random.default_rng(seed)
    n, textured = int(rng.choice([40, 80, 140])), bool(rng.random() < 0.5)
    patch = None
    if rng.random() < 0.4:
        patch = CENTRE + rng.uniform(-40.0, 40.0, 2) + rng.uniform(-25.0, 25.0, (3, 2)), rng.choice([70.0, 165.0, 30.0])
    blur, bend, share = rng.uniform(0.6, 2.0), rng.normal(0.0, 0.1, (3, 8)), rng.choice([0.0, rng.uniform(-1.0, 1.0)])
    light = rng.uniform(0.8, 1.2), rng.uniform(-20.0, 20.0)
    G, noise = view(rng, rng.uniform(0.2, 1.0)), rng.uniform(0.5, 2.5)
    image = draw(G, seed, blur=blur, noise=noise, textured=textured, patch=patch, light=light, bend=share * bend)
    mixed = np.eye(4) + np.tril(0.2 * rng.normal(size=(4, 4)), -1)
    asked = question(
        pyramid(image),
        reach=rng.choice([0.0, 5.0, 14.0]),
        last=view(rng, 2.0) if rng.random() < 0.3 else A,
        nuisance=np.array([rng.uniform(0.0, 4.0), *rng.uniform(-0.4, 0.4, 3)]),
        nuisance_covariance=mixed @ np.diag(rng.uniform([0.5, 0.01, 0.01, 0.01], [9.0, 0.16, 0.25, 0.25])) @ mixed.T,
        sides=rng.uniform(0.0, 1.0),
        gain=light[0] + rng.normal(0.0, 0.05),
        bias=light[1] + rng.normal(0.0, 5.0),
        edge_width=math.hypot(0.4, blur),
        blur_share=rng.choice([0.0, 0.2, 0.45]),
        bend=bend,
        readout=share,
    )
    return target(native, seed, n, textured=textured), definition(seed, n, textured=textured), asked


class Left(NamedTuple):
    """What is left of an answer where its objective is least."""

    px: float  # px, deviations: work px by which a contact would still move, and in standard deviations of the answer
    deviations: float
    narrow: float  # least share of the variance that the objective has which the answer has, in any direction

    @property
    def agrees(self) -> bool:
        """Whether the answer is where its objective is least, as far as it says."""
        return self.px < 0.05 or self.deviations < 1.0


def what_is_left(seed: int) -> Left:
    """How far the answer to a fuzzed question is from where its objective is least, and its covariance from the curvature's."""
    made, about, asked = fuzzed(seed)
    found = made.solve(**asked)
    least = objective(about, asked, found.G)
    J = about.jacobian(CONTACTS)
    px, variance = np.abs(J @ least.x[:8]), np.einsum("npa,ab,npb->np", J, found.P, J)
    share = scipy.linalg.eigh(found.P, least.P[:8, :8], eigvals_only=True)
    return Left(px.max(), float((px / np.sqrt(variance)).max()), share.min())


def carried(G: Floats, points: Floats) -> Floats:
    seen = (np.column_stack([points, np.ones(len(points))]) @ G.T).T
    return np.asarray((seen[:2] / seen[2]).T)


def told(estimate: Any) -> dict[str, Any]:
    """All that an estimate, or a flow, holds, by name."""
    return {name: getattr(estimate, name) for name in vars(type(estimate)) if name[0] != "_" and name != "origin"}


def same(found: Any, wanted: Any, *, rtol: float = 1e-7, atol: float = 1e-8) -> None:
    """Equal up to rounding, whatever they are made of."""
    if isinstance(wanted, native.PoseEstimate | native.PoseFlow | native.OtherPiece):
        found, wanted = told(found), told(wanted)
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
