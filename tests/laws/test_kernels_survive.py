# SPDX-License-Identifier: Apache-2.0
"""Every kernel survives any array: an answer or a refusal, as their definitions have it; what once crashed is played again."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest

import _grasptrack_native as native
import grasptrack as gt
import reference
from children import run_trials
from contour_trials import judge_number, judge_pair
from corpus import FOLDER, read_case
from kernel_calls import NAMES, REFUSALS, Call, draw_call, judge_call, make_call, types_of
from scene import CLASS, SPECIAL, USUAL, Scene, parameters_of

CASES = sorted(FOLDER.glob("*.json"))
PATIENT = 120.0 if "sanitize" in native.__file__ else 10.0  # seconds; under sanitizers all takes ten times as long


def test_each_parameter_of_each_kernel_has_a_good_argument_that_is_taken() -> None:
    for seed, name in enumerate(NAMES):
        rng = np.random.default_rng(seed)
        scene = Scene(rng)
        while len(np.unique(scene.outer, axis=0)) < len(scene.outer):  # one of the odd outlines
            scene = Scene(rng)
        of_class = CLASS if "." in name else name
        assert all(f"{of_class}.{p}" in SPECIAL or p in USUAL for p in parameters_of(of_class))
        arguments = [scene.argument(name.partition(".")[2] or name, p) for p in parameters_of(name)]
        made = [scene.argument(CLASS, p) for p in parameters_of(CLASS)] if "." in name else []
        for module in [native] if name.startswith(CLASS) else [native, reference]:
            assert judge_call(Call(name, arguments, made), module) == "answered", name


@pytest.mark.sampled(12)
@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_what_was_found_stays_mended(path: Path) -> None:
    case = read_case(path)

    def trial(module: int) -> str:
        if not isinstance(case, Call):
            return judge_pair(case)
        return judge_call(case, (native, reference)[module])

    alone = isinstance(case, Call) and case.kernel.startswith(CLASS)  # the class has no definition of its own
    ran = run_trials(trial, 0, 1 if alone else 2, patience=120.0)
    assert not ran.findings, ran.findings


def test_calls_with_odd_arguments() -> None:
    ran = run_trials(lambda index: judge_call(draw_call(2, index), native), 0, 1000, PATIENT)
    assert not ran.findings, ran.findings
    assert ran.outcomes["answered"] > 300 and ran.outcomes["refused"] > 300


def test_degenerate_contours() -> None:
    ran = run_trials(lambda index: judge_number(2, index), 0, 300, PATIENT)
    assert not ran.findings, ran.findings
    assert ran.outcomes["carried"] > 30 and ran.outcomes["refused"] > 30


def test_kernels_refuse_what_their_definitions_refuse() -> None:
    # a width of which rounding makes nothing; shares of any shape; regions below 0, of which NumPy has no root
    differ = {"contact_frames", "judge_contacts", "surface_evidence", "surface_probability", "rank_grasps"}
    apart, compared = [], 0
    for index in range(800):
        call = draw_call(3, index)
        # the class is declared, and refuses what test_kernels_pose says
        if (
            call.kernel in differ
            or call.kernel.startswith(CLASS)
            or types_of(call) != types_of(draw_call(3, index, odd=False))
        ):
            continue
        try:
            make_call(call, native)
            end = "answered"
        except TypeError:  # a shape or a kind of argument, of which the definitions say nothing
            continue
        except REFUSALS:
            end = "refused"
        compared += 1
        if end != (other := judge_call(call, reference)):
            apart.append((index, call.kernel, end, other))
    assert not apart and compared > 400, (apart, compared)


def test_a_trial_that_dies_or_hangs_is_named_and_the_others_go_on() -> None:
    def trial(index: int) -> str:
        if index == 3:
            os.kill(os.getpid(), signal.SIGKILL)  # without the trace that a broken one would print
        while index == 5:
            pass
        return "internal: raw" if index == 6 else "fine"

    ran = run_trials(trial, 0, 8, patience=0.5)
    assert [(f.index, f.how.partition(":")[0]) for f in ran.findings] == [(3, "crash"), (5, "hang"), (6, "internal")]
    assert ran.outcomes == {"fine": 5, "crash": 1, "hang": 1, "internal": 1}


def test_the_circle_that_crashed() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = 300.0 + 80.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert len(gt.Contour(circle)) == 199
    for module in (native, reference):  # a side of no length at the end, and a step of which rounding made a sum
        _, curvature = module.curvature_vector(circle, None, 0.25)
        assert np.isfinite(curvature).all()
