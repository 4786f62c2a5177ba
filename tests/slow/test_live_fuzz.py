# SPDX-License-Identifier: Apache-2.0
"""The live page is sent odd messages and requests, and played at full speed: a line for each, and nothing stays open."""

import sys
from collections import Counter
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
from long_live import RECORDED_AS, ROUNDS, Held, LongLive, run
from watched import reached, until


def is_first(shown: Shown) -> bool:
    return shown.arrival is not None and shown.arrival.frame.name == "0.png"


def test_the_page_survives_what_it_is_told(tmp_path: Path) -> None:
    target = live_messages.Target(tmp_path)
    try:
        found = [finding for _, finding in islice(live_messages.fuzz(target, 1), 1000)]
        assert [f for f in found if f is not None] == []
        assert {kind: target.flood(kind, 1100)[0] for kind in live_messages.FLOODS} == dict.fromkeys(
            live_messages.FLOODS, ""
        )
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


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="open files are looked up in /proc")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("suffix", RECORDED_AS)
def test_nothing_is_left_open(suffix: str) -> None:
    if suffix == ".mcap":
        pytest.importorskip("foxglove", reason="the extra foxglove is not installed")
    found = run(1.0, 5, suffix)  # ROUNDS of them, however long they take
    assert found.findings == [] and len(found.held) == found.counts["rounds"] >= ROUNDS
    assert found.counts["recordings"] and found.counts["clients"] and found.counts["images"] > 5 * ROUNDS, found.counts


@pytest.mark.parametrize("name", ["files", "threads"])
def test_what_grows_with_every_round_is_found(name: str) -> None:
    flat = [Held(100.0, 10, 8)] * 12
    assert LongLive(Counter(), flat, (0, 0)).findings == []
    once = flat[:3] + [held._replace(**{name: 20}) for held in flat[3:]]
    assert LongLive(Counter(), once, (0, 0)).findings == []
    growing = [held._replace(**{name: 10 + k}) for k, held in enumerate(flat)]
    (line,) = LongLive(Counter(), growing, (0, 0)).findings
    assert line == f"{name} grow: 15 at most, then 19 at least"
    assert LongLive(Counter(), flat, (1, 0)).findings == ["1 files are left over"]
