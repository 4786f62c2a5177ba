# SPDX-License-Identifier: Apache-2.0
"""Live sources: the newest image, times that go on, devices that come back, and threads that end."""

import itertools
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from grasptrack import SourceError
from grasptrack.io import live
from grasptrack.io.live import DeviceGoneError, LiveSource


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
