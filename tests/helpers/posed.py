# SPDX-License-Identifier: Apache-2.0
"""Targets, images and questions for the kernel that fits poses and for its definition."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import _grasptrack_native as native
import reference
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.typing import Floats

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
        NUMBERS.table() | numbers, A, CENTRE, RADIUS, 1.5, 2.0, 0.03, points, normals, contrast[found], inner[found],
        surface, value, CONTACTS, depth, inside, (rng.random((len(points), 16)) < 0.9).astype(np.float64),
    ]  # fmt: skip


def target(module: Any, seed: int, n: int = 80, *, textured: bool = True, **numbers: float) -> Any:
    """A target, compiled or of the definition."""
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
        "levels": levels, "G": start, "P": known(3.0, 1.0), "last": start, "bend": np.zeros((3, 8)),
        "readout": 0.0, "nuisance": np.array([0.0, *THETA]),
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
