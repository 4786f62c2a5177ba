# SPDX-License-Identifier: Apache-2.0
"""The hand: lengths in three units, and what cannot be one."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import Hand, InputError, Length
from grasptrack.grasp.hand import parse_length


@pytest.mark.parametrize(
    ("text", "length"),
    [
        ("120", Length(120.0, "px")),
        ("120px", Length(120.0, "px")),
        (" 40.5 mm ", Length(40.5, "mm")),
        ("30%", Length(0.3, "size")),
        (".5px", Length(0.5, "px")),
    ],
)
def test_lengths_are_read(text, length):
    assert parse_length(text, "opening") == length


@pytest.mark.parametrize("text", ["", "px", "-3", "0", "3 cm", "1e3", "nan", "inf", "3,5", "1 2"])
def test_what_is_no_length_is_refused_with_its_name(text):
    with pytest.raises(InputError, match="opening is a length such as"):
        parse_length(text, "opening")


@given(st.floats(0.01, 1e4), st.floats(1.0, 1e4), st.floats(0.01, 100.0))
def test_units(value, size, scale):
    assert Length(value).in_px(size, None) == value
    assert Length(value, "size").in_px(size, None) == value * size
    assert Length(value, "mm").in_px(size, scale) == value * scale
    with pytest.raises(InputError, match="px per mm"):
        Length(value, "mm").in_px(size, None)


def test_no_limit_needs_no_scale():
    assert Length(math.inf, "mm").in_px(100.0, None) == math.inf
    assert Length(0.0, "mm").in_px(100.0, None) == 0.0


def test_a_hand_on_an_object():
    hand = Hand(Length(10, "mm"), Length(60, "mm"), 12.0, Length(0.2, "size"), 0.0, px_per_mm=2.0)
    assert hand.in_px(100.0) == (20.0, 120.0, 12.0, 20.0, 0.0)
    plain = Hand().in_px(100.0)
    assert plain == pytest.approx((0.0, math.inf, 10.0, 10.0, 3.0))


@pytest.mark.parametrize(
    "wrong",
    [
        {"finger_width": 0.0},
        {"finger_width": math.inf},
        {"finger_width": math.nan},
        {"finger_thickness": -1.0},
        {"finger_thickness": math.inf},
        {"clearance": math.inf},
        {"min_opening": -1.0},
        {"max_opening": math.nan},
        {"px_per_mm": 0.0},
        {"px_per_mm": math.inf},
    ],
)
def test_what_is_no_hand_is_refused(wrong):
    with pytest.raises(InputError):
        Hand(**wrong)


def test_openings_that_contradict_each_other_on_an_object():
    hand = Hand(min_opening=Length(0.5, "size"), max_opening=60.0)
    assert hand.in_px(100.0).min_opening == 50.0
    with pytest.raises(InputError, match="least opening of 100 px is above the largest, 60 px"):
        hand.in_px(200.0)
