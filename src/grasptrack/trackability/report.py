# SPDX-License-Identifier: Apache-2.0
"""An inspection in words: its level, what speaks against the object, what would help; the rows of terminal and picture."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from grasptrack.grasp.closure_probability import CHANCE
from grasptrack.kernels import EDGE_WINDOW
from grasptrack.trackability.appearance import MIN_STRENGTH, RELATIVE_STRENGTH
from grasptrack.trackability.evidence import PEAKS, Settled, Symmetry, Usable, recommended_strategy
from grasptrack.trackability.motions import SLIDING, Motions
from grasptrack.trackability.prediction import Prediction
from grasptrack.trackability.result import Held, Level, Looks, Reason, Suitability
from grasptrack.tracking.numbers import NUMBERS

SMALL = NUMBERS.tolerance_px / NUMBERS.tolerance
"""px; of a smaller object, the tracker's tolerance in px is a larger share than its tolerance in sqrt(area)."""
FAINT = MIN_STRENGTH / RELATIVE_STRENGTH
"""Grey levels per px; a stronger edge may lose as much as the tracker allows for and still be one."""
HALF = 0.5
"""Of the outline, so much must show its edge: with less, more of it is missing than seen."""
COVER = 0.3
"""Share of the outline that a cover may take without harm where all of it has a clear edge."""
TRACKED, LOST = 0.9, 0.5
"""Share of the frames that is located at the least where an object is good; and below which, by expectation, it is poor."""
HARDLY = math.sqrt(2.0) * SLIDING
"""Of a motion, the part across the outline below which the evidence counts for less than half."""

WORDS = {"turn": "a turn", "shift along": "a shift", "shift across": "a shift", "scale": "a change of scale"}
"""What a user calls the motions within the image; the others are parts of a tilt."""
NO_TURN = "another object, or a mark on its outline such as a notch"


class Findings(NamedTuple):
    """All that a verdict rests on; `refusal` is what the tracker says of the first view."""

    looks: Looks
    motions: Motions
    symmetry: Symmetry
    equals: int
    strategies: tuple[Usable, ...]
    grasp: Held | None
    no_grasp: str
    refusal: str
    settled: Settled | None
    prediction: Prediction | None


def is_lost(prediction: Prediction | None) -> bool:
    """Whether a run is expected to lose the object in most frames."""
    return prediction is not None and prediction.located < LOST


def level_of(grasp: Held | None, prediction: Prediction | None) -> Level:
    """How well an object can be tracked, by what a run will give.

    Poor: no grasp that closes and that the strategy can carry; or less than half of the frames expected to be located; or,
    within 95 %, contacts off by more than the tracker promises. Good, else: with 95 %, at least nine tenths of the frames
    located.
    """
    if grasp is None or not grasp.stable or prediction is None or is_lost(prediction):
        return "poor"
    if prediction.error_interval[1] > grasp.tolerance:
        return "poor"
    return "good" if prediction.located_interval[0] >= TRACKED else "fair"


def reasons_of(found: Findings) -> tuple[Reason, ...]:
    """What speaks against an object, of the grasp first; empty when nothing does."""
    listed = [*_of_grasp(found), *_of_motions(found), *_of_edges(found), *_of_likeness(found)]
    drawn = None if found.prediction is None else found.prediction.drawn
    if drawn is not None and drawn.located < drawn.images:
        text = f"lost in {drawn.images - drawn.located} of {drawn.images} rendered images: {drawn.reason}"
        advice = "" if found.looks.clear * (1.0 - COVER) < HALF else _clearer_edge_advice(found.looks)
        listed.append(Reason(text, advice))
    return tuple(listed)


def _of_grasp(found: Findings) -> list[Reason]:
    listed = []
    grasp = found.grasp
    if found.no_grasp:
        listed.append(Reason(found.no_grasp, "give contacts with --grasp, or more --friction"))
    elif grasp is not None and not grasp.stable:
        listed.append(Reason("the grasp does not close", "another grasp, or more --friction"))
    elif grasp is not None and grasp.chance < CHANCE and _contacts_are_fixed(found):
        text = f"the grasp closes with a chance of only {100.0 * grasp.chance:.0f} % where its contacts are uncertain"
        listed.append(Reason(text, "another grasp, on longer straight sides"))
    if not recommended_strategy(found.strategies) and not found.refusal:
        listed.append(Reason(f"no strategy can carry it: {found.strategies[0].reason}", "more contrast"))
    return listed


def _contacts_are_fixed(found: Findings) -> bool:
    """Whether anything fixes the contacts."""
    if found.settled is not None:
        return found.settled.by != "nothing"
    return found.motions.models["homography"].observable


def _of_motions(found: Findings) -> list[Reason]:
    """What the outline leaves free: poor, unless the surface or the ground fixes it."""
    listed = _of_outline(found)
    by = None if found.settled is None else found.settled.by
    if by not in ("surface", "ground"):
        return listed
    free = listed[0].text if listed else "the outline hardly fixes the contacts"
    if found.refusal:
        return [Reason(found.refusal, "another grasp, nearer to where the outline bends")]
    if by == "surface":
        text = f"{free}; the surface fixes it: where that is covered or in glare, it may be lost"
        return [Reason(text, "keep the surface in view")]
    text = f"{free}; only the ground fixes it: on a belt it will be lost"
    return [Reason(text, "let the object rest on the ground, or mark its surface")]


def _of_outline(found: Findings) -> list[Reason]:
    models, looks = found.motions.models, found.looks
    flat = models["similarity"]
    if not flat.observable and flat.unswayed >= HARDLY:
        return [Reason("the noise of its edges hides how it moves", _clearer_edge_advice(looks))]
    if found.symmetry.every or not flat.observable:
        hidden = [
            m.name for m in found.motions.motions if "similarity" not in m.observed and "affine" not in m.observed
        ]
        what = "a turn about its centre" if found.symmetry.every or "turn" in hidden else "a shift along itself"
        return [Reason(f"{what} is not shown by the outline", NO_TURN)]
    whole = models["homography"]
    if not whole.observable and whole.unswayed >= HARDLY:
        return [Reason("the noise of its edges hides a tilt", _clearer_edge_advice(looks))]
    if not whole.observable:
        text = "a tilt is not shown by this outline"
        mixed = [WORDS[m.name] for m in found.motions.motions if m.name in WORDS and "homography" not in m.observed]
        if mixed:
            text = f"a tilt cannot be told from {_join_names(list(dict.fromkeys(mixed)))} by this outline"
        return [Reason(text, "begin with the whole object in view" if looks.clipped else NO_TURN)]
    if found.refusal:
        return [Reason(found.refusal, "another grasp, nearer to where the outline bends")]
    if whole.weakest < HARDLY:
        share = f"{100.0 * whole.weakest:.0f} %; {100.0 * SLIDING:.0f} % is needed"
        text = f"{WORDS.get(whole.least, 'a tilt')} is hardly told from other motions ({share})"
        advice = "a sharper image" if looks.sharpness > EDGE_WINDOW else "more of the object in view, or another object"
        return [Reason(text, advice)]
    return []


def _join_names(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"


def _of_edges(found: Findings) -> list[Reason]:
    looks, listed = found.looks, []
    if looks.clear * (1.0 - COVER) < HALF:
        text = f"only {100.0 * looks.clear:.0f} % of the outline has a clear edge"
        listed.append(Reason(text, _clearer_edge_advice(looks)))
    elif looks.strength < FAINT:
        text = f"faint edges ({looks.strength:.1f} grey levels per px)"
        listed.append(Reason(text, _clearer_edge_advice(looks)))
    if looks.size < SMALL:
        text = f"a small object: its area is only that of {looks.size:.0f} x {looks.size:.0f} px"
        listed.append(Reason(text, "move nearer, or take a larger image"))
    if looks.clipped:
        text = "the image border cuts the object: once lost, it is not found again"
        listed.append(Reason(text, "begin with the whole object in view"))
    return listed


def _clearer_edge_advice(looks: Looks) -> str:
    """What would make edges clearer."""
    if looks.sharpness > EDGE_WINDOW:
        return "focus: the edges are blurred"
    if CONTRAST * looks.noise > looks.contrast:
        return "more light: noise hides the edges"
    return "more contrast with the ground, or even light"


CONTRAST = EDGE_WINDOW / RELATIVE_STRENGTH
"""Times its noise that an image's contrast should be, so that the slope of an edge as wide as EDGE_WINDOW, as weak as the
tracker allows, is more than the noise of a pixel."""


def _of_likeness(found: Findings) -> list[Reason]:
    listed = []
    symmetry = found.symmetry
    if symmetry.known and not symmetry.every and symmetry.turns:
        text = (
            f"it looks the same after a turn by {360.0 / symmetry.order:.0f}°: out of sight for a moment, it stays lost"
        )
        listed.append(Reason(text, "keep it in view, or mark one side"))
    if found.equals:
        others = "another object has" if found.equals == 1 else f"{found.equals} other objects have"
        text = f"{others} the same outline: out of sight for a moment, it stays lost"
        listed.append(Reason(text, "keep it in view, or take its equals away"))
    return listed


ADDS_LITTLE = 0.9
"""What leaves more than this share of an error adds nothing worth telling."""


class Entry(NamedTuple):
    """One row: of what, the figure, and what goes with it."""

    name: str
    value: str
    note: str


def report_rows(found: Suitability) -> list[Entry]:
    """All that was found, in rows."""
    looks = found.looks
    holes = {0: "no hole", 1: "1 hole"}.get(looks.holes, f"{looks.holes} holes")
    border = "cut by the border" if looks.clipped else f"{looks.border:.0f} px from the border"
    listed = [
        Entry("object", f"{looks.size:.0f} px", f"{100.0 * looks.share:.0f} % of the image, {border}, {holes}"),
        Entry(
            "contrast", f"{looks.contrast:.0f} levels", f"noise {looks.noise:.1f}, the ground's grain {looks.grain:.1f}"
        ),
        Entry("edges", f"{100.0 * looks.clear:.0f} % clear", f"{looks.sharpness:.1f} px wide"),
        Entry("motions", describe_motions(found.motions), describe_weakest_motion(found.motions)),
        Entry("symmetry", describe_symmetry(found.symmetry), f"equal objects in view: {len(found.equals) or 'none'}"),
        Entry("peaks", str(len(found.peaks)), f"a homography needs {PEAKS}"),
        Entry("surface", f"{found.surface.rms:.1f} levels/px", describe_texture(found, "surface")),
        Entry("ground", f"{found.ground.rms:.1f} levels/px", describe_texture(found, "ground")),
    ]
    listed += [Entry(u.name, "no" if u.reason else "yes", u.reason) for u in found.strategies]
    if found.grasp is None:
        return [*listed, Entry("grasp", "none", "")]
    return [*listed, *_grasp_rows(found, found.grasp)]


def _grasp_rows(found: Suitability, grasp: Held) -> list[Entry]:
    run = found.prediction
    error = format_px(found.error_px) if math.isfinite(found.error_px) else "not known"
    closes = f"margin {math.degrees(grasp.margin):.0f}°, closes with {100.0 * grasp.chance:.0f} % chance"
    listed = [Entry("grasp", f"{grasp.opening:.0f} px wide", closes)]
    listed.append(Entry("error", error, "of the worst contact, rms over a run"))
    if run is not None:
        told = f"expected of a run; {run.drawn.located} of {run.drawn.images} rendered images"
        listed.append(Entry("located", f"{100.0 * run.located:.0f} %", told))
    return listed


def describe_expectation(found: Suitability) -> str:
    """What a run will give, in one line; empty without a grasp that can be carried."""
    if found.prediction is None:
        return ""
    least, most = found.located_interval
    share = f"located in {math.floor(100.0 * least + 1e-9)} to {math.ceil(100.0 * most - 1e-9)} % of frames"
    if math.isnan(found.error_px):
        return f"{share} (95 %), contacts not known"
    low, high = found.error_interval
    return f"{share}, contacts {_format_number(low)} to {format_px(high)} off (95 %)"


def describe_reasons(found: Suitability) -> list[str]:
    """What speaks against the object, each with what would help."""
    return [r.text + (f". Would help: {r.advice}" if r.advice else "") for r in found.reasons]


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
        if texture.settles > ADDS_LITTLE * found.surface.settles:
            return "adds nothing to that"
        return f"to {format_px(texture.settles)}, as long as it moves along"
    return "does not fix what the outline leaves free"
