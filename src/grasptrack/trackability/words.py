# SPDX-License-Identifier: Apache-2.0
"""An inspection in words: the same rows in the terminal and beside the picture."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from grasptrack.trackability.motions import SLIDING, Motions
from grasptrack.trackability.result import Held, Suitability
from grasptrack.trackability.strategies import PEAKS
from grasptrack.trackability.symmetry import Symmetry

HARDLY = 0.9
"""What leaves more than this share of an error adds nothing worth telling."""


class Row(NamedTuple):
    """One row: of what, the figure, and what goes with it."""

    name: str
    value: str
    note: str


def report_rows(found: Suitability) -> list[Row]:
    """All that was found, in rows."""
    looks = found.looks
    holes = {0: "no hole", 1: "1 hole"}.get(looks.holes, f"{looks.holes} holes")
    border = "cut by the border" if looks.clipped else f"{looks.border:.0f} px from the border"
    listed = [
        Row("object", f"{looks.size:.0f} px", f"{100.0 * looks.share:.0f} % of the image, {border}, {holes}"),
        Row(
            "contrast", f"{looks.contrast:.0f} levels", f"noise {looks.noise:.1f}, the ground's grain {looks.grain:.1f}"
        ),
        Row("edges", f"{100.0 * looks.clear:.0f} % clear", f"{looks.sharpness:.1f} px wide"),
        Row("motions", describe_motions(found.motions), describe_weakest_motion(found.motions)),
        Row("symmetry", describe_symmetry(found.symmetry), f"equal objects in view: {len(found.equals) or 'none'}"),
        Row("peaks", str(len(found.peaks)), f"a homography needs {PEAKS}"),
        Row("surface", f"{found.surface.rms:.1f} levels/px", describe_texture(found, "surface")),
        Row("ground", f"{found.ground.rms:.1f} levels/px", describe_texture(found, "ground")),
    ]
    listed += [Row(u.name, "no" if u.reason else "yes", u.reason) for u in found.strategies]
    if found.grasp is None:
        return [*listed, Row("grasp", "none", "")]
    return [*listed, *_grasp_rows(found, found.grasp)]


def _grasp_rows(found: Suitability, grasp: Held) -> list[Row]:
    run = found.prediction
    error = format_px(found.error_px) if math.isfinite(found.error_px) else "not known"
    listed = [
        Row(
            "grasp",
            f"{grasp.opening:.0f} px wide",
            f"margin {math.degrees(grasp.margin):.0f}°, closes with {100.0 * grasp.chance:.0f} % chance",
        ),
        Row("error", error, "of the worst contact, rms over a run"),
    ]
    if run is not None:
        listed.append(
            Row(
                "located",
                f"{100.0 * run.located:.0f} %",
                f"{run.drawn.located} of {run.drawn.images} images that were drawn",
            )
        )
    return listed


def expected(found: Suitability) -> str:
    """What a run will give, in one line; empty without a grasp that can be carried."""
    if found.prediction is None:
        return ""
    least, most = found.located_interval
    share = f"located in {math.floor(100.0 * least + 1e-9)} to {math.ceil(100.0 * most - 1e-9)} % of frames"
    if math.isnan(found.error_px):
        return f"{share} (95 %), contacts not known"
    low, high = found.error_interval
    return f"{share}, contacts {_format_number(low)} to {format_px(high)} off (95 %)"


def format_px(value: float) -> str:
    """A length in px with two figures."""
    return f"{_format_number(value)} px"


def _format_number(value: float) -> str:
    return f"{value:.0f}" if value >= 9.5 else f"{value:.2g}"


def describe_motions(motions: Motions) -> str:
    """Which motions the outline shows."""
    if motions.models["homography"].observable:
        return "all shown"
    return "flat ones only" if motions.models["similarity"].observable else "not all shown"


def describe_weakest_motion(motions: Motions) -> str:
    """How much of the motion that is shown least moves the edges."""
    shown = motions.models["homography"].weakest
    return f"the weakest moves the edges by {100.0 * shown:.0f} % of itself, {100.0 * SLIDING:.0f} % is needed"


def describe_symmetry(found: Symmetry) -> str:
    """How often the outline fits itself."""
    if not found.known:
        return "unknown"
    return "every turn" if found.every else f"each {360.0 / found.order:.0f}°" if found.turns else "none"


def describe_texture(found: Suitability, what: Literal["surface", "ground"]) -> str:
    """Whether the surface, or else the ground, fixes what the outline leaves free."""
    texture = found.surface if what == "surface" else found.ground
    if found.by == "outline":
        return "not needed: the outline fixes all motions" if texture.rms else "no structure"
    if math.isnan(texture.settles):
        return "no grasp for it to fix"
    if found.by == what:
        word = "fixes" if what == "surface" else "alone fixes"
        lost = "" if what == "surface" else ": on a belt it will be lost"
        return f"{word} what the outline leaves free, to {format_px(texture.settles)}{lost}"
    if found.by == "surface":
        if texture.settles > HARDLY * found.surface.settles:
            return "adds nothing to that"
        return f"to {format_px(texture.settles)}, as long as it moves along"
    return "does not fix what the outline leaves free"
