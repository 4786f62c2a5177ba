# SPDX-License-Identifier: Apache-2.0
"""Every study and notebook runs to its end in its smallest setting, and an evaluation on a cluster that loses a worker."""

import os
import signal
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.cli.main import main
from grasptrack_bench.simulation import SHAPES, Scene, similarity_path
from research import studies
from research.studies import common
from test_cli_evaluate import scored

TITLES = st.lists(st.text("abc xyz", min_size=1).map(str.strip).filter(bool), unique=True, min_size=1, max_size=5)
TEXTS = st.text("ab|\n- 12", min_size=1).map(str.strip).filter(bool)


SMALLEST = {
    "calibration": "--parts bracket --others key --disturbances clean-6dof --frames 6 --workers 1",
    "closure_probability": "--shapes bracket --draws 20 --grasps 1",
    "confidence": "RUN --picture PICTURE",
    "failures": "--shapes bracket --seeds 1 --frames 6 --picture PICTURE",
    "first_kinds": "--parts bracket",
    "first_look": "--data DATA --fit",
    "edge_loss": "--real DATA/videos",
    "returns": "--parts bracket --disturbances clean-6dof --repeats 1 --workers 1",
    "real_contours": "--data DATA --films film --frames 4",
    "publishing": "--frames 4 --rounds 1",
    "recording": "--frames 4 --rounds 1",
    "polygons": "--data DATA --fit",
    "first_outline": "--shapes bracket --kinds gap --frames 4",
    "gallery": "--sections Strategies --pictures DATA/gallery",
    "hand_motions": "--paths DATA/paths --frames 3 --every 1",
    "literature": "--shapes bracket --seeds 0 --frames 4",
    "live_page": "--frames 4 --blocks 1 --seconds 0.5 --viewers client",
    "loop": "--frames 4 --repeat 1 --long 0 --starts 1",
    "matching": "--shapes bracket --pairs 1 --cut 1 --images 1",
    "moved_photos": "--kinds twin,cover --frames 9 --each 30",
    "moving_picture": "--frames 4 --picture PICTURE",
    "plane": "--parts bracket --tilts 30",
    "precision_bound": "--shapes bracket --disturbances clean-4dof --frames 7",
    "reason_pictures": "--codes no-grasp,no-object --pictures DATA/reasons",
    "robot_page": "--seconds 1 --trials 1",
    "scene": "--seeds 1 --motions rest --surfaces equal --pictures DATA/scene",
    "segmentation": "--data DATA --pictures DATA/pictures",
    "steps": "--calls 8 --updates 8 --largest 1",
    "synthesis": "--silhouettes DATA/tools/masks --friction 0.3",
    "strategies": "--shapes bracket --frames 4",
    "thickness": "--parts bracket --thick 0.02 --workers 1",
    "trackability": "--parts bracket --disturbances clean-4dof --frames 12",
    "trays": "--seeds 1 --laid apart --pictures DATA/trays",
    "transfers": "--pairs 12 --points 60",
    "undistortion": "--frames 4 --shapes bracket --workers 1",
}


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A folder with one photo of a tool and its mask, and a film of a part with where it truly is."""
    for name in ("images", "masks"):
        (tmp_path / "tools" / name).mkdir(parents=True)
    frame = Scene(SHAPES["spanner"](), similarity_path(1), colour=True)[0]
    mask = np.zeros(frame.image.shape[:2], np.uint8)
    cv2.fillPoly(mask, [np.rint(p).astype(np.int32) for p in frame.outline], 255)
    cv2.imwrite(str(tmp_path / "tools" / "images" / "a.jpg"), frame.image)
    cv2.imwrite(str(tmp_path / "tools" / "masks" / "a.png"), mask)
    (tmp_path / "tools" / "index.csv").write_text("name,scene\na,table\n")
    (tmp_path / "videos").mkdir()
    filmed = Scene(SHAPES["bracket"](), similarity_path(4), colour=True)
    film = cv2.VideoWriter(str(tmp_path / "videos" / "film.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (640, 480))
    rows = ["frame," + ",".join(f"h{i}{j}" for i in "123" for j in "123")]
    for k in range(len(filmed)):
        film.write(filmed[k].image)
        rows.append(",".join(map(str, [k, *filmed.homography(k).ravel()])))
    film.release()
    (tmp_path / "videos" / "film.derived_homographies.csv").write_text("\n".join(rows))
    (tmp_path / "paths").mkdir()
    corners = np.array([[300.0, 200.0], [900.0, 210.0], [890.0, 600.0], [310.0, 590.0]])
    np.savetxt(tmp_path / "paths" / "V01_5_gt_points.txt", [(corners + 4.0 * k).ravel() for k in range(4)])
    np.savetxt(tmp_path / "paths" / "V01_5_flag.txt", np.zeros(4))
    return tmp_path


def test_every_study_has_a_smallest_setting() -> None:
    found = {path.stem for path in Path(studies.__path__[0]).glob("*.py")} - {"__init__", "common"}
    assert found == set(SMALLEST)


@pytest.mark.parametrize("name", sorted(SMALLEST))
def test_a_study_runs_and_writes_its_sections(
    name: str, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("GRASPTRACK_DATA", str(data))
    monkeypatch.setattr(common, "_sections", [])
    run, picture = tmp_path / "run", tmp_path / "reliability.png"
    if name == "confidence":
        scenes = "evaluate scenes --methods auto,klt --shapes bracket --disturbances clean-4dof --frames 4 --quiet"
        assert main([*scenes.split(), "--risk", "0.5", "--output", str(run)]) == 0
    given = SMALLEST[name].replace("RUN", str(run)).replace("PICTURE", str(picture)).replace("DATA", str(data))
    output = tmp_path / "results.md"
    monkeypatch.setattr(sys, "argv", [f"studies/{name}.py", *given.split(), "--output", str(output)])
    import_module(f"research.studies.{name}").main()
    assert "\n## " in output.read_text(encoding="utf-8") and capsys.readouterr().out
    assert picture.exists() == ("PICTURE" in SMALLEST[name])


@given(titles=TITLES, texts=st.lists(TEXTS, min_size=6, max_size=6), data=st.data())
def test_a_section_takes_the_place_of_its_old_self(
    tmp_path_factory: pytest.TempPathFactory, titles: list[str], texts: list[str], data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("results") / "R.md"
    for title, text in zip(titles, texts, strict=False):
        common.replace_section(path, title, text)
    before = path.read_text(encoding="utf-8")
    again = data.draw(st.integers(0, len(titles) - 1))
    common.replace_section(path, titles[again], texts[again])
    assert path.read_text(encoding="utf-8") == before
    common.replace_section(path, titles[again], texts[5])
    expected = [texts[5] if i == again else texts[i] for i in range(len(titles))]
    parts = "".join(f"\n\n## {title}\n\n{text}" for title, text in zip(titles, expected, strict=True))
    assert path.read_text(encoding="utf-8") == f"{common.PREFACE.strip()}{parts}\n"


def test_a_run_is_written_with_its_command_and_its_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(common, "_sections", [])
    monkeypatch.setattr(sys, "argv", ["studies/x.py", "--calls", "3"])
    common.begin_section("Title")
    common.add_paragraph("A sentence.")
    common.add_table(["call", "us"], [["a", 1234.5], ["b", float("nan")]])
    common.write_sections(None)
    assert list(tmp_path.iterdir()) == []
    common.write_sections(tmp_path / "R.md")
    text = (tmp_path / "R.md").read_text(encoding="utf-8")
    assert "## Title\n\n`python -m research.studies.x --calls 3`\n\n" in text
    assert text.endswith("A sentence.\n\n| call | us |\n| --- | ---: |\n| a | 1,234 |\n| b |  |\n")


NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "examples" / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run(notebook: Path) -> None:
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    content = nbformat.read(notebook, as_version=4)
    assert not any(cell.get("outputs") for cell in content.cells)
    client = nbclient.NotebookClient(content, timeout=120, resources={"metadata": {"path": notebook.parent}})
    done = client.execute()
    shown = [out.get("data", {}) for cell in done.cells for out in cell.get("outputs", [])]
    assert sum("image/png" in data for data in shown) >= 1


def test_there_are_five() -> None:
    assert len(NOTEBOOKS) == 5


def test_a_cluster_that_loses_a_worker_gives_the_same_to_the_last_digit(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    given = ["evaluate", "scenes", "--shapes", "bracket", "--disturbances", "noise,belt,bar,clip", "--frames", "6"]
    given += ["--methods", "homography,klt", "--output"]
    assert main([*given, str(tmp_path / "here"), "--quiet"]) == 0
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        given[-1:] = ["--scheduler", cluster.scheduler_address, "--output", str(tmp_path / "there")]
        command = [sys.executable, "-m", "grasptrack.cli.main", *given, "--quiet"]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        cases = tmp_path / "there" / "cases"
        while not (cases.is_dir() and any(cases.glob("*.csv"))) and process.poll() is None:
            time.sleep(0.02)
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        _, told = process.communicate(timeout=120)
    assert process.returncode == 0, told
    assert told == ""
    assert scored(tmp_path / "here") == scored(tmp_path / "there")
