# SPDX-License-Identifier: Apache-2.0
"""The atlas of failures: its causes are those without which most of an error is gone."""

import re

import numpy as np
import pytest

from research.paper.footage import ideal_footage, make_part
from research.paper.transfers import COMPARED, transfer_and_measure
from research.studies.failures import SHOWN, WorstView, cause_of, draw_atlas, failure_rows, tilt_degrees, worst_views


@pytest.fixture(scope="module")
def found():
    return worst_views(("bracket", "spoon"), 1, 20)


def test_the_worst_view_of_each_shape_is_there_the_farthest_off_first(found):
    assert list(found) == list(COMPARED)
    for strategy, failures in found.items():
        assert len(failures) == 2 <= SHOWN and {f.footage.part.name for f in failures} == {"bracket", "spoon"}
        assert [f.off for f in failures] == sorted((f.off for f in failures), reverse=True)
        for f in failures:
            course = transfer_and_measure(f.footage, strategy, "first view")
            assert f.off == max(e.maximum_px for e in course.answered)


def one(strategy, motion, frame=-1):
    footage = ideal_footage(make_part("bracket", 0), "resampled", motion, 100, 0)
    answers = transfer_and_measure(footage, strategy, "first view").answers
    off = footage.truth(strategy, len(answers) + 1 + frame) - answers[frame]
    return WorstView(footage, strategy, len(answers) + 1 + frame, answers[frame], float(np.hypot(*off.T).max()))


def test_causes_are_named():
    tilted = one("rrp", "6 DoF")
    assert cause_of(tilted) == f"tilt of {tilt_degrees(tilted):.0f} degrees: the tracker has 4 DoF"
    assert 10.0 < tilt_degrees(tilted) < 25.0 and tilt_degrees(one("rrp", "approach")) < 0.01
    assert cause_of(one("paper-rrp", "4 DoF")) == "a place is a whole sample"
    assert "turns and shifts the axes" in cause_of(one("grasp-line", "6 DoF"))
    assert "the object is seen 2.50 times as large" in cause_of(one("paper-grasp-line", "approach"))
    assert re.search(r"match(es)? (of four )?(is|are) \d", cause_of(one("paper-homography", "6 DoF")))


def test_the_picture_and_the_table_have_all_of_them(found):
    rows = list(failure_rows(found))
    assert len(rows) == 2 * len(COMPARED) and all(all(row) for row in rows)
    assert draw_atlas(found).shape[2] == 3
