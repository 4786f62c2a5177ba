# SPDX-License-Identifier: Apache-2.0
"""The two sides of an outline: covers are forgiven, notches and tabs are not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack import kernels
from grasptrack.kernels import reference
from grasptrack.kernels.reference_flanks import longest, runs
from grasptrack.observation.flanks import BY, Flanks
from grasptrack.observation.surface import shrunk

SIZE, CENTRE, RADIUS, COUNT = 180.0, np.array([200.0, 150.0]), 90.0, 240
ANGLES = np.arange(COUNT) * (2.0 * np.pi / COUNT)
NORMALS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
POINTS = CENTRE + RADIUS * NORMALS


def disc(seed: int, ground: int = 180, part: int = 70) -> np.ndarray:
    image = np.full((300, 400), ground, np.uint8)
    cv2.circle(image, (200, 150), 90, part, -1, cv2.LINE_AA)
    noise = np.random.default_rng(seed).normal(0, 2, image.shape)
    return np.asarray(np.clip(image + noise, 0, 255), dtype=np.uint8)


def judged(
    image: np.ndarray, against: list[int], missed: list[int], ground: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    flanks = Flanks(POINTS, NORMALS, disc(0), SIZE)
    flags = [np.isin(np.arange(COUNT), which) for which in (against, missed)]
    left, covered = flanks.judged(shrunk(image, BY), np.eye(3), *flags, ground)
    return np.flatnonzero(left), np.flatnonzero(covered)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(0.6, 1.3), st.floats(-15, 15))
def test_nothing_speaks_against_what_has_not_changed(seed: int, gain: float, level: float) -> None:
    image = np.clip(gain * disc(seed) + level, 0, 255).astype(np.uint8)
    left, covered = judged(image, [], [])
    assert not len(left) and not len(covered)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.sampled_from([30, 120, 180, 230]), st.booleans())
def test_a_cover_across_the_outline_is_forgiven(seed: int, grey: int, ground: bool) -> None:
    image = disc(seed)
    if grey == 180:  # of the ground's own grey it cannot be told from a notch, unless something on it can be
        grey = 205
    cv2.rectangle(image, (230, 20), (262, 140), grey, -1)
    hidden = [k for k in range(COUNT) if 232 < POINTS[k, 0] < 260 and 20 < POINTS[k, 1] < 140]
    left, covered = judged(image, hidden, hidden, ground)
    assert not len(left) and set(covered) == set(hidden)


@pytest.mark.parametrize("reach", [0.1, 0.2])
def test_a_tab_and_a_notch_speak_against_the_outline(reach: float) -> None:
    for sign, level in ((1.0, 70), (-1.0, 180)):
        image = disc(3)
        tip = POINTS[60] + sign * reach * SIZE * NORMALS[60]
        cv2.line(image, *(tuple(np.rint(p).astype(int).tolist()) for p in (POINTS[60], tip)), level, 14)
        gone = list(range(58, 63))
        assert len(judged(image, [], gone)[0]) >= 2
        assert len(judged(image, [], gone, ground=False)[0]) >= 2  # an even ground looks the same wherever it lies


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.booleans(), st.floats(0.0, 1.0), st.sampled_from([40, 120, 700]))
def test_native_equals_reference(seed: int, ground: bool, share: float, count: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.arange(count) * (2.0 * np.pi / count)
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    offsets = np.array([-11.0, -8, -5, 5, 8, 11])
    places = (CENTRE + 90.0 * normals)[:, None] + offsets[:, None] * normals[:, None]
    values = np.where(offsets < 0, 70.0, 180.0) + rng.normal(0, 2, (count, 6))
    values[rng.random(count) < 0.05] = np.nan
    image = disc(seed)
    for _ in range(6):  # covers, tabs and notches at random
        at, level = rng.integers(60, 340, 2), int(rng.choice([70, 180, 120]))
        cv2.rectangle(image, (int(at[0]), int(at[1]) - 40), (int(at[0]) + 20, int(at[1])), level, -1)
    flags = [rng.random(count) < 0.2 * share for _ in range(2)]
    H = np.eye(3)
    H[:2, 2] = rng.uniform(-120, 120, 2) if seed % 5 == 0 else rng.uniform(-2, 2, 2)
    given = (
        shrunk(image, BY),
        float(BY),
        H,
        np.ascontiguousarray(places.reshape(-1, 2)),
        values,
        110.0,
        *flags,
        ground,
    )
    for found, wanted in zip(kernels.judge_flanks(*given), reference.judge_flanks(*given), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_both_refuse_the_same() -> None:
    flags, places = np.zeros(4, np.bool_), np.ones((8, 2))
    image, H, values = np.zeros((40, 40), np.uint8), np.eye(3), np.ones((4, 2))
    for module in (kernels, reference):
        left, covered = module.judge_flanks(image, 2.0, H, places, values, 1.0, ~flags, flags, True)
        assert left.all() and not covered.any()  # too few places to say anything else
        for bad in ((places[:7], values, flags), (places[:4], values[:, :1], flags), (places, values, flags[:3])):
            with pytest.raises(ValueError, match="each sample needs its flags"):
                module.judge_flanks(image, 2.0, H, bad[0], bad[1], 1.0, bad[2], flags, True)


def test_runs_go_round() -> None:
    assert [r.tolist() for r in runs(np.array([0, 1, 5, 6, 8, 38, 39]), 40)] == [[38, 39, 0, 1], [5, 6, 8]]
    assert runs(np.array([], dtype=np.intp), 10) == []
    assert longest(np.array([True, True, False, True])) == 2
    assert longest(np.zeros(4, np.bool_)) == 0
