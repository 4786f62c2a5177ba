# SPDX-License-Identifier: Apache-2.0
"""What the Python blocks of README and docs take as given: a part, its neighbours, a robot, marked fingertips and object."""

import importlib.util
from pathlib import Path
from typing import Protocol, cast

import cv2
import numpy as np
from numpy.typing import NDArray

import grasptrack as gt
from grasptrack.geometry.homographies import apply_homography
from recordings import plate

Array = NDArray[np.float64]


class Robot(Protocol):
    """What a driver offers."""

    def image(self) -> NDArray[np.uint8]: ...
    def time(self) -> float: ...
    def pose(self) -> Array: ...
    def move(self, twist: Array) -> None: ...
    def close(self) -> bool: ...
    def open(self) -> None: ...
    def stop(self) -> None: ...
    def fingertips(self) -> Array: ...


def _example_robot() -> Robot:
    path = Path(__file__).resolve().parents[2] / "examples" / "06_servo.py"
    spec = importlib.util.spec_from_file_location("example_servo", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return cast(Robot, module.Robot())


robot = _example_robot()
fingertips_px = points_px = robot.fingertips()
clicked_px = gt.first_look(robot.image())[0].view.outer.points.mean(axis=0)
opening_m = 0.08
fingers_mask = np.zeros((480, 640), np.uint8)

_square = np.array([[-60, -20], [-20, -20], [20, -20], [60, -20], [60, 20], [20, 20], [-20, 20], [-60, 20]])
outline = gt.Contour(_square + 200.0)
others = [gt.Contour(apply_homography(np.array([[1.0, 0, 150], [0, 1, 0], [0, 0, 1]]), outline.points))]


def write_video(path: Path) -> None:
    """A plate that moves through 8 frames."""
    from grasptrack.io.video import VideoWriter

    writer = VideoWriter(path, 25.0)
    for i in range(8):
        writer.write(cv2.cvtColor(plate((300.0 + i, 240.0), 0.2 + 0.01 * i, (480, 640)), cv2.COLOR_GRAY2BGR))
    writer.close()
