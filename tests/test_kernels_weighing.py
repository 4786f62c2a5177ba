# SPDX-License-Identifier: Apache-2.0
"""What edges say for a carried outline and against it: the kernel against its definition, and its laws."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.kernels import reference

RULES = (0.02, 3.0, 12.0, 2.0, 0.3, 0.35, 0.25)
CONTACTS = 2
PER_CONTACT = 5


class Scene:
    """A wavy part on a table, dark or of two colours, its outline's samples and what the image bears out of them."""

    def __init__(self, seed: int, polarity: int, changes: int) -> None:
        rng = np.random.default_rng(seed)
        angle = np.arange(120) * (2 * math.pi / 120)
        radius = 55.0 * (1.0 + 0.15 * np.cos(3 * angle + rng.uniform(0, 6)))
        self.outline = np.ascontiguousarray(np.column_stack([80 + radius * np.cos(angle), 80 + radius * np.sin(angle)]))
        self.polarity = polarity
        before = self.image(rng)
        normals = kernels.blend_normals(self.outline)
        again = np.concatenate([np.arange(120), np.arange(30, 35), np.arange(90, 95)])
        self.points, self.normals = self.outline[again].copy(), normals[again].copy()
        edges = kernels.edge_search(before, self.points, self.normals, 4.0, polarity)
        self.levels = edges[:, 2].copy(), edges[:, 3].copy()
        self.strength = np.where(np.isfinite(edges[:, 0]), edges[:, 1] if not polarity else np.abs(edges[:, 1]), np.inf)
        self.now = before.copy()
        for _ in range(changes):  # covers, notches and tabs, of any grey
            at = self.outline[rng.integers(120)] + rng.uniform(-12, 12, 2)
            size = rng.uniform(4, 30, 2)
            corners = [tuple(np.rint(at + sign * size).astype(int).tolist()) for sign in (-0.5, 0.5)]
            cv2.rectangle(self.now, *corners, int(rng.choice([60, 100, 160, 200])), -1)
        self.beside, self.known = rng.random((2, 120)) < 0.05
        self.hidden = (rng.random((160, 160)) < 0.02).astype(np.uint8)

    def image(self, rng: np.random.Generator) -> NDArray[np.uint8]:
        image = np.full((160, 160), 160, np.uint8)
        ring = np.rint(self.outline).astype(np.int32)
        cv2.fillPoly(image, [ring], 60)
        if not self.polarity:  # its left half is lighter than the table
            image[:, :80][image[:, :80] == 60] = 220
        image = cv2.GaussianBlur(image, (0, 0), 1.0)
        return np.clip(image + rng.normal(0, 2.0, image.shape), 0, 255).astype(np.uint8)

    def arguments(self, image: NDArray[np.uint8], hidden: NDArray[np.uint8] | None = None) -> tuple[Any, ...]:
        area = float(cv2.contourArea(self.outline.astype(np.float32)))
        size, reach, at, along, edges, inside, found, *_ = kernels.outline_support(
            image,
            np.eye(3),
            self.points,
            self.normals,
            self.strength,
            self.outline[[32, 92]],
            self.polarity,
            area,
            *RULES,
        )
        shown = at, along, edges, inside, found, *self.levels
        return image, *shown, CONTACTS, self.polarity, reach, size, self.beside, self.known, hidden


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([1, 0]), st.integers(0, 4), st.booleans())
def test_native_equals_reference(seed: int, polarity: int, changes: int, hides: bool) -> None:
    scene = Scene(seed, polarity, changes)
    arguments = scene.arguments(scene.now, scene.hidden if hides else None)
    found, wanted = kernels.weigh_edges(*arguments), reference.weigh_edges(*arguments)
    for a, b in zip(found[:7], wanted[:7], strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)
    np.testing.assert_array_equal(found[7], wanted[7])


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([1, 0]), st.integers(0, 240))
def test_few_edges_and_levels_that_are_unknown_are_taken_alike(seed: int, polarity: int, spared: int) -> None:
    scene = Scene(seed, polarity, 1)
    image, at, along, edges, inside, found, own, beyond, *rest = scene.arguments(scene.now)
    rng = np.random.default_rng(seed)
    found = found & (rng.random(len(found)) < spared / 240.0)
    own = np.where(rng.random(len(own)) < 0.01, math.nan, own)
    arguments = image, at, along, edges, inside, found, own, beyond, *rest
    with np.errstate(all="ignore"):
        for a, b in zip(kernels.weigh_edges(*arguments), reference.weigh_edges(*arguments), strict=True):
            np.testing.assert_allclose(np.asarray(a, float), np.asarray(b, float), rtol=1e-12)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("polarity", [1, 0])
@pytest.mark.parametrize("level", [math.nan, 120.0])
def test_levels_that_tell_nothing_at_all_are_no_cause_for_warnings(polarity: int, level: float) -> None:
    scene = Scene(4, polarity, 2)
    image, at, along, edges, inside, found, own, _, *rest = scene.arguments(scene.now)
    one = np.full_like(own, level)
    arguments = image, at, along, edges, inside, found, one, one, *rest
    for a, b in zip(kernels.weigh_edges(*arguments), reference.weigh_edges(*arguments), strict=True):
        np.testing.assert_allclose(np.asarray(a, float), np.asarray(b, float), rtol=1e-12)


@pytest.mark.parametrize("polarity", [1, 0])
def test_the_reference_itself_is_borne_out_and_an_empty_table_is_not(polarity: int) -> None:
    scene = Scene(3, polarity, 0)
    share, visible, rms, spread, seen, against, (dark, light), which = kernels.weigh_edges(*scene.arguments(scene.now))
    assert share > 0.98 and visible == 1.0 and (seen == 1.0).all()
    assert rms <= spread < 1.0 and against == 0.0 and not which.any()
    assert light > 150 and abs(dark - light) > 20
    none = kernels.weigh_edges(*scene.arguments(np.full_like(scene.now, 160)))
    assert none[0] == 0.0 and math.isinf(none[2]) and math.isnan(none[6][0]) and not none[4].any()


def test_a_notch_speaks_against_the_outline_and_a_cover_does_not() -> None:
    scene = Scene(5, 1, 0)
    x, y = np.rint(scene.outline[60]).astype(int).tolist()
    told = []
    for grey in (160, 30):  # the table's, and something darker than the part that goes on beyond its edge
        image = scene.now.copy()
        cv2.rectangle(image, (x - 40, y - 12) if grey == 30 else (x - 12, y - 12), (x + 12, y + 12), grey, -1)
        told.append(kernels.weigh_edges(*scene.arguments(image))[5])
    known = scene.known.sum() + scene.beside.sum()
    assert told[0] > 0.03 and told[1] <= known / 120


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 200), st.sampled_from([1, -1]), st.floats(0.5, 0.8), st.floats(0, 6.28), st.floats(-20, 20))
def test_a_shadow_does_not_speak_against_the_outline(
    seed: int, polarity: int, lit: float, way: float, at: float
) -> None:
    scene = Scene(seed, 1, 0)
    if polarity < 0:
        scene.polarity, scene.now, levels = -1, 220 - scene.now, [220.0 - level for level in scene.levels]
        scene.levels = levels[0], levels[1]
    y, x = np.mgrid[0:160, 0:160]
    dark = np.clip((math.cos(way) * (x - 80) + math.sin(way) * (y - 80) - at) / 4.0, 0.0, 1.0)  # and soft
    image = (scene.now * (1.0 - (1.0 - lit) * dark)).astype(np.uint8)
    share, *_, which = kernels.weigh_edges(*scene.arguments(image))
    assert not which.any() and share > 0.4  # else it would not have been asked


def test_both_refuse_the_same() -> None:
    good = Scene(1, 1, 0)
    arguments = list(good.arguments(good.now))
    short = {1: arguments[1][:0], 6: arguments[6][:3], 8: 3, 12: arguments[12][:0], 13: arguments[13][:5]}
    for place, value in short.items():
        bad = [*arguments[:place], value, *arguments[place + 1 :]]
        for module in (kernels, reference):
            with pytest.raises(ValueError):
                module.weigh_edges(*bad)
