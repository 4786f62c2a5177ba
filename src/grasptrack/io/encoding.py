# SPDX-License-Identifier: Apache-2.0
"""Images as the bytes of a file: PNG, which keeps every grey level, or JPEG."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import arguments
from grasptrack.errors import InputError

QUALITY = 88
# Of OpenCV's ways to write PNG the fastest: a third of its default's time, and no larger.
_FAST = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
if hasattr(cv2, "IMWRITE_PNG_FILTER"):  # OpenCV 4.12
    _FAST += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB]


@arguments.checked(image=arguments.array(unbounded=True), quality=arguments.whole)
def encode_jpeg(image: NDArray[Any], quality: int = QUALITY) -> bytes:
    """The bytes of a JPEG file.

    Args:
        image: (H, W) or BGR (H, W, 3), 8 bit.
        quality: 1 to 100; more is larger and truer.

    Raises:
        InputError: a quality out of range, or no such image.
    """
    if not 1 <= quality <= 100:
        raise InputError(f"the quality of a JPEG is 1 to 100, not {quality}", quality=quality)
    try:
        good, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    except cv2.error:
        good, data = False, np.empty(0, np.uint8)
    if not good:
        raise InputError(f"an image of {image.shape}, {image.dtype}, has no JPEG", shape=image.shape)
    return data.tobytes()


def encode_image(image: NDArray[np.uint8], quality: int | None) -> tuple[bytes, str]:
    """The bytes of a file, and its format: "png" or "jpeg".

    Args:
        image: grey (H, W) or BGR (H, W, 3).
        quality: 1 to 100, of a JPEG; None for PNG.

    Raises:
        InputError: as of `encode_jpeg`.
    """
    if quality is None:
        return cv2.imencode(".png", image, _FAST)[1].tobytes(), "png"
    return encode_jpeg(image, quality), "jpeg"
