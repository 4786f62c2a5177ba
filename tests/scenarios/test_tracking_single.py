# SPDX-License-Identifier: Apache-2.0
"""An image that follows no other: judged by all that is seen in it, and by nothing that an image before could tell."""

import math
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.estimator import first_state
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.pose import PoseEstimate, largest_sigma
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.single import decide_single, pose_hypothesis, single_estimate, turned_hypotheses
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import build_pyramid
from scenery import L_PLATE, SQUARE, drawn

SIZE = (480, 640)


def begun(shape: np.ndarray, centre: tuple[float, float] = (320.0, 240.0)) -> TrackState:
    """A plate as it is drawn, gripped at two of its points."""
    ahead = np.roll(shape, -1, axis=0) - shape
    fine = np.concatenate(
        [a + np.linspace(0, 1, 80, endpoint=False)[:, None] * b for a, b in zip(shape, ahead, strict=True)]
    )
    levels = build_pyramid(drawn(shape, centres=(centre,), angle=0.0, size=SIZE))
    target = make_target(levels, View(Contour(fine + centre)), fine[[40, 200]] + centre, NUMBERS)
    return first_state(target, levels)


def placed(x: float, y: float, angle: float = 0.0) -> np.ndarray:
    """From the first image to one in which the plate lies at (x, y), turned."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    to, back = np.eye(3), np.eye(3)
    to[:2, 2], back[:2, 2] = (x, y), (-320.0, -240.0)
    return to @ turn @ back


def seen(state: TrackState, H: np.ndarray, image: np.ndarray) -> PoseEstimate:
    found = single_estimate(state, build_pyramid(image), pose_hypothesis(state.target, "given", H))
    assert found is not None
    return found


@pytest.mark.parametrize("angle", [0.0, 2.0])
def test_where_it_lies_and_how_it_turned_is_of_no_account(angle: float) -> None:
    state = begun(L_PLATE)
    for x, y in ((160.0, 120.0), (480.0, 330.0)):
        H = placed(x, y, angle)
        e = seen(state, H, drawn(L_PLATE, centres=((x, y),), angle=angle, size=SIZE, seed=2))
        decision = decide_single(state, [e])
        assert decision.is_accepted
        assert np.hypot(*(e.contacts - apply_homography(H, state.target.contacts)).T).max() < 0.3


@pytest.mark.parametrize(("share", "accepted"), [(0.9, True), (1.1, False)])
def test_the_largest_deviation_is_that_at_which_the_decision_refuses(share: float, accepted: bool) -> None:
    state = begun(2.0 * L_PLATE)
    e = seen(state, np.eye(3), drawn(2.0 * L_PLATE, centres=((320.0, 240.0),), angle=0.0, size=SIZE, seed=2))
    sigma = share * largest_sigma(e.area, NUMBERS) / NUMBERS.inflate
    uncertain = {name: getattr(e, name) for name in dir(e) if name[0] != "_"}
    uncertain["covariance"] = np.tile(sigma**2 * np.eye(2), (len(e.contacts), 1, 1))
    decision = decide_single(state, [cast(PoseEstimate, SimpleNamespace(**uncertain))])
    assert decision.is_accepted == accepted and decision.code == ("" if accepted else "uncertain")


def test_turns_that_nothing_tells_apart_are_not_believed() -> None:
    state = begun(SQUARE)
    levels = build_pyramid(drawn(SQUARE, centres=((320.0, 240.0),), angle=0.0, size=SIZE, seed=2))
    own = single_estimate(state, levels, pose_hypothesis(state.target, "given", np.eye(3)))
    assert own is not None and len(state.target.turns) == 3 and decide_single(state, [own]).is_accepted
    turned = [single_estimate(state, levels, h) for h in turned_hypotheses(state.target, own)]
    decision = decide_single(state, [own, *(e for e in turned if e is not None)])
    assert not decision.is_accepted and decision.presence < 0.5
