# SPDX-License-Identifier: Apache-2.0
"""Measures of integrity against their definitions, and records that come back to the last digit."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.errors import InputError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.result import TrackResult
from grasptrack_bench.metrics.integrity import (
    compute_measures,
    cumulative_share,
    loss_lengths,
    recovery_delays,
    risk_coverage,
    upper_bound,
)
from grasptrack_bench.metrics.score import FrameScore, Score, Truth
from grasptrack_bench.records import read_records, write_records
from reported import made_up
from scores import frame, random_run

SEEDS = st.integers(0, 2**32 - 1)


def test_contacts_given_while_the_object_is_gone_are_wrong_wherever_they_lie() -> None:
    assert not frame(1, 0.0).is_false_accept
    assert frame(1, 0.0, present=False).is_false_accept
    assert frame(1, 0.0, visible=0.0).is_false_accept
    assert frame(1, 4.01).is_false_accept and not frame(1, 4.0).is_false_accept
    assert not frame(1, None, present=False).is_false_accept


@given(SEEDS)
def test_measures_are_what_counting_gives(seed: int) -> None:
    runs = [random_run(np.random.default_rng((seed, k))) for k in range(3)]
    found = compute_measures(runs)
    frames = [f for run in runs for f in run if not f.defining]
    assert found.frames == len(frames)
    whole = [f for f in frames if f.present and f.visible == 1.0]
    assert found.located_whole == pytest.approx(sum(f.contacts is not None for f in whole) / len(whole))
    wrong = [f for f in frames if f.contacts is not None and (f.error > 4.0 or not f.present or f.visible == 0.0)]
    assert found.false_accepts == len(wrong)
    there = [f for f in frames if f.distances is not None and f.present and f.visible > 0.0]
    squares = [float(d) ** 2 for f in there if f.distances is not None for d in f.distances]
    assert found.rms_px == pytest.approx(math.sqrt(sum(squares) / len(squares)))
    assert found.in_ellipse == 0.5
    assert found.aligned_5 == pytest.approx(
        sum(f.contacts is not None and f.error <= 2.5 for f in frames) / len(frames)
    )
    assert found.aligned_15 >= found.aligned_5
    assert found.median_percent == pytest.approx(2.0 * found.median_px)
    assert found.false_bound >= found.false_accepts / found.frames


@given(st.integers(1, 100000), st.data())
def test_the_bound_of_a_rate(trials: int, data: st.DataObject) -> None:
    events = data.draw(st.integers(0, trials))
    bound = upper_bound(events, trials)
    assert events / trials <= bound <= 1.0
    assert upper_bound(events, 2 * trials) <= bound + 1e-12
    assert upper_bound(0, trials) == min(1.0, 3.0 / trials)
    if events < trials:
        assert upper_bound(events + 1, trials) >= bound - 1e-12 or events == 0


def test_nothing_to_count_is_not_a_number() -> None:
    found = compute_measures([])
    assert found.frames == 0 and found.false_accepts == 0
    assert math.isnan(found.located_whole) and math.isnan(found.rms_px) and math.isnan(found.false_bound)


def test_recovery_counts_from_the_return_to_whole_view() -> None:
    def here(i: int, error: float | None) -> FrameScore:
        return frame(i, error)

    def away(i: int) -> FrameScore:
        return frame(i, None, visible=0.0)

    run = [here(0, 0.0), away(1), away(2), frame(3, None, visible=0.8), here(4, None), here(5, 9.0), here(6, 0.1)]
    run += [away(7), here(8, 0.1), away(9), here(10, None), away(11), here(12, None)]
    assert recovery_delays(run) == [2, 0, None, None]
    assert recovery_delays(run[:1]) == []


def test_a_loss_lasts_until_the_object_is_rightly_located() -> None:
    errors = [0.0, None, None, 9.0, 0.1, None, None]
    run = [frame(i, error) for i, error in enumerate(errors)]
    assert loss_lengths(run) == [3, math.inf]  # the wrong answer ends nothing
    away = [frame(7, None, visible=0.5), frame(8, None), frame(9, 0.1)]
    assert loss_lengths([*run, *away]) == [3]  # out of view: from here on it is a return
    found = compute_measures([run, run[:5]])
    assert (found.losses, found.lost_median, found.lost_p95) == (3, 3.0, math.inf)
    unknown = [replace(f, visible=math.nan) for f in run]  # as images that nobody annotated
    assert loss_lengths(unknown) == loss_lengths(run)


def test_records_of_earlier_versions_know_no_alignment(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    write_records(path, {"auto": [frame(0, 0.5)]})
    head, row = (line.split(",") for line in path.read_text().splitlines())
    at = head.index("alignment_px")
    path.write_text("\n".join(",".join(line[:at] + line[at + 1 :]) for line in (head, row)))
    (read,) = read_records(path)["auto"]
    assert math.isnan(read.alignment) and read.error == 0.5 and read.latency_ms == 2.0


@given(SEEDS)
def test_risk_and_coverage(seed: int) -> None:
    run = random_run(np.random.default_rng(seed))
    curve = risk_coverage(run)
    given_ = [f for f in run if not f.defining and f.answered and math.isfinite(f.confidence)]
    assert (np.diff(curve[:, 0]) < 0.0).all() and (np.diff(curve[:, 1]) > 0.0).all()
    assert curve[-1, 1] == pytest.approx(len(given_) / (len(run) - 1))
    assert curve[-1, 2] == pytest.approx(sum(f.is_false_accept for f in given_) / len(given_))


def test_a_cumulative_curve_counts_what_is_as_small() -> None:
    assert cumulative_share(np.array([1.0, 2.0, 2.0, 5.0]), np.array([0.5, 1.0, 2.0, 9.0])).tolist() == [
        0.0,
        0.25,
        0.75,
        1.0,
    ]


@given(SEEDS)
def test_the_covariance_of_an_answer_is_held_against_its_error(seed: int) -> None:
    rng = np.random.default_rng(seed)
    contacts, H = np.array([[100.0, 100.0], [180.0, 120.0]]), np.diag([1.1, 1.1, 1.0])
    root = rng.normal(0.0, 1.0, (2, 2, 2)) + 2.0 * np.eye(2)
    off = np.einsum("kij,kj->ki", root, unit := rng.normal(0.0, 1.0, (2, 2)))
    score = Score("auto")
    truths = [Truth.of_homography(np.eye(3), 1e4), Truth.of_homography(H, 1.21e4)]
    score.add(TrackResult(0, None, "tracked", "", grasp_id=1, contacts=contacts), truths[0])
    moved = apply_homography(H, contacts) + off
    covariance = root @ root.transpose(0, 2, 1)
    scored = score.add(
        TrackResult(1, None, "tracked", "", grasp_id=1, contacts=moved, covariance=covariance), truths[1]
    )
    assert scored.spread == pytest.approx((unit**2).sum(axis=1))
    assert scored.opening == pytest.approx(1.1 * math.hypot(80.0, 20.0))


@given(SEEDS)
def test_records_come_back_to_the_last_digit(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    path = tmp_path_factory.mktemp("records") / "a.csv"
    runs = {name: random_run(np.random.default_rng((seed, k)), 12) for k, name in enumerate(("auto", "klt"))}
    write_records(path, runs)
    read = read_records(path)
    assert list(read) == list(runs)
    for name, run in runs.items():
        for one, other in zip(run, read[name], strict=True):
            for key in FrameScore.__slots__:
                a, b = getattr(one, key), getattr(other, key)
                same = (a is None) == (b is None) and (a is None or _same(a, b))
                assert same, (key, a, b)


def _same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray):
        return bool(np.array_equal(a, np.asarray(b)))
    return a == b or (isinstance(a, float) and math.isnan(a) and math.isnan(float(b)))  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["", "method,frame\nauto,0\n", "method,frame,status\n\x00\n"])
def test_what_is_no_record_is_refused_by_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"bad\.csv"):
        read_records(path)


def test_a_frame_without_a_truth_proves_nothing() -> None:
    """Frames that cannot be measured neither lower the bound of wrong answers nor the risk, and are no losses."""
    rng = np.random.default_rng(4)
    run = made_up(rng, "clean", "auto")
    unknown = [
        replace(f, frame=f.frame + 30, visible=math.nan, distances=None, spread=None, defining=False) for f in run
    ]
    alone, beside = compute_measures([run]), compute_measures([[*run, *unknown]])
    assert beside.frames == alone.frames == 29
    for name in ("false_bound", "located_whole", "tracked_visible", "rms_px", "frames_whole"):
        assert getattr(beside, name) == getattr(alone, name), name
    assert np.array_equal(risk_coverage(run), risk_coverage([*run, *unknown]))
    wrong = replace(run[1], distances=np.array([50.0, 0.0]))
    assert compute_measures([[run[0], wrong, *unknown]]).false_bound == 1.0
