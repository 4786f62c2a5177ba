# SPDX-License-Identifier: Apache-2.0
"""A camera as a source, through OpenCV."""

from __future__ import annotations

import time
from collections.abc import Generator

from grasptrack.errors import SourceError
from grasptrack.io.base import Image, Source


class CameraSource(Source):
    """`camera:0` and so on; endless. Times are s since the first image, by a clock that never goes back."""

    kind = "camera"

    def __init__(self, spec: str, fps: float | None = None) -> None:
        super().__init__(spec, fps)
        number = spec.partition(":")[2]
        if not number.isdecimal():
            raise SourceError(f'a camera is named by its number, as in camera:0, not "{spec}"', spec=spec)
        self._number = int(number)

    def _read(self) -> Generator[tuple[Image, float | None, str], None, None]:
        import cv2

        camera = cv2.VideoCapture(self._number)
        try:
            if not camera.isOpened():
                raise SourceError(
                    f"camera {self._number} cannot be opened: it is missing or in use", camera=self._number
                )
            index, start = 0, 0.0
            while True:
                good, image = camera.read()
                now = time.perf_counter()
                if not good or image is None:
                    raise SourceError(f"camera {self._number} gave no image after {index} frames", frame=index)
                start = start if index else now
                yield image, now - start, f"frame {index} of camera {self._number}"
                index += 1
        finally:
            camera.release()
