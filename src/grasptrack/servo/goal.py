# SPDX-License-Identifier: Apache-2.0
"""Where the contacts should be, seen from the hand: taught by a view in which it was right, or given by the fingertips.

Both are rays of the camera. What makes points of them is a length in m across the approach direction: between fingertips it is
the opening, between contacts what the hand's own moves have told.
"""

from __future__ import annotations

import itertools
import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from grasptrack import arguments
from grasptrack.equality import compared_by_value
from grasptrack.errors import InputError
from grasptrack.files import read_json, read_text, write_file
from grasptrack.servo.camera import HandCamera, align_rigid
from grasptrack.servo.features import MIN_DISTANCE_PX, rms_diameter
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats

MAX_OPENING = 1.0
"""m; what opens wider is no gripper on an arm, and 1 mm is below what any opens: lengths in mm are told apart by it."""
FILE_FORMAT = 1
"""Of a goal's file; raised when a key changes its meaning or goes away."""
MAX_FILE_BYTES = 1 << 16
"""Bytes of a goal's file; none that this writes has nearly as many."""
ALIKE_MISFIT = 1.15
"""Orders of the fingers that leave up to so many times the least misfit fit alike."""


@compared_by_value
@arguments.checked(
    kind=arguments.text,
    opening=arguments.optional(arguments.finite),
    beyond=arguments.finite,
    symmetric=arguments.truth,
)
@dataclass(frozen=True)
class Goal:
    """A goal of the servo. Make one by `Goal.fingertips` or `Goal.taught`.

    Attributes:
        kind: "fingertips" or "taught".
        points: (k, 2) px.
        opening: m between the first two fingertips; None where taught.
        beyond: m by which the fingertips reach past the contacts, along the approach direction.
        symmetric: whether fingers can take each other's places.
    """

    kind: Literal["fingertips", "taught"]
    points: Floats
    opening: float | None = None
    beyond: float = 0.0
    symmetric: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _check_points(self.points))

    def __repr__(self) -> str:
        return f"Goal({self.kind}, {' '.join(f'{x:.2f},{y:.2f}' for x, y in self.points.tolist())})"

    @classmethod
    @arguments.checked(arguments.number, points_px=arguments.array(unbounded=True), symmetric=arguments.truth)
    def fingertips(
        cls, points_px: ArrayLike, opening_m: float, *, beyond_m: float = 0.0, symmetric: bool = True
    ) -> Goal:
        """The contacts shall come to lie between the fingertips of the open gripper, midway, at their depth.

        Args:
            points_px: (k, 2) px, where the image shows the fingertips, in px of images as the tracker gets them.
            opening_m: m between the first two.
            beyond_m: m by which the fingertips shall reach past the contacts, as far as they are to overlap the sides.
            symmetric: whether fingers can take each other's places, which saves large turns.

        Raises:
            InputError: not (k, 2), fewer than two, not finite, not apart, or an opening that is not positive or wider than 1 m.
        """
        if not (np.isfinite(opening_m) and opening_m > 0.0):
            raise InputError(f"an opening is positive, in m, not {opening_m}", opening=opening_m)
        if opening_m > MAX_OPENING:
            raise InputError(
                f"an opening is in m: {opening_m:g} m is no gripper's ({opening_m / 1000.0:g}, if mm were meant)",
                opening=opening_m,
            )
        if not np.isfinite(beyond_m):
            raise InputError("beyond_m is a finite number of m", beyond=beyond_m)
        return cls("fingertips", _check_points(points_px), float(opening_m), float(beyond_m), symmetric)

    @classmethod
    @arguments.checked(symmetric=arguments.truth)
    def taught(cls, result: TrackResult | ArrayLike, *, symmetric: bool = True) -> Goal:
        """The contacts shall be seen as they were in a view in which the hand was right.

        Args:
            result: what the tracker said of that view, or its contacts (k, 2) px.
            symmetric: whether two fingers can change places.

        Raises:
            InputError: a result without contacts, or contacts that are none.
        """
        points = result.contacts if isinstance(result, TrackResult) else result
        if points is None:
            raise InputError("the view that is to teach the goal shows no contacts")
        return cls("taught", _check_points(points), symmetric=symmetric)

    @arguments.checked(path=arguments.instance(str, os.PathLike))
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the goal to a JSON file, as `Goal.load` reads it; a file of that name is replaced.

        Keys: format, kind ("fingertips" or "taught"), points_px ((k, 2) px, the centre of the top-left pixel at (0, 0), x
        right, y down), opening_m (m between the first two fingertips, null where taught), beyond_m (m), symmetric.

        Raises:
            InputError: it cannot be written.
        """
        content = {
            "format": FILE_FORMAT,
            "kind": self.kind,
            "points_px": self.points.tolist(),
            "opening_m": self.opening,
            "beyond_m": self.beyond,
            "symmetric": self.symmetric,
        }
        write_file(Path(path), json.dumps(content, indent=2) + "\n", "goal")

    @classmethod
    @arguments.checked(path=arguments.instance(str, os.PathLike))
    def load(cls, path: str | os.PathLike[str]) -> Goal:
        """A goal from a file that `Goal.save` or the live page wrote; keys and units as there.

        Raises:
            InputError: the file cannot be read, or what it holds is no goal. The message names the file.
        """
        file = Path(path)
        try:
            return cls._from_content(read_json(read_text(file, "goal", MAX_FILE_BYTES)))
        except InputError as error:
            raise InputError(f'goal "{file}": {error}', **error.values, path=str(file)) from None

    @classmethod
    def _from_content(cls, content: dict[str, Any]) -> Goal:
        """The goal that a file holds, or an InputError."""
        known = ("format", "kind", "points_px", "opening_m", "beyond_m", "symmetric")
        unknown = [key for key in content if key not in known]
        if unknown:
            raise InputError(f'has a key "{unknown[0]}", of which a goal knows nothing; it has {", ".join(known)}')
        if content.get("format") != FILE_FORMAT:
            raise InputError(f"has the format {content.get('format')!r}, not {FILE_FORMAT}")
        kind, points, symmetric = content.get("kind"), content.get("points_px"), content.get("symmetric", True)
        if not isinstance(points, list) or not isinstance(symmetric, bool):
            raise InputError("has points_px, a list of x, y in px, and symmetric, true or false")
        if kind == "taught":
            return cls.taught(points, symmetric=symmetric)
        if kind != "fingertips":
            raise InputError(f'is of the kind "fingertips" or "taught", not {kind!r}')
        opening: Any = content.get("opening_m")
        beyond = content.get("beyond_m", 0.0)
        for name, value in (("opening_m", opening), ("beyond_m", beyond)):
            if arguments.number(value):
                raise InputError(f"has {name}, a number of m, not {value!r}")
        return cls.fingertips(points, opening, beyond_m=beyond, symmetric=symmetric)

    def targets(self, camera: HandCamera, shape: Floats, order: tuple[int, ...]) -> Floats:
        """Contacts (k, 3) m in the hand's frame when it is right, in the order of the contacts.

        Args:
            camera: the camera on the hand.
            shape: (k, 2) m, the contacts in their plane, in any place and turn.
            order: the finger of each contact.
        """
        length = self.opening or math.dist(shape[0].tolist(), shape[1].tolist())
        tips = self._points_in_hand(camera, length)[list(order)]
        out = np.empty((len(order), 3))
        out[:, :2], out[:, 2] = align_rigid(shape, tips)[0], tips[:, 2].sum() / len(tips) - self.beyond
        return out

    def orders(self, camera: HandCamera, contacts: Floats) -> list[tuple[int, ...]]:
        """Fingers for contacts (k, 3) m in the hand's frame: those that fit, the one that asks for the least turn first."""
        k = len(self.points)
        every = [tuple(range(k))]
        if self.symmetric and (k == 2 or self.kind == "fingertips"):
            every = list(itertools.permutations(range(k)))
        tips = self._points_in_hand(camera, self.opening or float(np.linalg.norm(contacts[0] - contacts[1])))
        fits = []
        for order in every:
            there, turn = align_rigid(contacts[:, :2], tips[list(order), :2])
            fits.append((float(np.sqrt(((there - tips[list(order), :2]) ** 2).sum(axis=1).mean())), abs(turn), order))
        most = ALIKE_MISFIT * min(f[0] for f in fits) + MIN_DISTANCE_PX
        return [order for _, order in sorted((turn, order) for misfit, turn, order in fits if misfit <= most)]

    def _points_in_hand(self, camera: HandCamera, length: float) -> Floats:
        """The points (k, 3) m in the hand's frame, all at one depth, the first two `length` apart."""
        rays = camera.ray_directions(self.points)
        flat = rays / rays[:, 2:]  # as they meet the plane at depth 1 before the camera, along the approach
        depth = length / max(math.dist(flat[0].tolist(), flat[1].tolist()), MIN_DISTANCE_PX)
        return np.asarray(camera.offset + depth * flat)


@arguments.checked(points=arguments.array(unbounded=True))
def _check_points(points: ArrayLike) -> Floats:
    given = np.asarray(points, dtype=np.float64)
    if given.ndim != 2 or given.shape[1:] != (2,) or len(given) < 2 or not np.isfinite(given).all():
        raise InputError("points of a goal are (k, 2) px, two or more", shape=given.shape)
    if rms_diameter(given) < MIN_DISTANCE_PX or float(np.linalg.norm(given[0] - given[1])) < MIN_DISTANCE_PX:
        raise InputError("points of a goal lie apart", points=given.tolist())
    return given
