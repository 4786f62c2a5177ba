# SPDX-License-Identifier: Apache-2.0
"""Real videos with reference homographies: every method on the same frames, no parameter touched.

Which object of a video is meant, and where it is, stands in `scenes.csv` beside the videos.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import ConditioningError, GraspError, InputError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.io.sources import Frame, open_source
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Floats
from grasptrack_bench.method import MethodFrame, MethodStart, score_sequence
from grasptrack_bench.methods import method_makers
from grasptrack_bench.metrics.score import FrameScore, Truth
from grasptrack_bench.records import read_homographies, read_rows

Given = Literal["pixel", "quad", "outline", "nothing"]
"""What is told of the object before the first image.

A pixel of it; that, and contacts on two sides of its quadrilateral; these, and the quadrilateral as its outline; nothing.
"""
GIVEN: tuple[Given, ...] = ("pixel", "quad", "outline", "nothing")
ON_QUAD = ("quad", "outline")
"""With these the contacts lie on two sides of the quadrilateral."""

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
    """What is known of videos, by their names, from a table with the columns name, object and quad; others are passed over."""
    found: dict[str, Known] = {}
    for number, row in enumerate(read_rows(path, "scenes"), start=2):
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
    """What H_current_reference (3, 3) and (4, 2) px of the object tell of a frame; None where H sends it to infinity."""
    try:
        corners = apply_homography(H, quad)
    except ConditioningError:
        return None
    return replace(
        Truth.of_homography(H, area_of(corners)),
        visible=share_in_view(corners, size),
        sees=lambda p: _points_in_image(p, size),
        corners=quad,
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
    """Why an outline is another object's than that of a quadrilateral (4, 2) px; "" where it is the same, holes aside."""
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
    """(count, 2) px from "x,y x,y"."""
    points = np.array([[float(v) for v in point.split(",")] for point in text.split()], dtype=np.float64)
    if points.shape != (count, 2) or not np.isfinite(points).all():
        raise ValueError(f"{count} points are needed")
    return points


TABLES = (".homographies.csv", ".derived_homographies.csv")
"""What the name of a table ends with, in the place of the video's suffix."""


@dataclass(frozen=True)
class RealCase:
    """One video and its table.

    Attributes:
        video: a video file, or a folder of images.
        table: H_current_reference by frame, reference being frame 0.
        fingers: of the grasp that is chosen in the first frame.
        friction: for choosing it.
        known: of its object, where `scenes.csv` tells it; the first frame is then the first that the table lists.
        given: what of that is told before the first frame.
        risk: probability below which answers of the tracker may be wrong.
        every: of its frames from the first on, so many-th are shown.
    """

    video: Path
    table: Path
    fingers: int = 2
    friction: float = 0.5
    known: Known | None = None
    given: Given = "nothing"
    risk: float = DEFAULT_RISK
    every: int = 1

    @property
    def name(self) -> str:
        """As in tables and names of files."""
        return self.video.stem

    def homographies(self) -> dict[int, Floats]:
        """H_current_reference (3, 3) by frame."""
        return read_homographies(self.table)

    def truths(self, size: tuple[int, int]) -> Truths:
        """What the table tells, for images of a width and height in px."""
        return Truths(self.homographies(), self.known, size)


class Truths:
    """What is true of each frame of a video.

    Args:
        table: H_current_reference by frame, reference being frame 0.
        known: of the object, or None.
        size: width and height of the images in px.

    Attributes:
        start: number of the frame in which the object is told, and to which all truths are relative.
        quad: (4, 2) px of the object there; None where it is not known.
    """

    def __init__(self, table: Mapping[int, Floats], known: Known | None, size: tuple[int, int]) -> None:
        self.start, self.quad, self._size = first_frame(table, known), None, size
        self._table = dict(table)
        if known is not None:
            reference = table[self.start]
            self.quad = apply_homography(reference, known.quad)
            back = np.linalg.inv(reference)
            self._table = {frame: np.asarray(H @ back, dtype=np.float64) for frame, H in table.items()}
        self._area, self._centre = math.nan, np.zeros(2)

    def without_quad(self, area: float, centre: Floats) -> None:
        """Area in px^2 and centre (2,) px of the object in the first frame, where no quadrilateral tells them."""
        self._area, self._centre = area, centre

    def of(self, frame: int) -> Truth | None:
        """Of a frame by its number; None where the table does not list it."""
        H = self._table.get(frame)
        if H is None:
            return None
        if self.quad is not None:
            return truth_of_quad(H, self.quad, self._size)
        truth = Truth.of_homography(H)
        area = self._area * truth.area_growth(self._centre)
        return Truth.of_homography(H, area) if math.isfinite(area) else truth

    def outline(self, frame: int) -> tuple[Floats, ...]:
        """The object's polygon in a frame by its number, px; () where it is not known."""
        truth = self.of(frame)
        return () if truth is None or self.quad is None else (truth.carry_points(self.quad),)


def first_frame(table: Mapping[int, Floats], known: Known | None) -> int:
    """Number of the frame in which the object is told: the first of a table, or 0 where nothing is known of it."""
    return 0 if known is None else min(table)


def videos_of(
    folder: Path, fingers: int = 2, friction: float = 0.5, given: Given | None = None, risk: float = DEFAULT_RISK
) -> list[RealCase]:
    """The videos and folders of images in a folder that have a table of homographies beside them, by name.

    Videos that `scenes.csv` names and that are not there are cases too: they fail alone.

    Args:
        folder: of the videos.
        fingers, friction: of the grasps that are chosen.
        given: of what `scenes.csv` in that folder tells; None is a pixel where there is that table, else nothing.
        risk: probability below which answers of the tracker may be wrong.
    """
    if given in ON_QUAD and fingers != 2:
        raise InputError(f"a quadrilateral gives 2 contacts, not {fingers}", fingers=fingers)
    if not folder.is_dir():
        raise InputError(f'"{folder}" is no folder', path=str(folder))
    scenes = folder / SCENES
    known = read_scenes(scenes) if scenes.is_file() else {}
    if given not in (None, "nothing") and not known:
        raise InputError(f'a {given} of each object is told by "{scenes}", which is not there', path=str(scenes))
    told: Given = given or ("pixel" if known else "nothing")
    cases = []
    for table in sorted(path for end in TABLES for path in folder.glob(f"*{end}")):
        stem = next(table.name.removesuffix(end) for end in reversed(TABLES) if table.name.endswith(end))
        found = [path for path in sorted(folder.glob(f"{stem}*")) if path.stem == stem and path.suffix != ".csv"]
        of = known.get(stem)
        cases += [RealCase(p, table, fingers, friction, of, told if of else "nothing", risk) for p in found[:1]]
    if not cases:
        raise InputError(
            f'no video in "{folder}" has a table of homographies beside it: for film.mp4, film.homographies.csv '
            "with the columns frame, h11 ... h33",
            path=str(folder),
        )
    names = {case.name for case in cases}
    absent = [folder / name for name in known if name not in names]
    cases += [RealCase(path, folder / f"{path.name}{TABLES[0]}", known=known[path.name], given=told) for path in absent]
    return cases


def run_video(task: tuple[RealCase, tuple[str, ...]]) -> dict[str, list[FrameScore]]:
    """Scored frames by method of one video.

    The grasp is chosen by the tracker in the first frame and given to all methods; with the object's quadrilateral
    given, it is put on two opposite sides of it.
    """
    case, methods = task
    with sequence_of(case) as (start, shown, begin):
        return score_sequence(shown, method_makers(methods, case.risk), start, begin)


@contextmanager
def sequence_of(case: RealCase) -> Iterator[tuple[MethodStart, Iterator[MethodFrame], int]]:
    """What all methods are told of a video, its frames from the first that its table lists on, and the number of that.

    Frames are numbered as they are shown: number n is frame n of the video where all are, else the n-th of every so many.
    """
    if not case.table.is_file():
        raise InputError(f'no video of this name with a table of homographies lies in "{case.video.parent}"')
    with open_source(case.video) as source:
        begin = first_frame(case.homographies(), case.known)
        frames = islice(source, begin, None, case.every)
        first = next(frames, None)
        if first is None:
            raise InputError(f'"{case.video}" ends before frame {begin}, the first of its table', path=str(case.video))
        height, width = first.image.shape[:2]
        truths = case.truths((width, height))
        start = _make_start(case, first, truths)
        every_frame = (MethodFrame(f.image, f.time, truths.of(f.index)) for f in chain([first], frames))
        yield start, every_frame, begin // case.every


def _make_start(case: RealCase, first: Frame, truths: Truths) -> MethodStart:
    height, width = first.image.shape[:2]
    size = width, height
    pixel = None if case.known is None or case.given == "nothing" else case.known.object_at
    if truths.quad is not None and case.given in ON_QUAD:
        by_hand = case.given == "outline"
        return MethodStart(side_contacts(truths.quad), (truths.quad,), size, None if by_hand else pixel, by_hand)
    chosen = GraspTracker(fingers=case.fingers, friction=case.friction, object_at=pixel).update(first.image)
    if chosen.view is None:
        raise GraspError(f'"{case.video}", first frame: {chosen.reason}')
    outline = tuple(np.asarray(c.points) for c in chosen.view.contours)
    if truths.quad is None:
        area = chosen.view.outer.area - sum(c.area for c in chosen.view.contours[1:])
        truths.without_quad(area, outline[0].mean(axis=0))
    elif another := another_object(outline, truths.quad, size):
        raise GraspError(another)
    if chosen.contacts is None:
        raise GraspError(f'"{case.video}", first frame: {chosen.reason}')
    return MethodStart(chosen.contacts, outline, size, pixel)
