# SPDX-License-Identifier: Apache-2.0
"""What waits for a session: commands in order and before images, of a live source the newest image, of a file every one."""

import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import InputError
from grasptrack.io.base import Frame
from grasptrack.io.limits import HELD, HELD_BYTES
from grasptrack.live.inbox import MOST, Arrival, Inbox, KeptImages


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
