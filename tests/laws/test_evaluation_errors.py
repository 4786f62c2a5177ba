# SPDX-License-Identifier: Apache-2.0
"""The paper's error measures: their definitions, units and invariances."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack_bench.metrics.errors import contact_distances, error_measure, sequence_error

TRUTH = np.array([[100.0, 50.0], [100.0, 150.0]])


def test_average_and_maximum_follow_section_v() -> None:
    measure = error_measure(TRUTH + np.array([[3.0, 4.0], [0.0, 1.0]]), TRUTH, area=4000.0)
    assert measure.average_px == pytest.approx(3.0)
    assert measure.maximum_px == pytest.approx(5.0)
    assert measure.e_av == pytest.approx(3.0 / 4000.0)
    assert measure.e_max == pytest.approx(5.0 / 4000.0)
    assert measure.average_percent == pytest.approx(3.0)
    assert measure.maximum_percent == pytest.approx(5.0)


def test_each_contact_is_measured_against_its_own_place() -> None:
    assert contact_distances(TRUTH[::-1], TRUTH) == pytest.approx([100.0, 100.0])


@given(st.floats(0.1, 10.0), st.floats(-3.0, 3.0))
def test_per_cent_of_the_opening_is_invariant_and_the_papers_unit_is_not(scale: float, angle: float) -> None:
    c, s = math.cos(angle), math.sin(angle)
    turn = scale * np.array([[c, -s], [s, c]])
    found = TRUTH + np.array([[1.0, 2.0], [-2.0, 0.5]])
    before, after = (
        error_measure(found, TRUTH, 4000.0),
        error_measure(found @ turn.T, TRUTH @ turn.T, 4000.0 * scale**2),
    )
    assert after.average_percent == pytest.approx(before.average_percent)
    assert after.maximum_percent == pytest.approx(before.maximum_percent)
    assert after.e_av == pytest.approx(before.e_av / scale)


def test_sequence_error_is_the_mean_of_averages_and_the_largest_maximum() -> None:
    frames = [error_measure(TRUTH + np.array([[d, 0.0], [0.0, 0.0]]), TRUTH, 4000.0) for d in (0.0, 2.0, 4.0)]
    measure = sequence_error(frames)
    assert measure.average_px == pytest.approx(1.0)
    assert measure.maximum_px == pytest.approx(4.0)
    assert measure.e_max == pytest.approx(4.0 / 4000.0)


@pytest.mark.parametrize(("contacts", "area"), [(TRUTH[:1], 1.0), (TRUTH, 0.0), (TRUTH, math.nan)])
def test_nonsense_is_refused(contacts: np.ndarray, area: float) -> None:
    with pytest.raises(ValueError, match=r"contacts and truth|area"):
        error_measure(contacts, TRUTH, area)


def test_an_empty_sequence_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one frame"):
        sequence_error([])
