# SPDX-License-Identifier: Apache-2.0
"""Two runs side by side: the same run is no worse than itself, and what was made worse is named."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grasptrack.errors import InputError
from grasptrack_bench.metrics.paired import Unit, measures_of, units_of
from grasptrack_bench.metrics.score import FrameScore
from grasptrack_bench.metrics.statistics import bootstrap_counts, critical_value
from grasptrack_bench.metrics.summary import ALL, summarise_run
from grasptrack_bench.report.comparison import Comparison, compare_runs
from grasptrack_bench.report.comparison_page import comparison_lines
from grasptrack_bench.run_folder import read_run
from reported import METHODS, SHAPES, changed, lost, made_up, real, scenes


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scenes(tmp_path_factory.mktemp("runs") / "a")


def kinds(c: Comparison) -> set[tuple[str, str]]:
    return {(x.method, x.measure) for x in c.worse}


def test_a_run_is_no_worse_than_itself(folder: Path) -> None:
    found = compare_runs(folder, folder)
    assert found.worse == [] and found.better == [] and found.looks == () and found.differs == ()
    assert comparison_lines(found)[-1] == "Nothing got worse beyond its noise."
    summary = summarise_run(read_run(folder))
    for method in METHODS:
        row = summary.row(method)
        assert row is not None
        for key in (
            "located_whole", "tracked_visible", "rms_px", "median_px", "p95_px", "median_ms", "recovery_frames",
        ):  # fmt: skip
            change = found.change(method, ALL, key)
            assert change is not None and change.a == change.b
            assert change.a == pytest.approx(getattr(row.measures, key))
        wrong = found.change(method, ALL, "false_accepts")
        assert wrong is not None and wrong.a == wrong.b == row.measures.false_accepts


def larger(f: FrameScore) -> FrameScore:
    return f if f.distances is None else replace(f, distances=np.minimum(1.6 * f.distances, 3.9))


def astray(f: FrameScore) -> FrameScore:
    return replace(f, distances=np.array([9.0, 9.0])) if f.answered and f.frame % 7 == 3 else f


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("change", "measures", "untouched"),
    [
        (larger, {"median_px", "rms_px", "p95_px"}, {"located_whole", "tracked_visible", "false_accepts", "median_ms"}),
        (
            lambda f: lost(f) if f.frame % 3 == 0 else f,
            {"located_whole", "tracked_visible"},
            {"median_px", "median_ms"},
        ),
        (astray, {"false_accepts", "rms_px"}, {"located_whole", "median_ms"}),
        (lambda f: replace(f, latency_ms=1.5 * f.latency_ms), {"median_ms"}, {"rms_px", "located_whole"}),
        (
            lambda f: replace(f, status="unstable") if f.answered else f,
            {"tracked_visible"},
            {"located_whole", "rms_px"},
        ),
    ],
    ids=["errors", "located", "wrong", "slow", "unstable"],
)
def test_what_was_made_worse_is_named_and_nothing_else(
    folder: Path, tmp_path: Path, change: Callable[[FrameScore], FrameScore], measures: set[str], untouched: set[str]
) -> None:
    after = changed(folder, tmp_path / "b", "auto", change)
    found = compare_runs(folder, after)
    assert {("auto", m) for m in measures} <= kinds(found)
    assert kinds(found).isdisjoint({("auto", m) for m in untouched})
    assert {m for m, _ in kinds(found)} == {"auto"}
    back = compare_runs(after, folder)
    assert {(x.method, x.level, x.measure) for x in back.better} == {
        (x.method, x.level, x.measure) for x in found.worse
    }
    assert back.worse == []
    text = "\n".join(comparison_lines(found))
    assert "Worse beyond its noise" in text and "auto" in text and "nan" not in text


def test_new_wrong_answers_are_listed_frame_by_frame_even_when_they_may_be_chance(folder: Path, tmp_path: Path) -> None:
    after = changed(
        folder,
        tmp_path / "b",
        "auto",
        lambda f: replace(f, distances=np.array([0.0, 50.0]), contacts=np.zeros((2, 2))) if f.frame in (4, 5, 6) else f,
        where="blob.clean",
    )
    found = compare_runs(folder, after)
    assert ("auto", "false_accepts") not in kinds(found)
    assert [(x.method, x.case, x.new_wrong) for x in found.looks] == [("auto", "blob.clean", (4, 5, 6))]
    assert "  auto, blob.clean: wrong now, not before: frames 4-6; located" in "\n".join(comparison_lines(found))
    assert "3 answers are wrong that were not before" in comparison_lines(found)[-1]


def test_what_is_larger_than_its_noise_need_not_matter(folder: Path, tmp_path: Path) -> None:
    after = changed(
        folder,
        tmp_path / "b",
        "auto",
        lambda f: f if f.distances is None else replace(f, distances=f.distances * 1.005),
    )
    found = compare_runs(folder, after)
    change = found.change("auto", ALL, "median_px")
    assert change is not None and change.b > change.a and change.verdict == "same"


def test_what_differs_is_said(folder: Path, tmp_path: Path) -> None:
    other = scenes(
        tmp_path / "b",
        seed=1,
        shapes=(*SHAPES[1:], "cross"),
        machine="another",
        versions={"grasptrack": "0.2.0", "numpy": "2.0"},
        options={"methods": list(METHODS), "frames": 30, "seed": 1},
    )
    changed(other, tmp_path / "c", "auto", lambda f: replace(f, area=2.0 * f.area))
    found = compare_runs(folder, tmp_path / "c")
    assert found.only_a == tuple(f"bracket.{d}" for d in ("clean", "bar", "away"))
    assert found.only_b == tuple(f"cross.{d}" for d in ("clean", "bar", "away"))
    said = " / ".join(found.differs)
    assert "option seed: 0 before, 1 now" in said and "version grasptrack: 0.1.0 before, 0.2.0 now" in said
    assert "machine: a machine, 2 cores before, another now" in said and "numpy" not in said
    assert "frames differ in 12 of 12 sequences" in said
    assert {x.verdict for x in found.changes if x.measure == "median_ms"} == {"untold"}


def test_few_videos_are_cut_into_blocks(tmp_path: Path) -> None:
    a = real(tmp_path / "a")
    assert compare_runs(a, a).worse == []
    found = compare_runs(a, changed(a, tmp_path / "b", "ecc", larger))
    assert ("ecc", "median_px") in kinds(found)
    assert any("blocks of frames" in text for text in found.differs)


def test_one_short_sequence_proves_nothing(tmp_path: Path) -> None:
    a = scenes(tmp_path / "a", shapes=("disc",))
    found = compare_runs(a, changed(a, tmp_path / "b", "auto", larger, where="clean"))
    assert next(x for x in found.changes if x.level == "clean" and x.measure == "rms_px").verdict == "untold"


def test_runs_that_cannot_be_compared_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be compared"):
        compare_runs(folder, real(tmp_path / "r"))
    with pytest.raises(InputError, match="no sequence in common"):
        compare_runs(folder, scenes(tmp_path / "s", shapes=("cross",)))
    with pytest.raises(InputError, match="no folder of an evaluation"):
        compare_runs(folder, tmp_path / "nowhere")


def test_two_runs_of_the_same_kind_seldom_differ_beyond_their_noise(tmp_path: Path) -> None:
    def run(seed: int) -> list[list[FrameScore]]:
        return [made_up(np.random.default_rng((seed, k)), "bar", "ecc") for k in range(24)]

    beyond = total = 0
    for seed in range(12):
        units = units_of(Unit.of(a, b) for a, b in zip(run(2 * seed), run(2 * seed + 1), strict=True))
        found = measures_of(units, bootstrap_counts(len(units), 200, seed))
        for m in found.values():
            if math.isfinite(m.error):
                total += 1
                beyond += abs(m.b - m.a) > critical_value(1, m.units) * m.error
    assert total > 60
    assert beyond / total < 0.15  # 5 % are to be expected


def test_the_noise_of_a_mean_is_its_standard_error() -> None:
    rng = np.random.default_rng(0)
    units = []
    for k in range(60):
        one = made_up(np.random.default_rng((1, k)), "clean", "auto", 40)
        share = rng.random()
        units.append(Unit.of(one, [f if f.defining or rng.random() < share else lost(f) for f in one]))
    found = measures_of(units, bootstrap_counts(60, 2000, 0))["located_whole"]
    parts = [np.array([(sum(p[k].answered for p in u.pairs)) for u in units]) / 39.0 for k in (0, 1)]
    assert found.b - found.a == pytest.approx(float((parts[1] - parts[0]).mean()))
    assert found.error == pytest.approx(float((parts[1] - parts[0]).std()) / math.sqrt(60), rel=0.1)
