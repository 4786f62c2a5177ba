# SPDX-License-Identifier: Apache-2.0
"""A session that follows parts on file: one of them is chosen, the others go along, and what was not there is found later."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from grasptrack.cli.main import main
from grasptrack.errors import InputError
from grasptrack.live import commands as told
from grasptrack.live.frames import moment_to_json
from grasptrack.live.settings import SceneSettings
from grasptrack.live.state import headline_of
from recordings import rows
from watched import PLACES, ell_part, reached, scene_on, shifted, tray, until


def test_every_part_is_followed_and_one_is_chosen_by_click_or_number(tmp_path: Path) -> None:
    with scene_on(tmp_path / "run", shifted(0)) as (session, camera):
        shown = reached(session, "tracking", image=1)
        assert shown.scene is not None and sorted(shown.scene.results) == [1, 2]
        assert shown.chosen == 1 and shown.result is shown.scene.results[1]
        assert headline_of(shown).word == "OK TO CLOSE"
        first = shown.result.view.outer.points.mean(axis=0)
        other = next(place for place in PLACES if np.hypot(*(place - first)) > 100.0)
        session.send_command(told.Pick(1, *other))
        shown = until(session, lambda s: s.chosen == 2)
        assert shown.result is not None and shown.result.instance_id == 2
        camera.images.put(shifted(1))
        shown = until(session, lambda s: s.image == 2)
        assert shown.chosen == 2 and shown.result.instance_id == 2 and shown.result.located
        page = json.loads(moment_to_json(shown))
        assert page["chosen"] == 2 and [(p["number"], p["name"]) for p in page["parts"]] == [(1, "ell"), (2, "ell")]
        session.send_command(told.Choose(1))
        until(session, lambda s: s.chosen == 1)
        for command, line in ((told.Choose(7), "there is no part 7"), (told.Pick(1, 3.0, 3.0), "no part lies there")):
            before = session.shown.notice[0]
            session.send_command(command)
            assert line in until(session, lambda s, n=before: s.notice[0] > n).notice[1]
        session.send_command(told.Friction(0.3))
        assert "not for following parts" in until(session, lambda s: "friction" in s.notice[1]).notice[1]
    found = rows(tmp_path / "run")
    assert [(row["frame"], row["instance_id"]) for row in found] == [("0", "1"), ("0", "2"), ("1", "1"), ("1", "2")]
    assert len(json.loads((tmp_path / "run" / "run.json").read_text())["instances"]) == 2


def test_an_image_without_parts_waits_and_what_comes_later_is_found(tmp_path: Path) -> None:
    with scene_on(tmp_path / "run", tray()) as (session, camera):
        shown = reached(session, "choosing")
        assert 'none of "ell" is found' in shown.notice[1] and headline_of(shown).word == "No object"
        camera.images.put(tray(PLACES[0]))
        session.send_command(told.Rechoose())
        shown = reached(session, "tracking", image=2)
        assert shown.scene is not None and list(shown.scene.results) == [1]
        camera.images.put(tray(*PLACES))
        until(session, lambda s: s.image == 3)
        session.send_command(told.Rechoose())
        until(session, lambda s: "1 more part" in s.notice[1])
        camera.images.put(tray(*PLACES))
        shown = until(session, lambda s: s.image == 4)
        assert sorted(shown.scene.results) == [1, 2] and shown.chosen == 1


def test_who_left_is_told_and_nobody_is_chosen_in_its_place(tmp_path: Path) -> None:
    def seen(k: int) -> np.ndarray:
        return tray((130.0 - 22.0 * k, 120.0), PLACES[1])

    with scene_on(tmp_path / "run", seen(0)) as (session, camera):
        shown = reached(session, "tracking", image=1)
        left = next(n for n, r in shown.scene.results.items() if r.view.outer.points[:, 0].max() < 300.0)
        session.send_command(told.Choose(left))
        for k in range(1, 14):
            camera.images.put(seen(k))
            shown = until(session, lambda s, k=k: s.image == k + 1)
            if shown.chosen is None:
                break
        assert shown.chosen is None and shown.result is None and len(shown.scene.results) == 1
        assert headline_of(shown).word == "Which part?"


def test_a_recording_shows_every_part(tmp_path: Path) -> None:
    with scene_on(tmp_path / "run", shifted(0)) as (session, camera):
        reached(session, "tracking", image=1)
        session.send_command(told.Record(True))
        until(session, lambda s: s.recording)
        for k in (1, 2):
            camera.images.put(shifted(k))
            until(session, lambda s, k=k: s.image == k + 1)
        session.send_command(told.Record(False))
        until(session, lambda s: "recording-001.mp4" in s.files)
    video = cv2.VideoCapture(str(tmp_path / "run" / "recording-001.mp4"))
    assert sum(iter(lambda: video.read()[0], False)) == 2


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--all"], "say which with --part"),
        (["--part", "PART"], "add --all"),
        (["--part", "PART", "--all", "--object", "3,4"], "--object is for following one object"),
        (["--part", "PART", "--all", "--servo", "s.toml"], "--servo is for following one object"),
        (["--part", "PART", "--all", "--record-as", "mcap"], "--record-as is for following one object"),
        (["--part", "none.part", "--all"], "none.part"),
    ],
)
def test_what_does_not_go_together_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], line: str
) -> None:
    ell_part().save(tmp_path / "ell.part")
    cv2.imwrite(str(tmp_path / "one.png"), tray(*PLACES))
    asked = [str(tmp_path / "ell.part") if each == "PART" else each for each in options]
    assert main(["live", str(tmp_path / "one.png"), *asked, "--output", str(tmp_path / "run")]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and line in said.err
    assert not (tmp_path / "run").exists()


def test_parts_of_one_name_are_refused_before_anything_is_served() -> None:
    settings: Any = SceneSettings([ell_part(), ell_part()])
    with pytest.raises(InputError, match="two parts have the name"):
        settings.make_tracker()
