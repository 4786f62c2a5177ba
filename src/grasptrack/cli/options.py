# SPDX-License-Identifier: Apache-2.0
"""Options that several verbs share, each checked once, here, before any work."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from grasptrack.errors import GraspError, InputError, StrategyError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Fingers = Annotated[
    int | None,
    typer.Option(metavar="K", help="Fingers of the hand, 2 unless --grasp says otherwise.", show_default=False),
]
Friction = Annotated[float, typer.Option(metavar="MU", help="Coulomb friction between finger and object.")]
GraspText = Annotated[
    str | None,
    typer.Option(
        metavar='"X1,Y1 X2,Y2"', help="Contacts in the first image, px, in place of synthesis; they choose the object."
    ),
]
IgnorePath = Annotated[
    str | None,
    typer.Option(
        metavar="MASK", help="Image that is not black where nothing belongs to the scene, as the hand's own fingers."
    ),
]
NoVideo = Annotated[bool, typer.Option("--no-video", help="Write no overlay.mp4.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors.")]


def strategy_choice(name: str) -> str:
    """The name of a strategy, or "auto".

    Raises:
        StrategyError: unknown; the message lists the choices.
    """
    from grasptrack.transfer import STRATEGIES

    choices = ("auto", *STRATEGIES)
    if name not in choices:
        raise StrategyError(f'unknown strategy "{name}"; choose from {", ".join(choices)}', name=name)
    return name


def contacts_and_fingers(grasp: str | None, fingers: int | None) -> tuple[NDArray[np.float64] | None, int]:
    """Contacts (k, 2) px from --grasp, or None, and the number of fingers that go with them.

    Raises:
        GraspError: not contacts, fewer than two fingers, or --fingers and --grasp disagree.
    """
    if grasp is None:
        if fingers is not None and fingers < 2:
            raise GraspError(f"a grasp has at least 2 fingers, not {fingers}", fingers=fingers)
        return None, fingers or 2
    from grasptrack.grasp import parse_contacts

    contacts = parse_contacts(grasp)
    if fingers is not None and fingers != len(contacts):
        raise GraspError(f"--grasp has {len(contacts)} contacts, but --fingers says {fingers}", fingers=fingers)
    return contacts, len(contacts)


def point(text: str | None, option: str) -> tuple[float, float] | None:
    """A pixel from "x,y".

    Raises:
        InputError: anything else.
    """
    if text is None:
        return None
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f'{option} is a pixel written x,y, not "{text}"', text=text)
    return x, y


def positive_friction(friction: float) -> float:
    """The coefficient of friction.

    Raises:
        InputError: not positive and finite.
    """
    if not (0.0 < friction < math.inf):
        raise InputError(f"--friction must be a positive number, not {friction:g}", friction=friction)
    return friction


def ignore_mask(path: str | None) -> NDArray[Any] | None:
    """The mask of what never belongs to a scene, (H, W), or None.

    Raises:
        SourceError: it cannot be read.
    """
    if path is None:
        return None
    from grasptrack.io.masks import read_mask

    return read_mask(path)
