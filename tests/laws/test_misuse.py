# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the public API with every kind of wrong value: an answer, or an error of this package in one line."""

import inspect
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grasptrack as gt
from grasptrack.errors import LONGEST, GraspError, GraspTrackError, InputError
from grasptrack_bench.simulation import SHAPES
from stages import photo, pose

IMAGE = photo([(SHAPES["bracket"](), pose())])
RESULT = gt.GraspTracker().update(IMAGE)
VIEW: Any = RESULT.view
GRASP = gt.synthesize(VIEW)[0]
PART = gt.Part.of(IMAGE, VIEW, [GRASP], name="plate")
K = np.array([[350.0, 0.0, 160.0], [0.0, 350.0, 120.0], [0.0, 0.0, 1.0]])
LENS = gt.Camera(K, (0.1, 0.0, 0.0, 0.0), size=(320, 240))
GOAL = gt.Goal.taught(RESULT)

WRONG = {
    "None": None,
    "text": "text",
    "digits": "3",
    "bytes": b"x",
    "nan": math.nan,
    "inf": math.inf,
    "-inf": -math.inf,
    "negative": -1,
    "zero": 0,
    "large": 1e308,
    "too large": 10**400,
    "complex": 1j,
    "True": True,
    "object": object(),
    "empty": [],
    "mapping": {},
    "tuple": (1,),
    "ragged": [1, [2, 3]],
    "array of text": np.array(["a"]),
    "empty array": np.zeros((0, 2)),
    "array of NaN": np.full((4, 4), np.nan),
    "cube": np.zeros((3, 3, 3)),
    "complex array": np.array([1j, 2]),
    "array of objects": np.array([object()]),
    "array of times": np.zeros((2, 2), "datetime64[s]"),
    "a type": int,
    "wide": np.full((32, 100_000), 7, np.uint8),
    "tall": np.full((100_000, 32), 7, np.uint8),
    "six channels": np.zeros((240, 320, 6), np.uint8),
    "huge": 1e300,
    "nine contacts": 100.0 + 40.0 * np.array([(np.cos(k), np.sin(k)) for k in range(9)]),
    "contacts": np.random.default_rng(0).uniform(0, 240, (100, 2)),
    "far contacts": np.random.default_rng(0).normal(0, 1e200, (64, 2)),
    "NUL": "a\0b",
    "escape": "\x1b[2J",
    "long": "x" * 100_000,
    "function": lambda *given: None,
    "result": RESULT,
    "outline": VIEW,
}


def names(function: Callable[..., Any]) -> list[str]:
    return [name for name in inspect.signature(function).parameters if name != "self"]


def servoed(**given: Any) -> Any:
    return gt.GraspServo(**{"goal": GOAL, **given}).update(RESULT, time=0.0, pose=np.eye(4))


def drawn(**given: Any) -> Any:
    wire = gt.LiveWire(IMAGE)
    wire.start(100.0, 100.0)
    return wire.add(**{"x": 120.0, "y": 110.0, **given})


def call(function: Callable[..., Any], *only: str, **usual: Any) -> tuple[Callable[..., Any], list[str]]:
    """A function with its usual arguments, and the parameters that are given wrong values."""
    return lambda **given: function(**{**usual, **given}), list(only) or names(function)


CALLS: dict[str, tuple[Callable[..., Any], list[str]]] = {
    "GraspTracker": (lambda **given: gt.GraspTracker(**given).update(IMAGE), names(gt.GraspTracker)),
    "GraspTracker.update": (lambda **given: gt.GraspTracker().update(**{"image": IMAGE, **given}), ["image", "time", "mask"]),
    "Grasp": call(gt.Grasp, contacts=GRASP.contacts),
    "Grasp.on": call(GRASP.on),
    "Grasp.snapped": call(GRASP.snapped),
    "analyze": call(gt.analyze, grasp=GRASP, outline=VIEW),
    "Hand": (lambda **given: gt.Hand(**given).in_px(100.0), names(gt.Hand)),
    "Hand.in_px": call(gt.Hand(max_opening=gt.Length(3, "size")).in_px),
    "Length": (lambda **given: gt.Length(**{"value": 3.0, **given}).in_px(100.0, 2.0), ["value", "unit"]),
    "Length.in_px": call(gt.Length(3.0, "mm").in_px, size=100.0, px_per_mm=2.0),
    "synthesize": call(gt.synthesize, outline=VIEW),
    "transfer": call(
        gt.transfer, "grasp", "reference", "current", "strategy", "prior",
        grasp=GRASP, reference=VIEW, current=VIEW, strategy="grasp-line",
    ),
    "Camera": call(gt.Camera, matrix=K),
    "Camera.resized": call(LENS.resized, width=640, height=480),
    "Camera.distort": call(LENS.distort),
    "Camera.undistort": call(LENS.undistort),
    "read_camera": call(gt.read_camera),
    "Part.load": call(gt.Part.load),
    "find": call(gt.find, "image", "parts", "risk", "ignore", image=IMAGE, parts=PART),
    "open_source": (lambda **given: list(gt.open_source(**{"spec": "/no/such", **given})), ["spec", "fps"]),
    "first_look": call(gt.first_look, image=IMAGE),
    "inspect": call(
        gt.inspect, "image", "grasp", "fingers", "friction", "hand", "strategy", "risk", "focal", "number",
        image=np.zeros((64, 64), np.uint8), runs=1,
    ),
    "LiveWire": call(gt.LiveWire, image=IMAGE),
    "LiveWire.add": (drawn, ["x", "y"]),
    "GraspServo": (servoed, names(gt.GraspServo)),
    "GraspServo.update": (
        lambda **given: gt.GraspServo(GOAL).update(**{"result": RESULT, "time": 0.0, "pose": np.eye(4), **given}),
        ["result", "time", "pose"],
    ),
    "Goal.fingertips": call(gt.Goal.fingertips, points_px=GRASP.contacts, opening_m=0.05),
    "Goal.taught": call(gt.Goal.taught, result=RESULT),
    "NominalCamera": call(gt.NominalCamera, focal=300.0),
    **{c.__name__: call(c) for c in (gt.Limits, gt.Gain, gt.LossPolicy, gt.Exploration, gt.Closing, gt.Bounds)},
}  # fmt: skip
MORE: dict[str, tuple[Callable[..., Any], list[str]]] = {
    "Contour": call(gt.Contour, points=VIEW.outer.points),
    "Contour.transformed": call(VIEW.outer.transformed),
    "View": call(gt.View, contours=[VIEW.outer]),
    "Camera.jacobian": call(LENS.jacobian),
    "Camera.within": call(LENS.within),
    "draw": call(gt.draw, image=IMAGE, found=VIEW),
    "Goal": (
        lambda **given: servoed(goal=gt.Goal(**{"kind": "taught", "points": GRASP.contacts, **given})),
        ["kind", "points", "opening", "beyond", "symmetric"],
    ),
    "Goal.save": call(GOAL.save),
    "Gain.at": call(gt.Gain().at),
    "Exploration.twist": call(gt.Exploration().twist, axis=0, elapsed=0.1, seconds=0.2, larger=1.0),
    "GraspServo.closed": (lambda **given: gt.GraspServo(GOAL).closed(**given), ["held", "opening"]),
    "GraspServo.stop": (lambda **given: gt.GraspServo(GOAL).stop(**given), ["reason"]),
    "GraspServo.between": call(gt.GraspServo(GOAL).between, time=0.0, pose=np.eye(4)),
}
"""Some of their messages say what is right without the parameter's name."""
OWN_CODE = {("GraspTracker", "choose", "a type"), ("GraspTracker", "segmenter", "a type")}
"""A function or class of the caller's is called, and its errors are the caller's."""


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", [*CALLS, *MORE])
def test_a_misuse_is_an_error_of_this_package(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # whatever is a name of a file is written
    function, parameters = {**CALLS, **MORE}[name]
    failed = []
    for parameter in parameters:
        for kind, value in WRONG.items():
            if (name, parameter, kind) in OWN_CODE:
                continue
            try:
                function(**{parameter: value})
            except GraspTrackError as error:
                if not (str(error).isprintable() and 0 < len(str(error)) <= LONGEST):
                    failed.append((parameter, kind, f"message {error}"))
            except Exception as error:
                failed.append((parameter, kind, f"{type(error).__name__}: {error}"))
    assert not failed, f"{len(failed)}: {failed[:5]}"


@pytest.mark.parametrize("wrong", [None, 5, [None], "text", [GRASP.contacts], np.zeros((3, 3))], ids=repr)
def test_what_a_choice_or_a_segmenter_of_the_callers_returns_is_looked_at(wrong: Any) -> None:
    class Proposing:
        def regions(self, *given: Any) -> Any:
            return wrong

    with pytest.raises(GraspError, match="choose must return grasps"):
        gt.GraspTracker(choose=lambda view: wrong).update(IMAGE)
    with pytest.raises(InputError, match="must return a sequence of Region"):
        gt.GraspTracker(segmenter=Proposing()).update(IMAGE)


def test_a_hand_is_no_larger_than_anything_and_a_grasp_has_no_more_contacts_than_hands_have_fingers() -> None:
    for name in ("clearance", "finger_width", "finger_thickness", "min_opening"):
        with pytest.raises(InputError, match=f"{name} must be a length below"):
            gt.Hand(**{name: 1e300})
    for count in (9, 100):
        grasp = gt.Grasp(VIEW.outer.points[:count])
        for judge in (lambda g: gt.analyze(g, VIEW), lambda g: gt.GraspTracker(grasp=g.contacts)):
            with pytest.raises(GraspError, match="at most 8 fingers"):
                judge(grasp)


def test_a_pickle_of_another_version_is_refused() -> None:
    tracker = gt.GraspTracker()
    state = tracker.__getstate__()
    del state["_wish"]
    with pytest.raises(InputError, match="no tracker of this version"):
        tracker.__setstate__(state)


def test_there_are_thousands_of_misuses() -> None:
    assert sum(len(parameters) for _, parameters in CALLS.values()) * len(WRONG) > 3000


@pytest.mark.parametrize("name", [n for n in CALLS if n not in ("open_source", "Hand", "Length", "Goal.taught")])
def test_what_is_no_value_at_all_is_refused_by_its_name(name: str) -> None:
    function, parameters = CALLS[name]
    for parameter in parameters:
        if parameter in ("segmenter", "law"):  # anything that has the methods will do; choices are listed
            continue
        with pytest.raises(InputError, match=rf"\b{parameter}\b") as error:
            function(**{parameter: object()})
        assert error.value.values["name"] == parameter


def test_a_length_in_a_unit_that_nobody_measures_parts_in_is_refused() -> None:
    with pytest.raises(InputError, match="unit must be one of px, mm, cm, m, in, inch, size, not 'furlong'"):
        gt.Length(3, "furlong")  # type: ignore[arg-type]
    assert gt.Length(3, "mm").in_px(10.0, 2.0) == 6.0 and gt.Length(3) == gt.Length(3.0, "px")


@pytest.mark.parametrize("wrong", [math.nan, math.inf, "now", True])
def test_a_time_that_is_none_is_refused_and_the_run_goes_on(wrong: Any) -> None:
    tracker = gt.GraspTracker()
    tracker.update(IMAGE, time=0.0)
    with pytest.raises(InputError, match="time must be a finite number"):
        tracker.update(IMAGE, time=wrong)
    result = tracker.update(IMAGE, time=0.1)
    assert (result.frame, result.status) == (1, "tracked")


def test_a_time_that_goes_back_is_told_once() -> None:
    tracker = gt.GraspTracker()
    with pytest.warns(UserWarning, match=r"update 2 was given the time 0.5 s, after one of 1 s") as told:
        for time in (0.0, 1.0, 0.5, 0.25, 1.5):
            tracker.update(IMAGE, time=time)
    assert len(told) == 1
