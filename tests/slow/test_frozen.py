# SPDX-License-Identifier: Apache-2.0
"""What users see stays as it is where nothing was meant to change it: see `frozen`."""

import json

import pytest

import frozen

KEPT = json.loads((frozen.FROZEN / "grasps.json").read_text())


@pytest.mark.parametrize("name", frozen.sequence_names())
def test_grasps_are_the_same(name: str) -> None:
    images = list(frozen.images_of(name))
    for strategy in frozen.STRATEGIES:
        kept, rows = KEPT["grasps"][f"{name} {strategy}"], frozen.grasps_csv(images, strategy)
        assert frozen.differing(kept["frames"], frozen.in_short(rows)) == [], strategy
        if frozen.machine() == KEPT["machine"]:
            assert frozen.digest(rows) == kept["digest"], strategy


@pytest.mark.parametrize("name", list(frozen.TEXTS))
def test_texts_are_the_same(name: str) -> None:
    assert frozen.TEXTS[name]() == (frozen.FROZEN / name).read_text()


def test_a_difference_is_told() -> None:
    kept = ["tracked 1.00 2.00 3.00 4.00", "lost"]
    assert frozen.differing(kept, kept) == []
    assert frozen.differing(kept, ["tracked 1.00 2.00 3.00 4.06", "lost"]) == [0]
    assert frozen.differing(kept, ["tracked 1.00 2.00 3.00 4.00", "tracked 1.00 2.00 3.00 4.00"]) == [1]
    assert frozen.differing(kept, kept[:1]) == [0, 1]
