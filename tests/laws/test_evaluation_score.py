# SPDX-License-Identifier: Apache-2.0
"""Scores over sequences, and tables of homographies."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.demo.run import accept_limit
from grasptrack.errors import InputError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.result import Status, TrackResult
from grasptrack_bench.metrics.errors import contact_distances, error_measure, sequence_error
from grasptrack_bench.metrics.score import Score, Truth
from grasptrack_bench.records import read_homographies
from scores import write_homographies

CONTACTS = np.array([[100.0, 100.0], [180.0, 120.0]])
MOVE = np.array([[1.01, -0.02, 6.0], [0.03, 0.98, -4.0], [1e-5, -2e-5, 1.0]])


def result(frame: int, status: Status, contacts: np.ndarray | None, reason: str = "", grasp: int = 1) -> TrackResult:
    return TrackResult(frame, None, status, reason, grasp_id=grasp, contacts=contacts, latency_ms=1.0 + frame)


def powers(count: int) -> list[np.ndarray]:
    return [np.linalg.matrix_power(MOVE, i) for i in range(count)]


def test_truth_is_the_first_contacts_moved_by_the_homographies() -> None:
    score = Score("auto")
    moved = powers(4)
    score.add(result(0, "tracked", CONTACTS), Truth.of_homography(moved[0], 10000.0))
    score.add(result(1, "tracked", apply_homography(moved[1], CONTACTS)), Truth.of_homography(moved[1], 10000.0))
    off = apply_homography(moved[2], CONTACTS) + np.array([[0.0, 5.0], [0.0, 1.0]])
    score.add(result(2, "unstable", off, "slips"), Truth.of_homography(moved[2], 10000.0))
    score.add(result(3, "lost", None, "covered"), Truth.of_homography(moved[3], 10000.0))
    assert score.located == 0.75
    assert score.status_share("tracked") == 0.5
    assert score.error_percentile(100) == pytest.approx(5.0)
    assert score.false_accepts == 1  # 5 px against a limit of 4 px
    assert score.reasons() == [("covered", 1)]


def test_a_grasp_that_starts_late_is_measured_from_its_own_first_frame() -> None:
    score = Score("auto")
    moved = powers(4)
    score.add(result(0, "searching", None, "no object"), Truth.of_homography(moved[0], 10000.0))
    score.add(result(1, "tracked", CONTACTS), Truth.of_homography(moved[1], 10000.0))
    expected = apply_homography(moved[3] @ np.linalg.inv(moved[1]), CONTACTS)
    scored = score.add(result(3, "tracked", expected), Truth.of_homography(moved[3], 10000.0))
    assert scored.distances == pytest.approx([0.0, 0.0], abs=1e-9)


def test_a_new_grasp_gets_a_new_truth_and_frames_without_homography_none() -> None:
    score = Score("auto")
    score.add(result(0, "tracked", CONTACTS), Truth.of_homography(np.eye(3), 10000.0))
    assert score.add(result(1, "tracked", CONTACTS), None).distances is None
    renewed = score.add(result(2, "tracked", CONTACTS + 30.0, grasp=2), Truth.of_homography(np.eye(3), 10000.0))
    assert renewed.distances == pytest.approx([0.0, 0.0])
    assert score.false_accepts == 0


def test_contacts_on_another_object_from_the_first_frame_on_are_wrong() -> None:
    elsewhere, beside = Score("a", given=CONTACTS), Score("b", given=CONTACTS)
    for i, H in enumerate(powers(3)):
        truth = Truth.of_homography(H, 10000.0)
        elsewhere.add(result(i, "tracked", apply_homography(H, CONTACTS + 9.0)), truth)
        beside.add(result(i, "tracked", apply_homography(H, CONTACTS + 1.0)), truth)
    assert elsewhere.false_accepts == 3 and len(elsewhere.contact_errors) == 4
    assert beside.false_accepts == 0 and beside.contact_errors == pytest.approx(np.zeros(4), abs=1e-9)


def test_the_limit_of_a_false_accept_grows_with_the_object() -> None:
    assert accept_limit(100.0) == 3.0
    assert accept_limit(40000.0) == pytest.approx(8.0)


def test_homographies_come_back_to_the_last_digit(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    table = dict(enumerate(powers(3)))
    write_homographies(path, table)
    read = read_homographies(path)
    assert sorted(read) == [0, 1, 2]
    assert all((read[i] == table[i]).all() for i in read)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "frame,h11\n0,1\n",
        "frame,h11,h12,h13,h21,h22,h23,h31,h32,h33\n0,1,0,0,0,1,0,0,0,x\n",
        "frame,h11,h12,h13,h21,h22,h23,h31,h32,h33\n0,1,0,0,1,0,0,0,0,1\n",
    ],
)
def test_bad_tables_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"bad\.csv"):
        read_homographies(path)


def test_a_missing_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read"):
        read_homographies(tmp_path / "none.csv")


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
