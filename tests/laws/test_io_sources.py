# SPDX-License-Identifier: Apache-2.0
"""Sources: any kind is guessed, and frames come in order, in 8 bits, with their times."""

import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import open_source
from grasptrack.io.images import EightBits, natural_key
from recordings import movie, picture, write

# --- guesses ---------------------------------------------------------------------------------------


def test_a_folder_is_read_in_natural_order_and_other_files_are_passed_over(tmp_path: Path) -> None:
    names = ["f10.png", "f9.png", "F2.PNG", "f100.bmp", "f3.jpeg", "f4.tif", "f5.pgm"]
    for name in names:
        write(tmp_path / name, picture()[:, :, 0])
    for other in ("notes.txt", "f1.csv", "._f1.png", "f0.gif"):
        (tmp_path / other).write_text("not an image")
    (tmp_path / "f6.png").mkdir()
    source = open_source(tmp_path)
    assert [f.name for f in source] == ["F2.PNG", "f3.jpeg", "f4.tif", "f5.pgm", "f9.png", "f10.png", "f100.bmp"]
    assert (source.kind, source.count, source.fps) == ("folder", 7, None)


@given(st.lists(st.integers(0, 10**6), unique=True, min_size=2, max_size=30), st.randoms(use_true_random=False))
def test_natural_order_is_numeric_order(numbers: list[int], rng: random.Random) -> None:
    names = [f"img_{n}.png" for n in numbers]
    rng.shuffle(names)
    assert sorted(names, key=natural_key) == [f"img_{n}.png" for n in sorted(numbers)]


@given(st.lists(st.text(max_size=12), max_size=12))
def test_any_names_can_be_ordered(names: list[str]) -> None:
    ordered = sorted(names, key=natural_key)
    assert sorted(set(names), key=natural_key) == list(dict.fromkeys(ordered))


def test_a_glob_a_single_image_and_a_path_object(tmp_path: Path) -> None:
    for i in (2, 1, 11):
        write(tmp_path / f"a{i}.png", picture(i))
    (tmp_path / "a3.txt").write_text("x")
    matched = open_source(str(tmp_path / "a*"))
    assert matched.kind == "glob" and [f.name for f in matched] == ["a1.png", "a2.png", "a11.png"]
    alone = open_source(tmp_path / "a2.png")
    frames = list(alone)
    assert alone.kind == "image" and len(frames) == 1 and frames[0].index == 0 and frames[0].time is None
    np.testing.assert_array_equal(frames[0].image, picture(2))


def test_a_name_with_brackets_is_a_file_before_it_is_a_pattern(tmp_path: Path) -> None:
    path = write(tmp_path / "a[1].png", picture())
    assert open_source(path).kind == "image"


def test_folders_have_no_times_unless_fps_gives_them(tmp_path: Path) -> None:
    for i in range(4):
        write(tmp_path / f"{i}.png", picture(i))
    assert [f.time for f in open_source(tmp_path)] == [None] * 4
    assert [f.time for f in open_source(tmp_path, fps=8)] == [0.0, 0.125, 0.25, 0.375]
    assert [f.index for f in open_source(tmp_path)] == [0, 1, 2, 3]


def test_iterating_again_starts_over_and_a_source_closes(tmp_path: Path) -> None:
    with open_source(movie(tmp_path / "m.mp4")) as source:
        first = [next(iter(source)).index for _ in range(3)]
    assert first == [0, 0, 0]
    assert len(list(source)) == 12


# --- kinds of images -------------------------------------------------------------------------------


def test_grey_stays_grey_and_colour_stays_bgr(tmp_path: Path) -> None:
    write(tmp_path / "g.png", picture()[:, :, 0])
    write(tmp_path / "c.png", picture())
    grey, colour = (next(iter(open_source(tmp_path / name))).image for name in ("g.png", "c.png"))
    np.testing.assert_array_equal(grey, picture()[:, :, 0])
    np.testing.assert_array_equal(colour, picture())


def test_transparent_parts_show_black(tmp_path: Path) -> None:
    image = np.dstack([picture(), np.full((48, 64), 255, np.uint8)])
    image[:10, :, 3] = 0
    image[10:20, :, 3] = 128
    write(tmp_path / "a.png", image)
    got = next(iter(open_source(tmp_path / "a.png"))).image
    assert got.shape == (48, 64, 3) and not got[:10].any()
    np.testing.assert_allclose(got[10:20], picture()[10:20] * (128 / 255), atol=1)
    np.testing.assert_array_equal(got[20:], picture()[20:])


@pytest.mark.parametrize(("bits", "full"), [(10, 1023), (12, 4095), (14, 16383), (16, 65535)])
def test_deep_images_use_the_whole_scale_of_the_recording(tmp_path: Path, bits: int, full: int) -> None:
    ramp = np.linspace(0, full, 64).astype(np.uint16)[None].repeat(48, axis=0)
    write(tmp_path / "0.png", ramp)
    write(tmp_path / "1.png", ramp // 2)
    first, second = (f.image for f in open_source(tmp_path))
    assert first.dtype == np.uint8 and first.max() == 255 and first.min() == 0
    assert (np.diff(first[0].astype(int)) >= 0).all()
    # One scale for the sequence: half the light is half the value.
    np.testing.assert_allclose(second, first / 2, atol=1)


def test_what_is_brighter_than_the_first_image_saturates(tmp_path: Path) -> None:
    write(tmp_path / "0.png", np.full((48, 64), 4000, np.uint16))
    write(tmp_path / "1.png", np.full((48, 64), 60000, np.uint16))
    first, second = (f.image for f in open_source(tmp_path))
    assert first.max() == round(4000 * 255 / 4095) and second.min() == 255


def test_float_images_and_fractions() -> None:
    np.testing.assert_array_equal(EightBits()(np.array([[0.0, 0.5, 1.0]], np.float32)), [[0, 128, 255]])
    np.testing.assert_array_equal(EightBits()(np.array([[0.0, np.nan, 200.0]], np.float32)), [[0, 0, 200]])
    np.testing.assert_array_equal(EightBits()(np.array([[True, False]])), [[255, 0]])


# --- video -----------------------------------------------------------------------------------------


def test_video_times_are_presentation_times(tmp_path: Path) -> None:
    source = open_source(movie(tmp_path / "m.mp4", fps=12.5))
    frames = list(source)
    assert (source.kind, source.count, source.fps) == ("video", 12, 12.5)
    np.testing.assert_allclose([f.time for f in frames], np.arange(12) / 12.5, atol=1e-9)
    assert frames[0].image.shape == (48, 64, 3)
    np.testing.assert_allclose([f.time for f in open_source(tmp_path / "m.mp4", fps=100)], np.arange(12) / 100)


def test_video_turned_by_its_header_comes_upright(tmp_path: Path) -> None:
    plain = movie(tmp_path / "m.mp4")
    data = plain.read_bytes()
    identity = b"".join(v.to_bytes(4, "big") for v in (1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30))
    quarter = b"".join((v % 2**32).to_bytes(4, "big") for v in (0, 1 << 16, 0, -1 << 16, 0, 0, 0, 0, 1 << 30))
    track = data.index(b"tkhd")
    at = data.index(identity, track)
    (tmp_path / "turned.mp4").write_bytes(data[:at] + quarter + data[at + len(identity) :])
    upright = next(iter(open_source(plain))).image
    turned = next(iter(open_source(tmp_path / "turned.mp4"))).image
    if turned.shape == upright.shape:
        pytest.skip("this PyAV does not report a frame's rotation")
    np.testing.assert_array_equal(turned, np.rot90(upright, -1))  # the header asks for a quarter turn clockwise
