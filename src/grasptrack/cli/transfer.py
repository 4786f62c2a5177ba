# SPDX-License-Identifier: Apache-2.0
"""`grasptrack transfer`: the same grasp in two views, by every strategy."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from grasptrack.cli import options
from grasptrack.cli.scene import only_image
from grasptrack.errors import GraspTrackError, InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grasptrack.calibration import Camera
    from grasptrack.observation.undistortion import Told, Undistortion

_HEADS = (
    ("strategy", "left"),
    ("contacts, px", "left"),
    ("off by, px", "right"),
    ("stable", "left"),
    ("margin", "right"),
)


def transfer(
    image_a: Annotated[str, typer.Argument(metavar="IMAGE_A", help="The reference view.")],
    image_b: Annotated[str, typer.Argument(metavar="IMAGE_B", help="The view to carry the grasp to.")],
    fingers: options.Fingers = None,
    friction: options.Friction = 0.5,
    output: Annotated[Path, typer.Option(metavar="DIR", help="Folder for transfer.png.")] = Path(),
    grasp: options.GraspText = None,
    object_: Annotated[
        str | None, typer.Option("--object", metavar="X,Y", help="A pixel of the object in IMAGE_A.")
    ] = None,
    object_b: Annotated[str | None, typer.Option(metavar="X,Y", help="A pixel of the object in IMAGE_B.")] = None,
    ignore: options.IgnorePath = None,
    camera: options.CameraPath = None,
    quiet: options.Quiet = False,
) -> None:
    """Carry a grasp from one view of an object to another: what each strategy makes of it, or why it is not believed.

    The views may differ by any turn, by scale and by tilts up to 60 degrees. "registration" lays outline and surface on
    IMAGE_B; the three strategies of the paper follow.

    "off by" is how far IMAGE_B says that the worst contact is from where the strategy puts it.

    Writes transfer.png, both views side by side.

    \b
    Examples:
      grasptrack transfer a.png b.png
      grasptrack transfer a.png b.png --object 320,240 --object-b 300,250
      grasptrack transfer a.png b.png --grasp "193,308 157,99" --output pictures
      grasptrack transfer a.png b.png --camera camera.yaml
    """
    options.positive_friction(friction)
    contacts, count = options.contacts_and_fingers(grasp, fingers)
    place_a, place_b = options.point(object_, "--object"), options.point(object_b, "--object-b")
    hidden, calibration = options.ignore_mask(ignore), options.calibration(camera)
    first, second = (only_image(name, "transfer takes two images").image for name in (image_a, image_b))
    _check_folder(output)

    from grasptrack.grasp import Grasp
    from grasptrack.observation.undistortion import Told
    from grasptrack.pair import carry_to
    from grasptrack.tracking.tracker import GraspTracker

    lens, one, told = _straight(calibration, first, Told(contacts, place_a, None, hidden))
    lens_b, other, told_b = _straight(calibration, second, Told(None, place_b, None, hidden))
    # The first step of a sequence, so that object and grasp are chosen here as they are there.
    begun = GraspTracker(
        fingers=count, friction=friction, grasp=told.contacts, object_at=told.object_at, ignore=told.ignore
    )
    chosen = begun.update(one)
    if chosen.contacts is None or chosen.view is None:
        raise InputError(f'"{image_a}": {chosen.reason}')
    try:
        pair = carry_to(Grasp(chosen.contacts), chosen.view, one, other, friction, told_b.object_at, told_b.ignore)
    except GraspTrackError as error:
        raise InputError(f'"{image_b}": {error}') from None

    from grasptrack.view.pair import write_pair

    picture = output / "transfer.png"
    view, at, current, outcomes = chosen.view, chosen.contacts, pair.current, pair.outcomes
    if lens is not None and lens_b is not None:
        view, at, current = lens.view(view), lens.seen(at), lens_b.view(current)
        outcomes = [o if o.contacts is None else o._replace(contacts=lens_b.seen(o.contacts)) for o in outcomes]
    believed = {o.strategy: o.contacts for o in outcomes if o.contacts is not None and not o.reason}
    refused = {o.strategy: o.reason for o in outcomes if o.reason}
    write_pair(
        picture,
        (first, view, at),
        (second, current),
        believed,
        refused,
        (Path(image_a).name, Path(image_b).name),
    )
    if quiet:
        return
    from grasptrack.cli.report import show_rows

    rows = [["(reference)", _written(at), "", *_stable(chosen.analysis)]]
    notes = options.scaled(calibration, first.shape)
    for outcome in outcomes:
        if outcome.reason:
            rows.append([outcome.strategy, "refused", _number(outcome.off), "", ""])
            notes.append(f"{outcome.strategy} refused: {outcome.reason}")
        else:
            cells = [outcome.strategy, _written(outcome.contacts), _number(outcome.off)]
            rows.append([*cells, *_stable(outcome.analysis)])
    if pair.turns:
        others = ", ".join(f"{turn:+.0f}°" for turn in pair.turns)
        notes.append(f"ambiguous: the outline fits as well turned by {others}; the image cannot tell which is right")
    elif pair.found.status == "ambiguous":
        notes.append(f"ambiguous: {pair.found.reason}")
    show_rows("The grasp in both views", _HEADS, rows, [*notes, str(picture)])


def _straight(
    calibration: Camera | None, image: NDArray[Any], told: Told
) -> tuple[Undistortion | None, NDArray[Any], Told]:
    """An image and what was said of it, without the lens's distortion where the camera is known."""
    from grasptrack.observation.undistortion import Undistortion

    if calibration is None:
        return None, image, told
    lens = Undistortion(calibration, image.shape[1], image.shape[0])
    return lens, lens.image(image), told.straight(lens)


def _stable(analysis: Any) -> list[str]:
    """Cells: stable or not, and the margin."""
    if analysis is None:
        return ["", ""]
    return ["yes" if analysis.stable else "no", f"{math.degrees(analysis.margin):+.1f}°"]


def _written(contacts: Any) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in contacts.tolist())


def _number(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "-"


def _check_folder(output: Path) -> None:
    from grasptrack.io.run import prepare_folder

    prepare_folder(output)
