# SPDX-License-Identifier: Apache-2.0
"""`grasptrack transfer`: what is refused, with which status, and what is told where the images do not tell all."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from datasets import DATA
from grasptrack.cli.main import main
from grasptrack.transfer import STRATEGIES
from scenery import L_PLATE, SQUARE, drawn
from test_pair import motion, moved, printed

ALL = ["registration", *STRATEGIES]
SQUARES = 1.2 * SQUARE


def transfer(folder: Path, first: np.ndarray, second: np.ndarray, *options: str) -> tuple[int, dict[str, Any]]:
    """Exit status and transfer.json."""
    for name, image in (("a.png", first), ("b.png", second)):
        cv2.imwrite(str(folder / name), image)
    status = main(["transfer", str(folder / "a.png"), str(folder / "b.png"), "--output", str(folder), *options])
    return status, json.loads((folder / "transfer.json").read_text())


def at_rest(outline: np.ndarray, blots: float) -> np.ndarray:
    return moved(printed(outline, blots=blots)[0], np.eye(3), 1)


def elsewhere(outline: np.ndarray, blots: float, turn: float = 0.3, scale: float = 0.9) -> np.ndarray:
    return moved(printed(outline, blots=blots)[0], motion(turn, 0.0, scale), 2)


def test_what_is_believed_is_told_with_its_confidence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, told = transfer(tmp_path, at_rest(L_PLATE, 30.0), elsewhere(L_PLATE, 30.0))
    said = capsys.readouterr()
    assert status == 0 and told["believed"] and said.err == "" and "confidence" in said.out
    assert [o["strategy"] for o in told["outcomes"]] == ALL and told["options"]["risk"] == 1e-3
    assert told["ambiguous"] == "" and told["places"] == []
    for o in told["outcomes"]:
        assert 0.0 <= o["confidence"] <= 1.0
        assert o["believed"] == (o["reason"] == "") == (o["contacts"] is not None) == (o["stable"] is not None)
        assert o["confidence"] >= 0.999 if o["believed"] else o["confidence"] <= 0.999
    assert (
        main(["transfer", *(str(tmp_path / n) for n in ("a.png", "b.png")), "--output", str(tmp_path), "--json"]) == 0
    )
    assert json.loads(capsys.readouterr().out)["outcomes"] == told["outcomes"]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("scale", [0.42, 0.9])
def test_a_blank_key_is_no_page_of_print(scale: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By its outline alone each square is every other one."""
    status, told = transfer(tmp_path, at_rest(SQUARES, 30.0), elsewhere(SQUARES, 0.0, scale=scale))
    assert status == 3 and not told["believed"] and all(o["contacts"] is None for o in told["outcomes"])
    assert told["outcomes"][0]["confidence"] < 0.5
    (line,) = capsys.readouterr().err.splitlines()
    assert "b.png" in line and "every strategy refuses" in line


def test_the_places_of_a_symmetric_part_are_told_each_with_its_share(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images = at_rest(SQUARES, 0.0), elsewhere(SQUARES, 0.0)
    status, told = transfer(tmp_path, *images)
    out = capsys.readouterr().out
    places = told["places"]
    assert status == 3 and "ambiguous: the outline fits as well turned by" in out and told["ambiguous"] in out
    assert {o["reason_code"] for o in told["outcomes"][:1]} == {"ambiguous"}
    assert places[0]["turn_deg"] == pytest.approx(0.0)
    assert sorted(round(p["turn_deg"] / 90.0) % 4 for p in places) == [0, 1, 2, 3]
    assert sum(p["share"] for p in places) == pytest.approx(1.0)
    for place in places:
        assert " ".join(f"{x:.1f},{y:.1f}" for x, y in place["contacts"]) in out
    # the first is right in as many cases as its share says, and taken by who asks for no more
    sure = told["outcomes"][0]["confidence"]
    assert sure == pytest.approx(places[0]["share"], abs=1e-3)
    status, told = transfer(tmp_path, *images, "--risk", str(1.0 - 0.9 * sure))
    assert status == 0 and told["outcomes"][0]["contacts"] == places[0]["contacts"]


def test_another_object_and_a_plain_disc_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "transfer.png").write_bytes(b"of an earlier run")
    (tmp_path / "transfer.json").write_text('{"versions": {"grasptrack": "0"}, "files": ["transfer.png"]}')
    gear = drawn(1.3 * np.array([[-60.0, -8.0], [60.0, -8.0], [60.0, 8.0], [-60.0, 8.0]]), size=(360, 480))
    status, told = transfer(tmp_path, at_rest(L_PLATE, 0.0), gear, "--quiet")
    said = capsys.readouterr()
    assert status == 3 and not told["believed"] and said.out == "" and len(said.err.splitlines()) == 1
    assert [o["confidence"] for o in told["outcomes"]] == [0.0] * 4 or (tmp_path / "transfer.png").stat().st_size > 99
    assert all(o["reason"] for o in told["outcomes"])


@pytest.mark.sampled(1)
@pytest.mark.skipif(not (DATA / "stills").is_dir(), reason="needs the folder of real stills")
@pytest.mark.parametrize("key", ["100,105", "233,112", "410,215", "320,290", "140,430"])
def test_a_square_of_another_board_is_no_page(key: str, tmp_path: Path) -> None:
    page, board = DATA / "stills" / "choriginal.jpg", DATA / "stills" / "eye-in-hand" / "franka_image-1.png"
    given = ["--object", "300,60", "--object-b", key, "--output", str(tmp_path), "-q"]
    assert main(["transfer", str(page), str(board), *given]) in (2, 3)
    if (tmp_path / "transfer.json").exists():
        assert not json.loads((tmp_path / "transfer.json").read_text())["believed"]
