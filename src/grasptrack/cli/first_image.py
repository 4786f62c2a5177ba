# SPDX-License-Identifier: Apache-2.0
"""The first image: options that say which object of it is meant, the camera's lens, and the outlines in it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from grasptrack.cli import help_groups
from grasptrack.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grasptrack.first_image import FirstImage
    from grasptrack.geometry.cameras import Camera
    from grasptrack.geometry.contours import View
    from grasptrack.io.base import Frame
    from grasptrack.segmentation.candidate import Candidate
    from grasptrack.segmentation.undistortion import Undistortion

ObjectTexts = Annotated[
    list[str] | None,
    typer.Option(
        "--object",
        metavar="X,Y",
        rich_help_panel=help_groups.OBJECT,
        help="Pixel on the object in the (first) image, in px; may be repeated.",
        show_default="the object that stands out most",
    ),
]
NotTexts = Annotated[
    list[str] | None,
    typer.Option(
        "--not",
        metavar="X,Y",
        rich_help_panel=help_groups.OBJECT,
        help="Pixel in the (first) image that is not on the object, in px; may be repeated.",
    ),
]
BoxText = Annotated[
    str | None,
    typer.Option(
        "--box",
        metavar="X,Y,W,H",
        rich_help_panel=help_groups.OBJECT,
        help="Rectangle around the object, in px: left, top, width, height.",
    ),
]
OutlineText = Annotated[
    str | None,
    typer.Option(
        "--outline",
        metavar='"X,Y X,Y ..."',
        rich_help_panel=help_groups.OBJECT,
        help="Rough polygon round the object in the (first) image, in px; it is moved onto the edges beside it.",
    ),
]
MaskPath = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        rich_help_panel=help_groups.OBJECT,
        help="Your own segmentation: a mask that is white on objects.",
    ),
]
ChooseNumber = Annotated[
    int | None,
    typer.Option(
        "--choose",
        metavar="N",
        min=1,
        max=3,
        rich_help_panel=help_groups.OBJECT,
        help="Candidate to take, of those that candidates.png numbers.",
        show_default="the likeliest",
    ),
]
Sure = Annotated[
    float,
    typer.Option(
        "--sure",
        metavar="P",
        rich_help_panel=help_groups.OBJECT,
        help="Probability from which the choice of the object is called sure.",
    ),
]
SegmenterName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        rich_help_panel=help_groups.OBJECT,
        help="Proposes objects beside the own search: a model (grasptrack models), onnx:FILE, sam:ENCODER,DECODER, a plugin.",
    ),
]
BackgroundPath = Annotated[
    str | None,
    typer.Option(
        "--background",
        metavar="FILE",
        rich_help_panel=help_groups.OBJECT,
        help="Image of the empty bench, from where the (first) image is taken; the light may differ.",
    ),
]
IgnorePath = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        rich_help_panel=help_groups.SOURCE,
        help="Mask: white where pixels are ignored, such as the gripper.",
    ),
]
CameraPath = Annotated[
    str | None,
    typer.Option(
        "--camera",
        metavar="FILE",
        rich_help_panel=help_groups.SOURCE,
        help="Camera calibration (ROS, OpenCV, Kalibr or JSON); lens distortion is removed first.",
    ),
]
FirstLookMs = Annotated[
    float | None,
    typer.Option(
        "--first-look-ms",
        metavar="MS",
        rich_help_panel=help_groups.LIMITS,
        help="Work that the search for the object may do, in ms of a common machine.",
        show_default="unlimited",
    ),
]


_OPTIONS = {
    "object_at": "--object",
    "not_at": "--not",
    "the box": "--box",
    "the outline": "--outline",
    "sure": "--sure",
    "first_look_ms": "--first-look-ms",
}
"""What messages about a first image begin with, and the options that say it."""


class Scene(NamedTuple):
    """An image with what the user said of it, made straight where the camera's lens is known.

    Attributes:
        image: without the lens's distortion.
        said: of the object, in px of `image`.
        mask: the user's segmentation of it.
        lens: which was taken out; None without a calibration.
    """

    image: NDArray[Any]
    said: FirstImage
    mask: NDArray[Any] | None
    lens: Undistortion | None


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


def first_image(
    object_: Sequence[str] | None,
    not_: Sequence[str] | None,
    box: str | None,
    outline: str | None,
    **given: Any,
) -> FirstImage:
    """What --object, --not, --box, --outline and others say of the first image.

    Args:
        object_, not_, box, outline: as written.
        **given: other arguments of `FirstImage.of`.

    Raises:
        InputError: two of them say which object is meant, or one cannot be read.
    """
    from grasptrack.first_image import FirstImage

    said: dict[str, Any] = {
        "object_at": parse_points(object_, "--object"),
        "not_at": parse_points(not_, "--not"),
        "box": parse_rectangle(box, "--box"),
        "outline": parse_polygon(outline, "--outline"),
    }
    if bool(said["object_at"]) + (box is not None) + (outline is not None) > 1:
        raise InputError("--object, --box and --outline all say which object is meant: give one of them")
    with by_option():
        return FirstImage.of(**said, **given)


@contextmanager
def by_option() -> Iterator[None]:
    """Within it an error that names what is said of the first image names the option that said it."""
    try:
        yield
    except InputError as error:
        text = str(error)
        for name, option in _OPTIONS.items():
            text = option + text[len(name) :] if text.startswith(name) else text
        raise InputError(text, **error.values) from None


def told_words(object_: Sequence[str] | None, not_: Sequence[str] | None) -> dict[str, str | None]:
    """Pixels as they were written, for the record of a run."""
    words = {"object": object_, "not": not_}
    return {name: " ".join("".join(pixel.split()) for pixel in given or ()) or None for name, given in words.items()}


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
    image: NDArray[Any], said: FirstImage, calibration: Camera | None, mask: NDArray[Any] | None = None
) -> Scene:
    """An image and what was said of it, without the lens's distortion where the camera is known."""
    from grasptrack.segmentation.undistortion import Undistortion

    if calibration is None:
        return Scene(image, said, mask, None)
    lens = Undistortion(calibration, image.shape[1], image.shape[0])
    return Scene(lens.image(image), said.straight(lens), None if mask is None else lens.mask(mask), lens)


def find_outlines(scene: Scene, segmenter: str | None = None) -> tuple[list[View], list[Candidate]]:
    """Outlines in an image, none within another, the object that is meant first; and where that is not sure, what it may be.

    Raises:
        ObservationError: no object, or none where it should be.
        InputError: a mask of another size, no such segmenter, or fewer candidates than the number that was taken.
    """
    from grasptrack.segmentation.first_look import distinct_candidates, find_objects, look_for
    from grasptrack.segmentation.segmenters import segmenter_for

    regions = segmenter_for(segmenter)
    found = find_objects(scene.image, scene.said, mask=scene.mask, segmenter=regions)
    likely = scene.said.number is not None or found[0].probability >= scene.said.sure
    return [c.view for c in found], [] if likely else distinct_candidates(
        look_for(scene.image, scene.said, regions, scene.mask)
    )
