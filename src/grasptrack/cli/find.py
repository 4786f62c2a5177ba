# SPDX-License-Identifier: Apache-2.0
"""`grasptrack find`: every instance of parts on file in one image."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from grasptrack.cli import first_image, help_groups, options
from grasptrack.cli.help_groups import option
from grasptrack.cli.terminal import show_rows, tell_error
from grasptrack.presentation import format_confidence

if TYPE_CHECKING:
    from collections.abc import Sequence

    from grasptrack.tracking.instances import Instance
    from grasptrack.undistortion import Undistortion

NONE_FOUND = 3
"""Exit status when nothing is found."""
_HEADS = ("#", "<part", "<contacts, px", "confidence", "edge", "room, px", "<reason")


def find(
    image: Annotated[str, typer.Argument(metavar="IMAGE", help="Image in which parts are looked for.")],
    part: Annotated[
        list[str],
        option(
            help_groups.OBJECT, "FILE", "Part, or folder of parts, from grasptrack teach; may be repeated.", "--part"
        ),
    ],
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
    from grasptrack.view.instances import write_instances

    files = part_files(part)
    written = [output / name for name in ("instances.json", "instances.csv", "instances.png")]
    keep_inputs(written, [image, *files, *(path for path in (ignore, camera) if path is not None)])
    known, calibration = load_parts(files), first_image.load_calibration(camera)
    said = FirstImage.of(ignore=first_image.read_ignored(ignore))
    picture = first_image.only_image(image, "find takes one image").image
    help_groups.hold_until_end(output)
    scene = first_image.straighten(picture, said, calibration)
    found = find_instances(scene.image, known, risk=risk, ignore=scene.said.ignore)
    if scene.lens is not None:
        found = [_map_to_original(one, scene.lens) for one in found]
    data, table, drawn = written
    write_instances(drawn, picture, found)
    write_instances_csv(table, found)
    asked = {"parts": [str(file) for file in files], "risk": risk, "camera": camera, "ignore": ignore}
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
        if one.turns:
            turns = ", ".join(f"{turn:+.0f}°" for turn in one.turns)
            notes.insert(0, f"{number}: the outline fits as well turned by {turns}: any of these is as good a grasp")
    show_rows("Instances, the easiest to grasp first", _HEADS, rows, notes)
