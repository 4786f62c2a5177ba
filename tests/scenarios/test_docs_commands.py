# SPDX-License-Identifier: Apache-2.0
"""Every command that README, CONTRIBUTING and docs name is understood as it stands, and runs in a short form.

The pages' own file names are laid out in a folder (`workspace`), so that commands find `video.mp4` or `photo.jpg`; the
tables below say which options make a command short. A command that no table knows fails.
"""

import csv
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

from grasptrack.cli.main import main, run_app
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.io.video import VideoWriter
from program import whole_program
from research.paper.__main__ import app as paper

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
DATA = Path(os.environ.get("GRASPTRACK_DATA", ROOT.parent / "shared" / "data"))
PROGRAMS = ("grasptrack", "python", "python3", "pip", "make", "dask")

# Options that are set, in the place of a page's own value or beside what it gives; a flag has the value "".
SHORT: dict[str, dict[str, str]] = {
    "synthesize": {},
    "inspect": {"--runs": "1"},
    "track": {"--no-video": ""},
    "live": {"--start": "", "--until-end": "", "--port": "0"},
    "transfer": {},
    "teach": {"--output": "taught.part"},
    "find": {"--part": "flange.part"},
    "parts": {},
    "demo": {"--frames": "2", "--no-video": ""},
    "servo": {"--no-video": "", "--shape": "bracket"},
    "pick": {"--shape": "bracket", "--parts": "1"},
    "evaluate scenes": {"--shapes": "bracket", "--disturbances": "clean-4dof", "--frames": "2", "--workers": "1"},
    "evaluate real": {"--workers": "1"},
    "evaluate pot": {"--workers": "1"},
    "compare": {},
    "cameras": {},
    "models": {},
    "doctor": {},
    "models get": {},
}
FEWER = {
    "--trials": "1",
    "--trays": "1",
    "--repeats": "1",
    "--runs": "1",
    "--shape": "bracket",
}  # wherever a page gives them
LEFT_OUT = ("--output", "--seed")
"""Options whose value makes no other command, wherever a page gives them."""
DROPPED = {
    "--silhouettes": ("--shapes", "--shape"),
    "--trials": ("--no-video",),
    "--scheduler": ("--workers",),
}  # by an option of the page
WORDS = {"SOURCE": "photos", "IMAGE": "photo.jpg", "IMAGE_A": "a.png", "IMAGE_B": "b.png", "A": "old", "B": "new"}
WORDS |= {"N": "1", "MU": "0.5", "camera:0": "video.mp4", "/tmp/demo": "demo"}
WORDS |= {"tcp://0.0.0.0:5555": "0", "tcp://0.0.0.0:5555?format=fixed&rate=20": "0?format=fixed&rate=20"}
WORDS |= {"tcp://host:8786": "tcp://127.0.0.1:8786", "POT": "videos"}
NOT_HERE = {"camera:0?size=1280x720&fps=30", "pylon:40012345", "u2netp", "NAME", "sim:", "sim:spanner"}
"""Words of commands that want a camera, a model or a name, or never end: they are parsed, and not run."""
FOLDERS = {"--silhouettes": "shapes", "--folder": "shapes", "--data": "data", "--real": "videos"}
ELSEWHERE = {
    "pip install .": ".ci/run builds a wheel and installs it",
    "pip install --no-deps .": "the same without dependencies",
    "grasptrack models get u2netp": "downloads; tests/scenarios/test_first_look_hints.py does so on this machine",
    "python -m research.archive": "tests/laws/test_paper_archive.py runs it with few frames",
    "pip check": "pip's own",
    "pip install --no-binary av av": "builds FFmpeg's bindings from source",
    "python tests/slow/golden.py --write": "writes a file of the repository; tests/slow/test_golden.py runs the rest",
    "python tests/fuzz/servo_calls.py --count 10000 --real 250 --seed 21": "tests/slow/test_fuzz.py runs some of it",
    "python tests/helpers/setup_errors.py": "tests/slow/test_servo_setups.py runs all of it",
    "python tests/helpers/written_pages.py": "writes files of the repository; tests/scenarios/test_docs.py compares them",
    "python tests/helpers/frozen.py": "tests/slow/test_golden.py runs it",
    "grasptrack teach IMAGE '[options]'": "a synopsis: --name and --output have no default",
    "grasptrack find IMAGE '[options]'": "a synopsis: --part has no default",
    "python3 -m venv fresh": ".ci/run makes one",
    "fresh/bin/pip install .": ".ci/run builds a wheel and installs it",
}


def documented() -> list[str]:
    """Each command once, comments, prompts and the path of the environment taken off."""
    found: dict[str, None] = {}
    for page in PAGES:
        text = re.sub(r"<!--.*?-->", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for block in re.findall(r"^```(?:sh|bash|console)\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL):
            for line in block.replace("\\\n", " ").splitlines():
                for part in line.split("&&"):
                    words = shlex.split(part.rstrip("& "), comments=True)
                    if words:
                        found[shlex.join(words).replace(".venv/bin/", "")] = None
        prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
        for quoted in re.findall(r"`([^`]+)`", prose):
            words = quoted.replace(".venv/bin/", "").split()
            placeholder = any(re.search(r"\b(VERB|NAME)$", word) for word in words[:3])
            if len(words) > 1 and words[0] in PROGRAMS and not placeholder:
                found[shlex.join(shlex.split(" ".join(words)))] = None
    return list(found)


def split(command: str) -> tuple[dict[str, str], list[str]]:
    """Settings of the environment before a command, and its words without the placeholder of a synopsis."""
    words = [w for w in shlex.split(command) if w != "[options]"]
    given = {}
    while "=" in words[0]:
        name, _, value = words.pop(0).partition("=")
        given[name] = value
    return given, words


def verb_of(words: list[str]) -> tuple[str, list[str]]:
    """The verb of the command line, and what follows it."""
    count = 2 if words[1:2] == ["evaluate"] or words[1:3] == ["models", "get"] else 1
    return " ".join(words[1 : 1 + count]), words[1 + count :]


def set_option(words: list[str], name: str, value: str) -> list[str]:
    if name in words:
        at = words.index(name) + 1
        return [*words[:at], value, *words[at + 1 :]] if value else words
    return [*words, name, *([value] if value else [])]


def shortened(words: list[str], options: dict[str, str]) -> list[str]:
    """The words with metavariables filled in and long options made short."""
    out: list[str] = []
    for before, word in zip(["", *words], words, strict=False):
        if word in LEFT_OUT or before in LEFT_OUT:
            continue
        out.append(FOLDERS.get(before, "videos") if word == "DIR" else WORDS.get(word, word))
    ruled_out = {o for given, others in DROPPED.items() if given in words for o in others}
    for name, value in options.items():
        if name not in ruled_out:
            out = set_option(out, name, value)
    for name, value in FEWER.items():
        if name in words:
            out = set_option(out, name, value)
    return out


def cases() -> list[object]:
    """What is run: (environment, words) of each short form once."""
    seen: dict[str, object] = {}
    for command in documented():
        environment, words = split(command)
        if command in ELSEWHERE or NOT_HERE.intersection(words):
            continue
        if words[0] != "grasptrack" or words[1].startswith("-"):
            continue
        kind, rest = verb_of(words)
        if kind not in SHORT or (not rest and needs_arguments(kind)):
            continue  # unknown ones fail below; a verb's bare name in running text is no command
        short = ["grasptrack", *kind.split(), *shortened(rest, SHORT[kind])]
        name = " ".join([*(f"{key}={value}" for key, value in environment.items()), shlex.join(short)])
        seen[" ".join(sorted([*environment, *short]))] = pytest.param(environment, short, id=name)
    return list(seen.values())


def command_of(verb: str) -> typer.core.TyperCommand:
    found = whole_program()
    for name in verb.split():
        found = found.commands[name]  # type: ignore[attr-defined]
    return found  # type: ignore[return-value]


def needs_arguments(verb: str) -> bool:
    return any(p.param_type_name == "argument" and p.required for p in command_of(verb).params)


# --- as they stand -------------------------------------------------------------------------------


@pytest.mark.sampled(37)
@pytest.mark.parametrize("command", documented())
def test_every_command_is_known(command: str) -> None:
    """As it stands: verbs, options and values by the program's own parser, scripts, targets of make, extras of pip."""
    if command in ELSEWHERE:
        return
    _, words = split(command)
    if words[0] == "grasptrack":
        if words[1:] in (["--version"], ["--help"]):
            return
        verb, rest = verb_of(words)
        assert verb in SHORT, "no such verb in the table above"
        if rest:
            filled = [{"N": "1", "P": "0.5"}.get(word, word) for word in rest]
            command_of(verb).make_context(verb, filled)
    elif words[:3] == ["python", "-m", "research.paper"]:
        typer.main.get_command(paper).make_context("paper", words[3:])
    elif study := re.match(r"python -m research\.studies\.(\w+)", " ".join(words)):
        # tests/slow/test_studies.py runs each
        files = [ROOT / "research" / "studies" / f"{name}.py" for name in (study[1], "common")]
        shown = "".join(file.read_text(encoding="utf-8") for file in files)
        options = {w for w in words if w.startswith("--")}
        # with a default alone they are arguments of `create_parser`
        by_default = " ".join(re.findall(r"create_parser\((.*?)\n    \w", shown, re.DOTALL))
        known = {o for o in options if f'"{o}"' in shown or re.search(rf"\b{o[2:]}=", by_default)}
        assert options == known, "unknown options"
    elif words[0] == "make":
        subprocess.run(["make", "-n", *words[1:]], cwd=ROOT, check=True, capture_output=True)
    elif words[0] == "pip":
        optional = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        for extra in re.findall(r"\.\[(\w+)\]", command):
            assert extra in optional["optional-dependencies"]
        named = {word for word in words if ">=" in word}
        assert not named or named == {d for d in optional["dependencies"] if not d.startswith("opencv")}
    else:
        assert words[0] == "dask", "a command that no table knows"


def test_what_is_documented_without_options_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """As `python -m research.paper`: only the program of many verbs answers with the first steps."""
    ran, alone = [], typer.Typer()
    alone.command()(lambda: ran.append(True))
    assert run_app(alone, [], "alone") == 0 and ran
    assert main([]) == 0 and "grasptrack demo" in capsys.readouterr().out


def test_the_tables_name_nothing_that_is_gone() -> None:
    told = set(documented())
    assert {c for c in ELSEWHERE if c not in told} == set()


# --- in a short form -----------------------------------------------------------------------------


CORNERS = np.array([[100, 99], [440, 110], [430, 180], [350, 200], [430, 215], [425, 300], [310, 308], [100, 308]])
"""Of a plate at px that the pages name: contacts at 193,308 and 157,99, the object at 320,240 and at 300,250."""


def motion(i: int) -> np.ndarray:
    """(3, 3) px of frame 0 to px of frame i."""
    return similarity_transform(1.0, 0.01 * i, (270.0, 200.0), (270.0 + i, 200.0 + i))


def frame(i: int) -> np.ndarray:
    """(480, 640, 3) the plate in frame i, dark on light."""
    image = np.full((480, 640), 210, np.uint8)
    moved = np.rint(apply_homography(motion(i), CORNERS.astype(float)) * 16).astype(np.int32)
    cv2.fillPoly(image, [moved], (50,), cv2.LINE_AA, 4)
    for x, y, radius in ((150, 250, 12), (220, 150, 18), (270, 230, 9)):
        (u, v), *_ = apply_homography(motion(i), np.array([[x, y]], dtype=float)).tolist()
        cv2.circle(image, (round(16 * u), round(16 * v)), 16 * radius, (90,), cv2.FILLED, cv2.LINE_AA, 4)
    return np.dstack([cv2.GaussianBlur(image, (0, 0), 0.8)] * 3)


def write_frames(folder: Path, count: int) -> None:
    folder.mkdir(parents=True)
    for i in range(count):
        cv2.imwrite(str(folder / f"{i:03d}.png"), frame(i))


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the pages' commands name, small."""
    home = tmp_path_factory.mktemp("documented")
    for folder, count in (("photos", 4), ("images", 3), ("videos/film", 4), ("videos/other", 4), ("videos/V24_7", 8)):
        write_frames(home / folder, count)
    for name in ("film", "other"):
        with (home / "videos" / f"{name}.homographies.csv").open("w", newline="") as file:
            table = csv.writer(file)
            table.writerow(["frame", *(f"h{i}{j}" for i in "123" for j in "123")])
            table.writerows([i, *motion(i).ravel()] for i in range(4))
    quad = "100,99 440,110 425,300 100,308"
    scenes = "".join(f'{name},"320,200","{quad}"\n' for name in ("film", "other"))
    (home / "videos" / "scenes.csv").write_text(f"name,object,quad\n{scenes}")
    corners = np.array([point.split(",") for point in quad.split()], dtype=float)
    rows = [apply_homography(motion(i), corners).ravel() for i in range(8)]
    np.savetxt(home / "videos" / "V24_7_gt_points.txt", rows)
    for name, i in (("photo.jpg", 0), ("a.png", 0), ("b.png", 8)):
        cv2.imwrite(str(home / name), frame(i))
    silhouette = np.where(frame(0)[..., 0] < 130, 255, 0).astype(np.uint8)
    cv2.imwrite(str(home / "mask.png"), silhouette)
    cv2.imwrite(str(home / "fingers.png"), np.pad(np.full((40, 40), 255, np.uint8), ((440, 0), (600, 0))))
    cv2.imwrite(str(home / "tray.jpg"), frame(3))
    taught = ["teach", str(home / "photo.jpg"), "--object", "320,240", "--name", "flange", "--quiet", "--output"]
    assert main([*taught, str(home / "flange.part")]) == 0
    (home / "shelf").mkdir()
    for place in ("shelf", "videos"):
        shutil.copy(home / "flange.part", home / place)
    hook = np.full((240, 320, 3), 210, np.uint8)
    cv2.fillPoly(hook, [np.array([[60, 60], [250, 70], [240, 180], [200, 180], [200, 110], [60, 100]])], (50, 50, 50))
    cv2.imwrite(str(home / "hook.png"), cv2.GaussianBlur(hook, (0, 0), 0.8))
    taught = ["teach", str(home / "hook.png"), "--name", "hook", "--quiet", "--output", str(home / "hook.part")]
    assert main(taught) == 0
    (home / "shapes").mkdir()
    cv2.imwrite(str(home / "shapes" / "plate-1.png"), silhouette)
    (home / "camera.yaml").write_text(
        "image_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\n"
        "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [600.0, 0.0, 319.5, 0.0, 600.0, 239.5, 0.0, 0.0, 1.0]\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.1, 0.0, 0.0, 0.0, 0.0]\n"
    )
    (home / "mine.json").write_bytes((ROOT / "src/grasptrack/tracking/numbers.json").read_bytes())
    writer = VideoWriter(home / "video.mp4", 25.0)
    for i in range(4):
        writer.write(frame(i))
    writer.close()
    options = ["--shapes", "bracket", "--disturbances", "clean-4dof", "--frames", "3", "--methods", "auto"]
    first = home / "old"
    assert main(["evaluate", "scenes", *options, "--workers", "1", "--quiet", "--output", str(first)]) == 0
    for name in ("grasptrack-out/evaluate-scenes", "new"):
        shutil.copytree(first, home / name)
    if DATA.is_dir():
        (home / "data").symlink_to(DATA)
    return home


@pytest.fixture
def here(workspace: Path, tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder with links to those files of the workspace that the command reads, but not to what it writes."""
    words = request.node.callspec.params["words"]
    if "data" in words:
        if not DATA.is_dir():
            pytest.skip(f"no real data in {DATA}; set GRASPTRACK_DATA")
        monkeypatch.setenv("GRASPTRACK_DATA", str(DATA))
    written = {words[i + 1] for i, word in enumerate(words[:-1]) if word in ("--output", "--pictures", "--write")}
    read = [*words, *request.node.callspec.params["environment"].values()]
    for word in {w.split("/")[0] for w in read} - written:
        if (workspace / word).exists():
            (tmp_path / word).symlink_to(workspace / word)
    for name in written:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def start_cluster(folder: Path) -> tuple[str, list[subprocess.Popen[bytes]]]:
    """The two commands of docs/evaluation.md that start a Dask cluster, on a free port."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address, started = f"tcp://127.0.0.1:{port}", []
    for command in (c for c in documented() if c.startswith("dask ")):
        words = [address if w.startswith("tcp:") else w for w in shlex.split(command)[1:]]
        if words[0] == "scheduler":
            words += ["--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
        else:
            words[words.index("--nworkers") + 1] = "1"
            time.sleep(2)
        given = [sys.executable, "-m", "dask", *words]
        started.append(subprocess.Popen(given, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
    return address, started


@pytest.mark.slow
@pytest.mark.brief
@pytest.mark.parametrize(("environment", "words"), cases())
def test_a_short_form_runs(
    environment: dict[str, str],
    words: list[str],
    here: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """In this process, but for what is read once when the program is loaded."""
    cluster: list[subprocess.Popen[bytes]] = []
    if "--scheduler" in words:
        pytest.importorskip("distributed")
        address, cluster = start_cluster(here)
        words = set_option(words, "--scheduler", address)
    try:
        if environment:
            run = [sys.executable, "-m", "grasptrack.cli.main", *words[1:]]
            status = subprocess.run(run, env=os.environ | environment, check=False).returncode
        else:
            status = main(words[1:])
    finally:
        for process in reversed(cluster):
            process.terminate()
        for process in cluster:
            process.wait(20)
    told = capfd.readouterr()
    assert status == 0, f"{shlex.join(words)}\n{told.out[-500:]}{told.err[-800:]}"
