# SPDX-License-Identifier: Apache-2.0
"""An image as a JPEG, for programs that show it."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import arguments
from grasptrack.errors import InputError

QUALITY = 88


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
