# SPDX-License-Identifier: Apache-2.0
"""What waits of a live source: the newest; after `keep` all in order, thinned evenly; who is slow gets to the newest."""

from collections.abc import Iterator

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.io.limits import Backlog


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
