# SPDX-License-Identifier: Apache-2.0
"""Live sources, what waits for who works on them, and what is kept meanwhile: the newest image, in order, within memory."""

import itertools
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import InputError, SourceError
from grasptrack.io import live
from grasptrack.io.base import Frame
from grasptrack.io.limits import HELD, HELD_BYTES, Backlog
from grasptrack.io.live import DeviceGoneError, LiveSource
from grasptrack.live.inbox import MOST, Arrival, Inbox, KeptImages


def image(value: int) -> np.ndarray:
    return np.full((4, 6), value % 256, np.uint8)


class Played:
    """A device that gives what it is told: images with their stamps, pauses in s, None, or an error to raise."""

    missed = 0

    def __init__(self, *script: object) -> None:
        self._script: Iterator[object] = iter(script)
        self.closed = threading.Event()

    def read(self) -> tuple[np.ndarray, float | None] | None:
        for step in self._script:
            if isinstance(step, float):
                time.sleep(step)
            elif isinstance(step, BaseException):
                raise step
            else:
                return step  # type: ignore[return-value]
        time.sleep(0.02)
        return None

    def close(self) -> None:
        self.closed.set()


def source(*devices: Played | Exception, patience: float = 0.4) -> LiveSource:
    left = iter(devices)

    def open_device() -> Played:
        device = next(left, SourceError("it is not there"))
        if isinstance(device, Exception):
            raise device
        return device

    return LiveSource("test:", "camera", "camera test", open_device, None, patience)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "RETRY", 0.05)


def test_only_the_newest_image_is_given_and_the_others_are_counted() -> None:
    device = Played((image(0), 0.0), 0.2, *((image(i), i / 10) for i in range(1, 20)))
    found = source(device, patience=2.0)
    frames = iter(found)
    assert next(frames).image[0, 0] == 0
    time.sleep(0.4)
    newest = next(frames)
    assert newest.image[0, 0] == 19 and newest.time == pytest.approx(1.9)
    assert found.dropped == 20 - 2 and found.live and found.kind == "camera"
    found.close()
    assert device.closed.wait(1.0)


def test_what_came_during_the_first_look_is_caught_up_with_where_that_is_wanted() -> None:
    found = source(Played((image(0), 0.0), 0.2, *((image(i), i / 10) for i in range(1, 20))), patience=2.0)
    found.catches_up = True
    frames = iter(found)
    assert next(frames).image[0, 0] == 0
    time.sleep(0.4)
    assert [next(frames).image[0, 0] for _ in range(19)] == list(range(1, 20))
    assert found.dropped == 0
    found.close()


def test_images_that_the_device_dropped_are_counted_too() -> None:
    device = Played((image(0), None), 0.05, (image(1), None))
    device.missed = 7
    found = source(device)
    assert next(iter(found)).index == 0 and found.dropped == 7


def test_times_are_those_of_the_device_from_the_first_image_on() -> None:
    stamps = [1e9 + t for t in (0.0, 0.031, 0.064, 0.2)]
    device = Played(*itertools.chain.from_iterable(((image(0), s), 0.05) for s in stamps))
    times = [f.time for f in itertools.islice(source(device), 4)]
    np.testing.assert_allclose(times, [0.0, 0.031, 0.064, 0.2], atol=1e-6)


@pytest.mark.parametrize("stamp", [None, 5.0])
def test_our_own_clock_serves_where_the_device_has_none_or_one_that_stands(stamp: float | None) -> None:
    device = Played(*itertools.chain.from_iterable(((image(0), stamp), 0.06) for _ in range(3)))
    times = [f.time for f in itertools.islice(source(device), 3)]
    assert times[0] == 0.0 and all(0.04 < b - a < 0.3 for a, b in itertools.pairwise(times))  # type: ignore[operator]


def test_a_device_that_goes_is_opened_again_and_time_goes_on() -> None:
    first = Played((image(1), 100.0), 0.05, (image(2), 100.1), 0.05, DeviceGoneError("unplugged"))
    second = Played((image(3), 3.0), 0.05, (image(4), 3.2))  # its clock begins anew
    found = source(first, SourceError("not yet"), second)
    frames = list(itertools.islice(found, 4))
    assert [int(f.image[0, 0]) for f in frames] == [1, 2, 3, 4] and [f.index for f in frames] == [0, 1, 2, 3]
    times = [f.time for f in frames]
    assert times[1] == pytest.approx(0.1) and times[3] - times[2] == pytest.approx(0.2)  # type: ignore[operator]
    assert times[2] - times[1] >= 2 * 0.05  # type: ignore[operator]
    assert found.reconnected == 1 and first.closed.is_set()


def test_patience_ends_with_what_the_device_said() -> None:
    found = source(Played((image(0), None), DeviceGoneError("unplugged")))
    with pytest.raises(SourceError, match=r"camera test gave no image for 0.4 s after 1 frames: it is not there"):
        list(found)


def test_a_silent_device_ends_too() -> None:
    with pytest.raises(SourceError, match=r"gave no image for 0.4 s after 0 frames$"):
        list(source(Played()))


def test_images_that_cannot_be_read_are_an_error_at_once() -> None:
    device = Played((image(0), None), 0.05, SourceError("pixels of format Depth are not read"))
    with pytest.raises(SourceError, match=r"^pixels of format Depth"):
        list(source(device, patience=30.0))
    assert device.closed.wait(1.0)


def test_devices_are_opened_beside_the_main_thread_where_drivers_take_over_ctrl_c() -> None:
    opened: list[threading.Thread] = []

    def open_device() -> Played:
        opened.append(threading.current_thread())
        return Played((image(0), None))

    next(iter(LiveSource("test:", "camera", "camera test", open_device)))
    assert opened[0] is not threading.main_thread()


def test_a_driver_that_breaks_ends_the_source_with_its_words() -> None:
    device = Played((image(0), None), 0.05, ZeroDivisionError("in the driver"))
    with pytest.raises(SourceError, match="ZeroDivisionError: in the driver"):
        list(source(device))
    assert device.closed.wait(1.0)


def test_a_device_that_is_not_there_at_first_is_an_error_at_once() -> None:
    began = time.monotonic()
    with pytest.raises(SourceError, match="nothing attached"):
        next(iter(source(SourceError("nothing attached"), patience=30.0)))
    assert time.monotonic() - began < 1.0


def test_no_thread_stays_behind(quick: None) -> None:
    before = threading.active_count()
    for _ in range(5):
        frames: Callable[[], object] = iter(source(Played((image(0), None)))).__next__
        frames()
    del frames
    assert threading.active_count() == before


def test_a_rate_is_refused_because_images_are_dropped() -> None:
    with pytest.raises(SourceError, match="leave out the rate"):
        LiveSource("test:", "camera", "camera test", Played, 30.0)


def arrival(index: int, size: tuple[int, int] = (2, 2)) -> Arrival:
    return Arrival(Frame(index, None, np.zeros(size, np.uint8), f"frame {index}"), float(index), 1)


@given(st.lists(st.integers(0, 9), max_size=20), st.integers(0, 5))
def test_commands_come_in_order_and_before_images_and_only_the_newest_image_stays(told: list[int], images: int) -> None:
    inbox = Inbox()
    for k in range(images):
        inbox.replace_image(arrival(k))
    for word in told:
        inbox.tell(word)
    assert [inbox.take_next(True, 0.0) for _ in told] == told
    left = inbox.take_next(True, 0.0)
    assert (left.frame.index if left is not None else None) == (images - 1 if images else None)
    assert inbox.take_next(True, 0.0) is None


def test_every_image_of_a_file_is_taken_once() -> None:
    inbox, taken = Inbox(), []

    def read() -> None:
        for k in range(50):
            assert inbox.hand_over(arrival(k))

    reader = threading.Thread(target=read)
    reader.start()
    while len(taken) < 50:
        taken.append(inbox.take_next(True, 10.0).frame.index)
    reader.join(10.0)
    assert taken == list(range(50))


def test_an_image_that_nobody_wants_waits_and_a_closed_inbox_keeps_nobody_waiting() -> None:
    inbox, answers = Inbox(), list[bool]()
    assert inbox.hand_over(arrival(0))
    assert inbox.take_next(False, 0.01) is None
    reader = threading.Thread(target=lambda: answers.append(inbox.hand_over(arrival(1))))
    reader.start()
    inbox.close()
    reader.join(10.0)
    assert answers == [False] and inbox.take_next(True, 10.0) is None


def test_too_many_commands_are_refused_but_helpers_answers_are_not() -> None:
    inbox = Inbox()
    for k in range(MOST):
        inbox.tell(k)
    with pytest.raises(InputError, match="too many"):
        inbox.tell(MOST)
    inbox.tell("answer", bounded=False)
    assert [inbox.take_next(False, 0.0) for _ in range(MOST + 1)][-1] == "answer"


@pytest.mark.parametrize(("side", "most"), [(10, HELD), (4000, HELD_BYTES // 4000**2), (9000, 2)])
def test_kept_images_are_the_last_ones_within_their_bounds(side: int, most: int) -> None:
    kept, one = KeptImages(), arrival(0, (side, side))
    for image in range(1, 2 * HELD):
        kept.add(image, one)
    assert kept.get_image(2 * HELD - most) is one
    with pytest.raises(InputError, match="not kept"):
        kept.get_image(2 * HELD - most - 1)


def all_of(backlog: Backlog[int]) -> Iterator[int]:
    while backlog:
        item, _ = backlog.take()
        assert item is not None
        yield item


@given(st.integers(1, 40))
def test_the_newest_alone_where_nothing_is_kept(count: int) -> None:
    backlog: Backlog[int] = Backlog()
    fell = sum(backlog.add(k, 1) for k in range(count))
    assert list(all_of(backlog)) == [count - 1] and fell == count - 1
    assert backlog.take() == (None, 0)


@given(st.integers(0, 3), st.integers(0, 300), st.integers(1, 40))
def test_all_in_order_within_memory_and_evenly(before: int, count: int, most: int) -> None:
    backlog: Backlog[int] = Backlog(most)
    fell = sum(backlog.add(k, 1) for k in range(before))
    backlog.keep_all()
    first = max(before - 1, 0)
    fell += sum(backlog.add(k, 1) for k in range(before, before + count))
    given_out = list(all_of(backlog))
    came = list(range(first, before + count))
    assert len(given_out) <= max(2, most) and len(given_out) + fell == before + count
    if len(came) <= max(2, most):
        assert given_out == came
    else:
        steps = np.diff(given_out)
        assert given_out[0] == first and given_out[-1] == came[-1]
        assert len(set(steps[:-1])) <= 1 and steps[-1] <= steps.max() and (steps > 0).all()
        assert steps.max() <= 4 * len(came) / max(1, most - 1) + 1


@given(st.integers(0, 200), st.floats(0.1, 3.0))
def test_whoever_keeps_up_misses_nothing_and_whoever_does_not_gets_to_the_newest(late: int, pace: float) -> None:
    """`late` items came during the long step, and `pace` more come during each step after it."""
    backlog: Backlog[int] = Backlog()
    backlog.keep_all()
    came, due, taken = 0, float(late), list[int]()
    for _ in range(2000):
        while came < due:
            backlog.add(came, 0)
            came += 1
        if backlog:
            item, _ = backlog.take()
            assert item is not None
            taken.append(item)
        due += pace
    lag = came - 1 - taken[-1]
    assert lag <= pace + 1
    if pace <= 0.5:
        assert taken == list(range(came))[: len(taken)]


def test_forgetting() -> None:
    backlog: Backlog[int] = Backlog()
    backlog.keep_all()
    for k in range(5):
        backlog.add(k, 1)
    assert backlog.take() == (0, 0)
    backlog.add(5, 1)
    backlog.newest_only()
    assert list(all_of(backlog)) == [5]
    backlog.add(6, 1)
    backlog.clear()
    assert not backlog and backlog.take() == (None, 0)
    assert backlog.add(7, 1) == 0 and backlog.add(8, 1) == 1
