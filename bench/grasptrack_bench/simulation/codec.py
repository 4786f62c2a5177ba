# SPDX-License-Identifier: Apache-2.0
"""Video compression: groups of rendered images through a real encoder and back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

import av
import cv2
import numpy as np

from grasptrack.typing import Pixels

GROUP = 60
"""Frames from one key frame to the next: two seconds, as streams of cameras have. A whole one is held in memory."""
HELD = 2
"""Groups that are held, of whatever scenes were asked last."""


@dataclass(frozen=True)
class Codec:
    """How a video is compressed.

    Attributes:
        name: of the encoder, "libx264" or "libx265".
        crf: its constant rate factor; more is coarser.
        preset: how hard it tries.
    """

    name: str
    crf: float
    preset: str = "veryfast"

    def options(self) -> dict[str, str]:
        """For the encoder: a key frame first, then P-frames alone as a live stream has; one thread, so that it repeats."""
        made = {"crf": f"{self.crf:.1f}", "preset": self.preset, "tune": "zerolatency"}
        if self.name == "libx264":
            return {**made, "x264-params": f"keyint={GROUP}:scenecut=0:bframes=0:threads=1:log-level=none"}
        held = "pools=none:frame-threads=1:bframes=0:scenecut=0:log-level=none"
        return {**made, "x265-params": f"keyint={GROUP}:{held}"}


def through_codec(images: Sequence[Pixels], codec: Codec) -> list[Pixels]:
    """As many images, each (H, W) or (H, W, 3) BGR, 8 bit, as a decoder gives them back."""
    height, width = images[0].shape[:2]
    kind = "gray" if images[0].ndim == 2 else "bgr24"
    encoder: Any = av.CodecContext.create(codec.name, "w")
    encoder.width, encoder.height = width + width % 2, height + height % 2  # 4:2:0 needs even ones
    encoder.pix_fmt, encoder.framerate, encoder.options = "yuv420p", Fraction(30), codec.options()
    decoder: Any = av.CodecContext.create("h264" if codec.name == "libx264" else "hevc", "r")
    encoder.thread_count = decoder.thread_count = 1
    shown: list[Any] = []
    for number, image in enumerate(images):
        even = np.asarray(cv2.copyMakeBorder(image, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE), dtype=np.uint8)
        frame = av.VideoFrame.from_ndarray(even, format=kind).reformat(format="yuv420p")
        frame.pts = number
        shown += [seen for packet in encoder.encode(frame) for seen in decoder.decode(packet)]
    shown += [seen for packet in encoder.encode(None) for seen in decoder.decode(packet)] + decoder.decode(None)
    return [np.ascontiguousarray(frame.to_ndarray(format=kind)[:height, :width], dtype=np.uint8) for frame in shown]


def coded_image(take: Callable[[int], Pixels], count: int, codec: Codec, index: int) -> Pixels:
    """A frame of `count`, as it is decoded, of what `take` gives before; each group is encoded once while it is held."""
    return _coded_group(take, count, codec, index // GROUP)[index % GROUP].copy()


@lru_cache(maxsize=HELD)
def _coded_group(take: Callable[[int], Pixels], count: int, codec: Codec, group: int) -> list[Pixels]:
    return through_codec([take(i) for i in range(GROUP * group, min(count, GROUP * (group + 1)))], codec)
