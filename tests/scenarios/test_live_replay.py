# SPDX-License-Identifier: Apache-2.0
"""What was clicked on the live page and recorded is tracked again to the last digit, with the options that it keeps."""

import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import open_source
from grasptrack.cli.main import main
from grasptrack.io.recording import OPTIONS, points_text, tracking_options
from grasptrack.live import commands as told
from grasptrack.live.session import LiveSession
from recordings import plate, plates
from watched import FedCamera, plate_session, reached, session_on, until

pytest.importorskip("foxglove")

ON_PLATE = (150.0, 100.0)
WAYS: dict[str, Any] = {
    "start": lambda image: [told.Start()],
    "pixel": lambda image: [told.Pick(image, *ON_PLATE)],
    "pixels": lambda image: [told.Pick(image, 10.5, 12.25, on=False), told.Pick(image, *ON_PLATE), told.Start()],
    "box": lambda image: [told.Box(image, 60.0, 50.0, 200.5, 140.25), told.Start()],
    "contacts": lambda image: [told.Contacts(image, ((125.4, 67.2), (107.3, 154.7)))],
    "outline": lambda image: [
        told.Outline(
            image, ((80.0, 60.0), (240.0, 70.0), (235.0, 130.0), (140.0, 130.0), (130.0, 190.0), (76.0, 180.0))
        )
    ],
    "friction": lambda image: [told.Friction(0.7), told.Pick(image, *ON_PLATE)],
    "fingers": lambda image: [told.Fingers(3), told.Pick(image, *ON_PLATE)],
}


def recorded(path: Path) -> list[dict[str, Any]]:
    """Results that a recording holds, with all their digits, but for what no two runs share."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        found = [json.loads(m.data) for _, _, m in make_reader(file).iter_messages(topics=["/grasptrack/result"])]
    for each in found:  # images are counted from another one
        each["last_seen"] = each["last_seen"] and [each["frame"] - at for at in each["last_seen"]]
    return [{key: value for key, value in each.items() if key not in ("latency_ms", "frame")} for each in found]


def replayed(path: Path, folder: Path) -> tuple[str, list[dict[str, Any]]]:
    """The options that a recording keeps, and the results of tracking it again with them."""
    options = open_source(path).recorded_with
    given = ["track", str(path), "--output", str(folder / "again"), "--no-video", "--quiet"]
    assert main([*given, *shlex.split(options), "--record", str(folder / "again.mcap")]) == 0
    return options, recorded(folder / "again.mcap")


def record_until_end(session: LiveSession, commands: list[Any]) -> None:
    session.send_command(told.Record(True))
    until(session, lambda s: s.recording)
    for command in commands:
        session.send_command(command)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("way", WAYS)
def test_a_session_with_clicks_is_tracked_again_to_the_last_digit(tmp_path: Path, way: str) -> None:
    with plate_session(tmp_path, 6, record_as=".mcap") as session:
        image = reached(session, "choosing").image
        record_until_end(session, WAYS[way](image))
        reached(session, "ended", image=6)
    path = tmp_path / "run" / "recording-001.mcap"
    once = recorded(path)
    options, again = replayed(path, tmp_path)
    assert again == once and len(once) == 6, options
    assert {each["status"] for each in once} == {"tracked"}, once


def test_a_cameras_image_that_was_clicked_begins_the_recording(tmp_path: Path) -> None:
    camera, path = FedCamera(), tmp_path / "run" / "recording-001.mcap"
    with session_on(camera, tmp_path / "run", record_as=".mcap") as session:
        for k in range(2):  # the first has nothing to follow
            camera.images.put(np.full((240, 320), 200, np.uint8) if not k else plate((160.0, 120.0)))
        image = reached(session, "choosing").image
        record_until_end(session, [told.Pick(image, *ON_PLATE)])
        for k in range(1, 6):
            reached(session, "tracking", image=image + k - 1)
            camera.images.put(plate((160.0 + k, 120.0 + 0.4 * k), 0.2 + 0.01 * k))
        reached(session, "tracking", image=image + 5)
    once = recorded(path)
    options, again = replayed(path, tmp_path)
    assert again == once and len(once) == 6 and once[0]["time_s"] > 0.0
    assert "--object 150.0,100.0" in options and "--sure 0" in options


def test_what_begins_in_between_keeps_no_options(tmp_path: Path) -> None:
    camera = FedCamera()
    with session_on(camera, tmp_path, at_once=True, record_as=".mcap") as session:
        for k in range(3):
            camera.images.put(plate((160.0 + k, 120.0)))
            reached(session, "tracking", image=k + 1)
            session.send_command(told.Record(True))
            until(session, lambda s: s.recording)
    source = open_source(tmp_path / "recording-001.mcap")
    assert source.recorded_with == "" and len(list(source)) == 2


def test_other_options_are_told_of_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, path = plates(tmp_path / "in", 3), tmp_path / "run.mcap"
    out = ["--output", str(tmp_path / "out"), "--no-video"]
    assert main(["track", str(folder), *out, "--quiet", "--object", "150, 100", "--record", str(path)]) == 0
    assert main(["track", str(path), *out]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "recorded with other options" in line]
    options = line.partition("same digits: ")[2]
    assert "--object 150,100" in options
    assert main(["track", str(path), *out, *shlex.split(options)]) == 0
    assert "recorded with" not in capsys.readouterr().out


@given(
    points=st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 2), min_size=1, max_size=4),
    friction=st.floats(0.01, 3.0),
    again=st.booleans(),
)
def test_options_come_back_from_a_shell_as_they_were(
    points: list[tuple[float, float]], friction: float, again: bool
) -> None:
    asked = {"object": points_text(points), "friction": friction, "resynthesize": again, "fps": 30, "box": None}
    words = shlex.split(tracking_options(asked))
    pixels: list[tuple[float, ...]] = []
    while words:
        option, sign, value = words.pop(0).partition("=")
        assert option[2:] in OPTIONS
        if option == "--resynthesize":
            assert again
            continue
        value = value if sign else words.pop(0)
        if option == "--object":
            pixels.append(tuple(float(part) for part in value.split(",")))
        else:
            assert option == "--friction" and float(value) == friction
    assert pixels == points
