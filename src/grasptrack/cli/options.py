# SPDX-License-Identifier: Apache-2.0
"""Options that several verbs share, each checked once, before any work."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grasptrack.cli import help_groups
from grasptrack.errors import GraspError, InputError, StrategyError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grasptrack.grasp.hand import Hand


Fingers = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        rich_help_panel=help_groups.GRASP,
        help="Number of fingers.",
        show_default="2, or as many as --grasp has contacts",
    ),
]
TwoOrThree = Annotated[
    int, typer.Option(metavar="N", rich_help_panel=help_groups.GRASP, help="Number of fingers, 2 or 3.")
]
Friction = Annotated[
    float,
    typer.Option(
        metavar="MU",
        rich_help_panel=help_groups.GRASP,
        help="Coulomb friction coefficient between finger and object.",
    ),
]
GraspText = Annotated[
    str | None,
    typer.Option(
        metavar='"X,Y X,Y ..."',
        rich_help_panel=help_groups.GRASP,
        help="Contacts in the first image, in px; they also select the object.",
        show_default="synthesized",
    ),
]
StrategyName = Annotated[
    str,
    typer.Option(
        metavar="NAME", rich_help_panel=help_groups.GRASP, help="Strategy: auto, rrp, grasp-line or homography."
    ),
]
Resynthesize = Annotated[
    bool,
    typer.Option(
        "--resynthesize",
        rich_help_panel=help_groups.GRASP,
        help="Choose a new grasp when the current one is no longer stable.",
    ),
]
MinOpening = Annotated[
    str | None,
    typer.Option(metavar="L", rich_help_panel=help_groups.HAND, help="Smallest opening of the hand.", show_default="0"),
]
MaxOpening = Annotated[
    str | None,
    typer.Option(
        metavar="L", rich_help_panel=help_groups.HAND, help="Largest opening of the hand.", show_default="unlimited"
    ),
]
FingerWidth = Annotated[
    str | None,
    typer.Option(
        metavar="L",
        rich_help_panel=help_groups.HAND,
        help="Width of a finger, along the outline.",
        show_default="10%",
    ),
]
FingerThickness = Annotated[
    str | None,
    typer.Option(
        metavar="L",
        rich_help_panel=help_groups.HAND,
        help="Thickness of a finger, away from the outline.",
        show_default="10%",
    ),
]
Clearance = Annotated[
    str | None,
    typer.Option(
        metavar="L",
        rich_help_panel=help_groups.HAND,
        help="Gap between finger and object before closing.",
        show_default="3%",
    ),
]
Scale = Annotated[
    float | None,
    typer.Option(
        metavar="PX_PER_MM",
        rich_help_panel=help_groups.HAND,
        help="Image scale, in px per mm, for lengths in mm, cm, m or in.",
    ),
]
ObjectLength = Annotated[
    str | None,
    typer.Option(
        "--length",
        metavar="L",
        rich_help_panel=help_groups.OBJECT,
        help="Length of the object, the longer side of its smallest enclosing rectangle, in mm, cm, m or in: 120mm.",
    ),
]
FramesPerSecond = Annotated[
    float | None,
    typer.Option(
        "--fps",
        metavar="FPS",
        rich_help_panel=help_groups.SOURCE,
        help="Frame rate, in frames/s, for folders and globs, which have no times.",
    ),
]
Silhouettes = Annotated[
    str | None,
    typer.Option(
        metavar="DIR",
        rich_help_panel=help_groups.SCENE,
        help="Parts from silhouette images, black outside the part.",
    ),
]
Seed = Annotated[
    int, typer.Option(metavar="N", min=0, rich_help_panel=help_groups.SCENE, help="Seed of all that is random.")
]
OUTPUT = Path("grasptrack-out")
"""A verb that writes does so in the folder of its name within this one, unless it is told another."""
Output = Annotated[
    Path,
    typer.Option(
        metavar="DIR", rich_help_panel=help_groups.OUTPUT, help="Folder for the results; existing results are replaced."
    ),
]
NoVideo = Annotated[
    bool, typer.Option("--no-video", rich_help_panel=help_groups.OUTPUT, help="Do not write overlay.mp4.")
]
Json = Annotated[
    bool,
    typer.Option("--json", rich_help_panel=help_groups.OUTPUT, help="Print the JSON file instead of the table."),
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", rich_help_panel=help_groups.OUTPUT, help="Print nothing but errors.")
]
Risk = Annotated[
    float,
    typer.Option(
        metavar="P",
        rich_help_panel=help_groups.LIMITS,
        help="Accepted probability of a wrong answer, between 0 and 1.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        metavar="N", rich_help_panel=help_groups.PROCESSES, help="Number of processes.", show_default="one per core"
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler", metavar="ADDRESS", rich_help_panel=help_groups.PROCESSES, help="Address of a Dask scheduler."
    ),
]


def _limit_megapixels(most: float | None) -> float | None:
    from grasptrack.io.limits import limit_megapixels

    try:
        limit_megapixels(most)
    except InputError:
        raise InputError(f"--max-megapixels must be a positive number, not {most:g}", most=most) from None
    return most


MaxMegapixels = Annotated[
    float | None,
    typer.Option(
        "--max-megapixels",
        metavar="MP",
        callback=_limit_megapixels,
        rich_help_panel=help_groups.LIMITS,
        help="Largest image that is decoded, in 10^6 px; larger ones are refused.",
        show_default="100",
    ),
]


def strategy_choice(name: str) -> str:
    """The name of a strategy, or "auto".

    Raises:
        StrategyError: unknown; the message lists the choices.
    """
    from grasptrack.transfer import STRATEGIES, strategy_names

    if name in ("auto", *STRATEGIES):
        return name
    choices = ("auto", *strategy_names())
    if name not in choices:
        raise StrategyError(f'unknown strategy "{name}"; choose from {", ".join(choices)}', name=name)
    return name


def parse_names(text: str | None) -> tuple[str, ...]:
    """Names from "a,b"; none from None."""
    return () if text is None else tuple(part.strip() for part in text.split(",") if part.strip())


def one_of(option: str, text: str | None, choices: Sequence[str]) -> str | None:
    """A word from a few; None where none was given.

    Raises:
        InputError: another word.
    """
    if text is not None and text not in choices:
        raise InputError(f'{option} is {", ".join(choices[:-1])} or {choices[-1]}, not "{text}"', text=text)
    return text


def two_or_three(fingers: int) -> int:
    """The number of fingers, for grasps that are chosen.

    Raises:
        InputError: another number.
    """
    if fingers not in (2, 3):
        raise InputError(f"grasps are chosen for 2 or 3 fingers, not {fingers}", fingers=fingers)
    return fingers


def contacts_and_fingers(grasp: str | None, fingers: int | None) -> tuple[NDArray[np.float64] | None, int]:
    """Contacts (k, 2) px from --grasp, or None, and the number of fingers that go with them.

    Raises:
        GraspError: not contacts, fewer than two fingers, or --fingers and --grasp disagree.
    """
    if grasp is None:
        if fingers is not None and fingers < 2:
            raise GraspError(f"a grasp has at least 2 fingers, not {fingers}", fingers=fingers)
        return None, fingers or 2
    from grasptrack.grasp.contacts import parse_contacts

    contacts = parse_contacts(grasp)
    if fingers is not None and fingers != len(contacts):
        raise GraspError(f"--grasp has {len(contacts)} contacts, but --fingers says {fingers}", fingers=fingers)
    return contacts, len(contacts)


def hand_lengths(*lengths: str | None) -> dict[str, str | None]:
    """Openings, finger's width, thickness and clearance as the user wrote them, by the attributes of Hand."""
    names = ("min_opening", "max_opening", "finger_width", "finger_thickness", "clearance")
    return dict(zip(names, lengths, strict=True))


def build_hand(scale: float | None, **lengths: str | None) -> Hand:
    """The hand from the options that were given.

    Args:
        scale: px per mm.
        **lengths: attributes of Hand as the user wrote them; None leaves the default.

    Raises:
        InputError: no length, mm or inches without a scale, or lengths that contradict each other.
    """
    from grasptrack.grasp.hand import Hand, parse_length

    if scale is not None and not 0.0 < scale < math.inf:
        raise InputError(f"--scale must be a positive number of px per mm, not {scale:g}", scale=scale)
    given = {}
    for name, text in lengths.items():
        if text is None:
            continue
        option = "--" + name.replace("_", "-")
        given[name] = parse_length(text, option)
        if given[name].unit not in ("px", "size") and scale is None:
            raise InputError(f"{option} {text} needs --scale, the px per mm of the image", name=name)
    return Hand(**given, px_per_mm=scale)


def hand_for_first(
    scale: float | None, lengths: dict[str, str | None], grasp: str | None, resynthesize: bool
) -> Hand | None:
    """The hand for the grasp of the first image, or None where nothing was said of one.

    Raises:
        InputError: as in `build_hand`; or contacts given, for which nothing is ever chosen.
    """
    named = [("--" + name.replace("_", "-")) for name, text in {**lengths, "scale": scale}.items() if text is not None]
    if not named:
        return None
    if grasp is not None and not resynthesize:
        raise InputError(f"{named[0]} is for choosing a grasp, but --grasp gives one: leave out one of them")
    return build_hand(scale, **lengths)


def positive_friction(friction: float) -> float:
    """The coefficient of friction.

    Raises:
        InputError: not positive and finite.
    """
    if not (0.0 < friction < math.inf):
        raise InputError(f"--friction must be a positive number, not {friction:g}", friction=friction)
    return friction


def risk_rate(risk: float) -> float:
    """The probability below which an answer may be wrong.

    Raises:
        InputError: not between 0 and 1.
    """
    from grasptrack.tracking.numbers import check_risk

    return check_risk(risk, "--risk")
