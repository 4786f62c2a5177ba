# SPDX-License-Identifier: Apache-2.0
"""Tables VI and VII on contours of real images: two films of a flat object, with truths that its print gives.

The truths are homographies from features on the print, independent of the outline, and themselves good to half a pixel.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from grasptrack.geometry.contours import View
from grasptrack.io.sources import open_source
from grasptrack.segmentation.first_look import first_look
from grasptrack_bench.metrics.errors import ErrorMeasure
from grasptrack_bench.records import read_homographies
from research.paper.footage import FilmedPart, Footage, describable_contacts, follow_outlines, middle_frame
from research.paper.printed import TRANSFERS
from research.paper.transfers import transfer_and_measure, transfer_and_return, ways_of
from research.studies import common

FILMS = ("bruegel-62", "postcard-161")
"""A plate with a notch and a chamfer, and a card, whose outline maps to itself by a half turn."""


def film_footage(name: str, data: Path, frames: int | None = None) -> Footage:
    """The outlines of a film."""
    H = np.array([*read_homographies(data / "videos" / f"{name}.derived_homographies.csv").values()])[:frames]
    images = [frame.image for frame, _ in zip(open_source(data / "videos" / f"{name}.mp4"), H, strict=False)]
    view = first_look(images[0])[0].view
    contacts = describable_contacts(view)
    seen = follow_outlines(iter(images), H, contacts)
    first = seen[0][0]
    assert isinstance(first, View)
    areas = [sum(c.transformed(h).signed_area for c in first.contours) for h in H]
    part = FilmedPart(name, tuple(c.points for c in first.contours), first, contacts)
    return Footage(part, "filmed", "6 DoF", H, np.array(areas), *seen)


def error_rows(footage: Footage) -> Iterator[list[str]]:
    """One row for each strategy and way: R_v E and R_f E at the middle frame, SE, how many were answered, why not all."""
    half = middle_frame(len(footage.H))
    for transfer, strategies in TRANSFERS.items():
        for strategy in strategies:
            for way in ways_of(strategy):
                course = transfer_and_measure(footage, strategy, way)
                back = transfer_and_return(footage, strategy, half).error if way == "first view" else None
                cells = [_average(back), _average(course.errors[half - 1]), _average(course.sequence)]
                worst = f"{course.sequence.maximum_px:.3g}" if course.sequence else "-"
                answered = f"{len(course.answered)} of {len(course.errors)}"
                why = next(iter(course.reasons), "")
                yield [footage.part.name, transfer, strategy.removeprefix("paper-"), way, *cells, worst, answered, why]


def _average(error: ErrorMeasure | str | None) -> str:
    if error is None:
        return "-"
    return "refused" if isinstance(error, str) else f"{error.average_px:.3g}"


def main() -> None:
    """Run the study."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--data", type=Path, default=common.data_folder(), help="folder with videos/")
    parser.add_argument("--films", default=",".join(FILMS), help="names of films [all]")
    parser.add_argument("--frames", type=int, help="the first so many frames of each film [all]")
    asked = parser.parse_args()
    rows = [r for name in asked.films.split(",") for r in error_rows(film_footage(name, asked.data, asked.frames))]
    common.begin_section("Tables VI and VII on real contours")
    common.add_paragraph(
        "px. R_v E: e_av, to the frame in the middle and back. R_f E: e_av in that frame. SE: mean of e_av over the frames "
        "answered, and the worst contact. The truths are homographies from the print, themselves good to half a pixel; RRP "
        "works on a snake of 4 DoF, the others on outlines that were extracted and begin where the truth has it. -: nothing "
        "to measure."
    )
    head = ["film", "transfer", "strategy", "way", "R_v E", "R_f E", "SE", "worst", "answered", "refused, mostly"]
    common.add_table(head, rows)
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()
