# SPDX-License-Identifier: Apache-2.0
"""Registers of Modbus/TCP, read by pymodbus and byte by byte: those of the newest result, and nothing else is served."""

import itertools
import math
import struct
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.errors import InputError
from grasptrack.io import publishing
from grasptrack.io.peers import REGISTERS, ModbusPeer
from grasptrack.io.publishing import FIXED_STATUS, MODBUS, PublishAddress, ResultPublisher, parse_publish_address
from test_live_frames import LOST, result_of
from test_publishing import LOCAL, RESULT, Reader, frame_of, publish

ALL = b"".join(struct.pack(">H", 7 * k) for k in range(REGISTERS))


def request(function: int, first: int, count: int, transaction: int = 9, unit: int = 3) -> bytes:
    return struct.pack(">HHHBBHH", transaction, 0, 6, unit, function, first, count)


def decoded(data: bytes) -> tuple[Any, ...]:
    return struct.unpack(">HHHHIff6f", data)


@given(
    asked=st.lists(st.tuples(st.integers(0, 127), st.integers(0, 65535), st.integers(0, 65535)), max_size=5),
    cuts=st.lists(st.integers(0, 60)),
)
def test_each_request_has_one_answer_however_its_bytes_come(asked: list[tuple[int, int, int]], cuts: list[int]) -> None:
    data, peer, owed = b"".join(request(*each) for each in asked), ModbusPeer(lambda: ALL), b""
    ends = sorted({*(min(cut, len(data)) for cut in cuts), 0, len(data)})
    for begin, end in itertools.pairwise(ends):
        owed += peer.take_bytes(data[begin:end])
    for function, first, count in asked:
        size = struct.unpack_from(">HHHB", owed)[2]
        head, body, owed = owed[:7], owed[7 : 6 + size], owed[6 + size :]
        assert (head[:4], head[6]) == (b"\0\x09\0\0", 3)
        if function not in (3, 4):
            assert body == bytes([function | 0x80, 1])
        elif not 1 <= count <= 125:
            assert body == bytes([function | 0x80, 3])
        elif first + count > REGISTERS:
            assert body == bytes([function | 0x80, 2])
        else:
            assert body == bytes([function, 2 * count]) + ALL[2 * first : 2 * (first + count)]
    assert not owed and not peer.over


@given(st.binary(max_size=300))
def test_any_bytes_are_answered_or_end_it(data: bytes) -> None:
    peer = ModbusPeer(lambda: ALL)
    assert len(peer.take_bytes(data)) <= 30 * len(data)
    if len(data) >= 4 and data[2:4] != b"\0\0" and len(data) >= 7:
        assert peer.over


VALUES = st.floats() | st.floats(-2e3, 2e4)


@given(
    contacts=st.none() | st.lists(st.tuples(VALUES, VALUES), min_size=2, max_size=4),
    spread=VALUES,
    number=st.integers(1, 10**9),
    age=st.none() | st.floats(0.0, 1e12),
    confidence=st.floats(0.0, 1.0),
)
def test_any_result_fills_all_registers(
    contacts: Any, spread: float, number: int, age: float | None, confidence: float
) -> None:
    shape = None if contacts is None else np.full((len(contacts), 2, 2), spread)
    result = result_of(
        confidence=confidence, contacts=None if contacts is None else np.array(contacts), covariance=shape
    )
    fields = publishing.line_fields(
        publishing._Moment(number, age, frame_of(3), result), 0.0 if age is None else 2 * age
    )
    told = decoded(publishing.register_bytes(fields))
    version, status, count, sequence, ms, sure, off, *places = told
    assert confidence - 1e-7 < sure <= confidence
    assert (version, sequence) == (1, number % 65536) and not math.isnan(off)
    assert ms == 0xFFFFFFFF if age is None else ms >= min(fields["age_ms"], 0xFFFFFFFF)
    values = np.ravel(contacts or [])
    if len(values) <= 6 and bool((np.abs(values) <= 1e38).all()):
        assert status in (FIXED_STATUS["tracked"], 1) and count == len(values) // 2
        assert places[: len(values)] == pytest.approx(values, rel=1e-6, abs=1e-3) and not any(places[len(values) :])
    else:
        assert (status, count) == (publishing.DOES_NOT_FIT, 0) and not any(places)


def test_a_client_of_another_make_reads_the_newest_result_and_how_old_it_is() -> None:
    client = pytest.importorskip("pymodbus.client", reason="pymodbus is not installed")
    with ResultPublisher(LOCAL._replace(scheme=MODBUS)) as publisher:
        port = int(publisher.url.rpartition(":")[2])
        plc = client.ModbusTcpClient("127.0.0.1", port=port)
        assert plc.connect()

        def read() -> tuple[Any, ...]:
            words = plc.read_holding_registers(0, count=REGISTERS).registers
            assert plc.read_input_registers(0, count=4).registers[:1] == words[:1]
            return decoded(struct.pack(f">{REGISTERS}H", *words))

        assert read()[:3] == (1, 0, 0) and read()[4] == 0xFFFFFFFF
        publish(publisher, came=time.perf_counter() - 0.5)
        told = read()
        assert told[1:3] == (1, 2) and told[4] >= 500
        assert told[5] == pytest.approx(RESULT.confidence) and told[7:11] == pytest.approx(np.ravel(RESULT.contacts))
        publish(publisher, result_of(**LOST))
        assert read()[1:3] == (FIXED_STATUS["lost"], 0)
        assert plc.read_holding_registers(REGISTERS, count=1).exception_code == 2
        assert plc.write_register(0, 1).exception_code == 1
        plc.close()


def test_who_sends_no_modbus_is_left_and_who_asks_late_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publishing, "STALLED", 0.05)
    with ResultPublisher(LOCAL._replace(scheme=MODBUS)) as publisher:
        patient, other = Reader(publisher), Reader(publisher)
        other.link.sendall(b"GET / HTTP/1.1\r\n\r\n")
        assert other.line() == b""
        time.sleep(0.2)
        publish(publisher)
        patient.link.sendall(request(3, 0, 1))
        assert patient.file.read(11) == b"\0\x09\0\0\0\x05\x03\x03\x02\0\x01"
        patient.close()
        other.close()


def test_its_address_takes_no_settings_of_lines() -> None:
    assert parse_publish_address("modbus://0.0.0.0:502") == PublishAddress("0.0.0.0", 502, scheme=MODBUS)
    for text in ("modbus://h:1?rate=5", "modbus://h:1?format=fixed", "modbus://h"):
        with pytest.raises(InputError, match=r"or modbus://HOST:PORT; not"):
            parse_publish_address(text)
