# SPDX-License-Identifier: Apache-2.0
"""The command line: what it writes, what it says, and how fast it answers."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from grasptrack.cli.advice import BackgroundVerdict
from grasptrack.cli.main import main
from grasptrack.files import hold_folder
from grasptrack.io.columns import csv_columns
from recordings import plate, plates, rows, write

ENDINGS = [signal.SIGINT, signal.SIGTERM]
if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # nohup has these tests ignore it, too
    ENDINGS.append(signal.SIGHUP)


def test_the_hand_decides_which_grasp_is_tracked(tmp_path: Path) -> None:
    folder, out = plates(tmp_path / "in", 2), tmp_path / "out"
    given = ["track", str(folder), "--output", str(out), "-q", "--no-video"]
    openings = []
    for more in (["--max-opening", "20mm", "--scale", "4"], ["--min-opening", "110", "--finger-width", "5%"]):
        assert main([*given, *more]) == 0
        first = rows(out)[0]
        openings.append(math.dist(*((float(first[f"x{i}"]), float(first[f"y{i}"])) for i in (1, 2))))
    assert openings[0] <= 80.0 and openings[1] >= 110.0
    asked = json.loads((out / "run.json").read_text())["options"]
    assert (asked["min_opening"], asked["max_opening"], asked["finger_width"]) == ("110", None, "5%")
    contacts = " ".join(f"{first[f'x{i}']},{first[f'y{i}']}" for i in (1, 2))
    assert main([*given, "--grasp", contacts, "--max-opening", "80"]) == 2
    assert main([*given, "--grasp", contacts, "--max-opening", "80", "--resynthesize"]) == 0


def test_without_a_grasp_every_frame_says_why(tmp_path: Path) -> None:
    given = ["track", str(plates(tmp_path / "in", 2)), "--output", str(tmp_path / "out"), "-q", "--no-video"]
    assert main([*given, "--max-opening", "9"]) == 2
    found = rows(tmp_path / "out")
    assert [r["status"] for r in found] == ["searching"] * 2
    assert all(r["reason"].startswith("no stable grasp: too wide for the opening of 9 px: the narrow") for r in found)


@pytest.mark.whole("write_summary")
def test_track_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["track", str(plates(tmp_path / "in")), "--output", str(out), "--fps", "20"]) == 0
    said = capsys.readouterr()
    assert said.err == "" and re.search(r"tracked +8 +100", said.out) and "99th percentile" in said.out
    assert sorted(p.name for p in out.iterdir()) == ["grasps.csv", "overlay.mp4", "run.json", "summary.png"]
    assert (out / "grasps.csv").read_text().splitlines()[0] == ",".join(csv_columns(2))
    found = rows(out)
    assert [r["status"] for r in found] == ["tracked"] * 8 and [r["grasp_id"] for r in found] == ["1"] * 8
    np.testing.assert_allclose([float(r["time_s"]) for r in found], np.arange(8) / 20)
    options = json.loads((out / "run.json").read_text())["options"]
    assert options["strategy"] == "auto" and options["fps"] == 20 and options["friction"] == 0.5


VERDICT = (
    r"(GOOD|FAIR|POOR)\. Expected: located in \d+ to \d+ % of frames, contacts [^\n]+ off \(95 %\)(\nTo mind: [^\n]+)?"
)


@pytest.mark.slow
def test_the_verdict_comes_first_and_is_that_of_inspect(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = plates(tmp_path / "in", 3), ["--output", str(tmp_path / "out")]
    assert main(["track", str(folder), *out, "--no-video"]) == 0
    said = re.match(rf"{VERDICT}\n(?= *frames )", capsys.readouterr().out)
    assert said
    assert main(["inspect", str(folder / "000.png"), *out]) == 0
    told = " ".join(capsys.readouterr().out.split())
    level, expected, *mind = said[0].replace(". Expected: ", "\n").splitlines()
    assert told.startswith(f"{level},") and f"Expected: {expected}" in told
    assert all(line.removeprefix("To mind: ").partition(" (")[0] in told for line in mind)


def test_a_run_of_one_image_and_lines_of_json_have_no_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, given = plates(tmp_path / "in", 2), ["--output", str(tmp_path / "out"), "--no-video"]
    assert main(["track", str(folder / "000.png"), *given]) == 0
    assert "Expected" not in capsys.readouterr().out
    assert main(["track", str(folder), *given, "--jsonl", "-"]) == 0
    assert [json.loads(line)["status"] for line in capsys.readouterr().out.splitlines()] == ["tracked"] * 2


def test_a_verdict_that_is_not_wanted_ends_early(monkeypatch: pytest.MonkeyPatch) -> None:
    from grasptrack import trackability
    from grasptrack.tracking.tracker import GraspTracker

    tracker, begun, drawn = GraspTracker(), threading.Event(), list[int]()
    tracker.update(plate())
    assert tracker.first_scene is not None
    wanted = threading.Event()

    def slow(*given: object, check: Callable[[], None], **_: object) -> None:
        for i in range(1000):
            check()
            drawn.append(i)
            begun.set()
            wanted.wait(0.01)

    monkeypatch.setattr(trackability, "inspect_scene", slow)
    with BackgroundVerdict() as verdict:
        verdict.begin(tracker.first_scene)
        assert begun.wait(10) and verdict.take_lines() == []
    assert not any(t.name == "grasptrack-verdict" for t in threading.enumerate())
    assert len(drawn) < 1000 and verdict.take_lines() == []


def test_a_verdict_that_breaks_off_is_told_and_ends_no_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from grasptrack import trackability

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("of ours")

    monkeypatch.setattr(trackability, "inspect_scene", broken)
    given = ["track", str(plates(tmp_path / "in", 2)), "--output", str(tmp_path / "out"), "--no-video"]
    assert main(given) == 0
    assert "is not known: internal error, ZeroDivisionError: of ours\n" in capsys.readouterr().out


def test_quiet_says_nothing_and_no_video_writes_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["track", str(plates(tmp_path / "in", 3)), "--output", str(tmp_path / "out"), "--quiet", "--no-video"]
    assert main(given) == 0
    assert capsys.readouterr() == ("", "")
    assert not (tmp_path / "out" / "overlay.mp4").exists() and len(rows(tmp_path / "out")) == 3
    assert rows(tmp_path / "out")[0]["time_s"] == ""


def test_given_contacts_are_kept_in_their_order(tmp_path: Path) -> None:
    folder, out = plates(tmp_path / "in", 3), tmp_path / "out"
    assert main(["track", str(folder), "--output", str(out), "-q", "--no-video"]) == 0
    first = rows(out)[0]
    swapped = f"{first['x2']},{first['y2']} {first['x1']},{first['y1']}"
    assert main(["track", str(folder), "--output", str(out), "-q", "--no-video", "--grasp", swapped]) == 0
    again = rows(out)[0]
    for name, other in (("x1", "x2"), ("y1", "y2"), ("x2", "x1"), ("y2", "y1")):
        assert float(again[name]) == pytest.approx(float(first[other]), abs=0.01)


def test_masks_take_the_place_of_segmentation(tmp_path: Path) -> None:
    folder, out = plates(tmp_path / "in", 3), tmp_path / "out"
    (tmp_path / "masks").mkdir()
    for path in sorted(folder.iterdir()):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        write(tmp_path / "masks" / path.name, np.where(image < 130, np.uint8(1), np.uint8(0)))
        write(path, np.full_like(image, 128))  # nothing to be seen in the images themselves
    given = ["track", str(folder), "--output", str(out), "-q", "--no-video", "--masks", str(tmp_path / "masks")]
    assert main(given) == 0
    assert [r["status"] for r in rows(out)] == ["tracked"] * 3


def test_lost_after_the_start_is_done_all_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = plates(tmp_path / "in", 1), tmp_path / "out"
    for i in (1, 2):
        write(folder / f"00{i}.png", np.full((240, 320), 200, np.uint8))
    assert main(["track", str(folder), "--output", str(out), "--no-video"]) == 0
    assert [r["status"] for r in rows(out)] == ["tracked", "lost", "lost"]
    assert all(r["x1"] == "" and r["reason"] for r in rows(out)[1:])
    assert "lost" in capsys.readouterr().out


@pytest.mark.whole
def test_transfer_shows_every_strategy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, second = write(tmp_path / "a.png", plate()), write(tmp_path / "b.png", plate((150.0, 125.0), 0.35))
    assert main(["transfer", str(first), str(second), "--output", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert all(name in said.out for name in ("rrp", "grasp-line", "homography")) and said.err == ""
    assert cv2.imread(str(tmp_path / "out" / "transfer.png")) is not None


def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--frames", "2", "--output", str(tmp_path), "--no-video"]) == 0
    said = capsys.readouterr().out
    for strategy in ("auto", "rrp", "grasp-line", "homography"):
        assert strategy in said and len(rows(tmp_path / strategy)) == 2
    first, *_, last = said.strip().splitlines()
    assert "2 frames" in first and "4 strategies" in first and first.endswith(" s.")
    assert last.startswith("Open ") and Path(last.removeprefix("Open ").removesuffix(".")).is_file()


def test_version_names_the_backend_and_its_build(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    build = r"native, (abi3|cp\d+), \w+ \S.*"
    beneath = rf"Python \S+, NumPy {re.escape(np.__version__)}, OpenCV {re.escape(cv2.__version__)}"
    assert re.fullmatch(rf"grasptrack \S+ \(backend {build}; {beneath}\)\n", capsys.readouterr().out)


@pytest.mark.parametrize("given", [["--help"], ["-h"], ["synthesize", "-h"]])
def test_help_has_examples(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(given) == 0
    assert "Examples:\n  " in re.sub(r"\n +", "\n  ", capsys.readouterr().out)


HEAVY = {"av", "cv2", "distributed", "matplotlib", "mujoco", "numpy", "scipy"}
VERBS = (
    "",
    "synthesize",
    "inspect",
    "track",
    "transfer",
    "demo",
    "servo",
    "pick",
    "evaluate",
    "evaluate scenes",
    "compare",
)


def test_the_start_loads_nothing_heavy() -> None:
    code = f"""
import sys
def loaded(heavy):
    return sorted({{m.split('.')[0] for m in sys.modules}} & heavy)
import grasptrack
found = [loaded({HEAVY} | {{"typer", "rich"}})]
from grasptrack.cli.main import main
for verb in {VERBS}:
    main([*verb.split(), "--help"])
    found.append(loaded({HEAVY}))
print(found)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == str([[]] * (1 + len(VERBS)))


@pytest.mark.parametrize("how", [number.name for number in ENDINGS])
def test_an_interrupted_process_is_not_taken_down_piece_by_piece(how: str) -> None:
    code = f"""
import atexit, os, signal, sys
from grasptrack.cli import main
def strike(*_, **__):
    print("so far")
    os.kill(os.getpid(), signal.{how})
main.app = strike
atexit.register(print, "torn down")
sys.argv = ["grasptrack", "doctor"]
sys.exit(main.main())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "so far\n", "grasptrack: interrupted\n")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("how", [number.name for number in ENDINGS])
def test_a_signal_after_the_work_leaves_its_status(how: str) -> None:
    code = f"""
import atexit, os, signal, sys
atexit.register(lambda: os.kill(os.getpid(), signal.{how}))
from grasptrack.cli.main import main
sys.argv = ["grasptrack", "track", "nowhere.png"]
sys.exit(main())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.count("\n") == 1


@pytest.mark.parametrize("number", ENDINGS)
def test_a_signal_while_python_takes_itself_down_leaves_the_status(number: signal.Signals) -> None:
    """Python gives its handlers back before it destroys its modules, and a signal would kill."""
    code = """
import os, sys, time
from grasptrack.cli.terminal import end_process

class Slow:
    def __del__(self, write=os.write, sleep=time.sleep):
        write(1, b"x")
        sleep(1.0)

slow = Slow()
end_process(3)
sys.exit(3)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.read(1) == b"x"
        process.send_signal(number)
        assert process.wait(30.0) == 3


def test_a_search_that_nobody_waits_for_does_not_make_the_end_an_abort() -> None:
    code = """
import threading, time
import numpy as np
import grasptrack as gt
from grasptrack.cli.terminal import end_process

image = np.random.default_rng(0).integers(0, 255, (400, 600), np.uint8)

def search():
    while True:
        try:
            gt.first_look(image)
        except gt.GraspTrackError:
            pass
        begun.set()

begun = threading.Event()
threading.Thread(target=search, daemon=True).start()
begun.wait()
end_process(0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


ODD_NAMES = ("a\x1b[31m\x1b]0;owned\x07.png", "b\x9b2J\u202egnp.png", os.fsdecode(b"c\xff.png"), "d" * 200 + ".png")


@pytest.mark.parametrize("name", ODD_NAMES)
def test_what_a_file_is_called_reaches_no_terminal_as_a_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    monkeypatch.chdir(plates(tmp_path / "in", 2))
    Path("000.png").rename(name)
    (tmp_path / "out").mkdir()
    for verb in (["track", name, "--no-video"], ["inspect", name, "--runs", "1", "--json"], ["synthesize", name]):
        assert main([*verb, "--output", str(tmp_path / "out" / name)]) == 0, verb
    for verb in (["transfer", name, name + "none"], ["track", name, "--masks", name]):
        assert main([*verb, "--output", str(tmp_path / "out" / name)]) == 2, verb
    for said in capfd.readouterr():
        assert said and all(line.isprintable() for line in said.splitlines())
    for path in (tmp_path / "out" / name).glob("*.json"):
        assert "\x9b" not in path.read_text(encoding="utf-8") and json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.whole
def test_every_page_is_drawn_whatever_a_file_is_called(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(plates(tmp_path / "in", 2))
    name, pages = os.fsdecode(b"c\xff $\\q$.png"), {"track": "summary", "inspect": "inspect", "synthesize": "grasps"}
    Path("000.png").rename(name)
    for verb, page in pages.items():
        assert main([verb, name, "--quiet", "--output", verb]) == 0, verb
        assert Path(verb, f"{page}.png").is_file()
    assert main(["transfer", name, "001.png", "--quiet", "--output", "transfer"]) == 0
    assert Path("transfer", "transfer.png").is_file()


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no /dev/zero here")
@pytest.mark.parametrize("option", ["--ignore", "--background", "--camera", "--masks"])
def test_what_has_no_end_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str) -> None:
    image = plates(tmp_path / "in", 1) / "000.png"
    assert main(["track", str(image), option, "/dev/zero", "--output", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "/dev/zero" in said and said.count("\n") == 1


@pytest.mark.sampled(1)
@pytest.mark.parametrize("verb", ["synthesize", "inspect", "transfer"])
def test_two_runs_do_not_write_to_one_folder(tmp_path: Path, verb: str) -> None:
    images = [str(path) for path in sorted(plates(tmp_path / "in", 2).iterdir())]
    command = [verb, *images[: 1 + (verb == "transfer")], "--output", str(tmp_path / "out")]
    with hold_folder(tmp_path / "out"):
        done = subprocess.run([sys.executable, "-m", "grasptrack.cli.main", *command], capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "another run writes to" in done.stderr
    assert main(command) == 0


def test_a_message_is_one_line_that_fits(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["track", "nothing.png", "--strategy", "x" * 4000 + "\x1b\n"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and len(said) <= 301 and said[:-1].isprintable()
    assert said.startswith("grasptrack: ") and "xxx ... xxx" in said


@pytest.mark.parametrize("number", ENDINGS)
def test_a_signal_that_c_code_makes_another_error_of_is_an_interruption(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A module that is being loaded ends so: "initialization failed"."""

    def load() -> str:
        try:
            os.kill(os.getpid(), number)
            time.sleep(1.0)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None
        return ""

    monkeypatch.setattr("grasptrack.nets.models.models_folder", load)
    assert main(["models"]) == 130
    assert capsys.readouterr().err == "grasptrack: interrupted\n"


@pytest.mark.parametrize("strategy", ["auto", "homography"])
def test_the_summary_is_titled_by_source_and_strategy(
    strategy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from grasptrack.view import summary

    titles: list[str] = []
    monkeypatch.setattr(summary, "write_summary", lambda *_, title: titles.append(title))
    given = ["track", str(plates(tmp_path / "in", 2)), "--output", str(tmp_path / "out"), "-q", "--no-video"]
    assert main([*given, "--strategy", strategy]) == 0
    assert titles == [f"in, by {strategy}"]
