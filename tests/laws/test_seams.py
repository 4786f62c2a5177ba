# SPDX-License-Identifier: Apache-2.0
"""A region is cut where it may be two things that touch: from one inward corner to another, at its narrowest neck first."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.segmentation.seams import parts_with_contacts
from grasptrack.segmentation.silhouettes import Silhouette, polygon_silhouette, trace_silhouettes

SIZE = (480, 640)
PLATE = np.array([[-90, -55], [90, -55], [90, 55], [-90, 55]], dtype=np.float64)
CONTACTS = np.array([[-90.0, 0.0], [90.0, 0.0]])


def laid(points: np.ndarray, turn: float) -> np.ndarray:
    """Points (n, 2) px about the image's middle, turned."""
    c, s = math.cos(turn), math.sin(turn)
    return points @ np.array([[c, s], [-s, c]]) + (320.0, 240.0)


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


@given(st.integers(8, 60), st.integers(0, 99))
def test_no_shape_stops_the_cut(side: int, seed: int) -> None:
    noise = np.random.default_rng(seed).integers(0, 2, (side, side)).astype(np.uint8) * 255
    for shape in trace_silhouettes(noise, 4.0):
        parts_with_contacts(shape, np.array([[3.0, 3.0], [5.0, 6.0]]), 3.0)
