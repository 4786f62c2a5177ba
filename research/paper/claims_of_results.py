# SPDX-License-Identifier: Apache-2.0
"""Claims of Sections V and VI: errors, comparisons, times, and what the method is good for."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

from research.paper.evidence import (
    FEW,
    REFUSED,
    ROUNDING,
    SMALL,
    Claim,
    Evidence,
    Finding,
    claim,
    grade,
    number_of,
    percent,
    plain,
    px,
)
from research.paper.printed import OPENINGS, STRATEGIES, TABLE_VII
from research.paper.runs import OFF_PX

LETTERS = tuple(f"paper-{name}" for name in STRATEGIES)
NAMES = {"paper-rrp": "RRP", "paper-grasp-line": "grasp line", "paper-homography": "homography"}

CLAIMS_OF_RESULTS: list[Claim] = []
"""But those about time."""
CLAIMS_OF_TIME: list[Claim] = []
_claim, _claim_of_time = partial(claim, CLAIMS_OF_RESULTS), partial(claim, CLAIMS_OF_TIME)


@_claim(
    "V",
    "The transferred grasp is much like the original; what differs is discretisation",
    "Table P, 4 DoF, chains of pixels",
)
def _similar(e: Evidence) -> Finding:
    worst = [e.population(s, "4 DoF", "pixel chain", cell="worst px") for s in LETTERS[:2]]
    median = [e.population(s, "4 DoF", "pixel chain") for s in LETTERS[:2]]
    found = (
        f"on chains of pixels RRP median {px(median[0])}, worst {px(worst[0])}; grasp line {px(median[1])} and {px(worst[1])}; "
        "the grasp line's worst comes from distances over the area"
    )
    return Finding(grade(max(worst) <= OFF_PX, max(median) <= OFF_PX), found)


@_claim("V", "It differs less by RRP, thanks to the tracked outline", "Tables P and VII, 4 DoF")
def _rrp_lower(e: Evidence) -> Finding:
    on = {
        "chains of pixels": [e.population(s, "4 DoF", "pixel chain") for s in LETTERS[:2]],
        "the true curves": [e.population(s, "4 DoF") for s in LETTERS[:2]],
        "rendered images": [e.glance(f"{name} mean px", "4 DoF", "rendered") for name in ("RRP", "Grasp-line")],
    }
    ours = [e.glance(f"{name} mean px", "4 DoF", "rendered", "ours") for name in ("RRP", "Grasp-line")]
    told = ", ".join(f"on {what} {px(a)} against {px(b)}" for what, (a, b) in on.items())
    lower = [a < b for a, b in on.values()]
    found = (
        f"RRP against grasp line {told}. Where interp is whole half a sample is lost; ours in rendered images {px(ours[0])} "
        f"against {px(ours[1])}"
    )
    return Finding(grade(all(lower), any(lower) or ours[0] < ours[1]), found)


@_claim("V", "The homography is sensitive to errors of its correspondences", "Table A, 4 DoF")
def _sensitive(e: Evidence) -> Finding:
    exact, chain = (
        e.ablation("homography, the paper's", "4 DoF", contours) for contours in ("resampled", "pixel chain")
    )
    best = e.ablation("all of these", "4 DoF", "pixel chain")
    found = (
        f"median {px(exact)} on the true curves, {px(chain)} where the same contours are rounded to pixels; with better "
        f"correspondences {px(best)} there"
    )
    return Finding(grade(chain > 2 * exact and best < chain, chain > exact), found)


@_claim("V, IV-C.4", "The refinement makes up for such errors, and is important for it", "Tables R and A")
def _refinement(e: Evidence) -> Finding:
    paper = "homography, the paper's"
    shares = [
        e.number("R", "nearer %", {"motion": motion, "contours": contours, "transfer": paper})
        for motion, contours in (("6 DoF", "resampled"), ("4 DoF", "pixel chain"))
    ]
    without = "the paper's without the refinement"
    before, after = (e.ablation(t, "6 DoF") for t in (without, paper))
    off = [e.ablation(t, "6 DoF", cell="off %") for t in (without, paper)]
    found = (
        f"it brings a contact nearer in {percent(shares[0])} on the true curves and {percent(shares[1])} on chains of pixels; "
        f"median, 6 DoF, {px(before)} without and {px(after)} with it, off {percent(off[0])} and {percent(off[1])}. It "
        "corrects across the outline, never along it"
    )
    return Finding(grade(after < before / 2 and min(shares) > 75.0, after < before and min(shares) > 50.0), found)


@_claim("V", "Transferred contacts are sure to lie on the outline", "Table P, 6 DoF, sampled anew")
def _on_the_outline(e: Evidence) -> Finding:
    median, off = (e.population("paper-homography", "6 DoF", cell=cell) for cell in ("worst px", "off %"))
    found = (
        f"by construction, and it says little: of the homography's answers on the outline, 6 DoF, {percent(off)} were off, at "
        f"worst by {px(median)}"
    )
    return Finding("reproduced", found)


@_claim("V", "There and back, a grasp returns to where it was, or nearly (Table VI)", "Tables VI-1 to VI-3")
def _reversible(e: Evidence) -> Finding:
    columns = {"RRP": "RRP, px", "grasp line": "Grasp-line, px", "homography": "Hom., px"}
    where = {"error": "R_v E (e_max)", "transfer": "to the letter"}
    rows = [r for number in ("VI-1", "VI-2", "VI-3") for r in e.rows(number, where)]
    told, zero = [], []
    for name, column in columns.items():
        cells = [r[column] for r in rows]
        answered = [number_of(c) for c in cells if c and c != REFUSED]
        worst = max(answered, default=0.0)
        refused = sum(c == REFUSED for c in cells)
        zeros = sum(v < ROUNDING for v in answered)
        zero.append(zeros == len(cells))
        told.append(
            f"{name} 0 in {zeros} of {len(cells)} returns, at most {px(worst)}"
            + (f", {refused} refused" if refused else "")
        )
    astray = e.glance("RRP worst px", "6 DoF", "resampled")
    found = f"{'; '.join(told)}. No measure of accuracy: RRP comes back from where it was up to {px(astray)} off"
    return Finding(grade(all(zero), any("0 in 0" not in t for t in told)), found)


@_claim("V", "The homography has no error at all (Table VII)", "Table VII, corresponding; Table P")
def _zeros(e: Evidence) -> Finding:
    where = {"contours": "corresponding", "transfer": "to the letter", "way": "first view"}
    worst = {r["motion"]: number_of(r["Hom. worst px"]) for r in e.rows("VII", where)}
    anew = e.population("paper-homography", "6 DoF")
    told = ", ".join(f"{motion} {px(v)}" for motion, v in worst.items())
    found = (
        f"worst on contours moved by a homography: {told}. Of the same curves sampled anew, 6 DoF: median {px(anew)}"
    )
    return Finding(grade(max(worst.values()) < ROUNDING and anew < SMALL, min(worst.values()) < ROUNDING), found)


@_claim(
    "V",
    "The homography has the least error where the motion is one that it can express",
    "Table P, 6 DoF, sampled anew",
)
def _least_error(e: Evidence) -> Finding:
    letter = [e.population(s, "6 DoF") for s in LETTERS]
    ours = [e.population(s, "6 DoF", way="last frame as prior") for s in STRATEGIES]
    found = (
        f"6 DoF, RRP, grasp line, homography: to the letter {', '.join(map(px, letter))}; ours, with the last frame as prior, "
        f"{', '.join(map(px, ours))}"
    )
    return Finding(grade(letter[2] == min(letter), ours[2] == min(ours)), found)


@_claim("V", "RRP is accurate where the outline keeps its shape", "Table P, 4 DoF")
def _rrp_accurate(e: Evidence) -> Finding:
    worst = [e.population("paper-rrp", "4 DoF", contours, cell="worst px") for contours in ("resampled", "pixel chain")]
    found = (
        f"4 DoF, a perfect tracker: worst contact {px(worst[0])} on the true curves, {px(worst[1])} on chains of pixels"
    )
    return Finding(grade(max(worst) <= OFF_PX, min(worst) <= OFF_PX), found)


@_claim("V", "The sequence error tells the three strategies apart", "Table P, 4 DoF, chains of pixels; print")
def _tells_apart(e: Evidence) -> Finding:
    where = {"motion": "4 DoF", "contours": "pixel chain", "way": "first view"}
    ends = sorted(
        (e.number("P", "95 % from", {**where, "strategy": s}), e.number("P", "95 % to", {**where, "strategy": s}), s)
        for s in LETTERS
    )
    apart = all(a[1] < b[0] for a, b in pairwise(ends))
    printed = sum(grasp[2][0] > grasp[2][1] for grasp in TABLE_VII)
    found = (
        f"95 % intervals over all shapes: {', '.join(f'{NAMES[s]} {plain(a)} to {px(b)}' for a, b, s in ends)}. In print "
        f"RRP's SE is above the grasp line's for {printed} grasps of {len(TABLE_VII)}: three grasps do not tell"
    )
    return Finding(grade(apart and printed in (0, len(TABLE_VII)), apart), found)


@_claim("V", "RRP and homography carry more kinds of grasps than the grasp line", "Table C")
def _kinds_of_grasps(e: Evidence) -> Finding:
    letter, ours = (
        [e.context("a grasp of three contacts", s) for s in (f"{way}rrp", f"{way}homography")] for way in ("paper-", "")
    )
    found = (
        f"three contacts: RRP {px(letter[0])}, homography {px(letter[1])}, whose refinement is of two contacts; ours "
        f"{px(ours[0])} and {px(ours[1])}"
    )
    return Finding(grade(max(letter) <= OFF_PX, max(ours) <= OFF_PX), found)


@_claim("V", "RRP and homography carry more kinds of grasps than other methods that track grasps ([22])", "none", "-")
def _other_methods(_: Evidence) -> Finding:
    return Finding(
        "not tried", "the paper measures no other method, and of [22] only what its title says is built here"
    )


@_claim("V", "The errors of all three are minimal", "Table P, 4 DoF, chains of pixels; print")
def _minimal(e: Evidence) -> Finding:
    shares = [e.population(s, "4 DoF", "pixel chain", cell="median % of opening") for s in LETTERS]
    printed = 100.0 * TABLE_VII[0][2][0] / OPENINGS[0] if OPENINGS[0] else 0.0
    found = (
        f"4 DoF, chains of pixels, of the opening: RRP {percent(shares[0])}, grasp line {percent(shares[1])}, homography "
        f"{percent(shares[2])}. Printed: {percent(printed)} for RRP on the first grasp, if Table VII's rows follow Table VI's"
    )
    return Finding(grade(max(shares) <= FEW and printed <= FEW, min(shares) <= FEW), found)


@_claim(
    "V",
    "The reference error is that of one frame, the sequence error's maximum that of all (Table VII as printed)",
    "Table VII-2; print",
)
def _one_frame_of_all(e: Evidence) -> Finding:
    wrong = [(g, k) for g, rows in enumerate(TABLE_VII) for k in range(len(STRATEGIES)) if rows[1][k] > rows[3][k]]
    told = ", ".join(
        f"grasp {g + 1}, {STRATEGIES[k]}: {TABLE_VII[g][1][k]:g} above {TABLE_VII[g][3][k]:g} 1/px" for g, k in wrong
    )
    rows = [
        (
            e.numbers("VII-2", column, {"error": "R_f E (e_max)", "transfer": "to the letter"}),
            e.numbers("VII-2", column, {"error": "SE (e_max)", "transfer": "to the letter"}),
        )
        for column in ("RRP, px", "Grasp-line, px")
    ]
    kept = all(a <= b + ROUNDING for one, all_ in rows for a, b in zip(one, all_, strict=True))
    found = (
        "frame 50 is one of the sequence, so its error cannot be above the largest, if both errors are of the same pairs of "
        f"frames, which the text does not say. In print: {told or 'so throughout'}"
    )
    return Finding(grade(kept and not wrong, len(wrong) == 0), found + ("; in the rerun nowhere" if kept else ""))


@_claim("VI", "The homography carries any number of contacts", "Table C")
def _any_contacts(e: Evidence) -> Finding:
    letter, ours = (e.context("a grasp of three contacts", s) for s in ("paper-homography", "homography"))
    found = f"three contacts: {px(letter)} to the letter, as Fig. 11 needs a line; ours, along the normals, {px(ours)}"
    return Finding(grade(letter <= OFF_PX, ours <= OFF_PX), found)


@_claim("VI", "With well-chosen correspondences the homography needs no view of the whole outline", "Table K")
def _part_of_the_outline(e: Evidence) -> Finding:
    parts, shares = [], (10.0, 25.0, 40.0)
    for s, way in (("paper-homography", "first view"), ("homography", "last frame as prior")):
        cells = [[e.hidden(s, share, way, cell) for cell in ("median px", "answered %", "off %")] for share in shares]
        parts.append(cells)
    letter, ours = (
        "; ".join(
            f"{share:g} % hidden: {px(m)}, {percent(a)} answered, {percent(o)} off"
            for share, (m, a, o) in zip(shares, cells, strict=True)
        )
        for cells in parts
    )

    def works(cell: list[float]) -> bool:
        return cell[0] < OFF_PX and cell[1] > 100.0 - FEW and cell[2] <= FEW

    found = f"{letter}. Ours with the last frame as prior, {ours}"
    return Finding(grade(works(parts[0][1]), works(parts[1][0]) or parts[1][0][0] < OFF_PX), found)


@_claim("VI", "The grasp line does not rely on tracking the object", "Table P, 4 DoF, sampled anew, first view")
def _without_tracking(e: Evidence) -> Finding:
    cells = "median px", "answered %", "off %"
    alone, led = (
        [e.population("grasp-line", "4 DoF", way=way, cell=c) for c in cells]
        for way in ("first view", "last frame as prior")
    )
    told = [f"{px(m)}, {percent(a)} answered, {percent(o)} off" for m, a, o in (alone, led)]
    found = (
        f"ours, from the first view alone: {told[0]}; with the last frame as prior: {told[1]}. Which way an axis points, of "
        "which the text is silent, is all that tracking would tell"
    )
    works = alone[1] > 100.0 - FEW and alone[2] <= FEW
    return Finding(grade(works and alone[0] < SMALL, alone[0] < SMALL), found)


@_claim("VI", "The grasp line depends on a robust extraction of the contour", "Table C, images")
def _extraction(e: Evidence) -> Finding:
    off = e.context("images: a bar crosses the object", "paper-grasp-line")
    return Finding(grade(off > OFF_PX, False), f"a bar across the object, which is then another outline: {px(off)} off")


@_claim("V, VI", "Each strategy is the better one in its own context", "Tables P and VII")
def _context_decides(e: Evidence) -> Finding:
    where = {
        "4 DoF, chains of pixels": [e.population(s, "4 DoF", "pixel chain") for s in LETTERS],
        "4 DoF, true curves": [e.population(s, "4 DoF") for s in LETTERS],
        "6 DoF, contours moved by a homography": [
            e.glance(f"{n} mean px", "6 DoF", "corresponding") for n in ("RRP", "Grasp-line", "Hom.")
        ],
    }
    best = {what: NAMES[LETTERS[values.index(min(values))]] for what, values in where.items()}
    found = f"least error: {', '.join(f'{what}: {name}' for what, name in best.items())}"
    return Finding(grade(len(set(best.values())) > 1, False), found)


@_claim(
    "VI",
    "Tracked contacts can steer a hand by visual servoing",
    "docs/servo.md, measured",
    "grasptrack servo --trials 100 --seed 671",
)
def _servo(_: Evidence) -> Finding:
    return Finding(
        "not tried", "needs a robot: what our servo does in a simulated world stands in docs/servo.md, with its command"
    )


@_claim("VI", "The same serves grasps of objects in 3-D", "none", "-")
def _three_dimensions(_: Evidence) -> Finding:
    return Finding("not tried", "the paper tries it neither, and nothing here carries a grasp of an object in 3-D")


@_claim_of_time("I, VI", "Carrying a grasp costs less than searching for one in each frame", "Table times")
def _cheaper(e: Evidence) -> Finding:
    search, carry, judge = (_us(e, step) for step in ("search for a grasp", "homography: transfer", "analysis"))
    found = f"a search {plain(search)} us; the dearest transfer and the analysis {plain(carry + judge)} us, ours"
    return Finding(grade(search > 2 * (carry + judge), search > carry), found)


def _us(e: Evidence, step: str, column: str = "ours, median us") -> float:
    return e.number("times", column, {"step": step})


@_claim_of_time("V", "Transfers take less than 15, 35 and 290 us", "Table times")
def _printed_times(e: Evidence) -> Finding:
    steps = [f"{name}: transfer" for name in STRATEGIES]
    ours, letter, printed = (
        [_us(e, s, c) for s in steps] for c in ("ours, median us", "to the letter, median us", "paper, us")
    )
    found = (
        f"printed {', '.join(map(plain, printed))} us; ours {', '.join(map(plain, ours))}; to the letter, in NumPy, "
        f"{', '.join(map(plain, letter))}. The text's 290 ns must be us"
    )
    below = [a <= b for a, b in zip(ours, printed, strict=True)]
    return Finding(grade(all(below), any(below)), found)


@_claim_of_time("V, VI", "The homography is the slowest and most complex of the three", "Table times")
def _slowest(e: Evidence) -> Finding:
    rrp, line, homography = (_us(e, f"{name}: transfer") for name in STRATEGIES)
    found = f"ours {plain(homography / rrp)} times RRP and {plain(homography / line)} times the grasp line; printed 19 and 8"
    return Finding(grade(homography > 2 * max(rrp, line), homography > max(rrp, line)), found)


@_claim_of_time("V", "60 % of its time goes into the search of correspondences", "Table times")
def _share(e: Evidence) -> Finding:
    step = "homography: search, % of the transfer"
    ours, letter, printed = (_us(e, step, c) for c in ("ours, median us", "to the letter, median us", "paper, us"))
    found = f"{percent(ours)} ours, {percent(letter)} to the letter; printed {percent(printed)}"
    most = min(ours, letter) > 50.0
    return Finding(grade(most and abs(letter - printed) <= 10.0, most), found)


@_claim_of_time("V", "With the analysis a frame takes less than 1 ms", "Table times")
def _total(e: Evidence) -> Finding:
    ours, judged = _us(e, "homography and analysis"), _us(e, "analysis")
    found = (
        f"{plain(judged)} us of analysis, {plain(ours)} us together with the homography, ours; printed 370 and 660. What finds "
        "the contour in the image is in neither"
    )
    return Finding(grade(ours < 1000.0, False), found)
