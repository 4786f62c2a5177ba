# SPDX-License-Identifier: Apache-2.0
"""A run's figures are those of its parts, and its folder is read back or refused by name."""

import csv
import json
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scheduled
from grasptrack.errors import InputError
from grasptrack_bench import run_folder as module
from grasptrack_bench.metrics.integrity import Measures, compute_measures, risk_coverage
from grasptrack_bench.metrics.summary import ALL, APART, PER_CASE, risk_area, summarise_run, worst_frames, write_summary
from grasptrack_bench.records import write_records
from grasptrack_bench.run_folder import CASES, Case, Filled, Job, case_file, fill_run_folder, read_run
from grasptrack_bench.schedule import Scheduler, create_scheduler
from reported import DISTURBANCES, METHODS, SHAPES, lost, made_up, real, scenes, write_index


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scenes(tmp_path_factory.mktemp("runs") / "a")


def same(a: Measures, b: Measures) -> bool:
    return all(
        x == y or (math.isnan(x) and math.isnan(y)) for x, y in zip(asdict(a).values(), asdict(b).values(), strict=True)
    )


def test_a_folder_comes_back_as_it_was_written(folder: Path) -> None:
    run = read_run(folder)
    assert run.kind == "scenes" and run.factor == "disturbance"
    assert [c.name for c in run.cases] == [f"{s}.{d}" for s in SHAPES for d in DISTURBANCES]
    assert run.cases[1] == Case("bracket.bar", 30, "bracket", "bar", "hidden", 0)
    assert run.methods == METHODS
    assert run.scored == run.cases and run.failed == ()


def test_figures_are_the_measures_of_their_parts(folder: Path) -> None:
    run, summary = read_run(folder), summarise_run(read_run(folder))
    assert summary.levels == tuple(DISTURBANCES) and summary.shapes == SHAPES and summary.groups == ("motion", "hidden")
    parts = {
        "by_level": lambda c: c.disturbance,
        "by_group": lambda c: c.group,
        "by_shape": lambda c: c.shape,
        "overall": lambda c: ALL,
    }
    for name, of in parts.items():
        rows = getattr(summary, name)
        assert len(rows) == len(METHODS) * len({of(c) for c in run.cases})
        for row in rows:
            runs = [run.scores[c.name][row.method] for c in run.cases if of(c) == row.level]
            assert row.cases == len(runs)
            assert same(row.measures, compute_measures(runs))


def test_counts_add_up_over_every_division(folder: Path) -> None:
    summary = summarise_run(read_run(folder))
    for method in METHODS:
        whole = summary.row(method)
        assert whole is not None
        for rows in (summary.by_level, summary.by_group, summary.by_shape):
            mine = [r.measures for r in rows if r.method == method]
            assert sum(m.frames for m in mine) == whole.measures.frames
            assert sum(m.false_accepts for m in mine) == whole.measures.false_accepts
        runs = read_run(folder).runs(method, read_run(folder).cases)
        assert sum(n for _, n in summary.reasons[method]) == sum(not f.answered for run in runs for f in run)
    assert len(summary.reasons["auto"]) == 1  # they differ in their numbers alone


def test_worst_frames_are_the_wrong_ones_first_and_apart(folder: Path) -> None:
    run = read_run(folder)
    for method in METHODS:
        found = worst_frames(run, method, 1000)
        assert [w.false_accept for w in found] == sorted((w.false_accept for w in found), reverse=True)
        for case in run.cases:
            here = [w.frame for w in found if w.case == case.name]
            assert 0 < len(here) <= PER_CASE
            assert all(abs(a - b) >= APART for a in here for b in here if a != b)
            frames = [f for f in run.scores[case.name][method] if f.answered and not f.defining]
            worst = max(f.error for f in frames if f.is_false_accept == any(x.is_false_accept for x in frames))
            assert worst in [w.error for w in found if w.case == case.name]
    assert len(worst_frames(run, "ecc")) == 12


def test_the_area_under_risk_and_coverage() -> None:
    rng = np.random.default_rng(3)
    run = made_up(rng, "away", "ecc", 200)
    curve = risk_coverage(run)
    fine = np.linspace(0.0, curve[-1, 1], 200001)[1:]
    risks = curve[np.searchsorted(curve[:, 1], fine, side="left").clip(max=len(curve) - 1), 2]
    assert risk_area(curve) == pytest.approx(risks.mean(), abs=1e-4)
    assert risk_area(risk_coverage([lost(f) for f in run])) != risk_area(curve)
    assert math.isnan(risk_area(np.empty((0, 3))))
    right = [replace(f, distances=None if f.distances is None else 0.0 * f.distances, visible=1.0) for f in run]
    assert risk_area(risk_coverage(right)) == 0.0


def test_files_of_a_summary_hold_its_figures(folder: Path, tmp_path: Path) -> None:
    summary = summarise_run(read_run(folder))
    write_summary(tmp_path, summary)
    with (tmp_path / "summary.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(METHODS) * (1 + len(DISTURBANCES))
    for row, kept in zip((*summary.overall, *summary.by_level), rows, strict=True):
        flat = row.flat()
        assert kept["disturbance"] == flat["level"]
        for key, value in flat.items():
            if key != "level":
                assert kept[key] == ("" if isinstance(value, float) and math.isnan(value) else str(value))
    told = json.loads((tmp_path / "summary.json").read_text())
    assert told["overall"][0]["rms_px"] == summary.overall[0].measures.rms_px
    assert len(told["by_shape"]) == len(METHODS) * len(SHAPES)


def test_videos_are_their_own_level(tmp_path: Path) -> None:
    summary = summarise_run(read_run(real(tmp_path / "r")))
    assert summary.factor == "video" and summary.levels == ("box", "card") and summary.shapes == ()


def test_cases_that_failed_or_were_not_reached_are_told_and_left_out(tmp_path: Path) -> None:
    cases = [Case("a.clean", 30, "a", "clean"), Case("b.clean", 30, "b", "clean", error="no stable grasp")]
    cases.append(Case("c.clean", 30, "c", "clean"))
    write_index(tmp_path, "scenes", cases, ended="interrupted")
    write_records(tmp_path / CASES / "a.clean.csv", {"auto": made_up(np.random.default_rng(0), "clean", "auto")})
    run = read_run(tmp_path)
    assert [c.name for c in run.scored] == ["a.clean"]
    assert [c.error for c in run.failed] == ["no stable grasp", "the run ended before it was scored"]
    assert summarise_run(run).overall[0].cases == 1


@pytest.mark.parametrize(
    ("index", "says"),
    [
        (None, "no folder of an evaluation"),
        ("{", "cannot read"),
        ("[1]", "cannot read"),
        ("[" * 9000, "cannot read"),
        ('{"format": 2, "kind": "scenes", "cases": []}', "format 2"),
        ('{"format": 1, "kind": "dreams", "cases": []}', "dreams"),
        ('{"format": 1, "kind": "scenes"}', "list of cases is broken"),
        ('{"format": 1, "kind": "scenes", "cases": [{"name": "a"}]}', "list of cases is broken"),
        ('{"format": 1, "kind": "scenes", "cases": 7}', "list of cases is broken"),
        ('{"format": 1, "kind": "real", "cases": [{"name": "../a", "frames": 3}]}', "list of cases is broken"),
        ('{"format": 1, "kind": "real", "cases": []}', "no case with results"),
    ],
)
def test_what_is_no_run_is_refused_in_one_line(tmp_path: Path, index: str | None, says: str) -> None:
    if index is not None:
        (tmp_path / "evaluation.json").write_text(index)
    with pytest.raises(InputError, match=says) as raised:
        read_run(tmp_path)
    assert "\n" not in str(raised.value) and str(tmp_path) in str(raised.value)


def test_a_missing_file_of_frames_is_refused_by_name(tmp_path: Path) -> None:
    write_index(tmp_path, "real", [Case("film", 3, disturbance="film")])
    with pytest.raises(InputError, match=r"film\.csv"):
        summarise_run(read_run(tmp_path))


# --- what fills a folder of runs ------------------------------------------------------------------


def jobs(folder: Path, count: int = 6) -> list[Job]:
    marks = folder / "marks"
    marks.mkdir(parents=True, exist_ok=True)
    return [Job(f"part{i}.noise", 20, {"shape": f"part{i}"}, (i, str(marks))) for i in range(count)]


def asked(folder: Path) -> list[int]:
    return sorted(int(path.name.split("-")[1]) for path in (folder / "marks").iterdir())


def run(
    folder: Path,
    *,
    stop_after: int | None = None,
    last: Path | None = None,
    schedule: Scheduler = scheduled.in_this_process,
    **options: Any,
) -> Filled:
    done_before: list[int] = []

    def tell(step: str, done: int, total: int) -> None:
        done_before.append(done)
        if stop_after is not None and len(done_before) > stop_after:
            raise KeyboardInterrupt

    return fill_run_folder(
        folder / "out", "scenes", jobs(folder), scheduled.scored, schedule, options=options, last=last, progress=tell
    )


def test_an_interrupted_run_goes_on_without_repeating_what_is_done(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, stop_after=2, schedule=create_scheduler(workers=1), seed=1)
    index = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert index["ended"] == "interrupted"
    kept = {path.name: path.read_bytes() for path in (tmp_path / "out" / "cases").iterdir()}
    assert len(kept) == 2
    filled = run(tmp_path, schedule=create_scheduler(workers=1), seed=1)
    assert (filled.resumed, filled.done) == (2, 3)
    assert filled.failed == {"part3.noise": "ValueError: no grasp here"}
    assert all((tmp_path / "out" / "cases" / name).read_bytes() == content for name, content in kept.items())
    assert [i for i in asked(tmp_path) if i != 3].count(0) == 1


def test_results_are_the_same_with_and_without_interruption(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    run(tmp_path / "a")
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "b", stop_after=3)
    run(tmp_path / "b")
    for i in (0, 1, 2, 4, 5):
        one, other = (case_file(tmp_path / side / "out", f"part{i}.noise").read_bytes() for side in "ab")
        assert one == other


def test_a_finished_run_and_one_with_other_options_are_begun_anew(tmp_path: Path) -> None:
    assert run(tmp_path, seed=1).done == 5
    assert run(tmp_path, seed=1).resumed == 0
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, stop_after=2, seed=1)
    assert run(tmp_path, seed=2).resumed == 0


def test_a_run_without_its_report_is_gone_on_with(tmp_path: Path) -> None:
    page = tmp_path / "out" / "report.html"
    assert run(tmp_path, last=page).done == 5
    assert run(tmp_path, last=page).resumed == 5
    page.write_text("a report")
    assert run(tmp_path, last=page).resumed == 0 and not page.exists()


@pytest.mark.parametrize("text", ["[" * 9000, '{"ended": "running"}', "[1]", "", '{"options": null}'])
def test_an_index_that_is_damaged_is_begun_anew(tmp_path: Path, text: str) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "evaluation.json").write_text(text)
    assert run(tmp_path).done == 5


def test_results_of_other_code_are_not_gone_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, stop_after=2)
    monkeypatch.setattr(module, "code_fingerprint", lambda: "other")
    assert run(tmp_path).resumed == 0


def test_a_case_that_fails_is_told_in_the_index_and_the_others_are_there(tmp_path: Path) -> None:
    run(tmp_path)
    index = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert index["ended"] == "finished" and index["format"] == 1
    assert {case["name"]: case["error"] for case in index["cases"] if case["error"]} == {
        "part3.noise": "ValueError: no grasp here"
    }
    assert len(list((tmp_path / "out" / "cases").glob("*.csv"))) == 5


def test_a_folder_that_cannot_be_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"):
        run(tmp_path)
