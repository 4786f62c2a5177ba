# SPDX-License-Identifier: Apache-2.0
"""Options that several verbs share, each checked once, before any work; one image and the outlines in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from grasptrack.errors import GraspError, InputError, StrategyError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grasptrack.geometry.cameras import Camera
    from grasptrack.geometry.contours import View
    from grasptrack.grasp.hand import Hand
    from grasptrack.io.base import Frame
    from grasptrack.segmentation.candidate import Candidate
    from grasptrack.segmentation.undistortion import Told, Undistortion


Fingers = Annotated[
    int | None,
    typer.Option(
        metavar="K", help="Number of fingers.  [default: 2, or as many as --grasp has contacts]", show_default=False
    ),
]
Risk = Annotated[
    float,
    typer.Option(metavar="R", help="Accepted probability of a wrong answer, between 0 and 1."),
]
Friction = Annotated[float, typer.Option(metavar="MU", help="Coulomb friction coefficient between finger and object.")]
GraspText = Annotated[
    str | None,
    typer.Option(
        metavar='"X1,Y1 X2,Y2"',
        help="Contacts in the first image, in px, instead of synthesis; they also select the object.",
    ),
]
IgnorePath = Annotated[
    str | None,
    typer.Option(metavar="MASK", help="Mask: white where pixels are ignored, such as the gripper."),
]
CameraPath = Annotated[
    str | None,
    typer.Option(
        "--camera",
        metavar="FILE",
        help="Camera calibration (ROS, OpenCV, Kalibr or JSON); lens distortion is removed first.",
    ),
]
ObjectTexts = Annotated[
    list[str] | None,
    typer.Option("--object", metavar="X,Y", help="Pixel on the object in the (first) image; may be repeated."),
]
NotTexts = Annotated[
    list[str] | None,
    typer.Option("--not", metavar="X,Y", help="Pixel in the (first) image that is not on the object; may be repeated."),
]
OutlineText = Annotated[
    str | None,
    typer.Option(
        "--outline",
        metavar='"X,Y X,Y ..."',
        help="Rough polygon round the object in the (first) image, in px; it is moved onto the edges beside it.",
    ),
]
SegmenterName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Proposes objects beside the own search: a model (grasptrack models), onnx:FILE, sam:ENCODER,DECODER, a plugin.",
    ),
]
BackgroundPath = Annotated[
    str | None,
    typer.Option(
        "--background",
        metavar="IMAGE",
        help="Image of the empty bench, from where the (first) image is taken; the light may differ.",
    ),
]
ChooseNumber = Annotated[
    int | None,
    typer.Option(
        "--choose",
        metavar="N",
        min=1,
        max=3,
        help="Candidate to take, of those that candidates.png numbers.  [default: the likeliest]",
        show_default=False,
    ),
]
Sure = Annotated[
    float, typer.Option("--sure", metavar="P", help="Probability from which the choice of the object is called sure.")
]
FirstLookMs = Annotated[
    float | None,
    typer.Option(
        "--first-look-ms",
        metavar="MS",
        help="Work that the search for the object may do.  [default: all]",
        show_default=False,
    ),
]
BoxText = Annotated[
    str | None,
    typer.Option("--box", metavar="X,Y,W,H", help="Rectangle around the object in px: left, top, width, height."),
]
MinOpening = Annotated[str | None, typer.Option(metavar="L", help="Smallest opening of the hand.  [default: 0]")]
MaxOpening = Annotated[str | None, typer.Option(metavar="L", help="Largest opening of the hand.  [default: unlimited]")]
FingerWidth = Annotated[
    str | None, typer.Option(metavar="L", help="Width of a finger, along the outline.  [default: 10%]")
]
FingerThickness = Annotated[
    str | None, typer.Option(metavar="L", help="Thickness of a finger, away from the outline.  [default: 10%]")
]
Clearance = Annotated[
    str | None, typer.Option(metavar="L", help="Gap between finger and object before closing.  [default: 3%]")
]
ObjectLength = Annotated[
    str | None,
    typer.Option(
        "--length",
        metavar="L",
        help="Length of the object, the longer side of its smallest enclosing rectangle: 120mm, 12cm, 0.12m, 4.7in.",
    ),
]
Scale = Annotated[float | None, typer.Option(metavar="PX_PER_MM", help="Image scale in px per mm, for lengths in mm.")]
NoVideo = Annotated[bool, typer.Option("--no-video", help="Do not write overlay.mp4.")]
MaskPath = Annotated[
    str | None, typer.Option(metavar="MASK", help="Your own segmentation: a mask that is white on objects.")
]
Silhouettes = Annotated[
    str | None, typer.Option(metavar="DIR", help="Parts from silhouette images, black outside the part.")
]
Workers = Annotated[int | None, typer.Option(metavar="N", help="Number of processes.  [default: one per core]")]
Scheduler = Annotated[str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Address of a Dask scheduler.")]


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
        metavar="N",
        callback=_limit_megapixels,
        help="Refuse larger images, in 10^6 px, before they are decoded.  [default: 100]",
        show_default=False,
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]


class ObjectMeant(NamedTuple):
    """Which object of an image is meant: px; empty or None where nothing says.

    Attributes:
        on, off: x, y of pixels on it, and of pixels that are not.
        box: left, top, width, height of a rectangle round it.
        outline: corners of a rough polygon round it.
    """

    on: list[tuple[float, float]]
    off: list[tuple[float, float]]
    box: tuple[float, float, float, float] | None
    outline: list[tuple[float, float]] | None

    @property
    def is_told(self) -> bool:
        """Whether anything says which object is meant."""
        return bool(self.on or self.off) or self.box is not None or self.outline is not None

    def told(
        self, contacts: NDArray[Any] | None, ignore: NDArray[Any] | None, background: NDArray[Any] | None = None
    ) -> Told:
        """The same with contacts that are given, what to ignore, and the empty bench."""
        from grasptrack.segmentation.undistortion import Told

        return Told(contacts, self.on or None, self.off or None, self.box, self.outline, ignore, background)


class Scene(NamedTuple):
    """An image with what the user said of it, made straight where the camera's lens is known.

    Attributes:
        image: without the lens's distortion.
        told: contacts, object and what to ignore, in px of `image`.
        mask: the user's segmentation of it.
        lens: which was taken out; None without a calibration.
    """

    image: NDArray[Any]
    told: Told
    mask: NDArray[Any] | None
    lens: Undistortion | None


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


def parse_point(text: str | None, option: str) -> tuple[float, float] | None:
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


def parse_rectangle(text: str | None, option: str) -> tuple[float, float, float, float] | None:
    """left, top, width and height in px from "x,y,w,h".

    Raises:
        InputError: anything else, or nothing within.
    """
    if text is None:
        return None
    try:
        x, y, w, h = (float(part) for part in text.split(","))
    except ValueError:
        x = y = w = h = math.nan
    if not (math.isfinite(x + y + w + h) and w > 0.0 and h > 0.0):
        raise InputError(f'{option} is left,top,width,height in px, not "{text}"', text=text)
    return x, y, w, h


def parse_points(texts: Sequence[str] | None, option: str) -> list[tuple[float, float]]:
    """Pixels, each from "x,y".

    Raises:
        InputError: anything else.
    """
    return [place for text in texts or () if (place := parse_point(text, option)) is not None]


def parse_polygon(text: str | None, option: str) -> list[tuple[float, float]] | None:
    """Corners in px from "x,y x,y x,y ...".

    Raises:
        InputError: anything else, or fewer than three.
    """
    if text is None:
        return None
    corners = parse_points(text.split(), option)
    if len(corners) < 3:
        raise InputError(f'{option} is at least three corners written "x,y x,y x,y", not "{text}"', text=text)
    return corners


def sure_rate(sure: float) -> float:
    """The probability from which the choice of an object is sure.

    Raises:
        InputError: below 0, or 1 and more.
    """
    from grasptrack.segmentation.first_look import check_sure

    return check_sure(sure, "--sure")


def work_limit(ms: float | None) -> float | None:
    """ms of work that the search for the object may do, or None.

    Raises:
        InputError: not above 0.
    """
    from grasptrack.segmentation.work import check_limit_ms

    return check_limit_ms(ms, "--first-look-ms")


def object_meant(
    object_: Sequence[str] | None, not_: Sequence[str] | None, box: str | None, outline: str | None
) -> ObjectMeant:
    """Which object is meant, by --object, --not, --box and --outline.

    Raises:
        InputError: two of them say it, or one cannot be read.
    """
    meant = ObjectMeant(
        parse_points(object_, "--object"),
        parse_points(not_, "--not"),
        parse_rectangle(box, "--box"),
        parse_polygon(outline, "--outline"),
    )
    if bool(meant.on) + (meant.box is not None) + (meant.outline is not None) > 1:
        raise InputError("--object, --box and --outline all say which object is meant: give one of them")
    return meant


def told_words(object_: Sequence[str] | None, not_: Sequence[str] | None) -> dict[str, str | None]:
    """Pixels as they were written, for the record of a run."""
    return {"object": " ".join(object_) if object_ else None, "not": " ".join(not_) if not_ else None}


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
        InputError: no length, mm without a scale, or lengths that contradict each other.
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
        if given[name].unit == "mm" and scale is None:
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


def load_calibration(path: str | None) -> Camera | None:
    """The camera of --camera, or None.

    Raises:
        InputError: a file that cannot be read, or is no calibration.
    """
    if path is None:
        return None
    from grasptrack.io.calibration import read_camera

    return read_camera(path)


def scaling_notes(camera: Camera | None, shape: tuple[int, ...]) -> list[str]:
    """A line for the user where a calibration was made with images of another size than (H, W), which are scaled ones."""
    if camera is None or camera.size in (None, (shape[1], shape[0])):
        return []
    width, height = camera.size or (0, 0)
    return [f"the calibration, of {width}x{height} px, was scaled to the images' {shape[1]}x{shape[0]}"]


def ignore_mask(path: str | None) -> NDArray[Any] | None:
    """The mask of what never belongs to a scene, (H, W), or None.

    Raises:
        SourceError: it cannot be read.
    """
    if path is None:
        return None
    from grasptrack.io.masks import read_mask

    return read_mask(path)


def background_image(path: str | None, masks: str | None) -> NDArray[Any] | None:
    """The image of the empty bench, or None.

    Args:
        path: of --background.
        masks: of --mask or --masks, with which it cannot go.

    Raises:
        SourceError, InputError: it is missing, unreadable or no image, or masks are given.
    """
    if path is None:
        return None
    if masks is not None:
        raise InputError("--background and your own masks both say where the object is: give one of them")
    return only_image(path, "--background takes one image").image


def only_image(name: str, taken: str) -> Frame:
    """The image of a file.

    Args:
        name: of the file.
        taken: what the verb takes, for the message.

    Raises:
        SourceError, InputError: missing, unreadable, or more than one image.
    """
    from grasptrack.io.sources import open_source

    with open_source(name) as source:
        if source.kind != "image":
            raise InputError(f'"{name}" is a {source.kind}; {taken}')
        return next(iter(source))


def straighten_scene(
    image: NDArray[Any], told: Told, calibration: Camera | None, mask: NDArray[Any] | None = None
) -> Scene:
    """An image and what was said of it, without the lens's distortion where the camera is known."""
    from grasptrack.segmentation.undistortion import Undistortion

    if calibration is None:
        return Scene(image, told, mask, None)
    lens = Undistortion(calibration, image.shape[1], image.shape[0])
    return Scene(lens.image(image), told.straight(lens), None if mask is None else lens.mask(mask), lens)


def check_within(shape: tuple[int, ...], meant: ObjectMeant) -> None:
    """See that what says which object is meant lies in an image.

    Raises:
        InputError: it does not.
    """
    from grasptrack.segmentation.hints import make_hints

    try:
        make_hints(shape, meant.on or None, meant.off or None, meant.box, meant.outline)
    except InputError as error:
        text = str(error)
        for name, option in (
            ("object_at", "--object"),
            ("not_at", "--not"),
            ("the box", "--box"),
            ("the outline", "--outline"),
        ):
            text = option + text[len(name) :] if text.startswith(name) else text
        raise InputError(text, **error.values) from None


def find_outlines(
    scene: Scene,
    segmenter: str | None = None,
    number: int | None = None,
    sure: float = 0.0,
    first_look_ms: float | None = None,
) -> tuple[list[View], list[Candidate]]:
    """Outlines in an image, none within another, the object that is meant first; and where that is not sure, what it may be.

    Args:
        scene: the image.
        segmenter: proposes regions beside the own search.
        number: of the candidate that a person took.
        sure: probability from which the choice is sure.
        first_look_ms: work that the search may do.

    Raises:
        ObservationError: no object, or none where it should be.
        InputError: a mask of another size, no such segmenter, or fewer candidates.
    """
    from grasptrack.segmentation.first_look import distinct_candidates, find_objects, first_look
    from grasptrack.segmentation.segmenters import segmenter_for

    told = scene.told
    asked: dict[str, Any] = {
        "object_at": told.object_at,
        "box": told.box,
        "ignore": told.ignore,
        "mask": scene.mask,
        "not_at": told.not_at,
        "outline": told.outline,
        "segmenter": segmenter_for(segmenter),
        "background": told.background,
        "first_look_ms": first_look_ms,
    }
    found = find_objects(scene.image, **asked, number=number)
    likely = number is not None or found[0].probability >= sure
    return [c.view for c in found], [] if likely else distinct_candidates(first_look(scene.image, **asked))
