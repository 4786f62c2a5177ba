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
        ("3 cm", Length(3.0, "cm")),
        ("0.03m", Length(0.03, "m")),
        ("1.2in", Length(1.2, "in")),
        ("1.2 inch", Length(1.2, "inch")),
    ],
)
def test_lengths_are_read(text, length):
    assert parse_length(text, "opening") == length


@pytest.mark.parametrize("text", ["", "px", "-3", "0", "3 ft", "1e3", "nan", "inf", "3,5", "1 2"])
def test_what_is_no_length_is_refused_with_its_name(text):
    with pytest.raises(InputError, match="opening is a length such as"):
        parse_length(text, "opening")


@given(st.floats(0.01, 1e4), st.floats(1.0, 1e4), st.floats(0.01, 100.0))
def test_units(value, size, scale):
    assert Length(value).in_px(size, None) == value
    assert Length(value, "size").in_px(size, None) == value * size
    assert Length(value, "mm").in_px(size, scale) == value * scale
    for unit, mm in (("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("in", 25.4), ("inch", 25.4)):
        assert Length(value, unit).in_px(size, scale) == pytest.approx(value * mm * scale, rel=1e-12)
        with pytest.raises(InputError, match=f" {unit} needs the scale of the image in px per mm"):
            Length(value, unit).in_px(size, None)


def test_no_limit_needs_no_scale():
    assert Length(math.inf, "mm").in_px(100.0, None) == math.inf
    assert Length(0.0, "mm").in_px(100.0, None) == 0.0


def test_a_hand_on_an_object():
    hand = Hand(Length(10, "mm"), Length(60, "mm"), 12.0, Length(0.2, "size"), 0.0, px_per_mm=2.0)
    assert hand.in_px(100.0) == (20.0, 120.0, 12.0, 20.0, 0.0)
    plain = Hand().in_px(100.0)
    assert plain == pytest.approx((0.0, math.inf, 10.0, 10.0, 3.0))


@given(
    st.floats(0.01, 1e4).map(lambda value: round(value, 2)), st.sampled_from(["px", "mm", "cm", "m", "in", "inch", "%"])
)
def test_a_hand_reads_lengths_as_they_are_written(value, unit):
    length = Length(value / 100.0, "size") if unit == "%" else Length(value, unit)
    for name in ("min_opening", "max_opening", "finger_width", "finger_thickness", "clearance"):
        assert Hand(**{name: f"{value:.2f}{unit}"}, px_per_mm=2.0) == Hand(**{name: length}, px_per_mm=2.0)


def test_what_is_written_and_no_length_is_refused_with_its_name():
    with pytest.raises(InputError, match=r'max_opening is a length such as 120px.*, not "85 parsec"'):
        Hand(max_opening="85 parsec")


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
