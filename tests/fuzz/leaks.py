# SPDX-License-Identifier: Apache-2.0
"""Whether kernels keep memory: bytes that are allocated after many calls, with good and odd arrays, and after as many again.

    python tests/fuzz/leaks.py --calls 2000 --seed 1

The C library counts them (mallinfo2), so that a leak of a few bytes a call is seen where the size of the process says nothing.
"""

import ctypes
import gc
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1] / "oracle"), str(Path(__file__).parents[2])]

from harness import options
from kernel_calls import NAMES, draw_call, judge_call

VARIED = 40
"""Different calls of a kernel, which are made again and again."""


COUNTED = ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost")


class _Mallinfo2(ctypes.Structure):
    """Of glibc, `man mallinfo`."""

    _fields_ = tuple((name, ctypes.c_size_t) for name in COUNTED)


def allocated() -> int:
    """Bytes that are allocated with malloc now.

    Raises:
        AttributeError: this C library does not tell.
    """
    ask = ctypes.CDLL(None).mallinfo2
    ask.restype = _Mallinfo2
    gc.collect()
    told = ask()
    return int(told.uordblks + told.hblkhd)


def growth(call: Callable[[int], object], calls: int) -> float:
    """Bytes by which a call makes the memory grow, in the mean; the least of three rounds, as what is made once is no leak.

    Args:
        call: takes the number of a call, below VARIED.
        calls: in each round.
    """
    found = []
    for k in range(VARIED):
        call(k)
    for _ in range(3):
        before = allocated()
        for k in range(calls):
            call(k % VARIED)
        found.append((allocated() - before) / calls)
    return min(found)


def leaks(module: ModuleType, seed: int, calls: int) -> dict[str, float]:
    """Bytes per call by name of those kernels that keep memory."""
    found = {}
    for at, name in enumerate(NAMES):
        drawn = [draw_call(seed, at + k * len(NAMES)) for k in range(VARIED)]
        kept = growth(lambda k, drawn=drawn: judge_call(drawn[k], module), calls)
        if kept > 0.0:
            found[name] = kept
    return found


def main() -> int:
    """Print what leaks; status 1 where anything does."""
    asked = options(__doc__, calls=(2000, "of each kernel, three times"))
    import _grasptrack_native as module

    found = leaks(module, asked.seed, asked.calls)
    for name, kept in found.items():
        print(f"{name} keeps {kept:.1f} bytes per call")
    print(f"{len(NAMES)} kernels, {3 * asked.calls} calls of each: {len(found)} leaks")
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
