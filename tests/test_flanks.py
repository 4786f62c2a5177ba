# SPDX-License-Identifier: Apache-2.0
"""The two sides of an outline: covers are forgiven, notches and tabs are not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack.observation.flanks import BY, Flanks, longest, runs
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
        assert not len(judged(image, [], gone, ground=False)[0])  # a belt's own pattern changes there all the time


def test_runs_go_round() -> None:
    assert [r.tolist() for r in runs(np.array([0, 1, 5, 6, 8, 38, 39]), 40)] == [[38, 39, 0, 1], [5, 6, 8]]
    assert runs(np.array([], dtype=np.intp), 10) == []
    assert longest(np.array([True, True, False, True])) == 2
    assert longest(np.zeros(4, np.bool_)) == 0
