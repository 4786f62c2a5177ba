# SPDX-License-Identifier: Apache-2.0
"""Sheets that nearly fill the image, or that its border cuts."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import grasptrack as gt
from benches import grained, laid, overlap, photographed
from grasptrack.cli.main import main
from grasptrack.errors import ObservationError
from grasptrack.segmentation.candidate import describe_candidate

WHOLE = {
    "70 %": np.array([[60.0, 40], [590, 30], [580, 440], [50, 450]]),
    "86 %": np.array([[22.0, 18], [610, 12], [622, 462], [15, 468]]),
}
CUT = {
    "on the left": np.array([[-60.0, 60], [400, 40], [420, 400], [-60, 420]]),
    "on the right": np.array([[300.0, 100], [720, 60], [720, 420], [310, 400]]),
    "at a corner": np.array([[-60.0, -60], [580, -60], [590, 430], [-60, 440]]),
}


def sheet(quad: np.ndarray, printed: bool, seed: int = 3) -> np.ndarray:
    """A sheet on a grained bench, with lines of words."""
    scene, rng = laid(grained(seed, depth=20.0), quad, (225.0,) * 3), np.random.default_rng(seed)
    for y in np.arange(40.0, 440.0, 22.0) if printed else ():
        for x in np.arange(30.0, 600.0, 30.0):
            if rng.random() < 0.8 and cv2.pointPolygonTest(quad.astype(np.float32), (x, y), True) > 35:
                word = np.array([[x, y], [x + rng.uniform(8, 26), y], [x + rng.uniform(8, 26), y + 8], [x, y + 9]])
                scene = laid(scene, word, (60.0, 50.0, 50.0))
    return photographed(scene, seed + 1)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("printed", [False, True])
@pytest.mark.parametrize("name", WHOLE)
def test_a_sheet_that_nearly_fills_the_image_comes_first(name: str, printed: bool) -> None:
    first = gt.first_look(sheet(WHOLE[name], printed))[0]
    assert overlap(first.view.outer.points, WHOLE[name]) > 0.97
    assert not first.view.is_clipped


@pytest.mark.sampled(1)
@pytest.mark.parametrize("printed", [False, True])
@pytest.mark.parametrize("name", CUT)
def test_a_sheet_that_the_border_cuts_is_offered_and_said_to_be_cut(name: str, printed: bool) -> None:
    """On its blank margin a pixel brings it among three."""
    quad, image = CUT[name], sheet(CUT[name], printed)
    inside = np.clip(quad, 0, (639, 479))
    corner = inside[np.argmin(np.hypot(*(inside - (320, 240)).T))]
    pixel = corner + 14.0 * np.sign(inside.mean(axis=0) - corner)
    found = [c for c in gt.first_look(image, pixel)[:3] if overlap(c.view.outer.points, quad) > 0.9]
    assert found and found[0].view.is_clipped
    assert describe_candidate(found[0], found[0]).endswith("cut by the image's border")


def test_print_on_a_cut_sheet_does_not_hide_it() -> None:
    quad = CUT["on the right"]
    assert any(overlap(c.view.outer.points, quad) > 0.9 for c in gt.first_look(sheet(quad, True)))


def test_more_than_nine_tenths_are_no_object_and_a_rest_of_the_ground_is_none_instead() -> None:
    with pytest.raises(ObservationError):
        gt.first_look(sheet(np.array([[12.0, 10], [626, 9], [630, 468], [10, 470]]), False))


@pytest.mark.slow
def test_track_says_that_it_is_cut(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo = tmp_path / "sheet.png"
    cv2.imwrite(str(photo), sheet(CUT["on the left"], False))
    assert main(["track", str(photo), "--object", "100,200", "--no-video", "--output", str(tmp_path / "out")]) == 0
    assert "is cut by the border of its first image" in capsys.readouterr().out.replace("\n", " ")
    cv2.imwrite(str(photo), sheet(WHOLE["70 %"], False))
    assert main(["track", str(photo), "--no-video", "--output", str(tmp_path / "out")]) == 0
    assert "is cut by" not in capsys.readouterr().out.replace("\n", " ")
