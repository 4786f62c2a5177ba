# SPDX-License-Identifier: Apache-2.0
"""`grasptrack inspect`: how well the object in an image can be tracked, before the run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grasptrack.cli import first_image, help_groups, options
from grasptrack.cli.candidates import note_candidates
from grasptrack.cli.terminal import show_rows
from grasptrack.errors import InputError, ObservationError

if TYPE_CHECKING:
    from grasptrack.trackability import Suitability

_HEADS = (("", "left"), ("found", "left"), ("", "left"))
Runs = Annotated[
    int,
    typer.Option(
        metavar="N",
        min=1,
        rich_help_panel=help_groups.LIMITS,
        help="Number of simulated runs, of 12 images each; more give narrower intervals.",
    ),
]


def inspect(
    image: Annotated[str, typer.Argument(metavar="IMAGE", help="An image of a flat object, the first of a run.")],
    strategy: options.StrategyName = "auto",
    fingers: options.Fingers = None,
    friction: options.Friction = 0.5,
    grasp: options.GraspText = None,
    object_: first_image.ObjectTexts = None,
    not_: first_image.NotTexts = None,
    box: first_image.BoxText = None,
    outline: first_image.OutlineText = None,
    mask: first_image.MaskPath = None,
    choose: first_image.ChooseNumber = None,
    sure: first_image.Sure = 0.9,
    segmenter: first_image.SegmenterName = None,
    background: first_image.BackgroundPath = None,
    min_opening: options.MinOpening = None,
    max_opening: options.MaxOpening = None,
    finger_width: options.FingerWidth = None,
    finger_thickness: options.FingerThickness = None,
    clearance: options.Clearance = None,
    scale: options.Scale = None,
    camera: first_image.CameraPath = None,
    ignore: first_image.IgnorePath = None,
    output: options.Output = options.OUTPUT / "inspect",
    json_: options.Json = False,
    quiet: options.Quiet = False,
    risk: options.Risk = 1e-3,
    first_look_ms: first_image.FirstLookMs = None,
    max_megapixels: options.MaxMegapixels = None,
    runs: Runs = 4,
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
    contacts, count = options.contacts_and_fingers(grasp, fingers)
    said = first_image.first_image(
        object_, not_, box, outline, grasp=contacts, number=choose, sure=sure, first_look_ms=first_look_ms
    )
    if contacts is None:
        options.two_or_three(count)
    options.positive_friction(friction)
    options.risk_rate(risk)
    options.strategy_choice(strategy)
    lengths = options.hand_lengths(min_opening, max_opening, finger_width, finger_thickness, clearance)
    hand = options.hand_for_first(scale, lengths, grasp, False)
    calibration = first_image.load_calibration(camera)
    empty = first_image.background_image(background, mask)

    from grasptrack.documents import write_json
    from grasptrack.first_image import DEFAULT_SURE
    from grasptrack.io.folder import prepare_folder
    from grasptrack.io.json_results import inspection_to_dict
    from grasptrack.io.masks import read_mask
    from grasptrack.trackability import inspect as look
    from grasptrack.trackability.result import as_seen
    from grasptrack.tracking.camera import Beforehand
    from grasptrack.tracking.numbers import NUMBERS
    from grasptrack.view.inspect import write_inspection

    picture = first_image.only_image(image, "inspect takes one image").image
    with first_image.by_option():
        said.within(picture.shape)
    own = None if mask is None else read_mask(mask)
    said = replace(said, ignore=first_image.ignore_mask(ignore), background=empty, sure=DEFAULT_SURE)
    prepare_folder(output)
    scene = first_image.straighten_scene(picture, said, calibration, own)
    lens = scene.lens
    try:
        found = look(
            scene.image,
            **scene.said.arguments(),
            fingers=count,
            friction=friction,
            segmenter=segmenter,
            mask=scene.mask,
            hand=hand,
            strategy=strategy,
            risk=risk,
            focal=None if lens is None else Beforehand.by_calibration(lens.focal, NUMBERS),
            runs=runs,
        )
    except ObservationError as error:
        raise InputError(f'"{image}": {error}') from None
    asked = {
        **first_image.told_words(object_, not_),
        "box": box,
        "outline": outline,
        "choose": choose,
        "sure": sure,
        "mask": mask,
        "first_look_ms": first_look_ms,
        "segmenter": segmenter,
        "background": background,
        "ignore": ignore,
        "camera": camera,
        "grasp": grasp,
        "fingers": count,
        "friction": friction,
        "risk": risk,
        "strategy": strategy,
        "runs": runs,
        **lengths,
        "scale": scale,
    }
    data, page = output / "inspect.json", output / "inspect.png"
    write_inspection(page, scene.image, found, title=Path(image).name + (", made straight" if lens is not None else ""))
    found = found if lens is None else as_seen(found, lens)
    by_hand = said.is_settled or mask is not None
    notes = [
        *note_candidates(found.candidates, picture, output, sure, meant=by_hand),
        *first_image.scaling_notes(calibration, picture.shape),
        f"{data}, {page}",
    ]
    content = inspection_to_dict(found, image, picture.shape, asked)
    write_json(data, content)
    if json_ and not quiet:
        import json

        typer.echo(json.dumps(content, ensure_ascii=False, indent=1))
    elif not quiet:
        _show_results(found, notes)


def _show_results(found: Suitability, last: list[str]) -> None:
    from grasptrack.trackability.report import describe_expectation, describe_reasons, report_rows

    told = describe_expectation(found)
    notes = [f"Expected: {told}"] if told else []
    notes += describe_reasons(found)
    advice = f"--strategy {found.strategy}" if found.strategy else "no strategy will do"
    show_rows(f"{found.level.upper()}, {advice}", _HEADS, report_rows(found), [*notes, *last])
