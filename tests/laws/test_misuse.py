# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the public API with every kind of wrong value: an answer, or an error of this package in one line."""

import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import grasptrack as gt
from grasptrack.errors import GraspTrackError, InputError
from grasptrack_bench.simulation import SHAPES
from stages import photo, pose

IMAGE = photo([(SHAPES["bracket"](), pose())])
RESULT = gt.GraspTracker().update(IMAGE)
VIEW: Any = RESULT.view
GRASP = gt.synthesize(VIEW)[0]
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
    **{c.__name__: call(c) for c in (gt.Limits, gt.Gain, gt.LossPolicy, gt.Exploration, gt.Closing)},
}  # fmt: skip
OWN_CODE = {("GraspTracker", "choose", "a type"), ("GraspTracker", "segmenter", "a type")}
"""A function or class of the caller's is called, and its errors are the caller's."""


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", CALLS)
def test_a_misuse_is_an_error_of_this_package(name: str) -> None:
    function, parameters = CALLS[name]
    failed = []
    for parameter in parameters:
        for kind, value in WRONG.items():
            if (name, parameter, kind) in OWN_CODE:
                continue
            try:
                function(**{parameter: value})
            except GraspTrackError as error:
                if "\n" in str(error) or not str(error):
                    failed.append((parameter, kind, f"message {error}"))
            except Exception as error:
                failed.append((parameter, kind, f"{type(error).__name__}: {error}"))
    assert not failed, f"{len(failed)}: {failed[:5]}"


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
