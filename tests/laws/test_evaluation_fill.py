# SPDX-License-Identifier: Apache-2.0
"""A run's folder: nothing computed is lost, done twice or mixed in; one run at a time writes to it, whole files."""

import errno
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import scheduled
from grasptrack.cli.main import main
from grasptrack.errors import InputError
from grasptrack.files import hold_folder, whole_file
from grasptrack_bench import run_folder as module
from grasptrack_bench.run_folder import Filled, Job, case_file, fill_run_folder
from grasptrack_bench.schedule import Scheduler, create_scheduler
from recordings import plates, rows


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


pytest.importorskip("fcntl", reason="locks of this kind are Unix's")

HOLDER = """
import sys, time
from pathlib import Path
from grasptrack.files import hold_folder
with hold_folder(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def held_elsewhere(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that holds the folder "out"."""
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        yield process
        process.kill()


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "asked",
    [
        ["track", "{images}"],
        ["demo", "--frames", "2"],
        ["servo", "--trials", "1"],
        ["servo"],
        ["evaluate", "scenes", "--frames", "4"],
    ],
    ids=" ".join,
)
def test_a_second_run_is_refused_and_changes_nothing(
    asked: list[str], tmp_path: Path, held_elsewhere: subprocess.Popen[str], capsys: pytest.CaptureFixture[str]
) -> None:
    images, out = plates(tmp_path / "in", 2), tmp_path / "out"
    (out / "grasps.csv").write_text("of the first")
    before = sorted(path.name for path in out.iterdir())
    given = [word.format(images=images) for word in asked]
    assert main([*given, "--output", str(out)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and f'another run writes to "{out}" now' in told
    assert sorted(path.name for path in out.iterdir()) == before and (out / "grasps.csv").read_text() == "of the first"


def test_the_lock_ends_with_the_process_and_leaves_nothing(
    tmp_path: Path, held_elsewhere: subprocess.Popen[str]
) -> None:
    out = tmp_path / "out"
    with pytest.raises(InputError, match="another run writes"), hold_folder(out):
        pass
    held_elsewhere.kill()
    held_elsewhere.wait()
    assert list(out.iterdir()) == []
    assert main(["track", str(plates(tmp_path / "in", 2)), "--output", str(out), "--no-video", "--quiet"]) == 0
    assert len(rows(out)) == 2


def test_it_may_be_held_again_within_but_not_in_another_thread(tmp_path: Path) -> None:
    refused: list[str] = []

    def hold() -> None:
        try:
            with hold_folder(tmp_path):
                pass
        except InputError as error:
            refused.append(str(error))

    with hold_folder(tmp_path), hold_folder(tmp_path / "." / "other" / ".."):
        thread = threading.Thread(target=hold)
        thread.start()
        thread.join()
    assert len(refused) == 1
    hold()
    assert len(refused) == 1


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS])
def test_a_full_disk_is_told_in_a_line_and_other_errors_stay(tmp_path: Path, number: int) -> None:
    with pytest.raises(InputError, match="cannot be written"), hold_folder(tmp_path):
        raise OSError(number, "so it is")
    with pytest.raises(ConnectionResetError), hold_folder(tmp_path):
        raise ConnectionResetError(errno.ECONNRESET, "gone")


def test_a_file_is_replaced_when_all_of_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with whole_file(path) as part:
        part.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    for error in (KeyboardInterrupt(), OSError(errno.ENOSPC, "full")):
        with pytest.raises(type(error)), whole_file(path) as part:
            part.write_text("half")
            raise error
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]
    assert error.filename == str(path)
