# SPDX-License-Identifier: Apache-2.0
"""The first image: options that say which object of it is meant, the camera's lens, and the outlines in it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from grasptrack.cli.help_groups import LIMITS, OBJECT, SOURCE, as_asked, option, option_or
from grasptrack.errors import InputError

if TYPE_CHECKING:
    from grasptrack.cli.options import FollowedGrasp, HandSize, KnownGeometry
    from grasptrack.first_image import FirstImage
    from grasptrack.geometry.cameras import Camera
    from grasptrack.geometry.contours import View
    from grasptrack.io.base import Frame
    from grasptrack.live.settings import Settings
    from grasptrack.segmentation.candidate import Candidate
    from grasptrack.typing import Box, Floats, Pixels, Point
    from grasptrack.undistortion import Undistortion

Sure = Annotated[float, option(OBJECT, "P", "Probability from which the choice of the object is called sure.")]
CameraPath = Annotated[
    str | None,
    option(
        SOURCE,
        "FILE",
        "Camera calibration (ROS, OpenCV, Kalibr or JSON); lens distortion is removed first.",
        "--camera",
    ),
]
IgnorePath = Annotated[str | None, option(SOURCE, "FILE", "Mask: white where pixels are ignored, such as the gripper.")]
_OPTIONS = {
    "object_at": "--object",
    "not_at": "--not",
    "the box": "--box",
    "the outline": "--outline",
    "sure": "--sure",
    "first_look_ms": "--first-look-ms",
}
"""What messages about a first image begin with, and the options that say it."""


class UserScene(NamedTuple):
    """An image with what the user said of it, made straight where the camera's lens is known.

    Attributes:
        picture: as it was read.
        image: without the lens's distortion.
        said: of the object, in px of `image`.
        mask: (H, W) the user's segmentation of `image`, or None.
        lens: which was taken out; None without a calibration.
        notes: lines for the user.
    """

    picture: Pixels
    image: Pixels
    said: FirstImage
    mask: Pixels | None
    lens: Undistortion | None
    notes: list[str]


@dataclass(frozen=True)
class FirstImageOptions:
    """What is said of the first image, as written."""

    object_at: list[str] | None = option_or(
        None,
        OBJECT,
        "X,Y",
        "Pixel on the object in the (first) image, in px; may be repeated.",
        "--object",
        show_default="the object that stands out most",
    )
    not_at: list[str] | None = option_or(
        None, OBJECT, "X,Y", "Pixel in the (first) image that is not on the object, in px; may be repeated.", "--not"
    )
    box: str | None = option_or(
        None, OBJECT, "X,Y,W,H", "Rectangle around the object, in px: left, top, width, height."
    )
    outline: str | None = option_or(
        None,
        OBJECT,
        '"X,Y X,Y ..."',
        "Rough polygon round the object in the (first) image, in px; it is moved onto the edges beside it.",
    )
    mask: str | None = None
    number: int | None = option_or(
        None,
        OBJECT,
        "N",
        "Candidate to take, of those that candidates.png numbers.",
        "--choose",
        min=1,
        max=3,
        show_default="the likeliest",
    )
    sure: Sure = 0.9
    segmenter: str | None = option_or(
        None,
        OBJECT,
        "NAME",
        "Proposes objects beside the own search: a model (grasptrack models), onnx:FILE, sam:ENCODER,DECODER, a plugin.",
    )
    background: str | None = option_or(
        None, OBJECT, "FILE", "Image of the empty bench, from where the (first) image is taken; the light may differ."
    )
    camera: CameraPath = None
    ignore: IgnorePath = None
    first_look_ms: float | None = option_or(
        None,
        LIMITS,
        "MS",
        "Work that the search for the object may do, in ms of a common machine.",
        show_default="unlimited",
    )

    def as_written(self) -> dict[str, Any]:
        """As written, for the record of a run."""

        def in_one(pixels: list[str] | None) -> str | None:
            return " ".join("".join(pixel.split()) for pixel in pixels or ()) or None

        return {**as_asked(self), "object": in_one(self.object_at), "not": in_one(self.not_at)}

    def files(self) -> list[str]:
        """That are read of what is said."""
        return [path for path in (self.background, self.camera, self.ignore) if path is not None]

    def first_image(self, contacts: Floats | None = None) -> FirstImage:
        """What is said of the object, contacts (k, 2) px of --grasp among it; masks and images are not read yet."""
        from grasptrack.first_image import FirstImage

        on = [parse_pair(text, "--object") for text in self.object_at or ()]
        if bool(on) + (self.box is not None) + (self.outline is not None) > 1:
            raise InputError("--object, --box and --outline all say which object is meant: give one of them")
        with by_option():
            return FirstImage.of(
                on,
                not_at=[parse_pair(text, "--not") for text in self.not_at or ()],
                box=None if self.box is None else _parse_rectangle(self.box, "--box"),
                outline=None if self.outline is None else _parse_polygon(self.outline, "--outline"),
                grasp=contacts,
                number=self.number,
                sure=self.sure,
                first_look_ms=self.first_look_ms,
            )

    def with_images(self, said: FirstImage) -> FirstImage:
        """The same with the images of --ignore and --background."""
        empty = None
        if self.background is not None:
            if self.mask is not None:
                raise InputError("--background and your own masks both say where the object is: give one of them")
            empty = only_image(self.background, "--background takes one image").image
        return replace(said, ignore=read_ignored(self.ignore), background=empty)

    def read_scene(self, name: str, taken: str, contacts: Floats | None = None) -> UserScene:
        """An image with all that is said of it, contacts (k, 2) px of --grasp among it.

        `taken` is what the verb takes, for the message.
        """
        from grasptrack.io.masks import read_mask

        said, calibration = self.first_image(contacts), load_calibration(self.camera)
        said = self.with_images(said)
        picture = only_image(name, taken).image
        with by_option():
            said.within(picture.shape)
        return straighten(picture, said, calibration, None if self.mask is None else read_mask(self.mask, parted=True))


@dataclass(frozen=True)
class MaskedImage(FirstImageOptions):
    """What is said of one image, of which there may be a mask."""

    mask: str | None = option_or(
        None, OBJECT, "FILE", "Your own segmentation: a mask that is white on objects, or numbers them."
    )

    def files(self) -> list[str]:
        """That are read of what is said."""
        return super().files() if self.mask is None else [self.mask, *super().files()]


@dataclass(frozen=True)
class MaskedFrames(FirstImageOptions):
    """What is said of the first of many images, of each of which there may be a mask."""

    mask: str | None = option_or(
        None, OBJECT, "DIR", "Your own segmentation, one mask per frame, matched by name or by order.", "--masks"
    )


@contextmanager
def by_option() -> Iterator[None]:
    """Within it an error that names what is said of the first image names the option that said it."""
    try:
        yield
    except InputError as error:
        text = str(error)
        for name, written in _OPTIONS.items():
            text = written + text[len(name) :] if text.startswith(name) else text
        raise InputError(text, **error.values) from None


def parse_pair(text: str, option: str, wanted: str = "a pixel written x,y") -> Point:
    """A pixel from "x,y", or two other numbers that an option wants."""
    numbers = _parse_numbers(text)
    if len(numbers) != 2:
        raise InputError(f'{option} is {wanted}, not "{text}"', text=text)
    return numbers[0], numbers[1]


def parse_belt(text: str | None) -> Point | None:
    """The velocity of --belt; None where it was not given."""
    return None if text is None else parse_pair(text, "--belt", "a velocity in px/s written vx,vy")


def _parse_rectangle(text: str, option: str) -> Box:
    numbers = _parse_numbers(text)
    if len(numbers) != 4 or not (numbers[2] > 0.0 and numbers[3] > 0.0):
        raise InputError(f'{option} is left,top,width,height in px, not "{text}"', text=text)
    return numbers[0], numbers[1], numbers[2], numbers[3]


def _parse_polygon(text: str, option: str) -> list[Point]:
    corners = [parse_pair(corner, option) for corner in text.split()]
    if len(corners) < 3:
        raise InputError(f'{option} is at least three corners written "x,y x,y x,y", not "{text}"', text=text)
    return corners


def _parse_numbers(text: str) -> list[float]:
    """Finite numbers from "a,b,c"; none of anything else."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []


def load_calibration(path: str | None) -> Camera | None:
    """The camera of --camera, or None."""
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


def read_ignored(path: str | None) -> Pixels | None:
    """The mask of --ignore, (H, W), or None."""
    if path is None:
        return None
    from grasptrack.io.masks import read_mask

    return read_mask(path)


def only_image(name: str, taken: str) -> Frame:
    """The image of a file."""
    from grasptrack.io.sources import open_source

    with open_source(name) as source:
        if source.kind != "image":
            raise InputError(f'"{name}" is a {source.kind}; {taken}')
        return next(iter(source))


def straighten(picture: Pixels, said: FirstImage, calibration: Camera | None, mask: Pixels | None = None) -> UserScene:
    """An image and what was said of it, without the lens's distortion where the camera is known."""
    from grasptrack.undistortion import Undistortion

    if calibration is None:
        return UserScene(picture, picture, said, mask, None, [])
    lens = Undistortion(calibration, picture.shape[1], picture.shape[0])
    straight_mask = None if mask is None else lens.straight_mask(mask)
    notes = scaling_notes(calibration, picture.shape)
    return UserScene(picture, lens.straight_image(picture), said.without_distortion(lens), straight_mask, lens, notes)


class FoundOutlines(NamedTuple):
    """What lies in an image.

    Attributes:
        views: outlines, none within another, the object that is meant first.
        candidates: what that may be, where its choice is not sure.
        probability: that it is what the first one shows.
    """

    views: list[View]
    candidates: Sequence[Candidate]
    probability: float


def find_outlines(scene: UserScene, segmenter: str | None = None) -> FoundOutlines:
    """Outlines in an image."""
    from grasptrack.segmentation.candidate import distinct_candidates
    from grasptrack.segmentation.first_look import find_objects, look_for
    from grasptrack.segmentation.segmenters import segmenter_for

    regions, said = segmenter_for(segmenter), scene.said
    found = find_objects(scene.image, said, mask=scene.mask, segmenter=regions)
    views, probability = [c.view for c in found], found[0].probability
    if said.number is not None or probability >= said.sure:
        return FoundOutlines(views, [], probability)
    return FoundOutlines(views, distinct_candidates(look_for(scene.image, said, regions, scene.mask)), probability)


def tracker_settings(grasp: FollowedGrasp, first: FirstImageOptions, hand: HandSize, known: KnownGeometry) -> Settings:
    """How a tracker works that is asked for by these options, whatever the first image shows."""
    from grasptrack.grasp.hand import parse_measure
    from grasptrack.live.settings import Settings
    from grasptrack.segmentation.segmenters import segmenter_for

    length = None if known.length is None else parse_measure(known.length, "--length")
    return Settings(
        strategy=grasp.strategy,
        fingers=grasp.finger_count(),
        friction=grasp.friction,
        risk=grasp.risk,
        hand=hand.hand_for(grasp),
        camera=load_calibration(first.camera),
        length=length and length.value,
        unit=length.unit if length else "",
        belt=parse_belt(known.belt),
        pixel_aspect=known.pixel_aspect,
        resynthesize=grasp.resynthesize,
        tolerance=grasp.allowed_error(hand),
        wait=grasp.wait,
        next_object=grasp.next_object,
        search_ms=grasp.search_ms,
        segmenter=segmenter_for(first.segmenter),
    )
