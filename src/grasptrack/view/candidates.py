# SPDX-License-Identifier: Apache-2.0
"""What the first look may take for the object, numbered, in the image: for a person who chooses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.files import whole_file
from grasptrack.typing import Pixels
from grasptrack.view.style import FINGER_RGB, STATUS_RGB, STRATEGY_RGB, put_text, rgb_to_bgr, text_width

if TYPE_CHECKING:
    from grasptrack.segmentation.candidate import Candidate

COLOURS = (STATUS_RGB["tracked"], STRATEGY_RGB["rrp"], FINGER_RGB)
DARK = (22, 26, 33)


def draw_candidates(image: NDArray[Any], candidates: Sequence[Candidate]) -> Pixels:
    """The image (H, W, 3) BGR with the outlines of up to three candidates and their numbers, 1 being the likeliest."""
    from grasptrack.images import to_bgr

    seen = to_bgr(image)
    picture = np.array(seen if seen.ndim == 3 else cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    size = max(16, round(picture.shape[0] / 24))
    for number in range(min(3, len(candidates)), 0, -1):
        candidate, colour = candidates[number - 1], rgb_to_bgr(COLOURS[number - 1])
        for contour in candidate.view.contours:
            chain = np.rint(contour.points * 16.0).astype(np.int32)
            cv2.polylines(picture, [chain], True, (0, 0, 0), max(3, size // 5), cv2.LINE_AA, 4)
            cv2.polylines(picture, [chain], True, colour, max(2, size // 9), cv2.LINE_AA, 4)
    lines = [f"{number}   {100.0 * c.probability:.0f} %" for number, c in enumerate(candidates[:3], 1)]
    wide = max((text_width(line, size, True) for line in lines), default=0)
    picture[: round(1.4 * size * len(lines) + 0.5 * size), : wide + 2 * size] = rgb_to_bgr(DARK)
    for row, line in enumerate(lines):
        put_text(picture, line, size, round(1.4 * size * (row + 1)), size, COLOURS[row], True)
    return picture


def write_candidates(path: Path, image: NDArray[Any], candidates: Sequence[Candidate]) -> None:
    """The picture as a file.

    Raises:
        OSError: it cannot be written.
    """
    good, data = cv2.imencode(path.suffix, draw_candidates(image, candidates))
    if not good:
        raise OSError(f'"{path}" cannot be written')
    with whole_file(path) as part:
        part.write_bytes(data.tobytes())
