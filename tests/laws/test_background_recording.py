# SPDX-License-Identifier: Apache-2.0
"""Recordings in a thread of their own: the same as without, in order, bounded; what goes wrong there is told here, once."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.io.base import Frame
from grasptrack.io.limits import HELD, HELD_BYTES
from grasptrack.io.recording import BackgroundRecording, WriterThread
from grasptrack.tracking.result import TrackResult

PATIENCE = 20.0


class Slow:
    """A recording that keeps what it is given, when it may, and breaks at an image."""

    def __init__(self, breaks_at: int | None = None, open_gate: bool = True) -> None:
        self.path = Path("run.mcap")
        self.kept: list[tuple[int, bytes]] = []
        self.closed = 0
        self.gate = threading.Event()
        self.begun = threading.Event()
        self._breaks_at = breaks_at
        if open_gate:
            self.gate.set()

    def write(self, frame: Frame, result: TrackResult) -> None:
        self.begun.set()
        assert self.gate.wait(PATIENCE)
        if frame.index == self._breaks_at:
            raise OSError(28, "No space left on device")
        self.kept.append((frame.index, frame.image.tobytes()))

    def close(self) -> None:
        self.closed += 1


def frame(index: int, size: tuple[int, int] = (3, 4)) -> tuple[Frame, TrackResult]:
    image = np.full(size, index % 256, np.uint8)
    return Frame(index, None, image, str(index)), TrackResult(index, None, "searching", "no object")


@given(count=st.integers(0, 3 * HELD))
def test_all_is_written_in_order_and_what_changes_afterwards_is_not(count: int) -> None:
    slow = Slow()
    recording = BackgroundRecording(slow)
    expected = []
    for k in range(count):
        one, result = frame(k)
        expected.append((k, one.image.tobytes()))
        recording.write(one, result)
        one.image[:] = 255 - one.image
    recording.close()
    recording.close()
    assert slow.kept == expected and slow.closed == 1


@pytest.mark.parametrize(("size", "most"), [((3, 4), HELD), ((4000, 4000), HELD_BYTES // 4000**2)])
def test_whoever_writes_waits_only_where_as_many_wait_as_are_held(size: tuple[int, int], most: int) -> None:
    slow = Slow(open_gate=False)
    recording = BackgroundRecording(slow)
    recording.write(*frame(0, size))
    assert slow.begun.wait(PATIENCE)  # it is in the writer's hands now
    for k in range(1, most + 1):
        recording.write(*frame(k, size))
    late = threading.Thread(target=recording.write, args=frame(most + 1, size))
    late.start()
    late.join(0.1)
    assert late.is_alive() and not slow.kept
    slow.gate.set()
    late.join(PATIENCE)
    recording.close()
    assert [index for index, _ in slow.kept] == list(range(most + 2))


def test_who_does_not_wait_drops_and_counts() -> None:
    slow, ended = Slow(open_gate=False), threading.Event()
    writer = WriterThread(slow, waits=False, ended=lambda writer: ended.set())
    writer.add(*frame(0))
    assert slow.begun.wait(PATIENCE)
    for k in range(1, HELD + 6):
        writer.add(*frame(k))
    assert writer.dropped == 5
    slow.gate.set()
    writer.end()
    assert ended.wait(PATIENCE) and writer.written == HELD + 1 and slow.closed == 1
    assert [index for index, _ in slow.kept] == list(range(HELD + 1))


@given(breaks_at=st.integers(0, 9))
def test_an_error_is_told_once_and_the_file_is_closed(breaks_at: int) -> None:
    slow = Slow(breaks_at)
    recording = BackgroundRecording(slow)
    told = 0
    for k in range(10):
        try:
            recording.write(*frame(k))
        except OSError:
            told += 1
    if told:
        recording.close()
    else:
        with pytest.raises(OSError, match="No space"):
            recording.close()
    recording.close()
    assert told <= 1 and slow.closed == 1 and [index for index, _ in slow.kept] == list(range(breaks_at))


def test_an_error_wakes_whoever_waits() -> None:
    slow = Slow(breaks_at=0, open_gate=False)
    recording = BackgroundRecording(slow)

    def write_many() -> None:
        for k in range(HELD + 2):
            recording.write(*frame(k))

    late = threading.Thread(target=write_many)
    late.start()
    late.join(0.1)
    assert late.is_alive()
    slow.gate.set()
    late.join(PATIENCE)
    assert not late.is_alive()
    with pytest.raises(OSError, match="No space"):
        recording.close()


def test_a_second_interruption_ends_what_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    slow = Slow(open_gate=False)
    recording = BackgroundRecording(slow)
    for k in range(5):
        recording.write(*frame(k))
    assert slow.begun.wait(PATIENCE)

    def strike(self: threading.Thread, timeout: float | None = None) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "join", strike)
        with pytest.raises(KeyboardInterrupt):
            recording.close()
    slow.gate.set()
    recording.close()
    assert [index for index, _ in slow.kept] == [0] and slow.closed == 1


def test_nobody_waits_for_an_encoder_that_keeps_up() -> None:
    """Law of the whole: writing takes the tracker's thread a copy of the image, whatever encoding takes."""

    class Sleeping(Slow):
        def write(self, frame: Frame, result: TrackResult) -> None:
            time.sleep(0.01)
            super().write(frame, result)

    recording = BackgroundRecording(Sleeping())
    began = time.perf_counter()
    for k in range(HELD):
        recording.write(*frame(k))
    spent = time.perf_counter() - began
    recording.close()
    assert spent < 0.5 * HELD * 0.01
