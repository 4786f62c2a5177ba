# SPDX-License-Identifier: Apache-2.0
"""`grasptrack transfer`: the same grasp in two views, by every strategy."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from grasptrack.cli import options
from grasptrack.errors import GraspTrackError, InputError

if TYPE_CHECKING:
    from grasptrack.contour import View
    from grasptrack.grasp import Grasp
    from grasptrack.io.base import Frame
    from grasptrack.transfer import Transfer

_HEADS = (
    ("strategy", "left"),
    ("contacts, px", "left"),
    ("residual, px", "right"),
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
    quiet: options.Quiet = False,
) -> None:
    """Carry a grasp from one view of an object to another: what each strategy makes of it, or why it refuses.

    Writes transfer.png, both views side by side.

    \b
    Examples:
      grasptrack transfer a.png b.png
      grasptrack transfer a.png b.png --object 320,240 --object-b 300,250
      grasptrack transfer a.png b.png --grasp "193,308 157,99" --output pictures
    """
    options.positive_friction(friction)
    contacts, count = options.contacts_and_fingers(grasp, fingers)
    place_a, place_b = options.point(object_, "--object"), options.point(object_b, "--object-b")
    hidden = options.ignore_mask(ignore)
    first, second = _only_image(image_a), _only_image(image_b)
    _check_folder(output)

    from grasptrack.contour import View
    from grasptrack.grasp import Grasp
    from grasptrack.observation.segmentation import segment
    from grasptrack.tracker import GraspTracker
    from grasptrack.transfer import STRATEGIES

    # The first step of a sequence, so that object and grasp are chosen here as they are there.
    begun = GraspTracker(fingers=count, friction=friction, grasp=contacts, object_at=place_a, ignore=hidden)
    chosen = begun.update(first.image)
    if chosen.contacts is None or chosen.view is None:
        raise InputError(f'"{image_a}": {chosen.reason}')
    try:
        outline = segment(second.image, place_b, hidden)
    except GraspTrackError as error:
        raise InputError(f'"{image_b}": {error}') from None
    reference = View(chosen.view.contours, first.image)
    current = View(outline.contours, second.image)
    found: dict[str, Transfer] = {}
    refused: dict[str, str] = {}
    for name in STRATEGIES:
        try:
            found[name] = _carry(name, Grasp(chosen.contacts), reference, current)
        except GraspTrackError as error:
            refused[name] = str(error)

    from grasptrack.view.pair import write_pair

    picture = output / "transfer.png"
    write_pair(
        picture,
        (first.image, reference, chosen.contacts),
        (second.image, current),
        {name: moved.grasp.contacts for name, moved in found.items()},
        refused,
        (Path(image_a).name, Path(image_b).name),
    )
    if quiet:
        return
    from grasptrack.cli.report import show_rows

    notes = [str(picture)]
    rows = [["(reference)", _written(chosen.contacts), "", *_stable(chosen.analysis)]]
    for name in STRATEGIES:
        if name in found:
            analysis = _analysis(found[name], reference, current, friction)
            rows.append([name, _written(found[name].grasp.contacts), _number(found[name].residual), *_stable(analysis)])
        else:
            rows.append([name, "refused", "", "", ""])
            notes.insert(-1, f"{name} refused: {refused[name]}")
    show_rows("The grasp in both views", _HEADS, rows, notes)


def _carry(name: str, grasp: Grasp, reference: View, current: View) -> Transfer:
    """One strategy's transfer; RRP's points correspond only on a snake, which starts where the outlines align."""
    from grasptrack.transfer import transfer as carry

    if name != "rrp":
        return carry(grasp, reference, current, name)
    from grasptrack.carriers import SnakeCarrier
    from grasptrack.observation.images import to_grey
    from grasptrack.transfer.alignment import align, as_similarity

    assert reference.image is not None and current.image is not None
    snake = SnakeCarrier(grasp, reference, to_grey(reference.image), "affine")
    start = as_similarity(align(reference.outer, current.outer), reference.outer, current.outer)
    return snake.carry(to_grey(current.image), current, start).transfer


def _analysis(moved: Transfer, reference: View, current: View, friction: float) -> Any:
    """Judged in the reference view where the transfer says how to get back there, else in the image."""
    import numpy as np

    from grasptrack.analysis import analyze
    from grasptrack.grasp import Grasp
    from grasptrack.projective import apply_homography

    try:
        if moved.homography is None:
            return analyze(moved.grasp, current, friction)
        back = apply_homography(np.linalg.inv(moved.homography), moved.grasp.contacts)
        return analyze(Grasp(back), reference, friction, judged_in="reference")
    except GraspTrackError:
        return None


def _stable(analysis: Any) -> list[str]:
    """Cells: stable or not, and the margin."""
    if analysis is None:
        return ["off the outline", ""]
    return ["yes" if analysis.stable else "no", f"{math.degrees(analysis.margin):+.1f}°"]


def _written(contacts: Any) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in contacts.tolist())


def _number(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "-"


def _only_image(name: str) -> Frame:
    from grasptrack.io.sources import open_source

    with open_source(name) as source:
        if source.kind != "image":
            raise InputError(f'"{name}" is a {source.kind}; transfer takes two images')
        return next(iter(source))


def _check_folder(output: Path) -> None:
    from grasptrack.io.run import prepare_folder

    prepare_folder(output)
