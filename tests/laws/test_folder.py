# SPDX-License-Identifier: Apache-2.0
"""The folder of a run is held by one run at a time, however that ends, and a file in it is whole at any moment."""

import errno
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from grasptrack.cli.main import main
from grasptrack.errors import InputError
from grasptrack.files import hold_folder, whole_file
from recordings import plates, rows

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
