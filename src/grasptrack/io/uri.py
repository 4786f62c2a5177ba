# SPDX-License-Identifier: Apache-2.0
"""Names of sources as users write them: ``kind:where?name=value&name=value``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple
from urllib.parse import parse_qsl

from grasptrack.errors import SourceError

PATIENCE = 10.0
"""s without an image, after which a live source is given up; the setting `wait` says otherwise."""


class Address(NamedTuple):
    """A source's name in its parts.

    Attributes:
        spec: the whole, for messages.
        where: between the kind and the question mark.
        settings: what follows it, and on top of it what was given apart from the name.
    """

    spec: str
    where: str
    settings: dict[str, str]


def parse_address(spec: str, settings: Mapping[str, str] | None = None) -> Address:
    """Take a name apart.

    Raises:
        SourceError: after the question mark there is something that is not NAME=VALUE.
    """
    where, mark, query = spec.partition(":")[2].partition("?")
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True) if mark else []
    except ValueError:
        raise SourceError(f'"{spec}": after the question mark come NAME=VALUE, joined by &', spec=spec) from None
    return Address(spec, where, {**dict(pairs), **dict(settings or {})})


def take_patience(settings: dict[str, str]) -> float:
    """Take the setting `wait` out of the others, in s.

    Raises:
        SourceError: it is no positive number.
    """
    return take_number(settings, "wait", PATIENCE)


def take_number(settings: dict[str, str], name: str, otherwise: float) -> float:
    """Take a setting that is a positive number out of the others.

    Raises:
        SourceError: it is none.
    """
    text = settings.pop(name, None)
    if text is None:
        return otherwise
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise SourceError(f"the setting {name} is a positive number, not {text!r}", name=name)
    return value


def take_size(settings: dict[str, str]) -> tuple[int, int] | None:
    """Take the setting `size`, as 1280x720, out of the others: width and height in px.

    Raises:
        SourceError: it is written otherwise.
    """
    text = settings.pop("size", None)
    if text is None:
        return None
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise SourceError(f"the setting size is WIDTHxHEIGHT, as 1280x720, not {text!r}", size=text)
    return int(width), int(height)
