# SPDX-License-Identifier: Apache-2.0
"""What a person may tell a session, each as a dataclass; and the one place where a message of the page becomes one.

A message is a JSON object: "do" names the command, the other keys are its fields. Everything is checked here, so that a
session never meets what is no number, or too many of them. Places are px, the centre of the top-left pixel at (0, 0), x
right, y down.
"""

from __future__ import annotations

import json
import math
from dataclasses import MISSING, dataclass, fields
from typing import Any, Literal, get_args, get_type_hints

from grasptrack.errors import InputError
from grasptrack.grasp.contacts import MOST_CONTACTS
from grasptrack.live.inbox import FASTEST, SLOWEST
from grasptrack.servo.goal import Goal

LARGEST = 1 << 16
"""Bytes of a message; an outline of 1,000 points has some 20,000."""
FARTHEST = 1e6
"""px; no image is so large."""
MOST_POINTS = 4096
LARGEST_NUMBER = 1 << 53
"""JavaScript has no larger whole numbers without gaps."""

Point = tuple[float, float]
Points = tuple[Point, ...]


@dataclass(frozen=True)
class Pick:
    """A pixel on the object, or beside it; `image` is the number of the image that was shown."""

    image: int
    x: float
    y: float
    on: bool = True


@dataclass(frozen=True)
class Box:
    """A rectangle round the object: left, top, width and height."""

    image: int
    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Contacts:
    """Where the fingers shall touch; each is moved to the outline."""

    image: int
    points: Points


@dataclass(frozen=True)
class Outline:
    """A rough polygon round the object, such as a live wire."""

    image: int
    points: Points


@dataclass(frozen=True)
class Choose:
    """One of the numbered candidates, or parts, from 1."""

    number: int


@dataclass(frozen=True)
class Start:
    """Follow what is proposed."""


@dataclass(frozen=True)
class Pause:
    """Stop at an image, or go on."""

    paused: bool


@dataclass(frozen=True)
class Forward:
    """One more image, while paused."""


@dataclass(frozen=True)
class Tempo:
    """A file is played so many times as fast as its times say."""

    factor: float


@dataclass(frozen=True)
class Restart:
    """Play a file from its start, or begin anew with a camera's newest image, with what was said of the object."""


@dataclass(frozen=True)
class Rechoose:
    """Forget the object and choose in the newest image."""


@dataclass(frozen=True)
class Friction:
    """Coulomb coefficient, from the next image on."""

    value: float


@dataclass(frozen=True)
class Fingers:
    """Number of fingers: another grasp on the same object."""

    count: int


@dataclass(frozen=True)
class Wire:
    """A step of a live wire; `point` counts the clicks from 0 and is for "move"; the first "add" begins it."""

    image: int
    step: Literal["add", "hover", "close", "move", "back", "clear"]
    x: float = 0.0
    y: float = 0.0
    point: int = 0


@dataclass(frozen=True)
class Hover:
    """Where the pointer is, for a segmenter that is asked by points."""

    image: int
    x: float
    y: float


@dataclass(frozen=True)
class Fingertips:
    """Where the image shows the fingertips of the open gripper, with m between the first two, and m past the contacts."""

    points: Points
    opening_m: float
    beyond_m: float = 0.0
    symmetric: bool = True

    def servo_goal(self) -> Goal:
        """The servo's goal."""
        return Goal.fingertips(self.points, self.opening_m, beyond_m=self.beyond_m, symmetric=self.symmetric)


@dataclass(frozen=True)
class Record:
    """Begin a recording, or end it."""

    on: bool


@dataclass(frozen=True)
class Teach:
    """This is how it shall look: the contacts as they are seen now become the servo's goal."""


@dataclass(frozen=True)
class Anew:
    """A new approach of the servo."""


@dataclass(frozen=True)
class Press:
    """Begin to hold the servo's button."""


@dataclass(frozen=True)
class Keep:
    """It is held still: the answer to the question of a number."""

    number: int


@dataclass(frozen=True)
class Release:
    """It is held no more, and why."""

    why: Literal["released", "blur", "hidden"]


HoldCommand = Press | Keep | Release
Command = (
    Pick | Box | Contacts | Outline | Choose | Start | Pause | Forward | Tempo | Restart | Rechoose | Friction | Fingers | Wire
    | Hover | Fingertips | Record | Teach | Anew
)  # fmt: skip
COMMANDS: dict[str, type[Any]] = {kind.__name__.lower(): kind for kind in get_args(Command)}
HOLD_COMMANDS: dict[str, type[Any]] = {kind.__name__.lower(): kind for kind in get_args(HoldCommand)}


def parse_message(text: str | bytes) -> dict[str, Any]:
    """The JSON object of a message."""
    if len(text) > LARGEST:
        raise InputError(f"a message has at most {LARGEST} bytes, not {len(text)}")
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise InputError('a message is a JSON object, such as {"do": "start"}')
    return content


def command_of(content: dict[str, Any]) -> Command:
    """The command that a message gives."""
    command: Command = _make_command(content, COMMANDS)
    _check_ranges(command)
    return command


def hold_command_of(content: dict[str, Any]) -> HoldCommand:
    """The same, of the servo's button."""
    command: HoldCommand = _make_command(content, HOLD_COMMANDS)
    return command


def _make_command(content: dict[str, Any], commands: dict[str, type[Any]]) -> Any:
    name = content.get("do")
    kind = commands.get(name) if isinstance(name, str) else None
    if kind is None:
        raise InputError(f"unknown command {_short_json(name)}; there are {', '.join(commands)}")
    told = {key: value for key, value in content.items() if key != "do"}
    types, known = get_type_hints(kind), {field.name: field for field in fields(kind)}
    for key in told:
        if key not in known:
            raise InputError(f'"{name}" has no {_short_json(key)}; it has {", ".join(known) or "nothing"}')
    missing = [key for key, field in known.items() if field.default is MISSING and key not in told]
    if missing:
        raise InputError(f'"{name}" lacks {", ".join(missing)}')
    return kind(**{key: _parse_value(value, types[key], f"{name}.{key}") for key, value in told.items()})


def _check_ranges(command: Command) -> None:
    if isinstance(command, (Contacts, Fingertips)) and not 2 <= len(command.points) <= MOST_CONTACTS:
        raise InputError(f"contacts and fingertips are 2 to {MOST_CONTACTS} points, not {len(command.points)}")
    if isinstance(command, Outline) and len(command.points) < 3:
        raise InputError(f"an outline has three points or more, not {len(command.points)}")
    if isinstance(command, Friction) and not command.value > 0.0:
        raise InputError(f"friction is a positive number, not {command.value:g}")
    if isinstance(command, Tempo) and not SLOWEST <= command.factor <= FASTEST:
        raise InputError(f"a file is played {SLOWEST:g} to {FASTEST:g} times as fast, not {command.factor:g}")
    if isinstance(command, Fingers) and command.count not in (2, 3):
        raise InputError(f"grasps are chosen for 2 or 3 fingers, not {command.count}")
    if isinstance(command, Choose) and command.number < 1:
        raise InputError(f"candidates and parts are numbered from 1, not {command.number}")


def _parse_value(value: Any, wanted: Any, name: str) -> Any:
    """A value of a field's type."""
    if wanted is bool:
        if not isinstance(value, bool):
            raise InputError(f"{name} is true or false, not {_short_json(value)}")
        return value
    if wanted is int:
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < LARGEST_NUMBER:
            raise InputError(f"{name} is a whole number from 0, not {_short_json(value)}")
        return value
    if wanted is float:
        return _parse_number(value, name)
    if wanted == Points:
        return _parse_points(value, name)
    choices = get_args(wanted)
    if value not in choices or not isinstance(value, str):
        raise InputError(f"{name} is one of {', '.join(choices)}, not {_short_json(value)}")
    return value


def _parse_number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= FARTHEST:
        raise InputError(f"{name} is a number between -1e6 and 1e6, not {_short_json(value)}")
    return float(value)


def _parse_points(value: Any, name: str) -> Points:
    if not isinstance(value, list) or len(value) > MOST_POINTS:
        raise InputError(f"{name} is a list of at most {MOST_POINTS} points [x, y], not {_short_json(value)}")
    out = []
    for point in value:
        if not isinstance(point, list) or len(point) != 2:
            raise InputError(f"{name} is a list of points [x, y], not {_short_json(point)}")
        out.append((_parse_number(point[0], name), _parse_number(point[1], name)))
    return tuple(out)


def _short_json(value: Any) -> str:
    """A value in a few characters, on one line."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    try:
        text = json.dumps(value)
    except (TypeError, ValueError, RecursionError):
        text = type(value).__name__
    return text if len(text) <= 40 else text[:37] + "..."
