# SPDX-License-Identifier: Apache-2.0
"""A run's folder: nothing computed is lost, nothing is done twice, nothing of other code or options is mixed in."""

import json
from pathlib import Path
from typing import Any

import pytest

import scheduled
from grasptrack.errors import InputError
from grasptrack_bench import run_folder as module
from grasptrack_bench.run_folder import Filled, Job, case_file, fill_run_folder
from grasptrack_bench.schedule import Scheduler, create_scheduler


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
