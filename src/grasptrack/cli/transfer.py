# SPDX-License-Identifier: Apache-2.0
"""`grasptrack transfer`: the same grasp in two views, by every strategy."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from grasptrack.cli import first_image, help_groups, options
from grasptrack.cli.help_groups import as_asked, option_or
from grasptrack.cli.terminal import format_number, show_rows, tell_error
from grasptrack.errors import GraspTrackError, InputError, TransferError
from grasptrack.presentation import format_confidence

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grasptrack.geometry.contours import View
    from grasptrack.tracking.image_pair import Outcome, Pair, Place
    from grasptrack.undistortion import Undistortion

REFUSED = 3
"""Exit status when every strategy refuses."""
_HEADS = ("<strategy", "<contacts, px", "confidence", "off by, px", "<stable", "margin")


def transfer(
    image_a: Annotated[str, typer.Argument(metavar="IMAGE_A", help="Reference image.")],
    image_b: Annotated[str, typer.Argument(metavar="IMAGE_B", help="Image to transfer the grasp to.")],
    grasp: options.GivenGrasp,
    object_a: str | None = option_or(
        None,
        help_groups.OBJECT,
        "X,Y",
        "Pixel on the object in IMAGE_A, in px.",
        "--object",
        show_default="the object that stands out most",
    ),
    object_b: str | None = option_or(
        None,
        help_groups.OBJECT,
        "X,Y",
        "Pixel on the object in IMAGE_B, in px.",
        show_default="the object that fits best",
    ),
    camera: first_image.CameraPath = None,
    ignore: first_image.IgnorePath = None,
    output: options.Output = options.OUTPUT_FOLDER / "transfer",
    json_: options.Json = False,
    quiet: options.Quiet = False,
    max_megapixels: options.MaxMegapixels = None,
) -> None:
    """Transfer a grasp from one view of an object to another: each strategy's contacts, or why they are rejected.

    The views may differ by any turn, by scale and by tilts up to 60 degrees. "registration" lays outline and surface on
    IMAGE_B; the three strategies of the paper follow.

    "off by" is the error of the worst contact as measured in IMAGE_B. "confidence" is the probability that no contact is off by
    more than 3 px and 4 % of the root of the object's area, or on another object; a strategy is refused where the
    probability of being wrong is --risk or more. Where several places fit equally well, all are listed.

    Writes transfer.json, and transfer.png, both views side by side. Exit status 3 when every strategy refuses.

    \b
    Examples:
      grasptrack transfer a.png b.png
      grasptrack transfer a.png b.png --object 320,240 --object-b 300,250
      grasptrack transfer a.png b.png --grasp "193,308 157,99" --output pictures
      grasptrack transfer a.png b.png --camera camera.yaml
      grasptrack transfer a.png b.png --risk 1e-5 --json
    """
    from grasptrack.files import keep_inputs
    from grasptrack.first_image import FirstImage
    from grasptrack.grasp.contacts import Grasp
    from grasptrack.tracking.camera import Beforehand
    from grasptrack.tracking.image_pair import transfer_between_images
    from grasptrack.tracking.numbers import NUMBERS
    from grasptrack.tracking.tracker import GraspTracker

    contacts, count = grasp.given_contacts(), grasp.finger_count()
    hidden, calibration = first_image.read_ignored(ignore), first_image.load_calibration(camera)
    pixels = ((object_a, "--object"), (object_b, "--object-b"))
    places = [None if text is None else first_image.parse_pair(text, written) for text, written in pixels]
    meant = FirstImage.of(places[0], grasp=contacts, ignore=hidden), FirstImage.of(places[1], ignore=hidden)
    images = [first_image.only_image(name, "transfer takes two images").image for name in (image_a, image_b)]
    read = [path for path in (image_a, image_b, ignore, camera) if path is not None]
    keep_inputs((output / name for name in ("transfer.json", "transfer.png")), read)
    help_groups.hold_until_end(output)
    one, other = (first_image.straighten(image, said, calibration) for image, said in zip(images, meant, strict=True))
    lens = one.lens
    # The first step of a sequence, so that object and grasp are chosen here as they are there.
    begun = GraspTracker(fingers=count, friction=grasp.friction, **one.said.tracker_arguments())
    chosen = begun.update(one.image)
    if chosen.contacts is None or chosen.view is None:
        raise InputError(f'"{image_a}": {chosen.reason}')
    pair, refusal = None, ""
    focal = None if lens is None else Beforehand.by_calibration(lens.focal, NUMBERS)
    try:
        pair = transfer_between_images(
            Grasp(chosen.contacts), chosen.view, one.image, other.image, grasp.friction, other.said, grasp.risk, focal
        )
    except TransferError as error:
        refusal = str(error)
    except GraspTrackError as error:
        raise InputError(f'"{image_b}": {error}') from None

    view, at = chosen.view, chosen.contacts
    if lens is not None:
        view, at = lens.view_seen(view), lens.points_seen(at)
    found = _Found.all_refused(refusal) if pair is None else _Found.from_pair(pair, other.lens)
    asked = {**as_asked(grasp), "fingers": count, "object": object_a, "object_b": object_b}
    asked |= {"ignore": ignore, "camera": camera}
    files = _write_files(output, (image_a, image_b), (images[0], view, at), images[1], found, asked)
    if json_ and not quiet:
        typer.echo(files[0].read_text(encoding="utf-8").rstrip())
    elif not quiet:
        _show_results(chosen.analysis, at, found, one.notes, files)
    if all(o.reason for o in found.outcomes):
        tell_error(f'"{image_b}": every strategy refuses: {found.outcomes[0].reason}')
        raise typer.Exit(REFUSED)


class _Found(NamedTuple):
    """What is told of the second image: outline (None where the object was not found), outcomes, places, ambiguity."""

    current: View | None
    outcomes: list[Outcome]
    places: list[Place]
    ambiguous: str

    @classmethod
    def all_refused(cls, reason: str) -> _Found:
        """Every strategy refuses for one reason."""
        from grasptrack.tracking.image_pair import Outcome
        from grasptrack.tracking.strategies import REGISTRATION
        from grasptrack.transfer import strategy_names

        names = (REGISTRATION, *strategy_names())
        return cls(None, [Outcome(name, None, None, None, math.nan, reason) for name in names], [], "")

    @classmethod
    def from_pair(cls, pair: Pair, lens: Undistortion | None) -> _Found:
        """Of a pair, in px of the image as it is."""
        ambiguous = ""
        if pair.turns:
            others = ", ".join(f"{turn:+.0f}°" for turn in pair.turns)
            ambiguous = f"the outline fits as well turned by {others}; the image cannot tell which is right"
        elif pair.found.status == "ambiguous":
            ambiguous = pair.found.reason
        elif pair.places:
            ambiguous = "the object fits elsewhere as well"
        if lens is None:
            return cls(pair.current, pair.outcomes, list(pair.places), ambiguous)
        outcomes = [
            o if o.contacts is None else o._replace(contacts=lens.points_seen(o.contacts)) for o in pair.outcomes
        ]
        places = [p._replace(contacts=lens.points_seen(p.contacts)) for p in pair.places]
        return cls(lens.view_seen(pair.current), outcomes, places, ambiguous)


def _write_files(
    output: Path,
    names: tuple[str, str],
    reference: tuple[NDArray[Any], View, NDArray[Any]],
    second: NDArray[Any],
    found: _Found,
    asked: dict[str, Any],
) -> list[Path]:
    """transfer.json, and transfer.png where the object was found; an older picture goes."""
    from grasptrack.files import write_json
    from grasptrack.io.json_results import transfer_to_dict
    from grasptrack.view.pair import write_pair

    data, picture = output / "transfer.json", output / "transfer.png"
    content = transfer_to_dict(names, reference[2], found.outcomes, found.places, found.ambiguous, asked)
    write_json(data, {**content, "files": [data.name, *([] if found.current is None else [picture.name])]})
    if found.current is None:
        picture.unlink(missing_ok=True)
        return [data]
    believed = {o.strategy: o.contacts for o in found.outcomes if o.contacts is not None and not o.reason}
    refused = {o.strategy: o.reason for o in found.outcomes if o.reason}
    titles = Path(names[0]).name, Path(names[1]).name
    write_pair(picture, reference, (second, found.current), believed, refused, titles)
    return [data, picture]


def _show_results(analysis: Any, at: NDArray[Any], found: _Found, notes: list[str], files: list[Path]) -> None:
    rows, notes = [["(reference)", _format_contacts(at), "", "", *_stability_cells(analysis)]], notes[:]
    for o in found.outcomes:
        cells = [format_confidence(o.confidence), format_number(o.off)]
        if o.reason:
            rows.append([o.strategy, "refused", *cells, "", ""])
            notes.append(f"{o.strategy} refused: {o.reason}")
        else:
            rows.append([o.strategy, _format_contacts(o.contacts), *cells, *_stability_cells(o.analysis)])
    if found.ambiguous:
        notes.append(f"ambiguous: {found.ambiguous}")
    for i, place in enumerate(found.places):
        turned = f", turned by {place.turn:+.0f}°" if i else ""
        notes.append(
            f"{'or' if i else 'either'} {_format_contacts(place.contacts)}{turned}: {100.0 * place.share:.3g} %"
        )
    show_rows("The grasp in both views", _HEADS, rows, [*notes, ", ".join(map(str, files))])


def _stability_cells(analysis: Any) -> list[str]:
    """Cells: stable or not, and the margin."""
    if analysis is None:
        return ["", ""]
    return ["yes" if analysis.stable else "no", f"{math.degrees(analysis.margin):+.1f}°"]


def _format_contacts(contacts: Any) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in contacts.tolist())
