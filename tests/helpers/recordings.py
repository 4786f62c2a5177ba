# SPDX-License-Identifier: Apache-2.0
"""Images and videos for the tests of sources, runs and the command line."""

import csv
import json
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from grasptrack.io.video import VideoWriter


def picture(seed: int = 0, size: tuple[int, int] = (48, 64), channels: int = 3) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 256, (*size, channels), dtype=np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 2).reshape(*size, channels)


def write(path: Path, image: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), image)
    return path


def movie(path: Path, count: int = 12, fps: float = 25.0, size: tuple[int, int] = (48, 64)) -> Path:
    writer = VideoWriter(path, fps)
    for i in range(count):
        writer.write(np.roll(picture(1, size), 3 * i, axis=1))
    writer.close()
    return path


def recording(path: Path, codec: str) -> Path:
    """A video whose frames need one another, as cameras and screen recorders write them."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        for i in range(60):
            image = np.roll(picture(3, (120, 160)), 2 * i, axis=1)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode(None))
    return path


def plate(
    centre: tuple[float, float] = (160.0, 120.0), angle: float = 0.2, size: tuple[int, int] = (240, 320)
) -> np.ndarray:
    """(H, W) an L-shaped dark plate on a light ground."""
    corners = np.array([[-70, -45], [70, -45], [70, 5], [-20, 5], [-20, 45], [-70, 45]], dtype=np.float64)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    fixed = np.rint((corners @ turn.T + centre) * 16).astype(np.int32)
    image = np.full(size, 200, np.uint8)
    cv2.fillPoly(image, [fixed], 60, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(image, (0, 0), 0.8)


def square(angle: float, centre: tuple[float, float] = (160.0, 120.0)) -> np.ndarray:
    """(240, 320) a dark square of 100 px, turned by an angle in radians, on a light ground."""
    corners = 50.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    image = np.full((240, 320), 200, np.uint8)
    cv2.fillPoly(image, [np.rint((corners @ turn.T + centre) * 16).astype(np.int32)], 60, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(image, (0, 0), 0.8)


def plates(folder: Path, count: int = 8) -> Path:
    """A folder of images in which the plate moves."""
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        write(folder / f"{i:03d}.png", plate((150.0 + 1.5 * i, 118.0 + i), 0.2 + 0.01 * i))
    return folder


def strict_json(path: Path) -> dict[str, Any]:
    """What a file holds, in which every number is one."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    return dict(json.loads(path.read_text(), parse_constant=refuse))


def rows(folder: Path, name: str = "grasps.csv") -> list[dict[str, str]]:
    """What a table of a run holds."""
    with (folder / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
