# SPDX-License-Identifier: Apache-2.0
"""Masks beside a source: each with the frame that it belongs to, in any kind of file."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from grasptrack import SourceError, open_source
from grasptrack.io.masks import open_masks, read_mask
from grasptrack.io.video import VideoWriter

SIZE = (40, 50)


def marked(column: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    mask = np.zeros(size, np.uint8)
    mask[5:20, column] = 1
    return mask


def folders(tmp_path: Path, frames: list[str], masks: list[str]) -> tuple[Path, Path]:
    for folder, names in (("frames", frames), ("masks", masks)):
        (tmp_path / folder).mkdir()
        for i, name in enumerate(names):
            image = np.full(SIZE, 99, np.uint8) if folder == "frames" else marked(i)
            cv2.imwrite(str(tmp_path / folder / name), image)
    return tmp_path / "frames", tmp_path / "masks"


def columns(frames: Path, masks: Path) -> list[int]:
    source = open_source(frames)
    found = open_masks(masks, source)
    return [int(found.mask_for(frame).any(axis=0).argmax()) for frame in source]


def test_by_name_even_when_the_order_differs_and_masks_are_left_over(tmp_path: Path) -> None:
    paths = folders(tmp_path, ["b.bmp", "a.bmp"], ["a.png", "b.png", "c.png"])
    assert columns(*paths) == [0, 1]


def test_by_order_when_no_name_matches(tmp_path: Path) -> None:
    paths = folders(tmp_path, ["f1.png", "f2.png", "f10.png"], ["m8.png", "m9.png", "m10.png"])
    assert columns(*paths) == [0, 1, 2]


def test_by_order_for_a_video(tmp_path: Path) -> None:
    _, masks = folders(tmp_path, [], [f"{i:03d}.png" for i in range(4)])
    writer = VideoWriter(tmp_path / "v.mp4")
    for _ in range(4):
        writer.write(np.zeros((*SIZE, 3), np.uint8))
    writer.close()
    assert columns(tmp_path / "v.mp4", masks) == [0, 1, 2, 3]
    (masks / "003.png").unlink()
    with pytest.raises(SourceError, match="3 masks for 4 frames"):
        columns(tmp_path / "v.mp4", masks)


def test_what_does_not_match_is_said(tmp_path: Path) -> None:
    frames, masks = folders(tmp_path, ["1.png", "2.png"], ["1.png"])
    with pytest.raises(SourceError, match=r'none for frame "2.png"'):
        columns(frames, masks)
    (masks / "1.png").rename(masks / "x.png")
    with pytest.raises(SourceError, match="1 masks for 2 frames"):
        columns(frames, masks)
    cv2.imwrite(str(masks / "1.png"), marked(0))
    cv2.imwrite(str(masks / "2.png"), marked(0, (20, 30)))
    with pytest.raises(SourceError, match=r'"2.png" is 30x20 px, but frame 1 is 50x40'):
        columns(frames, masks)
    with pytest.raises(SourceError, match="no such folder"):
        open_masks(tmp_path / "nope")


def test_any_value_but_black_counts_in_any_kind_of_file(tmp_path: Path) -> None:
    mask = marked(7)
    expected = mask * np.uint8(255)
    alpha = np.dstack([np.full((*SIZE, 3), 255, np.uint8), expected])
    for name, image in {
        "labels.png": mask,
        "deep.png": mask.astype(np.uint16),
        "colour.png": np.dstack([0 * mask, mask, 0 * mask]),
        "alpha.png": alpha,
    }.items():
        cv2.imwrite(str(tmp_path / name), image)
        np.testing.assert_array_equal(read_mask(tmp_path / name), expected, err_msg=name)


def test_the_noise_of_a_jpeg_is_no_object(tmp_path: Path) -> None:
    mask = np.zeros((64, 64), np.uint8)
    mask[20:40, 20:40] = 255
    cv2.imwrite(str(tmp_path / "m.jpg"), mask, [cv2.IMWRITE_JPEG_QUALITY, 60])
    assert (read_mask(tmp_path / "m.jpg") != mask).mean() < 0.01
