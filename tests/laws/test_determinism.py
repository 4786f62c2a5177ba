# SPDX-License-Identifier: Apache-2.0
"""The same input gives the same bytes: in any process, with any seed of hashes, number of threads, and in a thread."""

import json
import os
import subprocess
import sys

import pytest

import repeatable

LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


LETTERING = """
import sys, threading
import numpy as np
from grasptrack.view.style import text_width, put_text

def written(k):
    picture = np.zeros((60, 400, 3), np.uint8)
    put_text(picture, f"{k} lines of text", (5, 40), 9 + k % 30, (255, 255, 255), bold=bool(k % 2))
    return picture

alone = [written(k) for k in range(200)]
import grasptrack.view.style as style
style._render_text.cache_clear()
sys.setswitchinterval(1e-6)
same = []
def write(seed):
    for k in np.random.default_rng(seed).permutation(len(alone)):
        style._render_text.cache_clear()
        same.append(np.array_equal(written(int(k)), alone[k]))
threads = [threading.Thread(target=write, args=(seed,)) for seed in range(4)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
sys.exit(0 if all(same) and len(same) == 4 * len(alone) else 1)
"""


def test_threads_that_write_text_do_not_meet_in_one_font() -> None:
    """In a process of its own, which a font's image that is written beyond would end."""
    assert subprocess.run([sys.executable, "-c", LETTERING], check=False, capture_output=True).returncode == 0


@pytest.mark.slow
def test_processes_of_other_settings_give_the_same() -> None:
    found = {}
    for seed, threads, where in (("0", 1, "main"), ("1", 2, "main"), ("77", 3, "thread"), ("random", 1, "thread")):
        environment = {**os.environ, "PYTHONHASHSEED": seed, **dict.fromkeys(LIBRARIES, str(threads))}
        command = [sys.executable, repeatable.__file__, str(threads), where]
        done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
        found[seed] = json.loads(done.stdout)
    assert set(found["0"]) == set(repeatable.PARTS)
    assert all(digests == found["0"] for digests in found.values()), found
