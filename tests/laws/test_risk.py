# SPDX-License-Identifier: Apache-2.0
"""One rate decides: what is answered, what the confidence says of it, and what is refused."""

import copy
import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.cli.main import main
from grasptrack.demo import run_demo
from grasptrack.errors import InputError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.hand import Hand, Length
from grasptrack.trackability import inspect
from grasptrack.tracking import solutions
from grasptrack.tracking.decision import NOTHING, Decision, any_of, decide_pose
from grasptrack.tracking.numbers import DEFAULT_RISK, NUMBERS, OWN, check_risk, read_numbers
from grasptrack.tracking.pose import contact_tolerance
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.transfer import STRATEGIES
from grasptrack_bench.approach import choosing
from grasptrack_bench.approach.trial import Looking
from grasptrack_bench.scenes import built_in, make_scene_cases, show_scene
from grasptrack_bench.simulation import SHAPES
from stages import HEIGHT, WIDTH, bar, mirrored, photo, pose

BRACKET, DISC = SHAPES["bracket"](), SHAPES["disc"]()
POSES = [pose(150.0 + 3 * k, 115.0 + 2 * k, 3.0 * k) for k in range(8)]
SEEN = [photo([(BRACKET, H)], seed=k) for k, H in enumerate(POSES)]
COVERED = [photo([(BRACKET, H)], [(bar(80.0 + 20 * k, 40.0), 150.0)], seed=k) for k, H in enumerate(POSES[:4])]
WRONG = [photo([(mirrored(BRACKET), H)], seed=k) for k, H in enumerate(POSES[4:6])]
BLANK = [photo([]), np.full((HEIGHT, WIDTH), 128, np.uint8)]
DIM = [cv2.GaussianBlur(image, (0, 0), 6.0) for image in SEEN[5:7]]
RUN = [*SEEN[:3], *COVERED, *WRONG, *BLANK, *DIM, *SEEN[5:]]
RISKS = (1e-12, 1e-6, 1e-4, 1e-3, 0.01, 0.1, 0.5, 0.9, 1.0 - 1e-9)
BAD = (0.0, 1.0, -0.1, 1.5, math.nan, math.inf)


def track(images: list[np.ndarray] = RUN, **options: Any) -> list[TrackResult]:
    tracker = GraspTracker(**options)
    return [tracker.update(image) for image in images]


@pytest.fixture(scope="module")
def asked() -> list[tuple[Any, ...]]:
    """What was asked of the decision in a run."""
    calls: list[tuple[Any, ...]] = []

    def noted(state: Any, estimates: Any, *more: Any) -> Decision:
        calls.append((copy.copy(state), list(estimates), *more))
        return decide_pose(state, estimates, *more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solutions, "decide_pose", noted)
        track()
    return calls


def test_what_is_accepted_shrinks_as_the_risk_falls(asked: list[tuple[Any, ...]]) -> None:
    before: set[int] = set()
    for risk in RISKS:
        decided = [decide_pose(*call).with_risk(risk) for call in asked]
        accepted = {k for k, d in enumerate(decided) if d.is_accepted}
        assert before <= accepted
        for d in decided:
            assert 0.0 <= d.confidence <= 1.0 and 0.0 <= d.rival_share <= 1.0
            assert d.is_accepted == (d.probability_off < risk) == (not d.code)
        before = accepted
    assert before and len(before) > len(asked) // 3


def test_from_the_default_up_a_higher_risk_changes_nothing_but_what_is_answered() -> None:
    runs = [track(risk=risk) for risk in (1e-3, 0.05, 0.999)]
    located = [{r.frame for r in run if r.located} for run in runs]
    assert all(few <= many for few, many in pairwise(located))
    assert len(located[0]) < len(located[-1])
    for run in runs[1:]:
        assert [r.confidence for r in run] == [r.confidence for r in runs[0]]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("risk", [1e-7, 1e-3, 0.5])
@pytest.mark.parametrize("strategy", ["auto", "paper", *STRATEGIES])
def test_confidence_and_status_say_the_same(strategy: str, risk: float) -> None:
    first, *results = track(strategy=strategy, risk=risk)
    assert first.located and first.confidence == 1.0
    for r in results:
        assert 0.0 <= r.confidence <= 1.0
        told = max(risk, NUMBERS.untested)  # no more is told than scenes have shown
        assert r.confidence >= 1.0 - told if r.located else r.confidence <= 1.0 - risk
        assert r.located == (r.status in ("tracked", "unstable"))
    if strategy == "auto":  # the others may find no transfer, of which nothing can be said
        assert any(not r.located and r.confidence > 0.0 for r in results)


def test_a_disc_whose_turn_nothing_tells_is_refused_by_its_probability() -> None:
    images = [photo([(DISC, H)], seed=k) for k, H in enumerate(POSES[:3])]
    for r in track(images)[1:]:
        assert r.located or r.confidence <= 1.0 - DEFAULT_RISK


def test_nothing_is_never_accepted() -> None:
    assert not any(NOTHING.with_risk(risk).is_accepted for risk in RISKS) and NOTHING.confidence == 0.0


@given(st.lists(st.floats(0.0, 1.0), max_size=5))
def test_any_of_some_things(probabilities: list[float]) -> None:
    found = any_of(*probabilities)
    assert max(probabilities, default=0.0) - 1e-15 <= found <= min(1.0, sum(probabilities) + 1e-15)
    assert found == pytest.approx(1.0 - math.prod(1.0 - p for p in probabilities), abs=1e-14)
    assert any_of(1e-30, 1e-31) == pytest.approx(1.1e-30)  # exact where all are small


def test_learning_is_never_looser_than_the_default() -> None:
    assert [NUMBERS.for_learning(risk).risk for risk in (1e-6, 1e-3, 0.5)] == [1e-6, 1e-3, 1e-3]
    assert NUMBERS.with_risk(0.5).risk == 0.5


@pytest.mark.parametrize("risk", BAD)
def test_a_risk_that_is_none_is_bad_input(risk: float) -> None:
    for refused in (
        lambda: check_risk(risk),
        lambda: GraspTracker(risk=risk),
        lambda: inspect(SEEN[0], risk=risk),
        lambda: NUMBERS.with_risk(risk),
    ):
        with pytest.raises(InputError, match="a probability between 0 and 1"):
            refused()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("disturbance", ["noise", "clean-6dof"])
def test_a_larger_tolerance_locates_more_and_none_is_off_by_more(disturbance: str) -> None:
    (case,) = make_scene_cases(built_in(["bracket"]), [disturbance], frames=20, seed=3)
    scene, share = case.scene(), 1.0 / 6.0
    S = np.array([[share, 0.0, 0.5 * share - 0.5], [0.0, share, 0.5 * share - 0.5], [0.0, 0.0, 1.0]])
    chosen = apply_homography(S, show_scene(scene)[0].contacts)
    size, located = 1.0, list[int]()
    for tolerance in (0.2, 0.4, None):
        tracker = GraspTracker(grasp=chosen, tolerance=tolerance)
        located.append(0)
        for frame in scene:
            result = tracker.update(cv2.resize(frame.image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA))
            if result.contacts is None or result.view is None:
                continue
            located[-1] += 1
            now = math.sqrt(result.view.outer.area)
            size = now if frame.index == 0 else size
            assert size < 75.0, "of a larger one 3 px are less than 4 %"
            truth = apply_homography(S @ frame.H_current_reference @ np.linalg.inv(S), chosen)
            allowed = 3.0 if tolerance is None else tolerance * now / size
            assert np.hypot(*(result.contacts - truth).T).max() < allowed
    assert located == sorted(located) and located[0] < located[-1]


@given(st.floats(0.5, 500.0), st.floats(1e-3, 0.5))
def test_a_tolerance_is_one_on_the_object(size: float, share: float) -> None:
    numbers = NUMBERS.with_tolerance(share)
    assert contact_tolerance(size**2, numbers) == pytest.approx(share * size)
    assert replace(numbers, tolerance=NUMBERS.tolerance, tolerance_px=NUMBERS.tolerance_px) == NUMBERS


@pytest.mark.parametrize("tolerance", [0.0, -1.0, math.nan, math.inf, "much", "0px", "5mm"])
def test_a_tolerance_that_is_none_is_bad_input(tolerance: float | str) -> None:
    for refused in (GraspTracker, lambda **given: inspect(SEEN[0], **given)):
        with pytest.raises(InputError, match=r"length|scale of the image"):
            refused(tolerance=tolerance)


def test_mm_are_those_of_the_hand() -> None:
    by_mm = GraspTracker(tolerance="5mm", hand=Hand(px_per_mm=2.0)).wish.tolerance
    assert by_mm == GraspTracker(tolerance=10).wish.tolerance == Length(10.0)


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("images")
    for k, image in enumerate(RUN[:9]):
        cv2.imwrite(str(folder / f"{k}.png"), image)
    return folder


@pytest.mark.parametrize("risk", [0.0, 1.0, -0.1, math.nan])
def test_every_verb_refuses_it_in_one_line(risk: float, images: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two = [str(images / "0.png"), str(images / "1.png")]
    for verb in (["track", str(images)], ["inspect", two[0]], ["transfer", *two], ["evaluate", "scenes"]):
        assert main([*verb, "--risk", str(risk), "--output", str(images / "out")]) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert "--risk must be a probability between 0 and 1" in line and f"not {risk:g}" in line


def test_a_run_tells_its_risk_and_the_confidence_of_every_frame(images: Path, tmp_path: Path) -> None:
    for risk in ("0.5", "1e-05"):
        assert main(["track", str(images), "--risk", risk, "--output", str(tmp_path), "--no-video", "-q"]) == 0
        assert json.loads((tmp_path / "run.json").read_text())["options"]["risk"] == float(risk)
        head, *rows = (line.split(",") for line in (tmp_path / "grasps.csv").read_text().splitlines())
        for row in rows[1:]:
            told = dict(zip(head, row, strict=False))
            sure = float(told["confidence"])
            if float(risk) >= NUMBERS.untested:
                assert (sure >= 1.0 - float(risk)) == (told["status"] != "lost")
            assert sure <= 1.0 - NUMBERS.untested
            assert told["x1"] == "" or told["status"] != "lost"


def test_the_servo_and_the_demonstration_refuse_it_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for verb in (["servo"], ["servo", "--trials", "3"], ["demo"]):
        assert main([*verb, "--risk", "0", "--output", str(tmp_path / "out")]) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert "--risk must be a probability between 0 and 1, not 0" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_demonstration_is_tracked_at_the_risk(tmp_path: Path) -> None:
    rows = {}
    for risk in (1e-12, 1e-3):
        (rows[risk],) = run_demo(tmp_path / str(risk), frames=6, video=False, strategies=("homography",), risk=risk)
        told = json.loads((tmp_path / str(risk) / "homography" / "run.json").read_text())
        assert told["options"]["risk"] == risk
        head, *lines = (tmp_path / str(risk) / "homography" / "grasps.csv").read_text().splitlines()
        sure = [dict(zip(head.split(","), line.split(","), strict=False)) for line in lines[1:]]
        assert all((float(row["confidence"]) >= 1.0 - risk) == (row["status"] != "lost") for row in sure)


def test_every_tracker_of_an_approach_takes_the_risk(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    class Noted(GraspTracker):
        def __init__(self, **options: Any) -> None:
            asked.append(options["risk"])
            super().__init__(**options)

    monkeypatch.setattr(choosing, "GraspTracker", Noted)
    tips, ignore = np.array([[60.0, 200.0], [260.0, 200.0]]), np.zeros((HEIGHT, WIDTH), np.uint8)
    hand = choosing.hand_for(0.06)
    tracker, first = choosing.first_look(SEEN[0], 0.0, ignore, hand, tips, risk=1e-7)
    assert first.view is not None
    looking = Looking(tracker, first.view, ignore, hand, tips, 1e-7)
    for k in range(1, 12):  # nothing there: it looks anew
        looking.update(BLANK[1], float(k))
    assert set(asked) == {1e-7} and len(asked) > 1


def test_the_file_of_numbers_is_read_and_what_is_wrong_in_it_is_told(tmp_path: Path) -> None:
    told = json.loads(OWN.read_text(encoding="utf-8"))
    assert read_numbers() == NUMBERS and {n: e["value"] for n, e in told.items()} == NUMBERS.kernel_table()
    assert all(
        entry["from"] <= entry["value"] <= entry["to"] and entry["by"] for entry in told.values() if "from" in entry
    )
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(told | {"inflate": {"value": 2.25}}), encoding="utf-8")
    assert read_numbers(path).inflate == 2.25
    for bad, why in (
        ({n: e for n, e in told.items() if n != "inflate"}, "inflate is missing"),
        (told | {"inflat": {"value": 1.0}}, "inflat is no number of the core"),
        (told | {"inflate": {"value": math.inf}}, "inflate must be a finite number, not inf"),
        (told | {"inflate": 1.5}, "cannot read the numbers"),
        ([], "cannot read the numbers"),
    ):
        path.write_text(json.dumps(bad), encoding="utf-8")
        with pytest.raises(InputError, match=why):
            read_numbers(path)
    with pytest.raises(InputError, match="cannot read the numbers"):
        read_numbers(tmp_path / "none.json")


def test_the_environment_names_another_file_of_numbers(tmp_path: Path) -> None:
    told = json.loads(OWN.read_text(encoding="utf-8"))
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(told | {"exposed": {"value": 0.125}}), encoding="utf-8")
    code = "from grasptrack.tracking.numbers import NUMBERS; print(NUMBERS.exposed)"
    environment = {**os.environ, "GRASPTRACK_NUMBERS": str(path)}
    shown = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "0.125"
