# SPDX-License-Identifier: Apache-2.0
"""Where it is not sure which object is meant: it is said, it is shown, and no hand moves."""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack import GraspTracker, synthesize
from grasptrack.cli.main import main
from grasptrack.errors import GraspError, InputError
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.trackability import inspect
from grasptrack_bench.simulation import SHAPES, Scene, similarity_path
from scenery import L_PLATE, SQUARE, drawn
from servo_bench import Bench

TWO = drawn(L_PLATE, L_PLATE, centres=((180.0, 240.0), (460.0, 240.0)), size=(480, 640))
ALONE = drawn(L_PLATE, centres=((320.0, 240.0),), size=(480, 640))


def first_result(image: np.ndarray = TWO, **asked: Any) -> gt.TrackResult:
    return gt.GraspTracker(**asked).update(image)


def test_two_equal_objects_are_not_sure_and_one_alone_is() -> None:
    assert not first_result().object_sure
    assert first_result(ALONE).object_sure
    tracker = gt.GraspTracker()
    assert tracker.object_sure
    assert [tracker.update(TWO).object_sure for _ in range(3)] == [False] * 3
    assert tracker.candidates[0].probability < 0.9


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "word",
    [
        {"object_at": (160, 240)},
        {"box": (100, 180, 160, 120)},
        {"outline": [(100, 180), (260, 180), (260, 300), (100, 300)]},
        {"number": 1},
        {"number": 2},
        {"sure": 0.0},
        {"segmenter": lambda seen: (seen < 130) & (np.arange(640) < 320)},
    ],
)
def test_a_word_of_a_person_makes_it_sure(word: dict[str, Any]) -> None:
    result = first_result(**word)
    assert result.status == "tracked" and result.object_sure


def test_what_is_not_on_the_object_is_no_word_which_is() -> None:
    """Three are left two."""
    three = drawn(L_PLATE, L_PLATE, L_PLATE, centres=((110.0, 120.0), (320.0, 240.0), (530.0, 360.0)), size=(480, 640))
    assert not first_result(three, not_at=(100, 120)).object_sure


@settings(max_examples=12)
@given(
    turn=st.floats(0.0, 6.28),
    wide=st.floats(8.0, 26.0),
    at=st.floats(-0.5, 0.5),
    seed=st.integers(0, 9),
)
def test_contacts_say_where_and_not_how_far_it_reaches(turn: float, wide: float, at: float, seed: int) -> None:
    """A cable of the plate's grey that comes from outside lies within the same outline: that is right, or it is not sure."""
    ring = np.array([[-90, -55], [90, -55], [90, 55], [-90, 55]], dtype=np.float64)
    middle = 90.0 * at
    cable = np.array([[middle - wide, -50], [middle + wide, -50], [middle + wide, -500], [middle - wide, -500]])
    image = drawn(ring, cable, centres=((320.0, 240.0),) * 2, angle=turn, size=(480, 640), seed=seed)
    c, s = np.cos(turn), np.sin(turn)
    contacts = np.array([[-90.0, 0.0], [90.0, 0.0]]) @ np.array([[c, s], [-s, c]]) + (320.0, 240.0)
    tracker = gt.GraspTracker(grasp=contacts)
    result = tracker.update(image)
    assert result.status == "tracked" and result.view is not None
    assert result.object_probability == tracker.candidates[0].probability
    right = result.view.outer.area == pytest.approx(180.0 * 110.0, rel=0.03)
    assert right or not result.object_sure
    alone = drawn(ring, centres=((320.0, 240.0),), angle=turn, size=(480, 640), seed=seed)
    assert first_result(alone, grasp=contacts).object_sure


def test_of_what_carries_the_contacts_a_number_takes_one() -> None:
    """A cable of the plate's grey runs up to it: the plate, or both together."""
    ring, cable = 1.5 * SQUARE, np.array([[-12, -70], [12, -70], [12, -300], [-12, -300]], dtype=np.float64)
    image = drawn(ring, cable, centres=((260.0, 240.0),) * 2, angle=0.0, size=(480, 640))
    contacts = [[185.0, 240.0], [335.0, 240.0]]
    found = gt.GraspTracker(grasp=contacts)
    assert not found.update(image).object_sure
    assert found.candidates[0].view.outer.area == pytest.approx(150.0**2, rel=0.02)
    assert len(found.candidates) > 1
    for number, each in enumerate(found.candidates, 1):
        result = first_result(image, grasp=contacts, number=number)
        assert result.object_sure and result.view == each.view
    with pytest.raises(InputError, match="candidates, not 9"):
        first_result(image, grasp=contacts, number=9)


@pytest.mark.parametrize("sure", [-0.1, 1.0, float("nan")])
def test_no_probability_is_told(sure: float) -> None:
    for refused in (lambda: gt.GraspTracker(sure=sure), lambda: gt.first_look(TWO, sure=sure)):
        with pytest.raises(InputError, match="0 or more and below 1"):
            refused()


@given(st.integers(0, 20), st.integers(1, 60))
def test_no_hand_moves_before_it_is_sure(seed: int, frames: int) -> None:
    """However long it lasts; then it goes as if it had begun there."""
    bench = Bench(seed=seed % 6)
    servo = gt.GraspServo(bench.goal(), bench.dof, latency=bench.latency)
    for _ in range(frames):
        result = replace(bench.result(), object_sure=False)
        command = servo.update(result, time=bench.time, pose=bench.hand)
        assert command.state == "unsure" and not command.twist.any() and not command.close
        assert "number=1" in command.reason and "\n" not in command.reason
        bench.move(command.twist)
    moved = False
    for _ in range(10):
        command = servo.update(bench.result(), time=bench.time, pose=bench.hand)
        bench.move(command.twist)
        moved = moved or bool(command.twist.any())
    assert moved and command.state == "approaching"


def test_it_does_not_wait_for_ever_and_a_moving_hand_stops() -> None:
    bench = Bench(seed=1)
    servo = gt.GraspServo(bench.goal(), bench.dof, time_limit=2.0)
    for k in range(200):
        result = replace(bench.result(), object_sure=k < 20)
        command = servo.update(result, time=bench.time, pose=bench.hand)
        bench.move(command.twist)
        if k == 40:
            assert command.state == "unsure" and not command.twist.any()
        if servo.over:
            break
    assert servo.state == "failed" and "not sure" in servo.reason


@pytest.mark.slow
def test_a_rendered_hand_stands_still_and_says_why(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    from grasptrack_bench.approach.case import ApproachCase
    from grasptrack_bench.approach.trial import Step, run_trial
    from grasptrack_bench.simulation import SHAPES

    twists = []

    def watch(world: object, step: Step) -> None:
        if step.command is not None:
            twists.append(step.command.twist)

    row, _ = run_trial(ApproachCase(SHAPES["bracket"](), 3, pictures=False, sure=0.9999), watch)
    assert row.outcome == "failed" and "not sure which object" in row.reason
    assert not np.any(twists)
    assert main(["servo", "--sure", "1.2", "--output", str(tmp_path)]) == 2


@pytest.mark.parametrize("verb", ["track", "inspect"])
def test_verbs_with_contacts_go_on_and_say_that_it_is_not_sure(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ring, cable = 1.5 * SQUARE, np.array([[-12, -70], [12, -70], [12, -300], [-12, -300]], dtype=np.float64)
    photo, out = tmp_path / "cable.png", tmp_path / "out"
    cv2.imwrite(str(photo), drawn(ring, cable, centres=((260.0, 240.0),) * 2, angle=0.0, size=(480, 640)))
    words = [verb, str(photo), "--grasp", "185,240 335,240", "--output", str(out)]
    words += ["--no-video"] if verb == "track" else ["--runs", "1"]
    assert main(words) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "is not sure" in told and "round it" in told
    assert (out / "candidates.png").exists()
    if verb == "track":
        (row,) = csv.DictReader((out / "grasps.csv").read_text().splitlines())
        assert row["status"] == "tracked" and row["object_sure"] == "0" and float(row["object_probability"]) < 0.9
    assert main([*words, "--choose", "1"]) == 0
    assert "not sure" not in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("verb", "more"), [("inspect", ["--runs", "1"]), ("synthesize", []), ("track", ["--no-video"])]
)
def test_verbs_show_what_it_may_be_and_take_one(
    verb: str, more: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo, out = tmp_path / "two.png", tmp_path / "out"
    cv2.imwrite(str(photo), TWO)
    words = [verb, str(photo), "--output", str(out), *more]
    assert main(words) == 0
    assert "is not sure" in capsys.readouterr().out.replace("\n", " ")
    assert cv2.imread(str(out / "candidates.png")).shape == (480, 640, 3)
    for word in (["--choose", "1"], ["--choose", "2"], ["--sure", "0"]):
        assert main([*words, *word]) == 0
        assert "not sure" not in capsys.readouterr().out
        assert not (out / "candidates.png").exists()
    assert main([*words, "--choose", "2", "--outline", "100,180 260,180 260,300 100,300"]) == 2
    assert "1 candidates, not 2" in capsys.readouterr().err
    assert main([*words, "--sure", "1"]) == 2
    if verb == "synthesize":
        assert main([*words, "--all"]) == 0
        assert "not sure" not in capsys.readouterr().out
        assert main([*words, "--all", "--choose", "2"]) == 2


def test_candidates_of_an_inspection_are_those_of_the_first_look() -> None:
    found = inspect(TWO, runs=1)
    assert len(found.candidates) >= 2
    other = inspect(TWO, number=2, runs=1)
    places = [f.view.outer.points[:, 0].mean() > 320 for f in (found, other)]
    assert places[0] != places[1]


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
