# SPDX-License-Identifier: Apache-2.0
"""The hand, how far it opens and how large its fingers are, in px, in mm, or as shares of the object; lengths as written."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

from grasptrack import arguments
from grasptrack.errors import InputError

Unit = Literal["px", "mm", "cm", "m", "in", "inch", "size"]
_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "inch": 25.4}
_NUMBER = r"\s*([0-9]*\.?[0-9]+)\s*"


class Length(NamedTuple):
    """A length in one of its units.

    Attributes:
        value: how many of them.
        unit: "px"; "mm", "cm", "m", "in" or "inch", for which a scale is needed; or "size", shares of the object's sqrt(area).
    """

    value: float
    unit: Unit = "px"

    @arguments.checked(size=arguments.number, px_per_mm=arguments.optional(arguments.number))
    def in_px(self, size: float, px_per_mm: float | None) -> float:
        """The length in px on an object of sqrt(area) = size px.

        Raises:
            InputError: in mm or another unit of the world where nobody said how large a mm is.
        """
        if self.unit == "px" or self.value in (0.0, math.inf):
            return self.value
        if self.unit == "size":
            return self.value * size
        if px_per_mm is None:
            raise InputError(f"{self.value:g} {self.unit} needs the scale of the image in px per mm", value=self.value)
        return self.value * _MM[self.unit] * px_per_mm


def _check_length(self: Length, value: float, unit: Unit = "px") -> None:
    wanted = arguments.number(value)
    if wanted:
        raise InputError(f"value must be {wanted}, not {value!r}", value=value)
    if not isinstance(unit, str) or unit not in get_args(Unit):
        raise InputError(f"unit must be one of {', '.join(get_args(Unit))}, not {unit!r}", unit=unit)


setattr(Length, "__init__", _check_length)  # noqa: B010  a named tuple takes none in its body


FINGER = Length(0.1, "size")
"""Width and thickness of a finger of which nothing is known."""
CLEARANCE = Length(0.03, "size")
"""Clearance of a finger of which nothing is known."""


def parse_length(text: str, name: str) -> Length:
    """A length from "120", "120px", "40mm", "4cm", "0.04m", "1.6in", "1.6inch" or "30%", a share of the object's sqrt(area)."""
    match = re.fullmatch(_NUMBER + r"(px|mm|cm|m|in|inch|%)?\s*", text)
    value = float(match[1]) if match else math.nan
    if match is None or not value > 0.0:
        raise InputError(
            f'{name} is a length such as 120px, 40mm or 30% of the object\'s size, not "{text}"', text=text
        )
    if match[2] == "%":
        return Length(value / 100.0, "size")
    return Length(value, match[2] or "px")  # type: ignore[arg-type]


class Measure(NamedTuple):
    """A length of the world, in "mm", "cm", "m" or "in"."""

    value: float
    unit: Literal["mm", "cm", "m", "in"]


def parse_measure(text: str, name: str) -> Measure:
    """A length of the world from "120mm", "12 cm", "0.12m" or "4.7in"."""
    match = re.fullmatch(_NUMBER + r"(mm|cm|m|in)\s*", text)
    value = float(match[1]) if match else math.nan
    if match is None or not value > 0.0:
        raise InputError(f'{name} is a length such as 120mm, 12cm, 0.12m or 4.7in, not "{text}"', text=text)
    return Measure(value, match[2])  # type: ignore[arg-type]


class HandPx(NamedTuple):
    """A hand on one object: every length in px, as in Hand."""

    min_opening: float
    max_opening: float
    finger_width: float
    finger_thickness: float
    clearance: float


@arguments.checked(px_per_mm=arguments.optional(arguments.number))
@dataclass(frozen=True)
class Hand:
    """Limits of a gripper whose fingers come down beside the object, or into a hole, and then close or spread.

    In the image each finger is a rectangle: `finger_width` along the outline, `finger_thickness` away from it. Before
    it moves it stands `clearance` farther back, and all of this must be free.

    Each length is px, a Length, or such a length as it is written: "85mm", "1.6in", "30%" (`parse_length`).

    Args:
        min_opening: least distance of opposite contacts.
        max_opening: largest distance of opposite contacts.
        finger_width: of the pad that touches, along the outline.
        finger_thickness: of a finger, in the direction in which it moves.
        clearance: of each finger before it closes or spreads.
        px_per_mm: scale of the image, for lengths in mm and other units of the world.

    Raises:
        InputError: a length that is negative, not a number or no length, a finger without width, openings that contradict each
            other, or a scale that is not positive.
    """

    min_opening: Length | float | str = 0.0
    max_opening: Length | float | str = math.inf
    finger_width: Length | float | str = FINGER
    finger_thickness: Length | float | str = FINGER
    clearance: Length | float | str = CLEARANCE
    px_per_mm: float | None = None

    def __post_init__(self) -> None:
        for name in ("min_opening", "max_opening", "finger_width", "finger_thickness", "clearance"):
            given = getattr(self, name)
            length = checked_length(given, name)
            if isinstance(given, str):
                object.__setattr__(self, name, length)
            value = length.value
            if not value >= 0.0 or (name == "finger_width" and not 0.0 < value < math.inf):
                raise InputError(f"{name} must be a positive length, not {value:g}", name=name, value=value)
            if name in ("finger_thickness", "clearance") and not math.isfinite(value):
                raise InputError(f"{name} must be a finite length", name=name)
            if arguments.LARGEST <= value < math.inf:
                raise InputError(f"{name} must be a length below {arguments.LARGEST:g}, not {value:g}", name=name)
        if self.px_per_mm is not None and not 0.0 < self.px_per_mm < arguments.LARGEST:
            raise InputError(f"the scale must be a positive number of px per mm, not {self.px_per_mm}")

    @arguments.checked(size=arguments.number)
    def in_px(self, size: float) -> HandPx:
        """The hand on an object of sqrt(area) = size px.

        Raises:
            InputError: mm without a scale; a least opening above the largest.
        """
        lengths = [self.min_opening, self.max_opening, self.finger_width, self.finger_thickness, self.clearance]
        hand = HandPx(*(as_length(each).in_px(size, self.px_per_mm) for each in lengths))
        if hand.min_opening > hand.max_opening:
            raise InputError(
                f"the least opening of {hand.min_opening:.0f} px is above the largest, {hand.max_opening:.0f} px",
                min_opening=hand.min_opening,
                max_opening=hand.max_opening,
            )
        return hand


def checked_length(given: Length | float | str, name: str) -> Length:
    """A length as users give it to a parameter of this name."""
    if isinstance(given, str):
        return parse_length(given, name)
    wanted = "" if isinstance(given, Length) else arguments.number(given)
    if wanted:
        raise InputError(f'{name} must be {wanted} of px, a Length or a text such as "85mm", not {given!r}', name=name)
    return as_length(given)


def as_length(value: Length | float | str) -> Length:
    """A bare number counts px; a hand has read its texts."""
    if isinstance(value, str):
        return parse_length(value, "length")
    return value if isinstance(value, Length) else Length(value)
