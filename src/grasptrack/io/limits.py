# SPDX-License-Identifier: Apache-2.0
"""How large an image may be, told by its header, refused before memory is asked for; and how many are held at a time."""

from __future__ import annotations

import math
import os
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

from grasptrack.errors import InputError, SourceError

if TYPE_CHECKING:
    from numpy.typing import NDArray

DEFAULT_MEGAPIXELS = 100.0
"""10^6 px; the largest cameras give 150, those on a hand 20 at most."""
VARIABLE = "GRASPTRACK_MAX_MEGAPIXELS"
"""Environment variable that sets another limit, for all processes of an evaluation."""
HELD, HELD_BYTES = 32, 64 << 20
"""Images that are held for what comes after tracking, and what they may take in memory."""
_asked: ContextVar[float | None] = ContextVar("max_megapixels", default=None)


def limit_megapixels(most: float | None) -> None:
    """Set the limit of what is read from now on in this context; None takes the default.

    Args:
        most: 10^6 px of an image or of a frame of a video.

    Raises:
        InputError: not a number above 0.
    """
    _asked.set(None if most is None else _checked(most, "max_megapixels"))


def max_megapixels() -> float:
    """The limit, in 10^6 px.

    Raises:
        InputError: the environment variable holds no number above 0.
    """
    asked = _asked.get()
    if asked is not None:
        return asked
    text = os.environ.get(VARIABLE)
    return DEFAULT_MEGAPIXELS if not text else _checked(text, VARIABLE)


def check_size(width: int, height: int, name: str) -> None:
    """See that an image is not above the limit.

    Args:
        width, height: px, as its header says.
        name: of the image, for the message.

    Raises:
        SourceError: it is.
    """
    most = max_megapixels()
    if width * height > most * 1e6:
        raise SourceError(
            f"{name} is {width}x{height} px, {width * height / 1e6:.3g} megapixels; "
            f"at most {most:g} are read (--max-megapixels)",
            width=width,
            height=height,
            most=most,
        )


def most_held(image: NDArray[Any]) -> int:
    """How many images like this one may wait, or be kept, at a time: `HELD`, fewer of large ones, and 2 at least."""
    return max(2, min(HELD, HELD_BYTES // max(image.nbytes, 1)))


def _checked(value: float | str, name: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not 0.0 < number < math.inf:
        raise InputError(f"{name} must be a positive number of megapixels, not {value}", value=value)
    return number
