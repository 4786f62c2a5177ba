# SPDX-License-Identifier: Apache-2.0
"""Photos of one tool each, with their masks."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Photo:
    """A photo and its true mask."""

    name: str
    scene: str
    image: Array
    truth: Array


def read_photos(folder: Path, only: str | None) -> list[Photo]:
    """The photos that index.csv lists, in its order; with `only`, those whose names contain it.

    The masks are nonzero on the tool. A photo or mask that cannot be read ends the run.
    """
    with (folder / "index.csv").open(newline="", encoding="utf-8") as file:
        listed = [(row["name"], row["scene"]) for row in csv.DictReader(file)]
    return [
        Photo(
            name,
            scene,
            read(folder / "images" / f"{name}.jpg", cv2.IMREAD_COLOR),
            read(folder / "masks" / f"{name}.png", cv2.IMREAD_GRAYSCALE) > 0,
        )
        for name, scene in listed
        if only is None or only in name
    ]


def read(path: Path, flags: int) -> Array:
    image = cv2.imread(str(path), flags)
    if image is None:
        raise SystemExit(f"cannot read {path}")
    return image


def deepest(mask: Array) -> tuple[float, float]:
    """(x, y) px of the mask's pixel that is farthest from all that is not of it: where a user would point."""
    depth = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    y, x = np.unravel_index(int(np.argmax(depth)), mask.shape)
    return float(x), float(y)
