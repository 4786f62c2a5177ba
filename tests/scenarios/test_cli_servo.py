# SPDX-License-Identifier: Apache-2.0
"""`grasptrack servo`: what it writes, that the same seed is the same trial, and one line for what is wrong."""

import builtins
import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grasptrack.cli.main import main
from grasptrack.errors import install_hint
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.grasp.hand import Hand
from grasptrack.tracking.tracker import GraspTracker
from grasptrack_bench.approach.case import ApproachCase, Row
from grasptrack_bench.approach.runs import Trials, draw_cases, kind_of, run_trials
from grasptrack_bench.approach.trial import Looking
from grasptrack_bench.schedule import TaskOutcome
from grasptrack_bench.simulation import SHAPES
from test_cli_bad_input import refused


def needs_mujoco() -> None:
    if find_spec("mujoco") is None:
        pytest.skip("the physical world needs MuJoCo")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["--scenario", "storm"], "--scenario is one of static, pushed, belt, blackout"),
        (["--arm", "leg"], "--arm is one of gantry, arm"),
        (["--law", "none"], "--law is one of online, nominal, textbook"),
        (["--images", "oil"], "--images is one of auto, mujoco, planar"),
        (["--fingers", "4"], "the hand has 2 or 3 fingers, not 4"),
        (["--trials", "0"], "--trials"),
        (["--workers", "2"], "--workers and --scheduler are for --trials"),
        (["--shape", "disc", "--silhouettes", "x"], "give one of them"),
        (["--shape", "nothing"], "unknown shape"),
    ],
)
def test_bad_input_is_one_line_and_status_2(given: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    if told == "unknown shape":
        needs_mujoco()
    assert told in refused(["servo", *given], capsys)


@pytest.mark.parametrize("verb", ["servo", "pick"])
def test_without_the_extra_it_says_what_to_install(
    verb: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "mujoco":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    assert main([verb]) == 2
    assert install_hint("sim") in capsys.readouterr().err


@pytest.mark.slow
def test_three_fingers_close_on_what_faces_them_and_refuse_what_does_not(tmp_path: Path) -> None:
    needs_mujoco()
    found = {}
    for shape in ("guitar", "square"):
        given = ["--shape", shape, "--fingers", "3", "--seed", "7", "--images", "planar", "--no-video", "-q"]
        assert main(["servo", *given, "--output", str(tmp_path)]) == 0
        found[shape] = json.loads((tmp_path / "approach.json").read_text())["verdict"]
    assert found["guitar"]["fingers"] == 3
    assert found["guitar"]["outcome"] == "lifted", found["guitar"]["reason"]
    assert found["guitar"]["believed"] and abs(found["guitar"]["turned_deg"]) < 10.0
    assert found["square"]["outcome"] == "refused" and found["square"]["confirmed"]


def test_shapes_are_drawn_evenly_and_alike_for_every_law() -> None:
    shapes = [make() for make in list(SHAPES.values())[:5]]
    cases = draw_cases(shapes, 12, seed=4, scenario="static", arm="gantry", law="online")
    counts = [sum(c.shape.name == s.name for c in cases) for s in shapes]
    assert max(counts) - min(counts) <= 1
    others = draw_cases(shapes, 12, seed=4, scenario="static", arm="gantry", law="textbook")
    assert [(c.shape.name, c.seed) for c in cases] == [(c.shape.name, c.seed) for c in others]
    assert len({c.name for c in cases}) == 12


def test_the_rate_leaves_refusals_out_and_counts_what_broke() -> None:
    def row(outcome: str, reason: str = "") -> Row:
        return Row(0, "s", "static", "gantry", "online", outcome, reason)

    trials = Trials([row("lifted"), row("lifted"), row("refused"), row("failed", "off by 3.2 px")], {"x": "died at 7"})
    assert trials.tried == 4
    assert trials.success_rate == pytest.approx(0.5)
    low, high = trials.success_interval()
    assert 0.0 < low < 0.5 < high < 1.0
    assert dict(trials.count_reasons()) == {"off by # px": 1, "broken: died at #": 1}
    assert kind_of("a 12 b -3.5") == "a # b #"


def answered(cases: list[ApproachCase], made: Any, stop: int | None = None) -> Any:
    """A scheduler that gives rows for cases, and is stopped after so many."""

    def schedule(function: Any, tasks: list[Any]) -> Any:
        for index, case in enumerate(tasks):
            if stop is not None and index >= stop:
                raise KeyboardInterrupt
            made.append(case.seed)
            rng = np.random.default_rng(case.seed)
            row = Row(case.seed, case.shape.name, case.scenario, case.arm, case.law, "failed", 'off, by "3" px')
            row = replace(row, time_s=float(rng.random()), images=7, believed=bool(rng.random() < 0.5), right=None)
            yield TaskOutcome(index, (row, b"picture"), "")

    return schedule


def test_trials_that_were_stopped_are_gone_on_with(tmp_path: Path) -> None:
    shapes = [SHAPES["disc"](), SHAPES["bracket"]()]
    cases = draw_cases(shapes, 6, scenario="static", arm="gantry", law="online", seed=3)
    made: list[int] = []
    whole = run_trials(tmp_path / "whole", cases, answered(cases, []), options={"seed": 3})
    out = tmp_path / "out"
    for stop in (2, 0, 1):
        with pytest.raises(KeyboardInterrupt):
            run_trials(out, cases, answered(cases, made, stop), options={"seed": 3})
    last = run_trials(out, cases, answered(cases, made), options={"seed": 3})
    assert sorted(made) == sorted(case.seed for case in cases) and last.resumed == 3
    assert list(map(repr, last.rows)) == list(map(repr, whole.rows)) and whole.resumed == 0  # some cells are NaN
    for name in ("trials.csv", "trials.json"):
        assert (out / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    assert len(list((out / "failures").glob("*.png"))) == 6
    # a run that is finished, or has other options, is begun anew
    assert run_trials(out, cases, answered(cases, made), options={"seed": 3}).resumed == 0
    with pytest.raises(KeyboardInterrupt):
        run_trials(out, cases, answered(cases, made, 2), options={"seed": 3})
    assert run_trials(out, cases[:2], answered(cases, made), options={"seed": 4}).resumed == 0
    assert len(list((out / "failures").glob("*.png"))) == 2


def test_what_is_chosen_anew_is_the_part_that_was_looked_at_first() -> None:
    tips = np.array([[100.0, 400.0], [300.0, 400.0]])

    def seen(name: str, scale: float, turn: float) -> View:
        turned = similarity_transform(scale, turn, (0.0, 0.0), (320.0, 240.0))
        return View([Contour(apply_homography(turned, SHAPES[name]().outer))])

    looking = Looking(GraspTracker(), seen("bracket", 60.0, 0.3), np.zeros((480, 640), np.uint8), Hand(), tips)
    assert looking._is_the_part(seen("bracket", 110.0, -1.0))
    for other in ("disc", "blob", "spanner"):
        assert not looking._is_the_part(seen(other, 110.0, -1.0))
