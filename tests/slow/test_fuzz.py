# SPDX-License-Identifier: Apache-2.0
"""The fuzzer for some seconds: nothing dies, hangs, comes out raw or answers wrongly."""

import ctypes
import subprocess
import sys
from pathlib import Path

import pytest

import leaks

RUN = Path(__file__).parents[1] / "fuzz" / "run.py"
NONE = "0 crash, 0 hang, 0 internal, 0 bad stability, 0 bad contact"


def test_a_seeded_run_finds_nothing(tmp_path: Path) -> None:
    command = [sys.executable, "-W", "ignore", str(RUN), "--seed", "11", "--calls", "10000", "--contours", "2500"]
    ran = subprocess.run([*command, "--keep", str(tmp_path)], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    told = ran.stdout.splitlines()
    assert [line.partition(";")[0] for line in told] == [f"kernel calls: 10000: {NONE}", f"contours: 2500: {NONE}"]


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="this C library does not count what it allocates"
)
def test_kernels_keep_no_memory() -> None:
    command = [sys.executable, "-W", "ignore", leaks.__file__, "--calls", "400"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0 and "1200 calls of each: 0 leaks" in done.stdout, done.stdout + done.stderr


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="this C library does not count what it allocates"
)
def test_a_few_bytes_that_are_kept_now_and_then_are_seen() -> None:
    """In a process of its own: what other tests leave behind goes while it counts."""
    code = f"""
import ctypes
import sys
sys.path[:0] = {sys.path!r}
import leaks

allocate = ctypes.CDLL(None).malloc
allocate.argtypes = [ctypes.c_size_t]
print(leaks.growth(lambda k: allocate(8) if k == 3 else None, 400))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(leaks.__file__).parent, check=True
    )
    assert float(done.stdout) > 0.1
