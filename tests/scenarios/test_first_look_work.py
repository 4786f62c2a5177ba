# SPDX-License-Identifier: Apache-2.0
"""The bound of a first look's work: less is found within less, the same within the same, and something always."""

from pathlib import Path

import cv2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import grasptrack as gt
from benches import PLATE, grained, laid, overlap, photographed
from grasptrack.cli.main import main
from grasptrack.errors import InputError
from grasptrack.first_image import FirstImage
from grasptrack.segmentation.closed_edges import RECIPES
from grasptrack.segmentation.proposals import PreparedImage, propose_closed_edges

IMAGE = photographed(laid(laid(grained(2), PLATE, (60.0, 70.0, 200.0)), PLATE * 0.4 + 20, (230.0, 70.0, 60.0)), 3)


def outlines(ms: float | None) -> list[tuple[float, ...]]:
    return [(c.probability, *c.view.outer.points.ravel().tolist()) for c in gt.first_look(IMAGE, first_look_ms=ms)]


def test_the_least_work_still_finds_an_object_and_much_work_finds_all() -> None:
    assert len(outlines(1e-3)) == 1
    assert outlines(1e6) == outlines(None) and len(outlines(None)) == 2
    assert overlap(gt.first_look(IMAGE, first_look_ms=1e6)[0].view.outer.points, PLATE) > 0.95


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(st.floats(1.0, 150.0))
def test_the_same_bound_finds_the_same(ms: float) -> None:
    assert outlines(ms) == outlines(ms)


@given(st.floats(0.0, 200.0), st.floats(0.0, 200.0))
def test_closings_are_cut_short_at_the_end_and_never_beyond_the_bound(one: float, other: float) -> None:
    few, many = sorted((one, other))
    found = []
    for ms in (few, many):
        scene = PreparedImage(IMAGE, FirstImage(first_look_ms=ms))
        found.append([(p.recipe, p.silhouette.box) for p in propose_closed_edges(scene)])
        assert scene.work.spent_ms <= ms or not found[-1] or scene.work.spent_ms < 1.2 * ms
    assert found[1][: len(found[0])] == found[0]
    assert {r for r, _ in found[0]} <= set(range(len(RECIPES)))


@pytest.mark.parametrize("ms", [0.0, -3.0, float("nan"), float("inf")])
def test_a_bound_that_is_none_is_told(ms: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for refused in (lambda: gt.first_look(IMAGE, first_look_ms=ms), lambda: gt.GraspTracker(first_look_ms=ms)):
        with pytest.raises(InputError, match="first_look_ms is a number of ms above 0"):
            refused()
    photo = tmp_path / "photo.png"
    cv2.imwrite(str(photo), IMAGE)
    for verb in ("track", "inspect", "synthesize"):
        assert main([verb, str(photo), "--first-look-ms", str(ms), "--output", str(tmp_path / "out")]) == 2
        assert "--first-look-ms is a number of ms above 0" in capsys.readouterr().err


@pytest.mark.slow
def test_tracker_and_verbs_keep_to_it(tmp_path: Path) -> None:
    tracker = gt.GraspTracker(first_look_ms=1e-3)
    tracker.update(IMAGE)
    assert len(tracker.candidates) == 1
    photo = tmp_path / "photo.png"
    cv2.imwrite(str(photo), IMAGE)
    for verb, more in (("track", ["--no-video"]), ("inspect", ["--runs", "1"]), ("synthesize", [])):
        out = tmp_path / verb
        words = [verb, str(photo), "--first-look-ms", "0.001", "--sure", "0.9999", "--output", str(out), *more]
        assert main([*words, "--quiet", "--choose", "2"]) == 2
        assert main([*words, "--quiet"]) == 0
