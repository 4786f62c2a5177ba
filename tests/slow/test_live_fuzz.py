# SPDX-License-Identifier: Apache-2.0
"""Odd messages and requests to the live page: a line for each, no file but the run's, and it still tracks afterwards."""

import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
pytest.importorskip("websockets")

import live_messages
from grasptrack.live import commands as told
from grasptrack.live.state import Shown
from watched import reached, until


def is_first(shown: Shown) -> bool:
    return shown.arrival is not None and shown.arrival.frame.name == "0.png"


def test_the_page_survives_what_it_is_told(tmp_path: Path) -> None:
    target = live_messages.Target(tmp_path)
    try:
        found = [finding for _, finding in islice(live_messages.fuzz(target, 1), 1000)]
        assert [f for f in found if f is not None] == []
        begun: list[int] = []
        target.session.add_listener(lambda s: begun.append(s.image) if s.phase == "looking" and is_first(s) else None)
        for command in (told.Record(False), told.Fingers(2), told.Friction(0.5), told.Restart()):
            target.session.send_command(command)
        # What was told of the first image holds after a restart, too, and may be sure: then it is followed at once.
        until(target.session, lambda s: s.phase in ("choosing", "ended") and begun)
        target.session.send_command(told.Pick(begun[-1], 110.0, 100.0))
        shown = reached(target.session, "ended")
        assert shown.result is not None and shown.result.status == "tracked"
    finally:
        target.close()


def test_the_same_seed_sends_alike() -> None:
    one, other, third = (live_messages.odd_message(np.random.default_rng(s)) for s in (5, 5, 6))
    assert one == other != third


def test_what_ends_badly_is_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(live_messages.Target, "check", lambda self: "as if it had failed")
    monkeypatch.setattr(sys, "argv", ["live_messages", "--count", "7"])
    assert live_messages.main() == 1
    assert "7 findings" in capsys.readouterr().out


def test_answers_that_are_wrong_are_told() -> None:
    assert live_messages.why_wrong(b"HTTP/1.1 500 Internal Server Error\r\n")
    assert live_messages.why_wrong(b"HTTP/1.1 200 OK\r\n\r\n" + live_messages.SECRET.encode())
    assert not live_messages.why_wrong(b"HTTP/1.1 404 Not Found\r\n")
