# SPDX-License-Identifier: Apache-2.0
"""A small picture for each reason code: a rendered frame with which the tracker gives it, for the page on troubleshooting."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

import grasptrack as gt
from grasptrack.geometry.contours import View
from grasptrack.typing import Pixels
from grasptrack.view.draw import draw_overlay
from grasptrack.view.style import Picture
from grasptrack_bench.scenes import SceneCase, ScenePart
from grasptrack_bench.simulation import SHAPES
from research.studies import common

SIZE, SHOWN = (480, 360), (320, 240)
"""px of the images, and of the pictures."""
FRAMES = 30


class Staged(NamedTuple):
    """Images with their times, and what the tracker is told."""

    images: Iterator[tuple[Pixels, float | None]]
    options: Mapping[str, Any]


def case_of(shape: str, disturbance: str, seed: int, frames: int = FRAMES) -> SceneCase:
    """One sequence of the suite of scenes, small."""
    return SceneCase(ScenePart(SHAPES[shape]()), disturbance, frames=frames, size=SIZE, seed=seed)


def from_suite(shape: str, disturbance: str, seed: int = 5, frames: int = FRAMES, **options: Any) -> Staged:
    """A sequence of the suite as it is."""
    scene = case_of(shape, disturbance, seed, frames).scene()
    return Staged(((frame.image, frame.time) for frame in scene), options)


def empty_table() -> Staged:
    """The table while the part is away."""
    scene = case_of("bracket", "leave", 5).scene()
    return Staged(((frame.image, frame.time) for frame in scene if frame.outline_visible == 0.0), {})


def gone_when_needed() -> Staged:
    """A grasp that hardly fails to close is to be chosen anew, and another part lies elsewhere."""
    frames = [case_of("bracket", "still", 5).scene()[k] for k in range(2)]
    contacts = gt.GraspTracker(fingers=2).update(frames[0].image).contacts
    start = gt.GraspTracker(grasp=contacts).update(frames[0].image)
    assert start.analysis is not None and contacts is not None
    friction = math.tan(math.atan(start.analysis.friction) - start.analysis.margin - 0.01)
    blank = np.full_like(frames[0].image, int(np.median(frames[0].image)))
    other = blank.copy()
    cv2.circle(other, (70, 70), 30, 255 - int(blank.max()), -1, cv2.LINE_AA)
    images = [*(frame.image for frame in frames), blank, other]
    return Staged(
        ((image, 0.04 * k) for k, image in enumerate(images)),
        {"grasp": contacts, "friction": friction, "resynthesize": True},
    )


STAGED: dict[str, Callable[[], Staged]] = {
    "no-object": empty_table,
    "object-gone": gone_when_needed,
    "no-grasp": lambda: from_suite("bracket", "still", friction=1e-6),
    "no-description": lambda: from_suite("disc", "clean-6dof", strategy="grasp-line"),
    "not-there": lambda: from_suite("bracket", "leave"),
    "other-place": lambda: from_suite("half-disc", "equal-enters"),
    "uncertain": lambda: from_suite("half-disc", "leave"),
    "other-shape": lambda: from_suite("half-disc", "hand"),
    "other-surface": lambda: from_suite("bracket", "print-exchange"),
    "apart": lambda: from_suite("bracket", "two-bodies"),
    "outline-open": lambda: from_suite("half-disc", "glare-first", seed=1),
    "ambiguous": lambda: from_suite("rectangle", "leave", seed=1, frames=24),
    "lookalike": lambda: from_suite("key", "equal-enters", seed=2, frames=24),
    "no-transfer": lambda: from_suite("square", "clip", seed=1, frames=24, strategy="homography"),
    "strategy-off": lambda: from_suite("bracket", "clean-6dof", strategy="grasp-line"),
    "off-outline": lambda: from_suite("key", "noise", seed=5, frames=24, strategy="homography"),
    "image-fixed": lambda: from_suite("half-disc", "overlay", seed=6, frames=24),
    "contact-unseen": lambda: from_suite("bracket", "cover"),
    "not-flat": lambda: from_suite("key", "block", seed=55, frames=24),
    "not-pinhole": lambda: from_suite("key", "aspect", seed=2, frames=40),
    "tilt-open": lambda: from_suite("bracket", "leave"),
    "not-closing": lambda: from_suite("half-disc", "aside", friction=0.05),
    "open-margin": lambda: from_suite("key", "aside", friction=0.15),
    "slips": lambda: from_suite("key", "leave", seed=5, frames=24),
}
"""By code. No scene here makes the tracker say the others."""


def first_frame_with(code: str) -> tuple[Picture, gt.TrackResult] | None:
    """The overlay, without its strip, of the first frame that gets a code; None where none does."""
    staged, last = STAGED[code](), None
    tracker = gt.GraspTracker(**{"fingers": 2, **staged.options})
    for image, time in staged.images:
        result = tracker.update(image, time=time)
        last = result.view if result.located else last
        if code in (result.reason_code, result.notice):
            return picture_of(image, result, last), result
    return None


def picture_of(image: Pixels, result: gt.TrackResult, last: View | None) -> Picture:
    """`SHOWN` px of the overlay."""
    whole = draw_overlay(image, result, last=last)
    rows = round(whole.shape[1] * image.shape[0] / image.shape[1])
    return np.asarray(cv2.resize(whole[:rows], SHOWN, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def main() -> None:
    """Run the study."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--codes", default=",".join(STAGED), help="codes to stage [all that can be]")
    parser.add_argument("--quality", type=int, default=75, help="of WebP, 1 to 100 [75]")
    parser.add_argument("--pictures", type=Path, default=Path("reasons"), help="folder to write to [reasons]")
    asked = parser.parse_args()
    asked.pictures.mkdir(parents=True, exist_ok=True)
    rows = []
    for code in asked.codes.split(","):
        found = first_frame_with(code)
        if found is None:
            rows.append([code, "", "no frame of its scene"])
            continue
        picture, result = found
        cv2.imwrite(str(asked.pictures / f"{code}.webp"), picture, [cv2.IMWRITE_WEBP_QUALITY, asked.quality])
        rows.append([code, str(result.frame), result.reason or result.notice])
    common.begin_section("Pictures of the reasons")
    common.add_table(["code", "frame", "reason"], rows)
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
