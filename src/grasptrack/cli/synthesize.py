# SPDX-License-Identifier: Apache-2.0
"""`grasptrack synthesize`: the best grasps on an object in one image, and what their rank rests on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grasptrack.cli import first_image, help_groups, options
from grasptrack.cli.advice import PICTURE, names_of_written, note_candidates
from grasptrack.cli.help_groups import as_asked, option_or
from grasptrack.cli.terminal import show_rows
from grasptrack.errors import InputError, ObservationError

if TYPE_CHECKING:
    from grasptrack.geometry.contours import View
    from grasptrack.grasp.contacts import RankedGrasp
    from grasptrack.grasp.hand import Hand
    from grasptrack.undistortion import Undistortion
    from grasptrack.view.grasps import Planned

_TERMS = ("quality", "closure", "centre", "flat", "room", "span")
_HEADS = ("#", "<contacts, px", "<kind", "opening\npx", "margin", "slip\npx", *_TERMS)


def synthesize(
    image: Annotated[str, typer.Argument(metavar="IMAGE", help="An image of a flat object, seen from above.")],
    first: first_image.MaskedImage,
    hand: options.HandSize,
    fingers: options.TwoOrThree = 2,
    friction: options.Friction = 0.5,
    top: int = option_or(10, help_groups.GRASP, "N", "Number of grasps at most."),
    all_: bool = option_or(False, help_groups.OBJECT, None, "Grasps on every object in the image.", "--all"),
    output: options.Output = options.OUTPUT_FOLDER / "synthesize",
    quiet: options.Quiet = False,
    max_megapixels: options.MaxMegapixels = None,
) -> None:
    """Choose the best grasps on the object in an image, for a hand of a given size.

    Every grasp closes with the friction given, fits the hand, and leaves room for each finger and its way in.

    Writes grasps.json and grasps.png, the picture of them; and candidates.png, where the choice of the object is not sure.

    \b
    Examples:
      grasptrack synthesize photo.jpg
      grasptrack synthesize photo.jpg --object 320,240 --fingers 3
      grasptrack synthesize photo.jpg --max-opening 85mm --finger-width 12mm --scale 4.2
      grasptrack synthesize photo.jpg --camera camera.yaml
      grasptrack synthesize photo.jpg --mask mask.png --all --output grasps
    """
    if all_ and first.first_image().says_anything:
        raise InputError(
            "--all takes every object in the image: leave out --object, --not, --box, --outline and --choose"
        )
    if top < 1:
        raise InputError(f"--top is at least 1, not {top}", top=top)
    size, scale = hand.make_hand(), hand.scale
    scene = first.read_scene(image, "synthesize takes one image")

    from grasptrack.files import keep_inputs, write_json
    from grasptrack.io.json_results import grasps_to_dict
    from grasptrack.view.grasps import write_grasps

    written = [output / name for name in ("grasps.json", "grasps.png", PICTURE)]
    keep_inputs(written, [image, *first.files()])
    help_groups.hold_until_end(output)
    try:
        views, candidates, probability = first_image.find_outlines(scene, first.segmenter)
    except ObservationError as error:
        raise InputError(f'"{image}": {error}') from None
    planned = _plan_grasps(views, all_, fingers, friction, top, size)
    if scene.lens is not None:
        planned = [_map_to_original(found, scene.lens) for found in planned]

    chosen = {"fingers": fingers, "top": top, "friction": friction}
    asked = {**first.as_written(), **chosen, **as_asked(hand), "all": all_}
    by_hand = all_ or first.outline is not None or first.mask is not None
    notes = [
        *note_candidates(candidates, scene.image, output, first.sure, meant=by_hand, segmenter=first.segmenter),
        *scene.notes,
    ]
    data, page = output / "grasps.json", output / "grasps.png"
    content = grasps_to_dict(planned, image, scene.picture.shape, asked, scale)
    choice = {"object_sure": by_hand or not candidates, "object_probability": probability}
    write_json(data, {**content, **choice, "files": names_of_written(written)})
    title = Path(image).name
    write_grasps(page, scene.picture, planned, fingers=fingers, friction=friction, title=title, px_per_mm=scale)
    if not any(found.grasps for found in planned):
        where = "" if len(planned) == 1 else f" on any of {len(planned)} objects"
        raise InputError(f'"{image}": no grasp{where}: {planned[0].grasps.reason}')
    if not quiet:
        _show_results(planned, scale, [*notes, f"{data}, {page}"])


def _plan_grasps(views: list[View], every: bool, fingers: int, friction: float, top: int, hand: Hand) -> list[Planned]:
    """Grasps on the first outline, or on each; all others are in the way."""
    from grasptrack import kernels
    from grasptrack.grasp.synthesis import synthesize
    from grasptrack.view.grasps import Planned

    planned = []
    for view in views if every else views[:1]:
        others = [other for other in views if other is not view]
        grasps = synthesize(view, fingers, friction, None, top, hand=hand, neighbours=others)
        size = math.sqrt(kernels.polygon_moments(view.points, view.offsets).area)
        planned.append(Planned(view, others, hand.in_px(size), grasps))
    return planned


def _map_to_original(found: Planned, lens: Undistortion) -> Planned:
    """What was planned in a straight image, in px of the image as it is."""
    from grasptrack.grasp.synthesis import GraspList

    grasps = GraspList([lens.grasp_seen(g) for g in found.grasps], found.grasps.reason, found.grasps.refused)
    others = [lens.view_seen(view) for view in found.neighbours]
    return found._replace(outline=lens.view_seen(found.outline), neighbours=others, grasps=grasps)


def _show_results(planned: Sequence[Planned], scale: float | None, notes: list[str]) -> None:
    several = len(planned) > 1
    heads = [*(["object"] if several else []), *_HEADS]
    if scale is not None:
        heads.insert(heads.index("margin"), "\nmm")
    rows, told = [], []
    for i, found in enumerate(planned):
        of = f"object {i + 1}: " if several else ""
        for rank, grasp in enumerate(found.grasps):
            rows.append([*([str(i + 1)] if several else []), *_row_cells(rank + 1, grasp, scale)])
        if not found.grasps:
            told.append(f"{of}no grasp: {found.grasps.reason}")
        elif found.outline.is_clipped:
            told.append(f"{of}cut by the border: its centre is that of the part in view")
        if found.grasps.refused:
            counts = ", ".join(f"{reason} ({count})" for reason, count in found.grasps.refused.items())
            told.append(f"{of}refused: {counts}")
    show_rows("Grasps, the best first", heads, rows, [*told, *notes], optional=5)


def _row_cells(rank: int, grasp: RankedGrasp, scale: float | None) -> list[str]:
    from grasptrack.view.grasps import format_quality
    from grasptrack.view.panel import grasp_opening

    return [
        str(rank),
        " ".join(f"{x:.0f},{y:.0f}" for x, y in grasp.contacts.tolist()),
        "spread" if grasp.spread else "squeeze",
        f"{grasp_opening(grasp):.1f}",
        *([] if scale is None else [f"{grasp_opening(grasp) / scale:.1f}"]),
        f"{math.degrees(grasp.margin):.1f}°",
        f"{grasp.regions.min():.1f}",
        format_quality(grasp.quality),
        *(f"{value:.2f}" for value in grasp.terms),
    ]
