# SPDX-License-Identifier: Apache-2.0
"""What is returned is a value: it compares, prints in a line, and is pickled; a tracker is copied in the middle of a run."""

import copy
import pickle
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import grasptrack as gt
from grasptrack import GraspTracker, InputError, TrackResult
from grasptrack.equality import are_equal
from grasptrack.presentation import format_confidence
from grasptrack_bench.simulation import SHAPES
from stages import photo, pose
from synthesis_shapes import circle

BRACKET = SHAPES["bracket"]()
IMAGES = [photo([(BRACKET, pose(150.0 + 4 * k, 115.0 + 2 * k, 4.0 * k))], seed=k) for k in range(8)]
STRATEGIES = ("auto", "homography", "grasp-line", "rrp", "paper")
CAMERA = gt.Camera(np.array([[350.0, 0.0, 160.0], [0.0, 350.0, 120.0], [0.0, 0.0, 1.0]]), (-0.05, 0.01, 0.0, 0.0))
GRASP = np.array([[215.0, 110.0], [104.5, 113.3]])


def unpickled(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("copied", "after", "options"),
    [
        *((how, after, {"grasp": GRASP}) for how in (copy.deepcopy, unpickled) for after in (0, 4)),
        *((copy.deepcopy, 4, {"strategy": strategy, "grasp": GRASP}) for strategy in STRATEGIES[1:]),
        (unpickled, 4, {"camera": CAMERA}),
    ],
)
def test_a_copied_tracker_goes_on_alike(copied: Callable[[Any], Any], after: int, options: dict[str, Any]) -> None:
    images = [*IMAGES[:5], np.full_like(IMAGES[0], 90), *IMAGES[5:]]
    tracker = gt.GraspTracker(**options)
    for image in images[:after]:
        tracker.update(image)
    twin = copied(tracker)
    mine = [tracker.update(image) for image in images[after:]]
    other = [twin.update(image) for image in images[after:]]
    assert mine == other
    assert any(r.located for r in mine[2:])
    assert tracker.candidates == twin.candidates


def test_a_tracker_knows_no_buffer_of_its_callers() -> None:
    grey = [image if image.ndim == 2 else image[:, :, 1] for image in IMAGES]
    apart, reused = gt.GraspTracker(), gt.GraspTracker()
    buffer = np.empty_like(grey[0])
    for k, image in enumerate(grey):
        time = 0.25 * k if k else None
        mine = apart.update(image.copy(), time)
        buffer[:] = image
        assert reused.update(buffer, time) == mine and mine.time == time
        assert np.array_equal(buffer, image)  # nor changes it
        buffer[:] = 0


def results() -> list[Any]:
    tracker = gt.GraspTracker(fingers=2)
    found: list[Any] = [tracker.update(image) for image in (*IMAGES[:2], np.zeros_like(IMAGES[0]))]
    view = found[0].view
    grasps = gt.synthesize(view)
    found += [view, view.outer, found[0].analysis, found[1].analysis, grasps[0], grasps, gt.Grasp(GRASP), CAMERA]
    found += tracker.candidates
    found += gt.first_look(IMAGES[0])[:1]
    found += [gt.transfer(grasps[0], view, view, "grasp-line"), gt.inspect(IMAGES[0], runs=1)]
    found += [gt.Frame(0, 0.5, IMAGES[0], "a.png"), gt.Goal.taught(found[0]), gt.Hand(), gt.Length(3.0), gt.Limits()]
    found += [gt.Command(np.zeros(6), "holding", "why"), gt.NominalCamera(300.0, np.eye(4))]
    return found


RESULTS = results()


@pytest.mark.parametrize("value", RESULTS, ids=lambda v: type(v).__name__)
def test_a_result_is_a_value(value: Any) -> None:
    for copied in (copy.deepcopy(value), unpickled(value)):
        assert are_equal(copied, value) and are_equal(value, copied)
        assert copied == value and not (copied != value)  # noqa: SIM202
        if type(value).__hash__ is not None:
            assert hash(copied) == hash(value)
    line = repr(value)
    assert "\n" not in line and len(line) < (2000 if isinstance(value, list) else 250), line


def test_comparing_any_two_results_answers_yes_or_no() -> None:
    for i, first in enumerate(RESULTS):
        for j, second in enumerate(RESULTS):
            assert (first == second) in (True, False)
            if i == j:
                assert first == second
        assert first != "something else" and first is not None


def test_what_differs_is_not_equal() -> None:
    first, second, lost = RESULTS[:3]
    assert first != second and second != lost
    assert gt.Grasp(GRASP) != gt.Grasp(GRASP + 0.001)
    assert gt.Grasp(GRASP, 0.5) != gt.Grasp(GRASP, 0.6)
    assert gt.GraspList([], "a") != gt.GraspList([], "b")
    one, other = gt.Contour(circle(0, 0, 20, 8)), gt.Contour(circle(0, 0, 40, 8))
    assert not are_equal(one, other) and one != other and one == gt.Contour(circle(0, 0, 20, 8))
    assert one.transformed(np.eye(3)) == one and hash(one.transformed(np.eye(3))) == hash(one)
    assert gt.View(one) == gt.View([one]) and gt.View(one) != gt.View(other)
    assert gt.View(one) != gt.View(one, np.zeros((4, 4), np.uint8))


NESTED = st.recursive(
    st.one_of(
        st.integers(),
        st.floats(),
        st.text(max_size=3),
        hnp.arrays(np.float64, hnp.array_shapes(max_dims=2, max_side=3)),
    ),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=2), inner, max_size=3)),
    max_leaves=8,
)


@given(NESTED, NESTED)
def test_equality_is_reflexive_and_symmetric(first: Any, second: Any) -> None:
    assert are_equal(first, copy.deepcopy(first))
    assert are_equal(first, second) is are_equal(second, first)


@given(st.one_of(st.floats(0.0, 1.0), st.floats(-12.0, -1.0).map(lambda power: 1.0 - 10.0**power)), st.integers(2, 4))
def test_no_confidence_is_rounded_up_to_certainty(confidence: float, decimals: int) -> None:
    text = format_confidence(confidence, decimals)
    shown = len(text.partition(".")[2])
    assert abs(float(text) - confidence) <= 0.5000001 * 10.0**-shown
    assert text == "1" if confidence == 1.0 else decimals <= shown <= 9
    assert float(text) < 1.0 or 1.0 - confidence < 1e-9


def test_a_lost_frame_does_not_read_as_certain() -> None:
    lost = gt.TrackResult(58, None, "lost", "another shape", reason_code="other-shape", confidence=0.9960830118693142)
    assert repr(lost) == "TrackResult(frame 58: lost (other-shape), confidence 0.9961)"


PARTS = [SHAPES[name]() for name in ("bracket", "gasket", "notched-plate")]
SEQUENCES = [[photo([(part, pose(150.0 + 4 * k, 115.0 + 2 * k, 4.0 * k))], seed=k) for k in range(8)] for part in PARTS]


def track(images: list[np.ndarray]) -> list[TrackResult]:
    tracker = GraspTracker()
    return [tracker.update(image, time=0.1 * k) for k, image in enumerate(images)]


def test_trackers_in_threads_give_what_each_gives_alone() -> None:
    alone = [track(images) for images in SEQUENCES]
    assert all(any(r.located for r in results[1:]) for results in alone)
    with ThreadPoolExecutor(len(SEQUENCES)) as pool:
        assert list(pool.map(track, SEQUENCES)) == alone


def test_one_tracker_in_two_threads_is_refused_and_unharmed() -> None:
    within, go_on = threading.Event(), threading.Event()

    def segment(image: np.ndarray) -> np.ndarray:
        within.set()
        assert go_on.wait(30.0)
        return np.asarray(image < 120)

    tracker = GraspTracker(segmenter=segment)
    image = SEQUENCES[0][0]
    with ThreadPoolExecutor(1) as pool:
        first: Any = pool.submit(tracker.update, image)
        assert within.wait(30.0)
        with pytest.raises(InputError, match="one thread at a time"):
            tracker.update(image)
        go_on.set()
        assert first.result().frame == 0
    assert tracker.update(image).frame == 1
