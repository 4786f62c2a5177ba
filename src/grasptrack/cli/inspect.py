# SPDX-License-Identifier: Apache-2.0
"""`grasptrack inspect`: how well the object in an image can be tracked, before the run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grasptrack.cli import first_image, help_groups, options
from grasptrack.cli.advice import PICTURE, names_of_written, note_candidates
from grasptrack.cli.help_groups import as_asked, option_or
from grasptrack.cli.terminal import show_rows
from grasptrack.errors import InputError, ObservationError

if TYPE_CHECKING:
    from grasptrack.trackability import Suitability

_HEADS = ("<", "<found", "<")


def inspect(
    image: Annotated[str, typer.Argument(metavar="IMAGE", help="An image of a flat object, the first of a run.")],
    grasp: options.CarriedGrasp,
    first: first_image.MaskedImage,
    hand: options.HandSize,
    output: options.Output = options.OUTPUT_FOLDER / "inspect",
    json_: options.Json = False,
    quiet: options.Quiet = False,
    max_megapixels: options.MaxMegapixels = None,
    runs: int = option_or(
        4, help_groups.LIMITS, "N", "Number of simulated runs, of 12 images each; more give narrower intervals.", min=1
    ),
) -> None:
    """Predict how well the object in an image can be tracked.

    Runs the tracker on the image itself, moved as an approach would move it, and gives the share of frames that will be located
    and the error of the contacts; which motions the outline shows, its symmetries, edges and contrast; which strategies
    can carry the grasp and why the others cannot; a verdict, and what would help.

    Writes inspect.json and inspect.png, the picture of it; and candidates.png, where the choice of the object is not sure.

    \b
    Examples:
      grasptrack inspect photo.jpg
      grasptrack inspect photo.jpg --object 320,240 --fingers 3
      grasptrack inspect photo.jpg --grasp "193,308 157,99" --json
      grasptrack inspect photo.jpg --camera camera.yaml
    """
    count, size = grasp.finger_count(at_most_three=True), hand.hand_for(grasp)
    scene = first.read_scene(image, "inspect takes one image", grasp.given_contacts())
    lens = scene.lens

    from grasptrack.files import keep_inputs, write_json
    from grasptrack.io.json_results import inspection_to_dict
    from grasptrack.trackability import inspect as look
    from grasptrack.trackability.result import as_seen
    from grasptrack.tracking.camera import Beforehand
    from grasptrack.tracking.numbers import NUMBERS
    from grasptrack.view.inspect import write_inspection

    written = [output / name for name in ("inspect.json", "inspect.png", PICTURE)]
    keep_inputs(written, [image, *first.files()])
    help_groups.hold_until_end(output)
    said = {name: value for name, value in scene.said.tracker_arguments().items() if name != "sure"}
    try:
        found = look(
            scene.image,
            **said,
            fingers=count,
            friction=grasp.friction,
            segmenter=first.segmenter,
            mask=scene.mask,
            hand=size,
            strategy=grasp.strategy,
            risk=grasp.risk,
            tolerance=grasp.allowed_error(hand),
            focal=None if lens is None else Beforehand.by_calibration(lens.focal, NUMBERS),
            runs=runs,
        )
    except ObservationError as error:
        raise InputError(f'"{image}": {error}') from None
    asked = {**first.as_written(), **as_asked(grasp, hand), "fingers": count, "runs": runs}
    data, page = output / "inspect.json", output / "inspect.png"
    write_inspection(page, scene.image, found, title=Path(image).name + (", made straight" if lens is not None else ""))
    found = found if lens is None else as_seen(found, lens)
    by_hand = scene.said.is_settled or first.mask is not None
    notes = note_candidates(
        found.candidates, scene.picture, output, first.sure, meant=by_hand, segmenter=first.segmenter
    )
    content = inspection_to_dict(found, image, scene.picture.shape, asked, names_of_written(written))
    write_json(data, content)
    if json_ and not quiet:
        import json

        typer.echo(json.dumps(content, indent=1))
    elif not quiet:
        _show_results(found, [*notes, *scene.notes, f"{data}, {page}"])


def _show_results(found: Suitability, last: list[str]) -> None:
    from grasptrack.trackability.report import describe_expectation, describe_reasons, report_rows

    told = describe_expectation(found)
    notes = [f"Expected: {told}"] if told else []
    notes += describe_reasons(found)
    advice = f"--strategy {found.strategy}" if found.strategy else "no strategy will do"
    show_rows(f"{found.level.upper()}, {advice}", _HEADS, report_rows(found), [*notes, *last])
