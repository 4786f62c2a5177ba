# SPDX-License-Identifier: Apache-2.0
"""Results over TCP: each client gets lines in order and the newest at last, and none makes the others or the tracker wait."""

import contextlib
import json
import math
import re
import runpy
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import jsonschema
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasptrack import InputError, Status
from grasptrack.cli.live import publish_moments
from grasptrack.io import publishing
from grasptrack.io.base import Frame
from grasptrack.io.columns import IN_JSON, result_fields
from grasptrack.io.publishing import (
    FIXED_STATUS,
    MOST_CLIENTS,
    WIDTH,
    PublishAddress,
    ResultPublisher,
    fixed_line,
    parse_publish_address,
)
from grasptrack.tracking.result import TrackResult
from test_live_frames import LOST, result_of, shown_of

PATIENCE = 10.0
LOCAL = PublishAddress("127.0.0.1", 0)
RESULT = result_of(confidence=0.99996, object_sure=True)
ROOT = Path(__file__).resolve().parents[2]
SCHEMA = jsonschema.Draft202012Validator(json.loads((ROOT / "docs" / "published.schema.json").read_text()))


def frame_of(index: int) -> Frame:
    return Frame(index, 0.04 * index, np.zeros((2, 2), np.uint8), str(index))


def publish(publisher: ResultPublisher, result: TrackResult = RESULT, came: float | None = None) -> int:
    """One more result; its number."""
    number = publisher._newest.number + 1
    publisher.publish(frame_of(number), result, time.perf_counter() if came is None else came)
    return number


class Reader:
    """A client that takes lines one by one."""

    def __init__(self, publisher: ResultPublisher, receive_buffer: int | None = None) -> None:
        self.link = socket.socket()
        if receive_buffer is not None:
            self.link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.link.settimeout(PATIENCE)
        self.link.connect(("127.0.0.1", int(publisher.url.rpartition(":")[2])))
        until = time.monotonic() + PATIENCE
        while not self.is_known(publisher) and len(publisher._clients) < MOST_CLIENTS and time.monotonic() < until:
            time.sleep(0.001)
        self.file = self.link.makefile("rb")

    def is_known(self, publisher: ResultPublisher) -> bool:
        for client in publisher._clients[:]:
            with contextlib.suppress(OSError):  # it has gone
                if client.link.getpeername() == self.link.getsockname():
                    return True
        return False

    def line(self) -> bytes:
        return self.file.readline()

    def read(self) -> dict[str, Any]:
        return dict(json.loads(self.line()))

    def rest(self) -> list[dict[str, Any]]:
        with contextlib.suppress(ConnectionResetError):
            return [json.loads(line) for line in self.file]
        return []

    def close(self) -> None:
        self.file.close()
        self.link.close()


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No line without a frame."""
    monkeypatch.setattr(publishing, "SILENCE", 60.0)
    yield


# --- who comes and goes --------------------------------------------------------------------------


@pytest.mark.usefixtures("patient")
@given(steps=st.lists(st.sampled_from(["come", "leave", "publish", "publish", "read"]), max_size=40), data=st.data())
def test_whatever_comes_between_lines_keep_their_order_and_the_newest_arrives(
    steps: list[str], data: st.DataObject
) -> None:
    number, here = 0, list[tuple[Reader, int, list[int]]]()
    with ResultPublisher(LOCAL) as publisher:
        for step in steps:
            if step == "publish":
                number = publish(publisher)
            elif step == "come" and len(here) < 5:
                here.append((Reader(publisher), number, []))
            elif here:
                reader, _, read = each = data.draw(st.sampled_from(here))
                if step == "leave":
                    here.remove(each)
                    reader.close()
                elif step == "read" and (read[-1] if read else each[1]) < number:
                    read.append(reader.read()["sequence"])
    for reader, since, read in here:
        read += [line["sequence"] for line in reader.rest()]
        assert read == sorted(set(read)) and all(k > since for k in read)
        assert (read[-1] if read else since) == number
        reader.close()


@pytest.mark.usefixtures("patient")
def test_who_reads_at_once_misses_nothing() -> None:
    with ResultPublisher(LOCAL) as publisher:
        readers = [Reader(publisher) for _ in range(3)]
        for k in range(50):
            came = time.perf_counter() - 0.5
            number = publish(publisher, came=came)
            for reader in readers:
                line = reader.read()
                age = 1e3 * (time.perf_counter() - came)
                assert line["sequence"] == number == k + 1 and 500.0 <= line["age_ms"] <= age + 1.0
                assert abs(time.time() - line["stamp_s"] - 0.5) < 5.0
                assert {key: line[key] for key in IN_JSON} == result_fields(frame_of(number), RESULT)
        for reader in readers:
            reader.close()


@pytest.mark.usefixtures("patient")
def test_nothing_waits_for_who_does_not_read() -> None:
    count = 3000
    with ResultPublisher(LOCAL) as publisher:
        slow, quick = Reader(publisher, 4096), Reader(publisher)
        for _ in range(count):
            number = publish(publisher)
            assert quick.read()["sequence"] == number
        rest = max(len(client.rest) for client in publisher._clients)
        first = slow.line()
        assert rest <= 2 * len(first)
    lines = [json.loads(first), *slow.rest()]
    read = [line["sequence"] for line in lines]
    assert read == sorted(set(read)) and read[-1] == count and len(read) < count / 10
    assert lines[-1]["age_ms"] < 1e3 * PATIENCE
    slow.close()
    quick.close()


def test_who_takes_nothing_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publishing, "STALLED", 0.05)
    monkeypatch.setattr(publishing, "SILENCE", 0.02)
    with ResultPublisher(LOCAL) as publisher:
        stuck = Reader(publisher, 2048)
        until = time.monotonic() + PATIENCE
        while publisher._clients and time.monotonic() < until:
            publish(publisher)
            time.sleep(0.001)
        assert not publisher._clients
        quick = Reader(publisher)
        assert quick.read()["version"] == 1
        stuck.close()
        quick.close()


def test_there_is_room_for_so_many_and_what_they_send_is_not_read() -> None:
    with ResultPublisher(LOCAL) as publisher:
        readers = [Reader(publisher) for _ in range(MOST_CLIENTS)]
        one_more = Reader(publisher)
        assert one_more.line() == b""
        readers[0].link.sendall(b"GET / HTTP/1.1\r\n\r\n")
        number = publish(publisher)
        assert [reader.read()["sequence"] for reader in readers] == [number] * MOST_CLIENTS
        for reader in (*readers, one_more):
            reader.close()


def test_the_port_is_free_again_and_one_that_is_taken_is_told() -> None:
    with ResultPublisher(LOCAL) as publisher:
        port = int(publisher.url.rpartition(":")[2])
        reader = Reader(publisher)
        with pytest.raises(InputError, match=rf"127.0.0.1:{port}: Address already in use; give an address of this"):
            ResultPublisher(LOCAL._replace(port=port))
    assert reader.line() == b""
    with ResultPublisher(LOCAL._replace(port=port)) as again:
        assert again.url == publisher.url
    reader.close()


def test_a_client_gets_no_more_lines_than_it_asks_for() -> None:
    with ResultPublisher(LOCAL._replace(rate=20.0)) as publisher:
        reader = Reader(publisher)
        came = []
        until = time.monotonic() + 0.5
        while time.monotonic() < until:
            number = publish(publisher)
            time.sleep(0.002)
    lines = reader.rest()
    came = [line["sequence"] for line in lines]
    assert 2 <= len(came) <= 0.6 * 20 + 2 and came[-1] == number
    reader.close()


# --- lines ---------------------------------------------------------------------------------------


def test_silence_is_told_by_a_line_with_the_same_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publishing, "SILENCE", 0.05)
    with ResultPublisher(LOCAL) as publisher:
        reader = Reader(publisher)
        first = reader.read()
        assert first["status"] == "silent" and first["age_ms"] is None and first["contacts"] is None
        publish(publisher, came=time.perf_counter() - 1.0)
        lines = [reader.read() for _ in range(4)]
        while lines[0]["status"] == "silent":
            lines = [*lines[1:], reader.read()]
        assert [line["status"] for line in lines[1:]] == ["silent"] * 3
        ages = [line["age_ms"] for line in lines]
        assert ages == sorted(ages) and ages[-1] >= 1140.0
        assert all(list(line) == list(first) for line in lines)
        reader.close()


VALUES = st.floats() | st.floats(-2e3, 2e4)


@settings(max_examples=60)
@example(contacts=[(math.nan, 1.0), (2.0, math.inf)], status="tracked", spread=0.1, number=1, age=0.0, confidence=0.5)
@given(
    contacts=st.none() | st.lists(st.tuples(VALUES, VALUES), min_size=2, max_size=4),
    status=st.sampled_from(get_args(Status)),
    spread=VALUES,
    number=st.integers(1, 10**9),
    age=st.none() | st.floats(0.0, 1e12),
    confidence=st.floats(0.0, 1.0),
)
def test_any_result_makes_a_line_of_the_schema_and_a_fixed_one_of_its_width(
    contacts: Any, status: Status, spread: float, number: int, age: float | None, confidence: float
) -> None:
    given = {"contacts": None if contacts is None else np.array(contacts), "status": status, "confidence": confidence}
    covariance = None if contacts is None else np.full((len(contacts), 2, 2), spread)
    moment = publishing._Moment(number, age, frame_of(3), result_of(**given, covariance=covariance))
    fields = json.loads(publishing.json_line(publishing.line_fields(moment, 0.0 if age is None else 1.5 * age)))
    SCHEMA.validate(fields)
    assert list(fields) == SCHEMA.schema["required"]
    line = fixed_line(fields)
    assert len(line.encode()) == WIDTH and line.isascii() and line.endswith(")\n") and line.count("\n") == 1
    version, told, count, sequence, _, sure, *places, _ = map(float, line.strip("()\n").split(","))
    assert (version, sequence) == (1, number % 10000) and confidence - 1e-4 <= sure <= confidence
    values = np.ravel(contacts or [])
    fit = len(contacts or ()) <= 3 and bool(((values > -999.99) & (values < 9999.99)).all())
    if fit:
        assert told in (FIXED_STATUS[status], 1) and count == len(contacts or ())
        assert places[: len(values)] == pytest.approx(values, abs=0.00501) and not any(places[len(values) :])
    elif told == publishing.DOES_NOT_FIT or len(contacts) > 3:
        assert told == publishing.DOES_NOT_FIT and not any(places) and count == 0
    else:
        assert ((values > -1000.0) & (values < 10000.0)).all()  # they are just at the border


def test_every_status_has_a_number_of_its_own() -> None:
    assert set(FIXED_STATUS) == {"silent", *get_args(Status)}
    assert len({*FIXED_STATUS.values(), publishing.MAY_CLOSE, publishing.DOES_NOT_FIT}) == len(FIXED_STATUS) + 2


@pytest.mark.parametrize("form", publishing.FORMATS)
def test_a_line_is_the_same_for_all_who_listen(form: str) -> None:
    with ResultPublisher(LOCAL._replace(form=form)) as publisher:
        reader = Reader(publisher)
        publish(publisher, result_of(**LOST))
        line = reader.line()
        assert b"lost" in line if form == "json" else line.startswith(b"(1,4,0,0001,0000")
        reader.close()


def test_the_session_of_a_page_publishes_each_result_once_and_with_the_age_of_its_image() -> None:
    heard: list[tuple[int, float]] = []

    class Heard:
        def publish(self, frame: Frame, result: TrackResult, came: float) -> None:
            heard.append((frame.index, came))

    listener = publish_moments(Heard())  # type: ignore[arg-type]
    first, second = result_of(), result_of(frame=1)
    choosing = shown_of(1, 1, result=first)
    listener(choosing.__class__(**{**vars(choosing), "phase": "choosing"}))
    for shown in (shown_of(1, 2, result=first), shown_of(1, 3, result=first), shown_of(2, 4, result=second)):
        listener(shown)
    assert heard == [(0, 1.0), (1, 1.0)]


# --- what robots read --------------------------------------------------------------------------------


ROBOTS = ROOT / "examples" / "robots"
COLUMNS = {"status": (4, 1), "age_ms": (13, 6), "x1": (27, 7), "y1": (35, 7), "x2": (43, 7), "y2": (51, 7)}
"""Of a fixed line: the first character, from 1, and how many."""


def number_of(text: str) -> float:
    """As `COLUMN` in kuka.src."""
    value, sign, step = 0.0, 1.0, 0.0
    for code in map(ord, text):
        sign = -1.0 if code == 45 else sign
        step = 1.0 if code == 46 else step
        if 48 <= code <= 57:
            value, step = 10.0 * value + (code - 48), 10.0 * step
    return sign * (value / step if step > 0.0 else value)


@given(
    contacts=st.lists(st.tuples(*[st.floats(-900.0, 9000.0)] * 2), min_size=2, max_size=2),
    status=st.sampled_from(get_args(Status)),
    age=st.floats(0.0, 900.0),
)
def test_robots_find_in_a_line_what_was_sent(contacts: Any, status: Status, age: float) -> None:
    result = result_of(contacts=np.array(contacts), status=status, notice="tilt-open")
    line = fixed_line(publishing.line_fields(publishing._Moment(7, 0.0, frame_of(3), result), age))
    truth = [FIXED_STATUS[status], 1e3 * age, *np.ravel(contacts)]
    for convert in (float, number_of):
        read = [convert(line[first - 1 : first - 1 + count]) for first, count in COLUMNS.values()]
        assert read[0] == truth[0] and -0.051 <= read[1] - truth[1] <= 1.051
        assert read[2:] == pytest.approx(truth[2:], abs=0.00501)
    values = [13.0, *map(float, line[line.index("(") + 1 : line.index(")")].split(","))]  # socket_read_ascii_float(13)
    assert len(values) == 14
    assert [values[k] for k in (2, 5, 7, 8, 9, 10)] == read


@pytest.mark.parametrize("name", ["fanuc.kl", "abb.mod", "kuka.src"])
def test_a_robot_program_reads_the_columns_of_its_variables(name: str) -> None:
    program = (ROBOTS / name).read_text()
    read = re.findall(r"(?:SUB_STR|StrPart|COLUMN)\((?:line|LINE\[\]), (\d+), (\d+)\)", program)
    assert sorted((int(first), int(count)) for first, count in read) == sorted(COLUMNS.values())
    assert f"{WIDTH}" in program and ("200" in program or "0.2" in program)


def test_the_urs_program_asks_for_as_many_numbers_as_there_are() -> None:
    program = (ROBOTS / "ur.script").read_text()
    line = fixed_line(publishing.line_fields(publishing._Moment(1, None), 0.0))
    count = line.count(",") + 1
    assert f'socket_read_ascii_float({count}, "grasptrack", 0.2)' in program and f"line[0] == {count}" in program
    assert re.findall(r"line\[(\d+)\]", program) == ["0", "2", "5", "7", "8", "9", "10"]
    assert "format=fixed" in program


def test_lines_have_one_width_for_a_client_that_counts_bytes() -> None:
    with ResultPublisher(LOCAL._replace(form="fixed")) as publisher:
        reader = Reader(publisher)
        for k in range(200):
            publish(publisher, RESULT if k % 3 else result_of(**LOST))
    data = reader.file.read()
    lines = [data[at : at + WIDTH] for at in range(0, len(data), WIDTH)]
    assert lines and all(line.startswith(b"(1,") and line.endswith(b")\n") for line in lines)
    reader.close()


def test_the_example_client_stops_without_lines_and_at_the_end() -> None:
    """It acts on the newest line: on a busy machine one that comes late is sent anew."""
    client = runpy.run_path(str(ROBOTS / "client.py"))
    said, read = list[str](), list[int]()
    client["follow_grasp"].__globals__["print"] = lambda *words: said.append(" ".join(map(str, words)))
    until, sent = time.monotonic() + PATIENCE, 0
    with ResultPublisher(LOCAL) as publisher:
        port = int(publisher.url.rpartition(":")[2])
        thread = threading.Thread(target=lambda: read.append(client["follow_grasp"]("127.0.0.1", port)))
        thread.start()
        while "STOP: no line" not in said and time.monotonic() < until:
            time.sleep(0.001)
        for result, part in (
            (RESULT, "may close at [[10.0, 25.1234]"),
            (result_of(notice="tilt-open"), "approach [[10.0, 25.1234]"),
            (result_of(**LOST), "STOP: lost not here"),
        ):
            while not any(line.startswith(part) for line in said):
                assert time.monotonic() < until, (part, said)
                publish(publisher, result)
                sent += 1
                time.sleep(0.05)
    thread.join(PATIENCE)
    assert said[0] == "STOP: no line" and said[-1] == "STOP: the tracker has ended" and 3 <= read[0] <= sent


# --- addresses -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("5555", PublishAddress("127.0.0.1", 5555)),
        (":0", PublishAddress("127.0.0.1", 0)),
        ("5555?format=fixed", PublishAddress("127.0.0.1", 5555, "fixed")),
        ("tcp://0.0.0.0:5555", PublishAddress("0.0.0.0", 5555)),
        ("tcp://[::1]:5555?rate=10", PublishAddress("::1", 5555, "json", 10.0)),
        ("robot.local:1?format=json&rate=1", PublishAddress("robot.local", 1, "json", 1.0)),
    ],
)
def test_an_address_is_what_users_write(text: str, address: PublishAddress) -> None:
    assert parse_publish_address(text) == address


@pytest.mark.parametrize(
    "text",
    (
        *("", "tcp://", "tcp://host", "host", "udp://host:1", "1:2:3", "h:99999", "5555?format=xml", "5555?rate=0"),
        *("5555?rate=nan", "5555?speed=1", "tcp://h:1/path", "tcp://me@h:1", "tcp://[::1:5", "5555?format", "h:-1"),
    ),
)
def test_any_other_address_is_told_with_what_would_be_right(text: str) -> None:
    with pytest.raises(InputError, match=r"^--publish takes tcp://HOST:PORT, as tcp://0.0.0.0:5555") as caught:
        parse_publish_address(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("host", ["203.0.113.1", "no.such.host.invalid", "a" * 300])
def test_an_address_of_another_machine_is_told(host: str) -> None:
    with pytest.raises(InputError, match=r"cannot listen at tcp://.*0.0.0.0 for all"):
        ResultPublisher(PublishAddress(host, 0))
