# SPDX-License-Identifier: Apache-2.0
"""`grasptrack inspect`: its table, its files, its picture, and one clear line for everything that is no input."""

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from grasptrack.cli.main import main
from grasptrack.io.json_results import inspection_to_dict
from grasptrack.trackability import inspect
from grasptrack.view.inspect import ellipse_magnification
from recordings import movie, plate, strict_json, write
from scenery import L_PLATE, drawn, ellipse
from test_cli_bad_input import refused

DOCS = Path(__file__).resolve().parents[2] / "docs"


def given(source: Path | str, tmp_path: Path, *more: str) -> list[str]:
    return ["inspect", str(source), "--output", str(tmp_path / "out"), *more]


def data(tmp_path: Path) -> dict[str, Any]:
    return strict_json(tmp_path / "out" / "inspect.json")


@pytest.mark.whole
def test_the_table_and_both_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(given(write(tmp_path / "a.png", plate()), tmp_path)) == 0
    said = capsys.readouterr()
    assert said.err == "" and said.out.startswith("GOOD, --strategy auto")
    for row in (
        "object", "contrast", "edges", "motions", "symmetry", "peaks", "grasp-line", "grasp", "error", "located",
    ):  # fmt: skip
        assert re.search(rf"^ {row} ", said.out, re.MULTILINE), row
    assert re.search(
        r"Expected: located in \d+ to 100 % of frames, contacts [\d.]+ to [\d.]+ px off \(95 %\)", said.out
    )
    assert "inspect.json" in said.out and "inspect.png" in said.out
    picture = cv2.imread(str(tmp_path / "out" / "inspect.png"))
    assert picture is not None and picture.shape == (900, 1600, 3)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["inspect.json", "inspect.png"]


def test_a_poor_object_is_no_error_and_says_what_would_help(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(given(write(tmp_path / "a.png", drawn(ellipse(50.0, 50.0))), tmp_path)) == 0
    said = capsys.readouterr().out
    assert said.startswith("POOR, no strategy will do")
    assert "a turn about its centre is not shown by the outline. Would help: another object" in said
    assert data(tmp_path)["level"] == "poor" and data(tmp_path)["symmetry"]["every_turn"]


def test_json_on_stdout_is_that_of_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(given(write(tmp_path / "a.png", plate()), tmp_path, "--json", "--runs", "1")) == 0
    assert json.loads(capsys.readouterr().out) == data(tmp_path)


def test_quiet_writes_the_files_and_says_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(given(write(tmp_path / "a.png", plate()), tmp_path, "--quiet", "--json")) == 0
    said = capsys.readouterr()
    assert said.out == said.err == "" and data(tmp_path)["verdict"] == "good"


def test_keys_of_inspect_json_are_those_that_are_told_of(tmp_path: Path) -> None:
    seen = inspection_to_dict(inspect(plate(), runs=1), "a.png", (240, 320), {})
    told = (DOCS / "files.md").read_text(encoding="utf-8").split("## inspect.json")[1].split("\n## ")[0]
    first = re.findall(r"^\| (`[^|]+`) \|", told, re.MULTILINE)
    assert set(re.findall(r"`(\w+)`", " ".join(first))) == set(seen)


def test_what_is_asked_for_is_done(tmp_path: Path) -> None:
    image = drawn(0.8 * L_PLATE, ellipse(25.0, 25.0), centres=((110.0, 140.0), (260.0, 50.0)), noise=0.5)
    source = write(tmp_path / "a.png", image)
    assert (
        main(given(source, tmp_path, "--object", "260,50", "--fingers", "3", "--friction", "0.8", "-q", "--runs", "1"))
        == 0
    )
    seen = data(tmp_path)
    assert len(seen["grasp"]["contacts"]) == 3 and seen["symmetry"]["every_turn"]
    assert np.allclose(np.mean(seen["outline"][0], axis=0), [260.0, 50.0], atol=1.0)
    contacts = " ".join(f"{x:.3f},{y:.3f}" for x, y in seen["grasp"]["contacts"])
    assert main(given(source, tmp_path, "--grasp", contacts, "--friction", "0.8", "-q", "--runs", "1")) == 0
    assert np.allclose(data(tmp_path)["grasp"]["contacts"], seen["grasp"]["contacts"], atol=0.01)
    mask = write(tmp_path / "m.png", np.where(image < 130, 255, 0).astype(np.uint8))
    assert main(given(source, tmp_path, "--mask", str(mask), "--box", "225,15,70,70", "-q", "--runs", "1")) == 0
    assert data(tmp_path)["symmetry"]["every_turn"] and data(tmp_path)["object"]["contrast"] > 200.0


def test_a_hand_without_a_grasp_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(given(write(tmp_path / "a.png", plate()), tmp_path, "--max-opening", "9")) == 0
    assert "too wide for the opening of 9 px" in capsys.readouterr().out
    assert data(tmp_path)["grasp"] is None and data(tmp_path)["error_px"] is None and data(tmp_path)["located"] == 0.0


def test_ellipses_are_drawn_to_be_seen() -> None:
    calm, noisy = (inspect(drawn(L_PLATE, noise=n), runs=1) for n in (0.5, 10.0))
    times = [ellipse_magnification(each, 0.5) for each in (calm, noisy)]
    assert times[0] > times[1] >= 1.0
    assert all(re.fullmatch(r"[125]0*", f"{each:.0f}") for each in times)
    for each, large in zip((calm, noisy), times, strict=True):
        assert each.grasp is not None
        longest = 2.45 * np.sqrt(np.linalg.eigvalsh(each.grasp.covariance).max())
        assert 0.3 * 26.0 * 0.5 < large * longest < 1.1 * 26.0 * 0.5


def test_a_video_is_no_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "one image" in refused(given(movie(tmp_path / "a.mp4"), tmp_path), capsys)
