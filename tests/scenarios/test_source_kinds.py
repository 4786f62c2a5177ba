# SPDX-License-Identifier: Apache-2.0
"""What other programs' files hold is what comes out of them, or one line says why not: five files of each kind."""

import sys
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from grasptrack import GraspTracker, InputError, SourceError, open_source
from grasptrack.images import to_bgr
from grasptrack.io.masks import read_mask
from sequence_kinds import BAGS, VIDEOS, on_black, video, with_alpha
from source_kinds import STILLS, Kind, colours, deep

FILES = 5


@pytest.mark.parametrize("kind", [*STILLS, *VIDEOS, *BAGS], ids=lambda kind: f"{kind.suffix}, {kind.what}")
def test_what_a_file_holds_is_what_comes_out(kind: Kind, tmp_path: Path) -> None:
    if not kind.can_be_written:
        pytest.skip(f"{kind.needs}, which writes it, is not installed")
    for number in range(FILES):
        path = tmp_path / f"{number}.{kind.suffix}"
        held = kind.write(path, number)
        if kind.refused:
            with pytest.raises(SourceError, match=f"^[^\n]*{kind.refused}[^\n]*$"):
                list(open_source(path))
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            frames = list(open_source(path))
        assert [frame.image.shape for frame in frames] == [image.shape for image in held.images]
        for frame, image in zip(frames, held.images, strict=True):
            assert np.abs(frame.image.astype(float) - image).mean() <= kind.within
        if held.times is None:
            assert not any(frame.time for frame in frames)
        else:  # some formats begin later than at 0
            times = np.array([frame.time for frame in frames], dtype=np.float64)
            np.testing.assert_allclose(times - times[0], held.times, atol=1.1e-3)


@pytest.mark.parametrize(
    "kind", [kind for kind in STILLS if not kind.refused], ids=lambda kind: f"{kind.suffix}, {kind.what}"
)
def test_a_damaged_file_is_read_or_refused_in_one_line(kind: Kind, tmp_path: Path) -> None:
    if not kind.can_be_written:
        pytest.skip(f"{kind.needs}, which writes it, is not installed")
    rng, path = np.random.default_rng(5), tmp_path / f"a.{kind.suffix}"
    kind.write(path, 0)
    whole = np.frombuffer(path.read_bytes(), np.uint8)
    for _ in range(12):
        data = whole[: rng.integers(len(whole))] if rng.random() < 0.3 else whole.copy()
        if len(data) == len(whole):
            data[rng.integers(min(len(data), 10 ** rng.integers(2, 6)), size=4)] = rng.integers(256, size=4)
        path.write_bytes(data.tobytes())
        try:
            list(open_source(path))
        except SourceError as error:
            assert "\n" not in str(error)


def test_several_images_in_one_file_are_no_image_of_a_folder(tmp_path: Path) -> None:
    for kind in STILLS:
        if kind.what in ("of several images", "several pages"):
            path = tmp_path / f"a.{kind.suffix}"
            kind.write(path, 0)
            with pytest.raises(SourceError, match=r"^image [^\n]* holds 4 images: it is a sequence of its own"):
                list(open_source(tmp_path))
            path.unlink()


def test_heic_without_its_reader_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (kind,) = (kind for kind in STILLS if kind.suffix == "heic" and kind.what == "one image")
    if not kind.can_be_written:
        pytest.skip("pillow-heif, which writes it, is not installed")
    kind.write(tmp_path / "a.heic", 0)
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    with pytest.raises(InputError, match=r"image [^\n]* needs pillow_heif.*\[heif\]"):
        list(open_source(tmp_path))


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "P", "CMYK", "L", "LA", "1", "I;16"])
def test_an_image_of_pillows_is_taken_for_the_colours_that_it_has(mode: str) -> None:
    picture = Image.fromarray(colours(0)[:, :, ::-1])
    picture = (
        Image.fromarray(deep(0)) if mode == "I;16" else picture.convert("L" if mode == "LA" else mode).convert(mode)
    )
    expected = deep(0) >> 8 if mode == "I;16" else np.asarray(picture.convert("RGB"))[:, :, ::-1]
    found, expected = (np.atleast_3d(each) for each in (to_bgr(picture), expected))
    np.testing.assert_array_equal(*np.broadcast_arrays(found, expected))


def test_arrays_of_12_bits_are_warned_of() -> None:
    with pytest.warns(UserWarning, match="multiply 10 bits by 64, 12 by 16"):
        to_bgr(deep(0, 12))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        to_bgr(deep(0))
        to_bgr(np.zeros((40, 50), np.uint16))


def test_transparency_beside_the_images_of_a_webm_is_told_of(tmp_path: Path) -> None:
    write = video("libvpx-vp9", "yuva420p", with_alpha, on_black, "bgra", crf="4", b="4M")
    write(tmp_path / "a.webm", 0)
    with pytest.warns(UserWarning, match="what is transparent in it is not read"):
        open_source(tmp_path / "a.webm")


def two_squares() -> np.ndarray:
    """Instances 1 and 2, which touch."""
    labels = np.zeros((120, 160), np.uint8)
    labels[30:90, 20:80], labels[30:90, 80:140] = 1, 2
    return labels


def test_instances_that_touch_in_a_mask_stay_apart(tmp_path: Path) -> None:
    labels = two_squares()
    colours = np.dstack([90 * labels, 200 - 90 * labels, 0 * labels]) * (labels > 0)[:, :, None].astype(np.uint8)
    for name, image in {"a.png": labels, "deep.png": labels * np.uint16(300), "colours.png": colours}.items():
        cv2.imwrite(str(tmp_path / name), image)
        mask = read_mask(tmp_path / name, parted=True)
        assert cv2.connectedComponents(mask, connectivity=8)[0] == 3, name
        assert np.array_equal(mask == 0, (labels == 0) | np.isin(np.arange(160), (78, 79, 80, 81))), name
        np.testing.assert_array_equal(read_mask(tmp_path / name), 255 * (labels > 0).astype(np.uint8))
    view = GraspTracker(object_at=(50.0, 60.0)).update(labels, mask=labels).view
    assert view is not None and abs(view.outer.area - 58 * 60) < 60


def test_a_soft_edge_of_a_mask_is_no_instance(tmp_path: Path) -> None:
    soft = cv2.GaussianBlur(255 * (two_squares() > 0).astype(np.uint8), (0, 0), 2.0)
    cv2.imwrite(str(tmp_path / "soft.png"), soft)
    np.testing.assert_array_equal(read_mask(tmp_path / "soft.png", parted=True), np.where(soft > 0, 255, 0))
