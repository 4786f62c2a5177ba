# SPDX-License-Identifier: Apache-2.0
"""Sessions at full speed with pages and recordings that come and go: no file stays open and no thread is left."""

from collections import Counter
from pathlib import Path

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
pytest.importorskip("websockets")

from long_live import RECORDED_AS, ROUNDS, Held, LongLive, run


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="open files are looked up in /proc")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("suffix", RECORDED_AS)
def test_nothing_is_left_open(suffix: str) -> None:
    if suffix == ".mcap":
        pytest.importorskip("foxglove", reason="the extra foxglove is not installed")
    found = run(1.0, 5, suffix)  # ROUNDS of them, however long they take
    assert found.findings == [] and len(found.held) == found.counts["rounds"] >= ROUNDS
    assert found.counts["recordings"] and found.counts["clients"] and found.counts["images"] > 5 * ROUNDS, found.counts


@pytest.mark.parametrize("name", ["files", "threads"])
def test_what_grows_with_every_round_is_found(name: str) -> None:
    flat = [Held(100.0, 10, 8)] * 12
    assert LongLive(Counter(), flat, (0, 0)).findings == []
    once = flat[:3] + [held._replace(**{name: 20}) for held in flat[3:]]
    assert LongLive(Counter(), once, (0, 0)).findings == []
    growing = [held._replace(**{name: 10 + k}) for k, held in enumerate(flat)]
    (line,) = LongLive(Counter(), growing, (0, 0)).findings
    assert line == f"{name} grow: 15 at most, then 19 at least"
    assert LongLive(Counter(), flat, (1, 0)).findings == ["1 files are left over"]
