# SPDX-License-Identifier: Apache-2.0
"""H.264 in MP4, as browsers play it, through PyAV (OpenCV's wheels write none)."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError

DEFAULT_FPS = 25.0
MAX_FPS = 240.0
"""frames/s; a header that says more than this has no constant rate, and is not believed."""
_BT601, _LIMITED = 6, 1
_QUALITY = {"crf": "20", "preset": "veryfast", "threads": "1"}


class VideoWriter:
    """Writes BGR images of one size to an MP4 file, which begins with the first image and is playable once closed.

    Sides are made even, as the format wants them, by repeating the last row or column.

    Args:
        path: the file, written over.
        fps: frames/s, constant; None, or what is beyond belief, for 25.

    Raises:
        InputError: PyAV was built without an H.264 encoder.
    """

    def __init__(self, path: Path, fps: float | None = None) -> None:
        self._path = path
        self._fps = Fraction(fps if fps and fps <= MAX_FPS else DEFAULT_FPS).limit_denominator(1001)
        self._container: Any = None
        self._stream: Any = None
        self._count = 0

    def write(self, image: NDArray[np.uint8]) -> None:
        """Add an image (H, W, 3), BGR."""
        import av
        import cv2

        height, width = image.shape[:2]
        if height % 2 or width % 2:
            image = np.pad(image, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        if self._container is None:
            self._open_container(image.shape[1], image.shape[0])
        # OpenCV's conversion keeps grey grey; FFmpeg's fast one tints it green.
        planes: Any = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_BGR2YUV_I420)
        frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
        frame.pts = self._count
        frame.time_base = 1 / self._fps
        self._count += 1
        self._container.mux(self._stream.encode(frame))

    def _open_container(self, width: int, height: int) -> None:
        import av

        if "libx264" not in av.codecs_available:
            raise InputError("this build of PyAV has no H.264 encoder (libx264): leave the video out (--no-video)")
        # The index in front lets a browser start before the whole file is there.
        self._container = av.open(str(self._path), "w", options={"movflags": "+faststart"})
        stream = self._container.add_stream("libx264", rate=self._fps, options=_QUALITY)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.time_base = 1 / self._fps
        stream.codec_context.colorspace, stream.codec_context.color_range = _BT601, _LIMITED
        self._stream = stream

    def close(self) -> None:
        """Write what the encoder still holds and the index; may be called again."""
        if self._container is None:
            return
        container, self._container = self._container, None
        try:
            container.mux(self._stream.encode(None))
        finally:
            container.close()
