# SPDX-License-Identifier: Apache-2.0
"""Which object of a real video is meant, and where it is: `scenes.csv` beside the videos."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.metrics.truth import Truth
from grasptrack.errors import ConditioningError, InputError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats

Given = Literal["pixel", "quad", "nothing"]
"""What is told of the object before the first image: a pixel of it, its quadrilateral, or nothing."""
GIVEN: tuple[Given, ...] = ("pixel", "quad", "nothing")

SCENES = "scenes.csv"
SAME_OBJECT = 0.5
"""Intersection over union with the object's quadrilateral that an outline needs to be the object's."""
BORDER = 1.0
"""px that a quadrilateral keeps from the border of an image that shows it whole."""
SAMPLES = 50
"""Points along each side by which the share of an outline in view is told."""
NOT_WHOLE = 0.99
"""Most of that share where a corner lies outside."""


@dataclass(frozen=True)
class Known:
    """What `scenes.csv` tells of one video.

    Attributes:
        object_at: px of the object in the first frame that the table of homographies lists.
        quad: (4, 2) px, its corners in order round it, in frame 0 of that table; contacts are put on its sides 0-3 and 1-2.
    """

    object_at: tuple[float, float]
    quad: Floats


def read_scenes(path: Path) -> dict[str, Known]:
    """What is known of videos, by their names, from a table with the columns name, object and quad; others are passed over.

    Raises:
        InputError: an unreadable file, missing columns, a name twice, or what is no pixel or no quadrilateral.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f'cannot read the scenes "{path}": {error}', path=str(path)) from error
    found: dict[str, Known] = {}
    for number, row in enumerate(rows, start=2):
        try:
            name = row["name"]
            (pixel,), quad = _parse_points(row["object"], 1), _parse_points(row["quad"], 4)
            if not name or name in found or not cv2.isContourConvex(quad.astype(np.float32)):
                raise ValueError
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                f'"{path}", line {number}: a row needs a name of its own, object as "x,y" and quad as the four corners '
                '"x,y x,y x,y x,y" of a convex quadrilateral',
                path=str(path),
                line=number,
            ) from error
        found[name] = Known((float(pixel[0]), float(pixel[1])), quad)
    if not found:
        raise InputError(f'"{path}" names no video', path=str(path))
    return found


def side_contacts(quad: Floats) -> Floats:
    """(2, 2) px, a grasp on a quadrilateral (4, 2): the midpoints of its sides 0-3 and 1-2."""
    return np.array([(quad[0] + quad[3]) / 2.0, (quad[1] + quad[2]) / 2.0])


def area_of(polygon: Floats) -> float:
    """px^2 of a polygon (N, 2)."""
    following = np.roll(polygon, -1, axis=0)
    return float(abs((polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]).sum()) / 2.0)


def truth_of_quad(H: Floats, quad: Floats, size: tuple[int, int]) -> Truth | None:
    """What is true of a frame; None where H sends the object to infinity.

    Args:
        H: (3, 3) H_current_reference.
        quad: (4, 2) px of the object in the reference.
        size: width and height of the images in px.
    """
    try:
        corners = apply_homography(H, quad)
    except ConditioningError:
        return None
    truth = Truth.of_homography(H, area_of(corners))
    return Truth(
        truth.carry, truth.back, truth.area, True, share_in_view(corners, size), lambda p: _points_in_image(p, size)
    )


def share_in_view(quad: Floats, size: tuple[int, int]) -> float:
    """Share of the sides of a quadrilateral (4, 2) px inside an image, 0 to 1; 1 exactly where it lies whole in it."""
    if bool((quad > BORDER).all()) and bool((quad < np.array(size) - 1.0 - BORDER).all()):
        return 1.0
    along = np.arange(SAMPLES)[:, None] / SAMPLES
    points = [a + along * (b - a) for a, b in zip(quad, np.roll(quad, -1, axis=0), strict=True)]
    lengths = np.hypot(*(np.roll(quad, -1, axis=0) - quad).T)
    shares = [float(_points_in_image(side, size).mean()) for side in points]
    return min(NOT_WHOLE, float(np.average(shares, weights=lengths)))


def another_object(outline: Sequence[Floats], quad: Floats, size: tuple[int, int]) -> str:
    """Why an outline is another object's than that of a quadrilateral (4, 2) px; "" where it is the same.

    Args:
        outline: polygons in px, outer first, then holes, which do not matter here.
        quad: of the object.
        size: width and height of the image in px.
    """
    outer = outline[0]
    one, other = (_polygon_mask(polygon, size) for polygon in (outer, quad))
    share = float((one & other).sum()) / max(1.0, float((one | other).sum()))
    moments = cv2.moments(outer.astype(np.float32))
    x, y = outer.mean(axis=0).tolist()
    if abs(moments["m00"]) > 0.0:
        x, y = moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]
    if share >= SAME_OBJECT and cv2.pointPolygonTest(quad.astype(np.float32), (x, y), False) >= 0.0:
        return ""
    return (
        f"the first look took another object, centred at {x:.0f},{y:.0f}: its outline shares {100.0 * share:.0f} % "
        "with the object's quadrilateral (intersection over union)"
    )


def _polygon_mask(polygon: Floats, size: tuple[int, int]) -> NDArray[np.bool_]:
    """(H, W) where a polygon (N, 2) px covers an image."""
    return np.asarray(cv2.fillPoly(np.zeros(size[::-1], np.uint8), [np.rint(polygon).astype(np.int32)], 1)) > 0


def _points_in_image(points: Floats, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which points (k, 2) px lie in an image."""
    return np.asarray(((points >= 0.0) & (points <= np.array(size) - 1.0)).all(axis=1))


def _parse_points(text: str, count: int) -> Floats:
    """(count, 2) px from "x,y x,y".

    Raises:
        ValueError: other than so many points.
    """
    points = np.array([[float(v) for v in point.split(",")] for point in text.split()], dtype=np.float64)
    if points.shape != (count, 2) or not np.isfinite(points).all():
        raise ValueError(f"{count} points are needed")
    return points
