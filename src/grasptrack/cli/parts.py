# SPDX-License-Identifier: Apache-2.0
"""Parts on file.

`grasptrack teach`: a part from one image; `grasptrack parts`: what is on file; `grasptrack find`: every instance in one image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grasptrack.cli import first_image, help_groups, options
from grasptrack.cli.help_groups import option
from grasptrack.cli.terminal import format_number, show_rows, tell_error
from grasptrack.errors import InputError, ObservationError
from grasptrack.presentation import format_confidence

if TYPE_CHECKING:
    from collections.abc import Sequence

    from grasptrack.geometry.contours import View
    from grasptrack.grasp.contacts import Grasp
    from grasptrack.grasp.hand import Hand
    from grasptrack.io.parts import Part
    from grasptrack.tracking.instances import Instance
    from grasptrack.typing import Floats
    from grasptrack.undistortion import Undistortion

_HEADS = ("<part", "<file", "size, px", "size, mm", "holes", "grasps", "fingers")
REMEDIES = {
    "other-shape": "where the outline that was taught is wrong (grasptrack parts FILE draws it), teach the part anew",
    "uncertain": "come nearer; where the camera leans as it did in teaching, say so (--same-tilt)",
    "turned-over": "of a part that cannot lie so, teach it with --face-up",
    "which-part": "teach what tells them apart, or look for one of them only",
}
"""What to try where something is not given, by the code of its reason."""
KEPT = 5
"""Grasps that a part keeps where none is given."""


@dataclass(frozen=True)
class TaughtGrasp(options.GivenGrasp):
    """The grasp that a part is taught with; at what risk it is found is said when it is looked for."""

    risk: float = 1e-3


def teach(
    image: Annotated[str, typer.Argument(metavar="IMAGE", help="An image that shows the part whole, from above.")],
    grasp: TaughtGrasp,
    first: first_image.MaskedImage,
    hand: options.HandSize,
    name: Annotated[str, option(help_groups.OUTPUT, "NAME", "Name of the part, up to 60 characters.")],
    output: Annotated[
        Path, option(help_groups.OUTPUT, "FILE", "File of the part; an existing part is replaced.", "--output")
    ],
    face_up: Annotated[bool, option(help_groups.OBJECT, None, "It never lies turned over.", "--face-up")] = False,
    quiet: options.Quiet = False,
    max_megapixels: options.MaxMegapixels = None,
) -> None:
    """Teach a part from one image, and keep it on file for grasptrack find.

    The file holds a picture of the part, its outline with holes and its grasps: a zip of JSON, PNG and CSV of at most 300 kB.
    With --scale it knows the part's size in mm, too.

    \b
    Examples:
      grasptrack teach photo.jpg --name flange --output flange.part
      grasptrack teach photo.jpg --object 320,240 --name flange --output flange.part --scale 4.2
      grasptrack teach photo.jpg --grasp "193,308 157,99" --name hook --output hook.part
    """
    from grasptrack.files import hold_folder, keep_inputs
    from grasptrack.io.parts import Part

    contacts, fingers, size = grasp.given_contacts(), grasp.finger_count(at_most_three=True), hand.make_hand()
    keep_inputs([output], [image, *first.files()])
    if output.exists():
        try:
            Part.load(output)
        except InputError:
            raise InputError(f'"{output}" is no part, and would be written over: name another file') from None
    scene = first.read_scene(image, "teach takes one image", contacts)
    try:
        view, grasps, probability = _view_and_grasps(scene, first.segmenter, (fingers, grasp.friction, size), contacts)
    except ObservationError as error:
        raise InputError(f'"{image}": {error}') from None
    part = Part.of(scene.image, view, grasps, name=name, friction=grasp.friction, hand=size)
    part = replace(part, face_up=face_up)
    with hold_folder(output.parent):
        part.save(output)
    if not quiet:
        notes = [*scene.notes, str(output)]
        if probability < first.sure:
            told = f"the object was chosen with a probability of {100.0 * probability:.0f} %, which is not sure"
            notes.insert(0, f"{told}: look at it (grasptrack parts {output}); --object or --outline say which is meant")
        show_rows("Taught", _HEADS, [_row_cells(part, output.name)], notes)


def _view_and_grasps(
    scene: first_image.UserScene, segmenter: str | None, asked: tuple[int, float, Hand], contacts: Floats | None
) -> tuple[View, Sequence[Grasp], float]:
    """The part's outline, its grasps, and the probability that the outline is meant; 1 where a person said which."""
    from grasptrack.grasp.contacts import Grasp
    from grasptrack.grasp.synthesis import synthesize
    from grasptrack.segmentation.first_look import look_for
    from grasptrack.segmentation.segmenters import segmenter_for
    from grasptrack.tracking.initialization import object_at_contacts

    said, settled = scene.said, scene.said.is_settled or scene.mask is not None
    if contacts is not None and said.grasp is not None:
        found = look_for(scene.image, said, segmenter_for(segmenter), scene.mask)
        meant = object_at_contacts(found, said.grasp, said.number)
        return meant.view, [Grasp(said.grasp.contacts).snapped(meant.view)], 1.0 if settled else meant.probability
    views, _, probability = first_image.find_outlines(scene, segmenter)
    (fingers, friction, hand), others = asked, views[1:]
    made = synthesize(views[0], fingers, friction, None, KEPT, hand=hand, neighbours=others)
    if not made:
        raise ObservationError(f"no grasp: {made.reason}")
    return views[0], made, 1.0 if settled else probability


def parts(
    folder: Annotated[str, typer.Argument(metavar="DIR", help="Folder with files of parts, or one such file.")],
    output: options.Output = options.OUTPUT_FOLDER / "parts",
    json_: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """List the parts on file, and draw each with its outline and first grasp.

    Writes parts.json, and parts.png, the picture of them.

    \b
    Examples:
      grasptrack parts shelf
      grasptrack parts flange.part --output pictures
    """
    from grasptrack.files import keep_inputs, write_json
    from grasptrack.io.json_results import parts_to_dict
    from grasptrack.io.parts import Part, part_files
    from grasptrack.view.instances import write_parts

    files = part_files([folder])
    data, picture = output / "parts.json", output / "parts.png"
    keep_inputs([data, picture], files)
    listed = [Part.load(file) for file in files]
    help_groups.hold_until_end(output)
    write_parts(picture, listed)
    write_json(data, {**parts_to_dict(listed, [str(file) for file in files]), "files": [data.name, picture.name]})
    if json_ and not quiet:
        typer.echo(data.read_text(encoding="utf-8").rstrip())
    elif not quiet:
        rows = [_row_cells(part, file.name) for part, file in zip(listed, files, strict=True)]
        show_rows("Parts on file", _HEADS, rows, [f"{data}, {picture}"])


def _row_cells(part: Part, file: str) -> list[str]:
    low, high = part.view.outer.points.min(axis=0), part.view.outer.points.max(axis=0)
    wide, tall = (high - low).tolist()
    millimetres = "" if math.isnan(part.px_per_mm) else " x ".join(format_number(v) for v in part.size_mm)
    holes, fingers = len(part.view.contours) - 1, len(part.grasps[0])
    return [part.name, file, f"{wide:.0f} x {tall:.0f}", millimetres, str(holes), str(len(part.grasps)), str(fingers)]


# --- find -----------------------------------------------------------------------------------------


NONE_FOUND = 3
"""Exit status when nothing is found."""
_FOUND_HEADS = ("#", "<part", "<contacts, px", "confidence", "edge", "room, px", "<reason")


def find(
    image: Annotated[str, typer.Argument(metavar="IMAGE", help="Image in which parts are looked for.")],
    part: Annotated[
        list[str],
        option(
            help_groups.OBJECT, "FILE", "Part, or folder of parts, from grasptrack teach; may be repeated.", "--part"
        ),
    ],
    same_tilt: options.SameTilt = False,
    camera: first_image.CameraPath = None,
    ignore: first_image.IgnorePath = None,
    risk: options.Risk = 1e-3,
    output: options.Output = options.OUTPUT_FOLDER / "find",
    json_: options.Json = False,
    quiet: options.Quiet = False,
    max_megapixels: options.MaxMegapixels = None,
) -> None:
    """Find every instance of parts on file in one image, the easiest to grasp first.

    Any turn, scales of 0.4 to 2.5 against the image that taught the part, and tilts up to 45 degrees. What lies turned over,
    what two parts explain, and what is not believed is listed with its reason, and never given as found.

    Writes instances.png, instances.csv and instances.json. Exit status 3 when nothing is found.

    \b
    Examples:
      grasptrack find tray.jpg --part flange.part
      grasptrack find tray.jpg --part shelf --output tray
      grasptrack find tray.jpg --part flange.part --part hook.part --risk 1e-5 --json
    """
    from grasptrack.files import keep_inputs, write_json
    from grasptrack.first_image import FirstImage
    from grasptrack.io.json_results import instances_to_dict, write_instances_csv
    from grasptrack.io.parts import load_parts, part_files
    from grasptrack.tracking.instances import find as find_instances
    from grasptrack.view.instances import draw_instances
    from grasptrack.view.style import write_picture

    files = part_files(part)
    written = [output / name for name in ("instances.json", "instances.csv", "instances.png")]
    keep_inputs(written, [image, *files, *(path for path in (ignore, camera) if path is not None)])
    known, calibration = load_parts(files, same_tilt=same_tilt), first_image.load_calibration(camera)
    said = FirstImage.of(ignore=first_image.read_ignored(ignore))
    picture = first_image.only_image(image, "find takes one image").image
    help_groups.hold_until_end(output)
    scene = first_image.straighten(picture, said, calibration)
    found = find_instances(scene.image, known, risk=risk, ignore=scene.said.ignore)
    if scene.lens is not None:
        found = [_map_to_original(one, scene.lens) for one in found]
    data, table, drawn = written
    write_picture(drawn, draw_instances(picture, found))
    write_instances_csv(table, found)
    asked = {"parts": [str(file) for file in files], "risk": risk, "camera": camera, "ignore": ignore}
    asked |= {"same_tilt": same_tilt}
    content = instances_to_dict(found, image, picture.shape, asked)
    write_json(data, {**content, "files": [path.name for path in written]})
    if json_ and not quiet:
        typer.echo(data.read_text(encoding="utf-8").rstrip())
    elif not quiet:
        _show_results(found, [*scene.notes, ", ".join(map(str, written))])
    if not any(one.found for one in found):
        names = ", ".join(f'"{each.name}"' for each in known)
        tell_error(f'"{image}": no instance of {names} was found')
        raise typer.Exit(NONE_FOUND)


def _map_to_original(one: Instance, lens: Undistortion) -> Instance:
    """What was found in a straight image, in px of the image as it is; the homography stays between straight images."""
    contacts = None if one.contacts is None else lens.points_seen(one.contacts)
    return replace(one, view=lens.view_seen(one.view), contacts=contacts)


def _show_results(found: Sequence[Instance], notes: list[str]) -> None:
    rows = []
    for number, one in enumerate(found, 1):
        at = "" if one.contacts is None else " ".join(f"{x:.1f},{y:.1f}" for x, y in one.contacts.tolist())
        room = "free" if one.room == float("inf") else f"{one.room:.0f}"
        edge = f"{100.0 * one.edge:.0f} %"
        rows.append([str(number), one.part, at, format_confidence(one.confidence), edge, room, one.reason_code])
        if one.any_turn and one.found:
            notes.insert(0, f"{number}: it is round: the grasp is as good in any turn")
        if one.turns:
            turns = ", ".join(f"{turn:+.0f}°" for turn in one.turns)
            notes.insert(0, f"{number}: the outline fits as well turned by {turns}: any of these is as good a grasp")
    codes = dict.fromkeys(one.reason_code for one in found)
    notes = [*(f"{code}: {REMEDIES[code]}" for code in codes if code in REMEDIES), *notes]
    show_rows("Instances, the easiest to grasp first", _FOUND_HEADS, rows, notes)
