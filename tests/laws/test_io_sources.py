# SPDX-License-Identifier: Apache-2.0
"""Sources: any kind is guessed, frames come in order, in 8 bits, with their times; packed pixels."""

import random
from collections.abc import Callable
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import av
import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from grasptrack import SourceError, open_source
from grasptrack.io.bags.messages import MessageImages
from grasptrack.io.images import natural_key
from grasptrack.io.pixels import EightBits, genicam_format, raw_image, ros_format, to_image
from recordings import movie, picture, write

# --- where it starts ---


@given(st.integers(0, 13))
@settings(max_examples=6)
@pytest.mark.parametrize("kind", ["folder", "deep folder", "video"])
def test_a_later_start_gives_the_rest_of_the_same_frames(kind: str, start: int) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "m.mp4"
        for k in range(12):
            deep = (
                picture()[:, :, 0].astype(np.uint16) * (400 + k) if kind == "deep folder" else picture() + np.uint8(k)
            )
            write(Path(folder) / f"{k}.png", deep)
        every = list(open_source(movie(path) if kind == "video" else folder))
        later = open_source(path if kind == "video" else folder)
        if start < len(every):
            assert list(later.start_at(start)) == every[start:]
            return
        later.exact = False  # as of a video whose header tells nothing
        with pytest.raises(SourceError, match=f"has 12 images, counted from 0: there is no frame {start}"):
            list(later.start_at(start))


def test_what_is_live_starts_with_what_comes() -> None:
    with pytest.raises(SourceError, match="is live"):
        open_source("udp://127.0.0.1:5999").start_at(1)


# --- guesses ---------------------------------------------------------------------------------------


def test_a_folder_is_read_in_natural_order_and_other_files_are_passed_over(tmp_path: Path) -> None:
    names = ["f10.png", "f9.png", "F2.PNG", "f100.bmp", "f3.jpeg", "f4.tif", "f5.pgm"]
    for name in names:
        write(tmp_path / name, picture()[:, :, 0])
    for other in ("notes.txt", "f1.csv", "._f1.png", "f0.txt"):
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


def test_a_glint_that_is_brighter_than_the_first_image_saturates(tmp_path: Path) -> None:
    image = np.full((48, 64), 4000, np.uint16)
    write(tmp_path / "0.png", image)
    image[:4, :4] = 60000
    write(tmp_path / "1.png", image)
    first, second = (f.image for f in open_source(tmp_path))
    assert first.max() == second.min() == round(4000 * 255 / 4095) and second.max() == 255


def test_after_a_first_image_that_was_nearly_black_the_scale_rises(tmp_path: Path) -> None:
    for k, level in enumerate((60, 60000, 30000)):
        write(tmp_path / f"{k}.png", np.full((48, 64), level, np.uint16))
    assert [int(f.image.max()) for f in open_source(tmp_path)] == [round(v / 257) for v in (257 * 15, 60000, 30000)]


def test_float_images_and_fractions() -> None:
    np.testing.assert_array_equal(EightBits()(np.array([[0.0, 0.5, 1.0]], np.float32)), [[0, 128, 255]])
    np.testing.assert_array_equal(EightBits()(np.array([[0.0, np.nan, 200.0]], np.float32)), [[0, 0, 200]])
    np.testing.assert_array_equal(EightBits()(np.array([[True, False]])), [[255, 0]])


@pytest.mark.parametrize("kind", ["plain", "with a thumbnail"])
def test_the_pages_of_one_tiff_are_a_sequence(tmp_path: Path, kind: str) -> None:
    pages = [np.full((48, 64), 60 * k + 10, np.uint8) for k in range(4)]
    rest = pages[1:] if kind == "plain" else [pages[0][::4, ::4].copy(), *pages[1:]]
    assert cv2.imwritemulti(str(tmp_path / "stack.tif"), [pages[0], *rest])
    source = open_source(tmp_path / "stack.tif")
    assert (source.kind, source.count) == ("stack", 4)
    assert [int(f.image.mean()) for f in source] == [10, 70, 130, 190]
    assert [f.index for f in open_source(tmp_path / "stack.tif").start_at(2)] == [2, 3]
    with pytest.raises(SourceError, match="holds 4 images: it is a sequence of its own, to be given alone"):
        list(open_source(tmp_path))


@pytest.mark.parametrize("data", [b"II*\0\0\0\0\0", b"II+\0" + bytes(20), b"MM\0*" + b"\xff" * 30, b"II*\0"])
def test_a_tiff_without_a_directory_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "none.tif").write_bytes(data)
    with pytest.raises(SourceError, match="cannot be read: it is damaged, or no image"):
        list(open_source(tmp_path / "none.tif"))


@given(st.lists(st.tuples(st.integers(0, 2**16), st.integers(0, 255)), min_size=1, max_size=12), st.floats(0.0, 1.0))
@settings(max_examples=60)
def test_a_damaged_stack_is_read_or_refused(changed: list[tuple[int, int]], whole: float) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "stack.tif"
        assert cv2.imwritemulti(str(path), [np.full((24, 32), 60 * k + 10, np.uint8) for k in range(3)])
        data = bytearray(path.read_bytes())
        for at, value in changed:
            data[at % len(data)] = value
        path.write_bytes(data[: max(8, int(len(data) * (1.0 if whole > 0.5 else 2.0 * whole)))])
        with suppress(SourceError):
            list(open_source(path))


def test_each_page_of_a_stack_is_bound_by_the_limit_of_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert cv2.imwritemulti(str(tmp_path / "s.tif"), [np.zeros((48, 64), np.uint8)] * 2)
    monkeypatch.setenv("GRASPTRACK_MAX_MEGAPIXELS", "0.001")
    with pytest.raises(SourceError, match="64x48"):
        list(open_source(tmp_path / "s.tif"))


def test_a_tiff_of_one_page_is_an_image(tmp_path: Path) -> None:
    write(tmp_path / "one.tif", picture())
    source = open_source(tmp_path / "one.tif")
    assert (source.kind, source.count, len(list(source))) == ("image", 1, 1)


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


@pytest.mark.parametrize(("a", "d", "axis"), [(-1, 1, 1), (1, -1, 0), (-1, -1, (0, 1))])
def test_video_mirrored_by_its_header_is_mirrored(tmp_path: Path, a: int, d: int, axis: int | tuple[int, int]) -> None:
    plain = movie(tmp_path / "m.mp4")
    data = plain.read_bytes()
    one, four = 1 << 16, (1 << 16).to_bytes(4, "big")
    identity = b"".join((four, bytes(12), four, bytes(12), (1 << 30).to_bytes(4, "big")))
    matrix = b"".join((v % 2**32).to_bytes(4, "big") for v in (a * one, 0, 0, 0, d * one, 0, 0, 0, 1 << 30))
    at = data.index(identity, data.index(b"tkhd"))
    (tmp_path / "mirrored.mp4").write_bytes(data[:at] + matrix + data[at + len(identity) :])
    as_it_is, mirrored = (next(iter(open_source(path))).image for path in (plain, tmp_path / "mirrored.mp4"))
    np.testing.assert_array_equal(mirrored, np.flip(as_it_is, axis))


def coded(path: Path, images: list[np.ndarray], codec: str, form: str, aspect: Fraction = Fraction(1)) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=10)
        frames = [av.VideoFrame.from_ndarray(image, format=form) for image in images]
        stream.width, stream.height, stream.pix_fmt = frames[0].width, frames[0].height, form
        stream.codec_context.sample_aspect_ratio = aspect
        for frame in frames:
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


@pytest.mark.parametrize(("aspect", "size"), [(Fraction(2), (128, 48)), (Fraction(1, 2), (64, 96))])
def test_pixels_that_are_not_square_become_so(tmp_path: Path, aspect: Fraction, size: tuple[int, int]) -> None:
    planes = np.full((72, 64), 128, np.uint8)
    planes[:48] = np.add.outer(2 * np.arange(48), 2 * np.arange(64)).astype(np.uint8)
    plain = coded(tmp_path / "plain.mp4", [planes], "libx264", "yuv420p")
    path = coded(tmp_path / "wide.mp4", [planes], "libx264", "yuv420p", aspect)
    with pytest.warns(UserWarning, match=f"wide as high; it is read with square ones, {size[0]}x{size[1]}"):
        (frame,) = open_source(path)
    (square,) = open_source(plain)
    np.testing.assert_array_equal(frame.image, cv2.resize(square.image, size))


def test_deep_grey_video_has_one_scale(tmp_path: Path) -> None:
    ramp = np.linspace(0, 4095, 64 * 48).reshape(48, 64).astype(np.uint16)
    path = coded(tmp_path / "deep.mkv", [ramp, ramp // 2], "ffv1", "gray16le")
    first, second = (f.image for f in open_source(path))
    assert first.max() == 255 and len(np.unique(first)) > 250
    np.testing.assert_allclose(second, first / 2, atol=1)


@pytest.mark.parametrize(("name", "swapped"), [("nv12", False), ("nv21", True)])
def test_half_sized_colours_that_follow_the_grey(name: str, swapped: bool) -> None:
    """By their definition: a plane of grey, then pairs of blue and red differences for two by two pixels."""
    rng = np.random.default_rng(3)
    small = rng.integers(40, 200, (12, 16, 3)).astype(np.uint8)
    planar = cv2.cvtColor(small.repeat(2, axis=0).repeat(2, axis=1), cv2.COLOR_BGR2YUV_I420)
    y, u, v = planar[:24], planar[24:30].reshape(12, 16), planar[30:].reshape(12, 16)
    pairs = np.stack([v, u] if swapped else [u, v], axis=-1).reshape(12, 32)
    data, form = np.concatenate([y.ravel(), pairs.ravel()]), ros_format(name)
    image = to_image(raw_image(data, 32, 24, form), form)
    assert np.abs(image.astype(int) - cv2.cvtColor(planar, cv2.COLOR_YUV2BGR_I420)).max() <= 2
    with pytest.raises(SourceError, match="px needs 1152 bytes, but has 1151"):
        raw_image(data[:-1], 32, 24, form)
    with pytest.raises(SourceError, match="an even number of px"):
        raw_image(data, 31, 24, form)


def raw_message(encoding: str, values: np.ndarray) -> SimpleNamespace:
    height, width = values.shape[:2]
    return SimpleNamespace(width=width, height=height, encoding=encoding, step=values.strides[0], data=values.tobytes())


def test_depths_that_a_name_tells_and_fractions() -> None:
    ramp = np.linspace(0, 1, 64 * 48).reshape(48, 64)
    named = MessageImages("raw").decode_message(raw_message("mono12", (2047.0 * ramp).astype(np.uint16)), "m")
    assert named is not None and named.max() == 127
    depth = MessageImages("raw").decode_message(raw_message("32FC1", ramp.astype(np.float32)), "m")
    assert depth is not None
    np.testing.assert_allclose(depth, 255.0 * ramp, atol=0.51)


def test_video_in_messages_of_compressed_images(tmp_path: Path) -> None:
    images, shown = MessageImages("compressed"), []
    with av.open(str(movie(tmp_path / "m.mp4"))) as container:
        packets = av.BitStreamFilterContext("h264_mp4toannexb", container.streams.video[0])
        for packet in container.demux(video=0):
            for part in packets.filter(packet):
                image = images.decode_message(SimpleNamespace(format="bgr8; h264", data=bytes(part)), "m")
                shown += [] if image is None else [image]
    assert len(shown) > 5 and shown[0].shape == (48, 64, 3)


def test_alpha_that_is_nowhere_set_is_not_meant() -> None:
    image = np.dstack([np.full((4, 5, 3), 90, np.uint8), np.zeros((4, 5), np.uint8)])
    assert EightBits()(image).min() == 90
    image[0, 0, 3] = 255
    assert EightBits()(image).min() == 0


def packed_low_first(values: list[int], bits: int) -> bytes:
    """Values one after another in a stream of bits, by the definition of GenICam's formats with p."""
    joined = sum(value << (i * bits) for i, value in enumerate(values))
    return joined.to_bytes(-(-len(values) * bits // 8), "little")


def packed_gige(values: list[int], bits: int) -> bytes:
    """Two values in three bytes, by the definition of GigE Vision's formats with Packed."""
    out = bytearray()
    low = bits - 8
    for first, second in zip(values[::2], [*values[1::2], 0], strict=False):
        mask = (1 << low) - 1
        out += bytes([first >> low, first & mask | (second & mask) << 4, second >> low])
    return bytes(out)


@pytest.mark.parametrize(
    ("kind", "depths", "pack"), [("p", (10, 12, 14), packed_low_first), ("Packed", (10, 12), packed_gige)]
)
@given(width=st.integers(1, 9), height=st.integers(1, 7), data=st.data())
def test_packed_values_come_out_as_they_went_in(
    kind: str,
    depths: tuple[int, ...],
    pack: Callable[[list[int], int], bytes],
    width: int,
    height: int,
    data: st.DataObject,
) -> None:
    bits = data.draw(st.sampled_from(depths))
    values = data.draw(st.lists(st.integers(0, 2**bits - 1), min_size=width * height, max_size=width * height))
    form = genicam_format(f"Mono{bits}{kind}")
    found = raw_image(np.frombuffer(pack(values, bits), np.uint8), width, height, form)
    np.testing.assert_array_equal(found, np.reshape(values, (height, width)))


@given(st.sampled_from([10, 12, 14, 16]), hnp.arrays(np.uint16, (3, 5), elements=st.integers(0, 1023)))
def test_the_scale_is_that_of_the_format_whatever_the_image_holds(bits: int, values: np.ndarray) -> None:
    form = genicam_format(f"Mono{bits}")
    raw = raw_image(values.view(np.uint8).ravel(), 5, 3, form)
    exact = values * (255.0 / (2**bits - 1))
    assert np.abs(to_image(raw, form).astype(float) - exact).max() <= 0.5 + 1e-4


@pytest.mark.parametrize("pattern", ["RG", "GR", "GB", "BG"])
@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_a_mosaic_of_one_colour_is_that_colour(pattern: str, bits: int) -> None:
    full = {"R": 0.8, "G": 0.4, "B": 0.1}
    tile = pattern + {"RG": "GB", "GR": "BG", "GB": "RG", "BG": "GR"}[pattern]
    mosaic = np.empty((12, 16), np.uint16)
    for k, letter in enumerate(tile):
        mosaic[k // 2 :: 2, k % 2 :: 2] = round(full[letter] * (2**bits - 1))
    form = genicam_format(f"Bayer{pattern}{bits}")
    data = mosaic.astype(form.value_type).view(np.uint8).ravel()
    found = to_image(raw_image(data, 16, 12, form), form)
    expected = [255 * full[letter] for letter in "BGR"]
    assert np.abs(found[2:-2, 2:-2].astype(float) - expected).max() <= 1.0


@given(hnp.arrays(np.uint16, (4, 6)), st.integers(0, 5), st.booleans())
def test_rows_may_be_padded_and_bytes_swapped(values: np.ndarray, gap: int, big: bool) -> None:
    stored = values.byteswap() if big else values
    rows = np.zeros((4, 12 + gap), np.uint8)
    rows[:, :12] = stored.view(np.uint8)
    found = raw_image(rows.ravel(), 6, 4, ros_format("mono16"), 12 + gap, big_endian=big)
    np.testing.assert_array_equal(found, values)
    shorter = rows.ravel()[: rows.size - gap]  # the last row ends with its pixels
    np.testing.assert_array_equal(raw_image(shorter, 6, 4, ros_format("mono16"), 12 + gap, big_endian=big), values)


def test_colours_of_every_order_are_the_same_image() -> None:
    bgr = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    alpha = np.full((4, 6, 1), 255, np.uint8)
    for encoding, values in {
        "bgr8": bgr,
        "rgb8": bgr[:, :, ::-1],
        "bgra8": np.concatenate([bgr, alpha], axis=2),
        "rgba8": np.concatenate([bgr[:, :, ::-1], alpha], axis=2),
    }.items():
        form = ros_format(encoding)
        found = to_image(raw_image(np.ascontiguousarray(values).ravel(), 6, 4, form), form)
        np.testing.assert_array_equal(found, bgr)


@pytest.mark.parametrize("name", ["Mono8", "Mono12", "Mono12p", "Mono10Packed", "RGB8"])
def test_too_few_bytes_are_refused(name: str) -> None:
    with pytest.raises(SourceError, match="an image of 8x4 px needs"):
        raw_image(np.zeros(20, np.uint8), 8, 4, genicam_format(name))


@pytest.mark.parametrize("name", ["Confidence8", "Coord3D_ABC32f", "Mono9", "BayerXX8", ""])
def test_formats_that_are_no_pixels_of_an_image_are_refused(name: str) -> None:
    with pytest.raises(SourceError, match="PixelFormat=Mono8"):
        genicam_format(name)
    with pytest.raises(SourceError, match="are not read"):
        ros_format(name or "64FC1")
