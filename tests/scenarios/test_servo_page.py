# SPDX-License-Identifier: Apache-2.0
"""The button of the servo through the server: one page holds it, and each way to lose that page lets go of it."""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grasptrack as gt
from grasptrack.cli.main import main
from grasptrack.io.arms import Order, Report
from grasptrack.live import commands as told
from grasptrack.live.servo_desk import TAKEN, ServoDesk
from grasptrack.live.session import GOAL, LiveSession
from grasptrack.servo.setup import ServoSetup
from recordings import plate
from watched import PATIENCE, FedCamera, reached, session_on, until

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
client = pytest.importorskip("websockets.sync.client")

from grasptrack.live.server import GONE, RELEASED, PageServer  # noqa: E402


class StillArm:
    """An arm that stands, and keeps what it was told."""

    goal: gt.Goal | None = None

    def __init__(self) -> None:
        self.orders: list[Order] = []

    def why_not(self) -> str:
        return ""

    def hand_pose(self) -> tuple[np.ndarray, float]:
        return np.eye(4), time.perf_counter()

    def send_order(self, order: Order) -> None:
        self.orders.append(order)

    def take_reports(self) -> list[Report]:
        return []

    def close(self) -> None:
        self.orders.append(Order(np.zeros(6)))


@dataclass
class Served:
    session: LiveSession
    desk: ServoDesk
    arm: StillArm
    camera: FedCamera
    server: PageServer

    def page(self) -> Any:
        return client.connect(self.server.url.replace("http", "ws", 1).replace("/?", "/hold?"))

    def wait(self, wanted: Callable[[], object]) -> None:
        end = time.monotonic() + PATIENCE
        while not wanted():
            assert time.monotonic() < end, self.session.shown.servo
            time.sleep(0.01)


@contextmanager
def served(folder: Path) -> Iterator[Served]:
    camera, arm = FedCamera(), StillArm()
    desk = ServoDesk(ServoSetup("still:"), arm)
    for k in range(3):
        camera.images.put(plate((150.0 + k, 100.0), 0.2, (240, 320)))
    with session_on(camera, folder, at_once=True, servo=desk) as session:
        server = PageServer(session)
        server.start()
        try:
            reached(session, "tracking")
            yield Served(session, desk, arm, camera, server)
        finally:
            server.stop()


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Served]:
    with served(tmp_path / "run") as made:
        made.session.send_command(told.Teach())
        until(made.session, lambda shown: shown.servo is not None and shown.servo.goal)
        yield made


def press(page: Any) -> dict[str, Any]:
    page.send(json.dumps({"do": "press"}))
    answer: dict[str, Any] = json.loads(page.recv(PATIENCE))
    return answer


def test_the_view_becomes_the_goal_and_a_file(here: Served, tmp_path: Path) -> None:
    result = here.session.shown.result
    assert result is not None and GOAL in here.session.shown.files
    assert gt.Goal.load(tmp_path / "run" / GOAL) == gt.Goal.taught(result)


def test_one_page_holds_the_button_and_another_is_refused(here: Served) -> None:
    with here.page() as first, here.page() as second:
        assert press(first)["held"] == 1
        assert press(second) == {"error": TAKEN}
        first.send(json.dumps({"do": "release", "why": "released"}))
        here.wait(lambda: here.desk.switch.holder is None)
        assert press(second)["held"]


@pytest.mark.parametrize("why", [*RELEASED, "gone", "late", "reloaded"])
def test_each_way_to_lose_the_page_lets_go_and_is_told(here: Served, why: str) -> None:
    with here.page() as page:
        assert press(page)["held"]
        if why in RELEASED:
            page.send(json.dumps({"do": "release", "why": why}))
        elif why in ("gone", "reloaded"):
            page.close()
        here.wait(lambda: here.desk.switch.holder is None)
    expected = RELEASED.get(why, GONE if why != "late" else "did not say within")
    shown = until(here.session, lambda s: expected in s.servo.why)
    assert shown.servo.word == "Stopped" and not here.arm.orders[-1].enabled
    if why == "reloaded":
        with here.page() as again:
            time.sleep(0.1)
            assert here.desk.switch.holder is None
            assert press(again)["held"]


def test_answers_to_questions_that_were_not_asked_hold_nothing(here: Served) -> None:
    with here.page() as page, here.page() as other:
        assert press(page)["held"]
        for number in range(5000):
            other.send(json.dumps({"do": "keep", "number": number}))
        here.wait(lambda: here.desk.switch.holder is None)


def test_what_is_no_message_is_told(here: Served) -> None:
    with here.page() as page:
        for text in ("{", '{"do": "start"}', '{"do": "keep"}', '{"do": "release", "why": "x"}'):
            page.send(text)
            assert "error" in json.loads(page.recv(PATIENCE))


def test_without_a_servo_nothing_is_held(tmp_path: Path) -> None:
    camera = FedCamera()
    camera.images.put(plate((150.0, 100.0), 0.2, (240, 320)))
    with session_on(camera, tmp_path / "run", at_once=True) as session:
        server = PageServer(session)
        server.start()
        address = server.url.replace("http", "ws", 1).replace("/?", "/hold?")
        with client.connect(address) as page, pytest.raises(Exception, match="there is no servo"):
            page.recv(PATIENCE)
        session.send_command(told.Anew())
        until(session, lambda shown: "there is no servo" in shown.notice[1])
        server.stop()


def test_a_verb_tells_what_is_wrong_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("tomllib", reason="TOML needs Python 3.11")
    (tmp_path / "servo.toml").write_text('arm = "scara:192.0.2.7"')
    (tmp_path / "in").mkdir()
    import cv2

    cv2.imwrite(str(tmp_path / "in" / "a.png"), plate((150.0, 100.0), 0.2, (240, 320)))
    for name in ("servo.toml", "none.toml"):
        arguments = ["live", str(tmp_path / "in"), "--servo", str(tmp_path / name), "--output", str(tmp_path / "run")]
        assert main([*arguments, "--port", "0"]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and ("tcp://HOST:PORT" in said or "none.toml" in said)
    assert not (tmp_path / "run").exists()
