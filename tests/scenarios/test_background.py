# SPDX-License-Identifier: Apache-2.0
"""The picture of the empty bench: what it tells of the object, whatever the light."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import grasptrack as gt
from benches import PLATE, glare, grained, laid, lit, overlap, photographed
from datasets import DATA
from grasptrack.cli.main import main
from grasptrack.errors import InputError, SourceError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.cameras import Camera
from grasptrack.segmentation.background import background_maps
from grasptrack.segmentation.first_look import find_objects
from grasptrack.segmentation.registration import register_affine

BENCH = grained(3)
EMPTY = photographed(BENCH, 1)
DULL = (70.0, 80.0, 95.0)
LIGHTS = {
    "the same": {},
    "darker, from the side": {"light": (0.6, 0.35, -0.1), "offset": 6.0},
    "of another colour": {"light": (0.9, 0.1, 0.0), "tint": (1.1, 1.0, 0.85)},
}


@pytest.mark.slow
@settings(max_examples=10)
@given(
    st.floats(0.5, 1.2), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(0.0, 12.0),
    st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.integers(0, 99),
)  # fmt: skip
def test_an_empty_bench_differs_nowhere(
    gain: float, x: float, y: float, offset: float, dx: float, dy: float, seed: int
) -> None:
    """Neither light nor a small motion of the camera is an object."""
    moved = np.array([[1.0, 0.0, dx], [0.0, 1.0, dy]])
    image = photographed(lit(BENCH, (gain, x, y), offset=offset), seed + 2, moved)
    inner = (slice(20, -20), slice(20, -20))
    for each in background_maps(image, EMPTY):
        assert float((each[inner] > 0.5).mean()) < 0.002
    motion = register_affine(*(np.float32(picture).mean(axis=2) for picture in (image, EMPTY)))
    assert np.abs(motion[:, 2] + (dx, dy)).max() < 0.5


@pytest.mark.sampled(2)
@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.3, -2.1)])
def test_what_was_laid_is_mapped_in_any_light(light: str, shift: tuple[float, float]) -> None:
    moved = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    image = photographed(lit(laid(BENCH, PLATE, DULL), **LIGHTS[light]), 5, moved)
    found = background_maps(image, EMPTY)[0] > 0.3
    truth = np.zeros(found.shape, np.uint8)
    cv2.fillPoly(truth, [np.rint(PLATE + shift).astype(np.int32)], (1,))
    assert (found & (truth > 0)).sum() / (found | (truth > 0)).sum() > 0.9


def test_a_shadow_of_another_hue_than_the_object_is_told_from_it() -> None:
    shaded = laid(BENCH, PLATE + 14, (0.0, 0.0, 0.0)) * 0.5 + 0.5 * BENCH
    image = photographed(laid(shaded, PLATE, (60.0, 90.0, 190.0)), 5)
    everything, coloured = (m > 0.5 for m in background_maps(image, EMPTY))
    truth = np.zeros(everything.shape, np.uint8)
    cv2.fillPoly(truth, [PLATE], (1,))
    shadow = np.zeros(everything.shape, np.uint8)
    cv2.fillPoly(shadow, [PLATE + 14], (1,))
    only = cv2.erode(shadow & (1 - truth), np.ones((9, 9), np.uint8)) > 0
    assert everything[only].mean() > 0.9 and coloured[only].mean() < 0.1
    assert coloured[truth > 0].mean() > 0.9


@pytest.mark.slow
def test_the_object_is_found_where_grain_and_reflections_hide_it() -> None:
    """A dull plate on a coarse grain, and lamps that shine in both pictures: without the empty bench it is not found."""
    coarse = glare(glare(grained(8, depth=75.0), 520, 380, 220.0, 35.0), 90, 120, 220.0, 30.0)
    empty, image = photographed(coarse, 1), photographed(lit(laid(coarse, PLATE, DULL), (0.8, 0.2, 0.0)), 2)
    without = gt.first_look(image)[0]
    told = gt.first_look(image, background=empty)[0]
    assert overlap(without.view.outer.points, PLATE) < 0.5 < 0.9 < overlap(told.view.outer.points, PLATE)
    assert overlap(find_objects(image, FirstImage(background=empty))[0].view.outer.points, PLATE) > 0.9
    tracker = gt.GraspTracker(background=empty)
    result = tracker.update(image)
    assert result.view is not None and overlap(result.view.outer.points, PLATE) > 0.9


@pytest.mark.slow
@pytest.mark.skipif(
    not (DATA / "textures").is_dir(), reason=f"needs {DATA}/textures; GRASPTRACK_DATA names another folder"
)
def test_real_benches_under_another_light_and_from_beside() -> None:
    missed = []
    for path in sorted((DATA / "textures").glob("*.png")):
        bench = cv2.resize(cv2.imread(str(path)), (640, 480)).astype(np.float32)
        moved = np.array([[1.0, 0.01, 3.3], [-0.01, 1.0, -2.1]])
        image = photographed(lit(laid(bench, PLATE, DULL), (0.7, 0.2, 0.1), (0.9, 1.0, 1.05), 4.0), 4, moved)
        seen = np.column_stack([PLATE, np.ones(len(PLATE))]) @ moved.T
        first = gt.first_look(image, background=photographed(bench, 1))[0]
        if overlap(first.view.outer.points, seen) < 0.9:
            missed.append(path.name)
    assert not missed


@pytest.mark.slow
def test_a_lens_is_taken_out_of_both_pictures() -> None:
    camera = Camera(np.array([[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]]), (-0.2, 0.03, 0.0, 0.0))
    image = photographed(laid(BENCH, PLATE, DULL), 2)
    tracker = gt.GraspTracker(background=EMPTY, camera=camera)
    result = tracker.update(image)
    assert result.view is not None and overlap(result.view.outer.points, PLATE) > 0.9
    with pytest.raises(InputError, match="background is 300x200 px, but the image is 640x480"):
        gt.GraspTracker(background=EMPTY[:200, :300], camera=camera).update(image)


def test_what_is_no_background_is_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = photographed(laid(BENCH, PLATE, DULL), 2)
    with pytest.raises(InputError, match="background is 300x200 px, but the image is 640x480"):
        gt.first_look(image, background=EMPTY[:200, :300])
    with pytest.raises(SourceError):
        gt.first_look(image, background=np.zeros(5))
    for told in ({"mask": EMPTY[..., 0] > 200}, {"segmenter": lambda seen: seen[..., 0] > 200}):
        with pytest.raises(InputError, match="give one of them"):
            gt.first_look(image, background=EMPTY, **told)
    photo, small, text = tmp_path / "photo.png", tmp_path / "small.png", tmp_path / "text.png"
    cv2.imwrite(str(photo), image)
    cv2.imwrite(str(small), EMPTY[:200, :300])
    text.write_text("no image")
    for verb in ("track", "inspect", "synthesize"):
        for name in (small, text, tmp_path / "none.png", tmp_path):
            assert main([verb, str(photo), "--background", str(name), "--output", str(tmp_path / "out")]) == 2
            told = capsys.readouterr().err.strip()
            assert told and len(told.splitlines()) == 1, (verb, name, told)


@pytest.mark.slow
def test_the_verbs_take_it(tmp_path: Path) -> None:
    coarse = grained(8, depth=75.0)
    photo, empty = tmp_path / "photo.png", tmp_path / "empty.png"
    cv2.imwrite(str(photo), photographed(laid(coarse, PLATE, DULL), 2))
    cv2.imwrite(str(empty), photographed(coarse, 1))
    for verb, more in (("track", ["--no-video"]), ("inspect", ["--runs", "1"]), ("synthesize", [])):
        words = [verb, str(photo), "--background", str(empty), "--quiet", "--output", str(tmp_path / verb), *more]
        assert main(words) == 0
    rows = (tmp_path / "track" / "grasps.csv").read_text().splitlines()
    contacts = [float(v) for v in rows[1].split(",")[5:9]]
    inside = [cv2.pointPolygonTest(PLATE.astype(np.float32), tuple(contacts[k : k + 2]), True) for k in (0, 2)]
    assert max(abs(d) for d in inside) < 3.0
