# SPDX-License-Identifier: Apache-2.0
"""Claims of Sections I to IV: what each strategy needs, and what its description keeps."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from research.paper.evidence import FEW, SMALL, Claim, Evidence, Finding, claim, grade, percent, plain, px
from research.paper.footage import STARTS
from research.paper.runs import OFF_PX

LAST_DIGIT = 1e-4
"""1/px, of a distance as printed."""

CLAIMS_OF_METHODS: list[Claim] = []
_claim = partial(claim, CLAIMS_OF_METHODS)


@_claim(
    "I, VI",
    "Carrying one grasp along keeps it the same grasp and keeps the noise of the images out of its choice",
    "Table G: synthesis in every frame, rendered",
)
def _searched(e: Evidence) -> Finding:
    rows = e.rows("G", {})
    anew = max(e.numbers("G", "searched anew: off %", {}))
    carried = max(e.numbers("G", "carried: off %", {}))
    least = min(e.numbers("G", "searched anew: off %", {}))
    answered = min(e.numbers("G", "carried: answered %", {}))
    other = sum(off > carried for off in e.numbers("G", "searched anew: off %", {}))
    found = (
        f"searched anew, the best grasp is more than {OFF_PX:g} px from the first one in {percent(least)} to {percent(anew)} "
        f"of an object's frames; ours carried by the homography in at most {percent(carried)} (answered at least "
        f"{percent(answered)})"
    )
    return Finding(grade(other == len(rows) and carried <= FEW, other > 0), found)


@_claim("I", "Neither the camera's parameters nor a model of the object is needed", "Table VII, rendered, 4 DoF")
def _without_calibration(e: Evidence) -> Finding:
    ours, letter = (
        [e.glance(f"{name} worst px", "4 DoF", "rendered", transfer) for name in ("RRP", "Grasp-line", "Hom.")]
        for transfer in ("ours", "to the letter")
    )
    found = (
        "by construction, outlines are all that a transfer gets. Worst contact in rendered images of 4 DoF, RRP, grasp line, "
        f"homography: ours {', '.join(map(px, ours))}; to the letter {', '.join(map(px, letter))}"
    )
    return Finding(grade(max(ours) <= OFF_PX, min(ours) <= OFF_PX), found)


@_claim("III-A", "RRP coordinates mean the same place only if all points are carried along as a whole", "Table C")
def _points_carried(e: Evidence) -> Finding:
    off = e.context("a contour with another start", "paper-rrp")
    return Finding(grade(off > OFF_PX, False), f"a contour that begins elsewhere: {px(off)} off, and nothing tells")


@_claim("III-A", "RRP is bound to motions of 4 DoF", "Table T: error over tilt")
def _rrp_four_dof(e: Evidence) -> Finding:
    level, twenty, forty = (e.tilted("paper-rrp", d) for d in (0.0, 20.0, 40.0))
    found = f"median {px(level)} without tilt, {px(twenty)} at 20 degrees, {px(forty)} at 40"
    return Finding(grade(level < SMALL < twenty, level < twenty), found)


@_claim("III-B", "Grasp-line coordinates describe grasps of two fingers only", "Table C")
def _two_fingers_only(e: Evidence) -> Finding:
    told = e.text("C", "paper-grasp-line", {"experiment": "a grasp of three contacts"})
    return Finding(grade(told.startswith("refused"), False), f"three contacts: {told}")


@_claim(
    "III-B",
    "Grasp-line coordinates are invariant under 4 DoF, the distance to the object among them",
    "Tables P and A, approach, contours sampled anew",
)
def _grasp_line_four_dof(e: Evidence) -> Finding:
    over_area = (
        e.population("paper-grasp-line", "approach"),
        e.population("paper-grasp-line", "approach", cell="worst px"),
    )
    over_root = (
        e.ablation("grasp line, over its root", "approach"),
        e.ablation("grasp line, over its root", "approach", cell="worst px"),
    )
    found = (
        f"where the object grows by 2.5, as printed (distances over the area) median {px(over_area[0])}, worst "
        f"{px(over_area[1])}; over the area's root {px(over_root[0])} and {px(over_root[1])}: a length over an area "
        "changes with scale"
    )
    return Finding(grade(over_area[1] < SMALL, over_root[1] < SMALL), found)


@_claim("III-B, VI", "The grasp line fails where part of the outline is not seen", "Table K")
def _whole_outline(e: Evidence) -> Finding:
    shares = (10.0, 25.0, 40.0)
    off = [e.hidden("paper-grasp-line", share, "first view") for share in shares]
    ours = max(e.hidden("grasp-line", share, "first view", "answered %") for share in shares)
    found = (
        f"median {px(off[0])}, {px(off[1])} and {px(off[2])} with 10, 25 and 40 % of the outline hidden; ours answers "
        f"{percent(ours)}"
    )
    return Finding(grade(off[0] < off[1] < off[2] and off[1] > OFF_PX, off[2] > OFF_PX), found)


@_claim("III-C", "The homography follows motions of 6 DoF", "Table VII, corresponding; Table P, 6 DoF, sampled anew")
def _six_dof(e: Evidence) -> Finding:
    own = e.glance("Hom. worst px", "6 DoF", "corresponding")
    letter, answered, off = (
        e.population("paper-homography", "6 DoF", cell=c) for c in ("median px", "answered %", "off %")
    )
    ours = e.population("homography", "6 DoF", way="last frame as prior")
    found = (
        f"contours moved point by point: {px(own)} at worst. Of the same curves sampled anew: median {px(letter)}, "
        f"{percent(answered)} answered, {percent(off)} of them off; ours with the last frame as prior {px(ours)}"
    )
    return Finding(grade(letter < SMALL and off <= FEW and own < SMALL, own < SMALL or ours < SMALL), found)


@_claim("IV-A, V", "RRP coordinates stay the same in a transfer", "Table III")
def _rrp_unchanged(e: Evidence) -> Finding:
    pairs = _before_and_after(e, "III")
    same = sum(a["RRP (c, r, t)"] == b["RRP (c, r, t)"] for a, b in pairs)
    return Finding(grade(same == len(pairs), same > 0), f"the same for {same} of {len(pairs)} contacts")


@_claim("IV-B, V", "Grasp-line coordinates stay the same in a transfer", "Table IV")
def _line_unchanged(e: Evidence) -> Finding:
    column = "Relative (d_c, alpha_m, d_1, d_2), 1/px and degrees"
    before, after = (
        np.array([[float(v.strip("()°")) for v in row[column].split(", ")] for row in rows if row[column]])
        for rows in zip(*_before_and_after(e, "IV"), strict=True)
    )
    moved = np.abs(after - before)
    angle, length = float(moved[:, 1].max()), float(moved[:, [0, 2, 3]].max())
    same = int((moved == 0.0).all(axis=1).sum())
    found = (
        f"as printed the same in {same} of {len(moved)} transfers; else alpha_m differs by up to {plain(angle)} degrees, "
        f"a distance by up to {length:.4f} 1/px"
    )
    return Finding(grade(angle < 0.1 and length < 2 * LAST_DIGIT, angle < SMALL), found)


@_claim("IV-C.1", "The four highest peaks of curvature are points that fix the homography", "Table A, 6 DoF")
def _four_peaks(e: Evidence) -> Finding:
    highest, chosen = (
        e.ablation(t, "6 DoF", cell="off %") for t in ("homography, the paper's", "the paper's and choice of peaks")
    )
    answered = e.ablation("homography, the paper's", "6 DoF", cell="answered %")
    found = (
        f"the four highest: {percent(answered)} answered, {percent(highest)} of them off; four well apart, all else to the "
        f"letter: {percent(chosen)} off"
    )
    return Finding(grade(highest <= FEW, chosen <= FEW), found)


def _before_and_after(e: Evidence, table: str) -> list[tuple[Mapping[str, str], Mapping[str, str]]]:
    """Rows of each contact in the first view and in the second, to the letter."""
    rows = e.rows(table, {"transfer": "to the letter"})
    before = [r for r in rows if not r["contact"].startswith("p'")]
    after = [r for r in rows if r["contact"].startswith("p'")]
    return list(zip(before, after, strict=True))


@_claim(
    "IV-C.1",
    "Consecutive frames are so alike that each point can be matched on its own, near where it was",
    "Table P, 4 DoF, sampled anew, carried on",
)
def _consecutive(e: Evidence) -> Finding:
    letter, off = (
        e.population("paper-homography", "4 DoF", way="carried on", cell=cell) for cell in ("median px", "off %")
    )
    ours, ours_off = (
        e.population("homography", "4 DoF", way="last frame as prior", cell=cell) for cell in ("median px", "off %")
    )
    found = (
        f"from frame to frame: median {px(letter)}, {percent(off)} of the answers off. Ours, always "
        f"from the first view and gated by the last frame: {px(ours)}, {percent(ours_off)} off"
    )
    return Finding(grade(letter < SMALL and off <= FEW, ours < SMALL and ours_off <= FEW), found)


@_claim("IV-C.1", "Views farther apart need a match of the whole outline", "Tables A and B, 4 DoF, chains of pixels")
def _global_match(e: Evidence) -> Finding:
    index, aligned = (
        e.ablation(t, "4 DoF", "pixel chain")
        for t in ("all without window at the alignment or prediction", "all of these")
    )
    where = {"motion": "4 DoF", "contours": "pixel chain", "way": "first view"}
    begun = {start: e.number("B", "median px", {**where, "begun": start}) for start in STARTS}
    found = (
        f"pairs of views up to a whole sequence apart: median {px(index)} with a search about an index, {px(aligned)} about "
        "where aligning the whole outlines puts it, if contours begin at the same place. To the letter by where they begin: "
        f"{', '.join(f'{start} {px(v)}' for start, v in begun.items())}"
    )
    return Finding(grade(index > OFF_PX >= aligned, begun["arbitrary"] > OFF_PX and aligned < index), found)


@_claim(
    "IV-C.4",
    "The line through the transferred contacts meets the outline at least twice",
    "Table A, 6 DoF, with and without the refinement",
)
def _two_crossings(e: Evidence) -> Finding:
    applied, refined = (
        e.ablation(t, "6 DoF", cell="answered %")
        for t in ("the paper's without the refinement", "homography, the paper's")
    )
    lost = applied - refined
    found = f"in {percent(lost)} of the frames the line through the transferred contacts did not meet the outline twice"
    return Finding(grade(lost < SMALL, lost <= FEW), found)
