# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for drivers whose devices no test machine has: a webcam through OpenCV, and a RealSense camera."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, ClassVar

import cv2
import numpy as np

SIZES = {(640, 480), (1280, 720)}


class Webcam:
    """cv2.VideoCapture of a camera that has two sizes and an exposure; gives `lives` images each time it is opened."""

    opened: ClassVar[list[Webcam]] = []
    lives = 10**9

    def __init__(self, which: int | str, backend: int = 0) -> None:
        self.which = which
        self.values: dict[int, float] = {cv2.CAP_PROP_FRAME_WIDTH: 640, cv2.CAP_PROP_FRAME_HEIGHT: 480}
        self.count = 0
        self.released = False
        Webcam.opened.append(self)

    def isOpened(self) -> bool:  # noqa: N802
        return self.which in (0, "/dev/null")

    def set(self, prop: int, value: float) -> bool:
        if prop in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT):
            self.values[prop] = min((s[prop - cv2.CAP_PROP_FRAME_WIDTH] for s in SIZES), key=lambda s: abs(s - value))
            return True
        if prop not in (cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_FPS, cv2.CAP_PROP_BUFFERSIZE, cv2.CAP_PROP_FOURCC):
            return False
        self.values[prop] = value
        return True

    def get(self, prop: int) -> float:
        if prop == cv2.CAP_PROP_POS_MSEC:
            return 5000.0 + 40.0 * self.count
        return self.values.get(prop, 0.0)

    def read(self) -> tuple[bool, np.ndarray | None]:
        self.count += 1
        if self.count > self.lives:
            return False, None
        size = int(self.values[cv2.CAP_PROP_FRAME_HEIGHT]), int(self.values[cv2.CAP_PROP_FRAME_WIDTH])
        return True, np.full((*size, 3), self.count % 256, np.uint8)

    def release(self) -> None:
        self.released = True


class Sensor:
    """One of two of a RealSense camera."""

    def __init__(self, color: bool) -> None:
        self.color = color
        self.options: dict[str, float] = {}

    def is_color_sensor(self) -> bool:
        return self.color

    def supports(self, option: str) -> bool:
        return option == "exposure"

    def set_option(self, option: str, value: float) -> None:
        if value < 0:
            raise RuntimeError("out of range")
        self.options[option] = value


def realsense(serials: list[str]) -> Any:
    """A module like pyrealsense2 with these cameras; `sensors` of it are the color one and the other."""
    sensors = [Sensor(False), Sensor(True)]
    device = SimpleNamespace(query_sensors=lambda: sensors)

    class Config:
        serial: str
        stream: tuple[Any, ...]

        def enable_device(self, serial: str) -> None:
            self.serial = serial

        def enable_stream(self, *stream: Any) -> None:
            self.stream = stream

    class Frame:
        def __init__(self, shape: tuple[int, ...], count: int) -> None:
            self.shape, self.count = shape, count

        def get_data(self) -> np.ndarray:
            return np.full(self.shape, self.count % 256, np.uint8)

        def get_timestamp(self) -> float:
            return 7000.0 + 33.0 * self.count

    class Pipeline:
        def start(self, config: Config) -> Any:
            self.config, self.count = config, 0
            if config.serial not in serials:
                raise RuntimeError("No device connected")
            if config.stream[1:3] == (31, 17):
                raise RuntimeError("Couldn't resolve requests")
            return SimpleNamespace(get_device=lambda: device)

        def try_wait_for_frames(self, wait: int) -> tuple[bool, Any]:
            self.count += 1
            kind, width, height = self.config.stream[:3]
            shape = (height or 480, width or 640)
            frame = Frame((*shape, 3) if kind == "color" else shape, self.count)
            return True, SimpleNamespace(get_color_frame=lambda: frame, get_infrared_frame=lambda: frame)

        def stop(self) -> None:
            pass

    def described(serial: str) -> Any:
        return SimpleNamespace(get_info=lambda what: {"serial": serial, "name": "Intel RealSense D435"}[what])

    return SimpleNamespace(
        pipeline=Pipeline,
        config=Config,
        sensors=sensors,
        context=lambda: SimpleNamespace(query_devices=lambda: [described(s) for s in serials]),
        camera_info=SimpleNamespace(serial_number="serial", name="name"),
        stream=SimpleNamespace(color="color", infrared="infrared"),
        format=SimpleNamespace(bgr8="bgr8", y8="y8"),
        option=SimpleNamespace(exposure="exposure", laser_power="laser_power"),
    )
