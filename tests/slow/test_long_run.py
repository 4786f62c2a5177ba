# SPDX-License-Identifier: Apache-2.0
"""A long run of mixed sequences: memory does not grow with the updates."""

from pathlib import Path

import pytest

from long_run import run

LARGEST = 0.03
"""Share of the memory by which two halves of a run may differ: what an allocator keeps."""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is looked up in /proc")
@pytest.mark.filterwarnings("ignore")
def test_memory_does_not_grow_with_updates() -> None:
    found = run(1250, 3)
    assert found.counts["tracked"] > 500
    assert all(found.counts[name] for name in ("lost", "refused", "copied", "pickled", "new")), found.counts
    assert found.growth < LARGEST * found.memory[0], found.memory
