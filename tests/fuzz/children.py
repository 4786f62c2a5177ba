# SPDX-License-Identifier: Apache-2.0
"""Numbered trials in child processes: one that dies or hangs is named, and the others go on."""

import mmap
import os
import signal
import struct
import time
from collections.abc import Callable
from typing import NamedTuple

PATIENCE = 10.0
"""Seconds within which a trial has to end."""


class Finding(NamedTuple):
    """A trial that did not end as it should: its number, and how."""

    index: int
    how: str


class Ran(NamedTuple):
    """How often each outcome was seen, and what is to be mended."""

    outcomes: dict[str, int]
    findings: list[Finding]


_HEAD = struct.Struct("qq")  # number of the trial that runs, bytes of report that follow
_ROOM = 1 << 20


def run_trials(trial: Callable[[int], str], first: int, last: int, patience: float = PATIENCE) -> Ran:
    """Run `trial` of each number from `first` to below `last`.

    Args:
        trial: takes a number, returns an outcome; one that begins with "bad" or "internal" is a finding.
        first, last: the numbers.
        patience: seconds for one trial.
    """
    outcomes: dict[str, int] = {}
    findings: list[Finding] = []
    while first < last:
        first, how = _run_child(trial, first, last, patience, outcomes, findings)
        if how:
            findings.append(Finding(first, how))
            kind = how.partition(":")[0]
            outcomes[kind] = outcomes.get(kind, 0) + 1
            first += 1
    return Ran(outcomes, findings)


def _run_child(
    trial: Callable[[int], str],
    first: int,
    last: int,
    patience: float,
    outcomes: dict[str, int],
    findings: list[Finding],
) -> tuple[int, str]:
    """The number of the first trial that a child did not end, and how it died in it, "" where it lives."""
    board = mmap.mmap(-1, _HEAD.size + _ROOM)
    board[: _HEAD.size] = _HEAD.pack(first, 0)
    child = os.fork()
    if child == 0:
        try:
            _work(trial, first, last, board)
        finally:
            os._exit(1)  # whatever is raised, nobody else's work goes on in a child
    how = _watch(child, board, patience)
    index, size = _HEAD.unpack(board[: _HEAD.size])
    for line in board[_HEAD.size : _HEAD.size + size].decode().splitlines():
        number, _, outcome = line.partition("\t")
        kind = outcome.partition(":")[0]
        outcomes[kind] = outcomes.get(kind, 0) + 1
        if kind.startswith(("bad", "internal")):
            findings.append(Finding(int(number), outcome))
    board.close()
    return index, how


def _work(trial: Callable[[int], str], first: int, last: int, board: mmap.mmap) -> None:
    size = 0
    for index in range(first, last):
        line = f"{index}\t{' '.join(trial(index).split())[:300]}\n".encode()
        if size + len(line) > _ROOM:
            break
        board[_HEAD.size + size : _HEAD.size + size + len(line)] = line
        size += len(line)
        board[: _HEAD.size] = _HEAD.pack(index + 1, size)
    os._exit(0)


def _watch(child: int, board: mmap.mmap, patience: float) -> str:
    seen, since = -1, time.monotonic()
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            if os.WIFSIGNALED(status):
                return f"crash: {signal.Signals(os.WTERMSIG(status)).name}"
            return "" if os.WEXITSTATUS(status) == 0 else f"crash: status {os.WEXITSTATUS(status)}"
        index = _HEAD.unpack(board[: _HEAD.size])[0]
        if index != seen:
            seen, since = index, time.monotonic()
        elif time.monotonic() - since > patience:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return f"hang: more than {patience:g} s"
        time.sleep(0.01)
