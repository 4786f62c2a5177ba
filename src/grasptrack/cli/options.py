# SPDX-License-Identifier: Apache-2.0
"""Options that several verbs share, alone and in groups, each checked once, before any work."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from grasptrack.cli.help_groups import (
    GRASP,
    HAND,
    LIMITS,
    OBJECT,
    OUTPUT,
    SOURCE,
    open_until_end,
    option,
    option_or,
)
from grasptrack.cli.terminal import tell_line
from grasptrack.errors import GraspError, InputError

if TYPE_CHECKING:
    from grasptrack.grasp.hand import Hand, Length
    from grasptrack.io.publishing import ResultPublisher
    from grasptrack.io.recording import Recording
    from grasptrack.typing import Floats


def _limit_megapixels(most: float | None) -> float | None:
    from grasptrack.io.limits import limit_megapixels

    try:
        limit_megapixels(most)
    except InputError:
        raise InputError(f"--max-megapixels must be a positive number, not {most:g}", most=most) from None
    return most


def _positive_friction(friction: float) -> float:
    if not (0.0 < friction < math.inf):
        raise InputError(f"--friction must be a positive number, not {friction:g}", friction=friction)
    return friction


def _risk_rate(risk: float) -> float:
    from grasptrack.tracking.numbers import check_risk

    return check_risk(risk, "--risk")


def _search_work(ms: float | None) -> float | None:
    from grasptrack.tracking.redetection import check_search_ms

    return check_search_ms(ms, "--search-ms")


def _two_or_three(fingers: int) -> int:
    if fingers not in (2, 3):
        raise InputError(f"--fingers: grasps are chosen for 2 or 3 fingers, not {fingers}", fingers=fingers)
    return fingers


def _strategy_choice(name: str) -> str:
    from grasptrack.transfer import check_strategy

    return check_strategy(name)


Friction = Annotated[
    float, option(GRASP, "MU", "Coulomb friction coefficient between finger and object.", callback=_positive_friction)
]
TwoOrThree = Annotated[int, option(GRASP, "N", "Number of fingers, 2 or 3.", callback=_two_or_three)]
OUTPUT_FOLDER = Path("grasptrack-out")
"""A verb that writes does so in the folder of its name within this one, unless it is told another."""
Output = Annotated[Path, option(OUTPUT, "DIR", "Folder for the results; existing results are replaced.")]
Publish = Annotated[
    str | None,
    option(
        OUTPUT,
        "ADDRESS",
        "Send a line for every frame to whoever connects to tcp:// or ws://HOST:PORT: JSON, or with ?format=fixed columns; "
        "modbus://HOST:PORT has registers.",
    ),
]
NoVideo = Annotated[bool, option(OUTPUT, None, "Do not write overlay.mp4.", "--no-video")]
Json = Annotated[bool, option(OUTPUT, None, "Print the JSON file instead of the table.", "--json")]
Quiet = Annotated[bool, option(OUTPUT, None, "Print nothing but errors.", "--quiet", "-q")]
Risk = Annotated[
    float, option(LIMITS, "P", "Accepted probability of a wrong answer, between 0 and 1.", callback=_risk_rate)
]
MaxMegapixels = Annotated[
    float | None,
    option(
        LIMITS,
        "MP",
        "Largest image that is decoded, in 10^6 px; larger ones are refused.",
        callback=_limit_megapixels,
        show_default="100",
    ),
]


@dataclass(frozen=True)
class GivenGrasp:
    """The grasp of a first image: given, or to be chosen for a number of fingers."""

    strategy: str = "auto"
    fingers: int | None = option_or(
        None, GRASP, "N", "Number of fingers.", show_default="2, or as many as --grasp has contacts"
    )
    friction: Friction = 0.5
    grasp: str | None = option_or(
        None,
        GRASP,
        '"X,Y X,Y ..."',
        "Contacts in the first image, in px; they also select the object.",
        show_default="synthesized",
    )
    resynthesize: bool = False
    risk: Risk = 1e-3

    def given_contacts(self) -> Floats | None:
        """Contacts (k, 2) px, or None."""
        fingers = self.fingers
        if self.grasp is None:
            if fingers is not None and fingers < 2:
                raise GraspError(f"a grasp has at least 2 fingers, not {fingers}", fingers=fingers)
            return None
        from grasptrack.grasp.contacts import parse_contacts

        contacts = parse_contacts(self.grasp)
        if fingers is not None and fingers != len(contacts):
            raise GraspError(f"--grasp has {len(contacts)} contacts, but --fingers says {fingers}", fingers=fingers)
        return contacts

    def finger_count(self, *, at_most_three: bool = False) -> int:
        """The number of fingers, 2 or 3 (`at_most_three`) where a grasp is to be chosen."""
        contacts = self.given_contacts()
        if contacts is not None:
            return len(contacts)
        return _two_or_three(self.fingers or 2) if at_most_three else self.fingers or 2


@dataclass(frozen=True)
class CarriedGrasp(GivenGrasp):
    """The grasp that a strategy is to carry, and how exactly."""

    strategy: str = option_or(
        "auto",
        GRASP,
        "NAME",
        "Strategy: auto, rrp, grasp-line, homography, or paper: the cheapest of these that suffices, anew in each image.",
        callback=_strategy_choice,
    )
    tolerance: str | None = option_or(
        None,
        HAND,
        "L",
        "How far a contact may be off before the answer is wrong, on the object as the first image shows it.",
        show_default="3px or 4%, whichever is more",
    )
    next_object: bool = False

    def allowed_error(self, hand: HandSize) -> Length | None:
        """The tolerance, mm in px by the hand's scale; None where it is the usual one."""
        if self.tolerance is None:
            return None
        length = parse_scaled(self.tolerance, "--tolerance", hand.scale)
        return length if length.unit == "size" else length._replace(value=length.in_px(1.0, hand.scale), unit="px")


@dataclass(frozen=True)
class FollowedGrasp(CarriedGrasp):
    """The grasp that is followed, and what becomes of one that is refused."""

    resynthesize: bool = option_or(
        False, GRASP, None, "Choose a new grasp when the current one is no longer stable.", "--resynthesize"
    )
    wait: bool = option_or(
        False, OBJECT, None, "Begin only when an object lies whole in view and its choice is sure.", "--wait"
    )
    next_object: bool = option_or(
        False,
        OBJECT,
        None,
        "When the object has left the image, go on with the next, as with --wait; what is said of the first is not of it.",
        "--next",
    )
    search_ms: float | None = option_or(
        None,
        LIMITS,
        "MS",
        "Work that the search for a lost object may do in an image, in ms of a common machine; the rest follows later.",
        callback=_search_work,
        show_default="unlimited",
    )


TILT_HELP = (
    "the camera leans against the plane as it did where the parts were taught (fixed, or held alike): "
    "ellipses and the like are found more often."
)
SameTilt = Annotated[bool, option(OBJECT, None, TILT_HELP[0].upper() + TILT_HELP[1:], "--same-tilt")]


@dataclass(frozen=True)
class PartsOptions:
    """Parts on file of which every instance is followed."""

    part: list[str] | None = option_or(
        None, OBJECT, "FILE", "Part, or folder of parts, from grasptrack teach, for --all; may be repeated.", "--part"
    )
    all_parts: bool = option_or(
        False, OBJECT, None, "Follow every instance of the parts of --part, each with its instance_id.", "--all"
    )
    look_every: float | None = option_or(
        None,
        OBJECT,
        "S",
        "Time of the images, in s, between looks for parts that come into view, for --all.",
        show_default="2 for files in grasptrack track, else never: a look takes seconds",
    )
    same_tilt: bool = option_or(False, OBJECT, None, f"For --all: {TILT_HELP}", "--same-tilt")

    def has_parts(self) -> bool:
        """Whether many are followed.

        Raises:
            InputError: an option without the one that it belongs to, or seconds not above 0.
        """
        if self.all_parts and not self.part:
            raise InputError("--all follows parts on file: say which with --part FILE (grasptrack teach makes one)")
        if not self.all_parts and (self.part or self.look_every is not None or self.same_tilt):
            raise InputError(
                "--part, --look-every and --same-tilt are for following every instance of a part: add --all"
            )
        if self.look_every is not None and not 0.0 < self.look_every < math.inf:
            raise InputError(f"--look-every must be a positive number of seconds, not {self.look_every:g}")
        return self.all_parts

    def refuse_unsuited(self, *groups: Any) -> None:
        """See that nothing is asked for that --all has no use for.

        Raises:
            InputError: something is; it is named.
        """
        suited = ("risk", "ignore", "belt", "jsonl", "outline_in_jsonl")
        for each in (each for group in groups for each in fields(group)):
            value = next(getattr(group, each.name) for group in groups if hasattr(group, each.name))
            if each.name not in suited and value != each.default:
                name = {"object_at": "object", "next_object": "next", "mask": "masks"}.get(each.name, each.name)
                raise InputError(f"--{name.replace('_', '-')} is for following one object: leave it out, or --all")


@dataclass(frozen=True)
class KnownGeometry:
    """What a person has measured of object, belt and camera."""

    length: str | None = option_or(
        None,
        OBJECT,
        "L",
        "Length of the object, the longer side of its smallest enclosing rectangle, in mm, cm, m or in: 120mm.",
    )
    belt: str | None = option_or(
        None,
        OBJECT,
        "VX,VY",
        "How the belt that carries the object moves in the first image, in px/s, before a camera at rest: equal parts "
        "that pass are told apart.",
    )
    pixel_aspect: float | None = option_or(
        None,
        SOURCE,
        "R",
        "Ratio of a pixel's width to its height, which in a squeezed image is not 1.",
        show_default="1 until views tell otherwise",
    )


@dataclass(frozen=True)
class HandSize:
    """The hand that a grasp is chosen for, in lengths as written; px per mm is the image's scale."""

    min_opening: str | None = option_or(None, HAND, "L", "Smallest opening of the hand.", show_default="0")
    max_opening: str | None = option_or(None, HAND, "L", "Largest opening of the hand.", show_default="unlimited")
    finger_width: str | None = option_or(None, HAND, "L", "Width of a finger, along the outline.", show_default="10%")
    finger_thickness: str | None = option_or(
        None, HAND, "L", "Thickness of a finger, away from the outline.", show_default="10%"
    )
    clearance: str | None = option_or(
        None, HAND, "L", "Gap between finger and object before closing.", show_default="3%"
    )
    scale: float | None = option_or(
        None, HAND, "PX_PER_MM", "Image scale, in px per mm, for lengths in mm, cm, m or in."
    )

    def make_hand(self) -> Hand:
        """The hand; what was not given has the default."""
        from grasptrack.grasp.hand import Hand

        lengths = {name: text for name, text in vars(self).items() if text is not None and name != "scale"}
        sizes: dict[str, Any] = {n: parse_scaled(text, _option_name(n), self.scale) for n, text in lengths.items()}
        return Hand(**sizes, px_per_mm=_positive_scale(self.scale))

    def hand_for(self, grasp: CarriedGrasp) -> Hand | None:
        """The hand for the grasp of the first image, or None where nothing was said of one."""
        named = [_option_name(name) for name, text in vars(self).items() if text is not None]
        if grasp.tolerance is not None and named == ["--scale"]:  # it is that one's
            named = []
        if not named:
            return None
        if grasp.grasp is not None and not (grasp.resynthesize or grasp.next_object):
            raise InputError(f"{named[0]} is for choosing a grasp, but --grasp gives one: leave out one of them")
        return self.make_hand()


def open_publisher(address: str | None, quiet: bool) -> ResultPublisher | None:
    """What --publish asks for, until the verb has ended."""
    if address is None:
        return None
    from grasptrack.io.publishing import ResultPublisher, parse_publish_address

    publisher = open_until_end(ResultPublisher(parse_publish_address(address)))
    if not quiet:
        tell_line(f"results at {publisher.url}")
    return publisher


def _option_name(field: str) -> str:
    return "--" + field.replace("_", "-")


def _positive_scale(scale: float | None) -> float | None:
    if scale is not None and not 0.0 < scale < math.inf:
        raise InputError(f"--scale must be a positive number of px per mm, not {scale:g}", scale=scale)
    return scale


def parse_scaled(text: str, written: str, scale: float | None) -> Length:
    """The length of an option, as written in an image of so many px per mm."""
    from grasptrack.grasp.hand import parse_length

    length = parse_length(text, written)
    if length.unit not in ("px", "size") and _positive_scale(scale) is None:
        raise InputError(f"{written} {text} needs --scale, the px per mm of the image", text=text)
    return length


def one_of(option: str, text: str | None, choices: Sequence[str]) -> str | None:
    """A word from a few; None where none was given."""
    if text is not None and text not in choices:
        raise InputError(f'{option} is {", ".join(choices[:-1])} or {choices[-1]}, not "{text}"', text=text)
    return text


@dataclass(frozen=True)
class SourceOptions:
    """How images are read."""

    fps: float | None = option_or(
        None, SOURCE, "FPS", "Frame rate, in frames/s, for folders and globs, which have no times."
    )
    set: list[str] | None = option_or(
        None, SOURCE, "NAME=VALUE", "Setting of a camera, a stream or a bag; may be repeated."
    )

    def camera_settings(self) -> dict[str, str]:
        """The settings of --set by name."""
        found = {}
        for pair in self.set or ():
            name, sign, value = pair.partition("=")
            if not (name.strip() and sign):
                raise InputError(f'--set takes NAME=VALUE, as --set ExposureTime=2000, not "{pair}"', text=pair)
            found[name.strip()] = value.strip()
        return found


@dataclass(frozen=True)
class RecordingOptions:
    """What is written beside the run's own files."""

    record: list[Path] | None = option_or(
        None, OUTPUT, "FILE", "Record images and results: .mcap for Foxglove, .rrd for rerun; may be repeated."
    )
    record_quality: int | None = option_or(
        None,
        OUTPUT,
        "N",
        "Record images as JPEG of this quality, 1 to 100.",
        show_default="as they are, so that a replay gives the same",
    )
    jsonl: str | None = option_or(
        None, OUTPUT, "FILE", "Write a JSON object for every frame, one a line; - for the standard output."
    )
    outline_in_jsonl: bool = option_or(False, OUTPUT, None, "Write the outline in --jsonl, too.", "--outline-in-jsonl")

    def as_written(self) -> dict[str, Any]:
        """As written, for the record of a run."""
        return {"record": self.record, "record_quality": self.record_quality, "jsonl": self.jsonl}

    def files(self) -> list[Path]:
        """That are written."""
        return [*(self.record or ()), *([] if self.jsonl in (None, "-") else [Path(self.jsonl or "")])]

    def open_recordings(self, asked: Mapping[str, Any]) -> list[Recording]:
        """What the options ask for; recordings keep the options of `asked`."""
        from grasptrack.io.recording import JsonLines, open_recording, tracking_options

        if self.record_quality is not None and not self.record:
            raise InputError("--record-quality is for --record: give both")
        if self.outline_in_jsonl and self.jsonl is None:
            raise InputError("--outline-in-jsonl is for --jsonl: give both")
        opened: list[Recording] = []
        try:
            for path in self.record or ():
                opened.append(
                    open_recording(path, quality=self.record_quality, options=lambda: tracking_options(asked))
                )
            if self.jsonl is not None:
                opened.append(JsonLines(Path(self.jsonl), outline=self.outline_in_jsonl))
        except BaseException:
            for recording in opened:
                recording.close()
            raise
        return opened
