# SPDX-License-Identifier: Apache-2.0
"""A grasp chosen by the caller, on the outline that the tracker found."""

import numpy as np
import pytest

from grasptrack import GraspTracker, synthesize
from grasptrack.errors import GraspError, InputError
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack_bench.simulation import SHAPES, Scene, similarity_path

FRAMES = Scene(SHAPES["bracket"](), similarity_path(4, seed=5), seed=5)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("rank", [0, 3])
def test_the_grasp_that_was_chosen_is_followed(rank: int) -> None:
    seen: list[View] = []

    def choose(view: View) -> list[Grasp]:
        seen.append(view)
        return [synthesize(view, 2)[rank]]

    tracker, first = GraspTracker(choose=choose), None
    for frame in FRAMES:
        result = tracker.update(frame.image)
        assert result.contacts is not None, result.reason
        first = result.contacts if first is None else first
        assert np.hypot(*(result.contacts - frame.carry(first)).T).max() < 0.3
    assert len(seen) == 1 and first is not None
    np.testing.assert_allclose(first, synthesize(seen[0], 2)[rank].contacts, atol=0.5)


def test_a_choice_of_none_says_so_and_is_asked_again() -> None:
    asked = 0

    def choose(view: View) -> list[Grasp]:
        nonlocal asked
        asked += 1
        return [] if asked == 1 else [synthesize(view, 2)[0]]

    tracker = GraspTracker(choose=choose)
    result = tracker.update(FRAMES[0].image)
    assert result.status == "searching" and "made none" in result.reason and result.view is not None
    assert tracker.update(FRAMES[1].image).status == "tracked"


def test_what_cannot_be_meant_is_refused() -> None:
    with pytest.raises(GraspError, match="3 contacts"):
        GraspTracker(fingers=3, choose=lambda view: [synthesize(view, 2)[0]]).update(FRAMES[0].image)
    with pytest.raises(InputError, match="give one of them"):
        GraspTracker(grasp=[[1.0, 2.0], [30.0, 40.0]], choose=lambda view: [])
