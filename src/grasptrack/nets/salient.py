# SPDX-License-Identifier: Apache-2.0
"""Nets that map how salient each pixel is (U^2-Net, ISNet), run by OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from grasptrack.errors import InputError
from grasptrack.first_image import FirstImage
from grasptrack.segmentation.segmenters import Region
from grasptrack.typing import Floats32, Pixels

SIDE = 320
"""px, side of the square that such nets take unless it is said."""
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of ImageNet's colours, red first: what such nets were trained on."""
MIN_MAP_SIDE = 8
"""px; what is smaller is no map of an image."""
ROUNDING = 1e-3
"""By which a probability may leave 0 to 1; what leaves it by more is a logit."""
MAX_LOGIT = 30.0


class SalientNet:
    """A net of an ONNX file, which takes a square of `side` px, as a segmenter: it looks at an image and its mirror image."""

    def __init__(self, path: str | Path, side: int = SIDE) -> None:
        self.path, self.side = Path(path), side
        if not self.path.is_file():
            raise InputError(f'there is no model file "{self.path}"', path=str(path))
        try:
            self._net: Any = cv2.dnn.readNetFromONNX(np.fromfile(self.path, np.uint8))
        except (cv2.error, OSError):  # its text names files of OpenCV's own
            raise InputError(f'"{self.path}" cannot be read as an ONNX model', path=str(path)) from None

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy reads the file again."""
        return SalientNet, (self.path, self.side)

    def regions(self, image: Pixels, hints: FirstImage) -> Sequence[Region]:
        """The map of the image, and that of its mirror image; a net knows nothing of hints, which choose afterwards."""
        plain, mirrored = self.saliency_map(image), self.saliency_map(image[:, ::-1])[:, ::-1]
        return [Region(plain, is_vote=True), Region(mirrored, is_vote=True)]

    def saliency_map(self, image: Pixels) -> Floats32:
        """(H, W) 0 to 1, how salient each pixel of an image (H, W) or BGR (H, W, 3) is."""
        colours = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        small = cv2.resize(colours, (self.side, self.side), interpolation=cv2.INTER_LINEAR)[:, :, ::-1]
        bright = np.asarray(small, dtype=np.float32) / np.float32(max(float(small.max()), 1.0))
        scaled = (bright - np.array(MEAN, np.float32)) / np.array(DEVIATION, np.float32)
        try:
            self._net.setInput(np.ascontiguousarray(scaled.transpose(2, 0, 1)[None], dtype=np.float32))
            found = np.asarray(self._net.forward())
        except cv2.error:
            shape = f"(1, 3, {self.side}, {self.side})"
            raise InputError(f'the model "{self.path}" does not run on an image of the shape {shape}') from None
        if found.ndim != 4 or found.shape[1] != 1 or min(found.shape[2:]) < MIN_MAP_SIDE:
            raise InputError(f'the model "{self.path}" gives {found.shape}, not a map (1, 1, h, w)', shape=found.shape)
        plane = found[0, 0].astype(np.float32)
        if plane.min() < -ROUNDING or plane.max() > 1.0 + ROUNDING:
            plane = probabilities(plane)
        size = (image.shape[1], image.shape[0])
        large = np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)
        return np.clip(large, 0.0, 1.0)


def probabilities(logits: Floats32) -> Floats32:
    """Of logits."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(logits, -MAX_LOGIT, MAX_LOGIT))), dtype=np.float32)


class SalientFile:
    """Makes a segmenter of a net's file."""

    usage = "FILE"

    def make(self, argument: str) -> SalientNet:
        """See SegmenterMaker."""
        return SalientNet(argument)


ONNX = SalientFile()
