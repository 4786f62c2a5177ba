# SPDX-License-Identifier: Apache-2.0
"""A region is cut where it may be two things that touch: from one inward corner to another, at its narrowest neck first."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.segmentation.closed_edges import lab_planes
from grasptrack.segmentation.seams import joined_parts, parts_with_contacts
from grasptrack.segmentation.silhouettes import Silhouette, polygon_silhouette, trace_silhouettes

SIZE = (480, 640)
PLATE = np.array([[-90, -55], [90, -55], [90, 55], [-90, 55]], dtype=np.float64)
CONTACTS = np.array([[-90.0, 0.0], [90.0, 0.0]])


def laid(points: np.ndarray, turn: float) -> np.ndarray:
    """Points (n, 2) px about the image's middle, turned."""
    c, s = math.cos(turn), math.sin(turn)
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + (320.0, 240.0))


def filled_shape(turn: float, *rings: np.ndarray) -> Silhouette:
    mask = np.zeros(SIZE, np.uint8)
    for ring in rings:
        cv2.fillPoly(mask, [np.rint(16.0 * laid(ring, turn)).astype(np.int32)], 255, cv2.LINE_8, 4)
    return trace_silhouettes(mask)[0]


def bar(middle: float, wide: float, reach: float) -> np.ndarray:
    return np.array([[middle - wide, -50], [middle + wide, -50], [middle + wide, -reach], [middle - wide, -reach]])


@given(
    turn=st.floats(0.0, 6.28), wide=st.floats(4.0, 12.0), middle=st.floats(-60.0, 60.0), reach=st.floats(120.0, 400.0)
)
def test_a_cable_is_cut_off_where_it_meets_the_plate(turn: float, wide: float, middle: float, reach: float) -> None:
    shape = filled_shape(turn, PLATE, bar(middle, wide, reach))
    parts = parts_with_contacts(shape, laid(CONTACTS, turn), 3.0)
    assert parts and [p.narrow for p in parts] == sorted(p.narrow for p in parts)
    assert all(0.0 < p.narrow < 1.0 for p in parts)
    rest = polygon_silhouette(parts[0].outer.astype(np.float64), SIZE)
    assert rest is not None and rest.area == pytest.approx(180.0 * 110.0, rel=0.05)


@given(turn=st.floats(0.0, 6.28), wide=st.floats(4.0, 12.0), reach=st.floats(160.0, 220.0))
def test_contacts_say_which_part_is_meant(turn: float, wide: float, reach: float) -> None:
    """On the cable's own sides they are the cable's."""
    shape = filled_shape(turn, PLATE, bar(0.0, wide, reach))
    contacts = laid(np.array([[-wide, -0.5 * (55.0 + reach)], [wide, -0.5 * (55.0 + reach)]]), turn)
    parts = parts_with_contacts(shape, contacts, 3.0)
    areas = [cv2.contourArea(p.outer) for p in parts]
    assert areas and areas[0] == pytest.approx(2.0 * wide * (reach - 55.0), rel=0.25)


@given(turn=st.floats(0.0, 6.28), a=st.floats(30.0, 120.0), b=st.floats(30.0, 120.0))
def test_what_turns_nowhere_inward_has_no_neck(turn: float, a: float, b: float) -> None:
    t = np.linspace(0.0, 2.0 * math.pi, 180, endpoint=False)
    shape = filled_shape(turn, np.column_stack([a * np.cos(t), b * np.sin(t)]))
    assert not parts_with_contacts(shape, laid(np.array([[-a, 0.0], [a, 0.0]]), turn), 3.0)


def photographed(turn: float, more: float, seed: int) -> tuple[np.ndarray, Silhouette]:
    """A plate that a bar touches, which is lighter by some grey levels, on a light table, and the region that both are."""
    beside = bar(20.0, 22.0, 190.0)
    image = np.full(SIZE, 190.0)
    for ring, level in ((PLATE, 90.0), (beside, 90.0 + more)):
        cv2.fillPoly(image, [np.rint(16.0 * laid(ring, turn)).astype(np.int32)], (level,), cv2.LINE_AA, 4)
    noise = np.random.default_rng(seed).normal(0.0, 2.0, SIZE)
    seen = cv2.GaussianBlur(image, (0, 0), 0.8) + noise
    return seen.clip(0, 255).astype(np.uint8), filled_shape(turn, PLATE, beside)


@given(turn=st.floats(0.0, 6.28), more=st.floats(10.0, 40.0), seed=st.integers(0, 99), px=st.integers(1, 2))
def test_what_touches_and_looks_otherwise_is_another_thing(turn: float, more: float, seed: int, px: int) -> None:
    def joined(level: float) -> float:
        image, shape = photographed(turn, level, seed)
        small = cv2.resize(image, None, fx=1.0 / px, fy=1.0 / px, interpolation=cv2.INTER_AREA).astype(np.uint8)
        return max((share for share, *_ in joined_parts(shape, lab_planes(small), px)), default=0.0)

    assert joined(0.0) < 0.05 < 0.2 < joined(more) < 1.0


@given(turn=st.floats(0.0, 6.28), more=st.floats(12.0, 30.0))
def test_of_two_things_that_touch_none_is_sure_and_the_one_that_is_meant_is_among_three(
    turn: float, more: float
) -> None:
    image, _ = photographed(turn, more, 1)
    found = gt.first_look(image, laid(np.array([[0.0, 10.0]]), turn)[0])
    whole = found[0].view.outer.area > 1.05 * 180.0 * 110.0
    assert not (whole and found[0].sure)
    assert any(c.view.outer.area == pytest.approx(180.0 * 110.0, rel=0.05) for c in found[:3])


@given(st.integers(8, 60), st.integers(0, 99))
def test_no_shape_stops_the_cut(side: int, seed: int) -> None:
    noise = np.random.default_rng(seed).integers(0, 2, (side, side)).astype(np.uint8) * 255
    for shape in trace_silhouettes(noise, 4.0):
        parts_with_contacts(shape, np.array([[3.0, 3.0], [5.0, 6.0]]), 3.0)
        assert all(0.0 <= share < 1.0 for share, *_ in joined_parts(shape, lab_planes(noise), 1))
