# SPDX-License-Identifier: Apache-2.0
"""Tables II and V: the correspondences between two contours, their homography, its application, the refinement."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grasptrack import kernels
from grasptrack.errors import StrategyError
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.kernels.results import CurvatureMatches, CurvatureVector, MatchWindow
from grasptrack.transfer import homography
from grasptrack.transfer.alignment import alignments_of_points, choose_alignment
from grasptrack.typing import Floats
from grasptrack_bench.baselines.literal import LiteralHomography
from grasptrack_bench.report.table import Cell, Table
from research.paper.footage import Footage
from research.paper.transfers import Refused

Row = tuple[Cell, ...]
RefusedPair = tuple[str, str, str]
"""Object, transfer ("ours" or "to the letter"), reason."""


def cubic_point(points: Floats, place: float) -> Floats:
    """(2,) of a closed contour at a place: Hermite's cubic, its tangents across the neighbours' chords."""
    n, i = len(points), int(place)
    f = place - i
    a, b, c, d = (points[(i + k) % n] for k in (-1, 0, 1, 2))
    if f == 0.0:
        return np.asarray(b)
    ab, bc, cd = (float(np.hypot(*(q - p))) for p, q in ((a, b), (b, c), (c, d)))
    m, k = ((q - p) * (bc / run) if run > 0.0 else 0.0 * p for p, q, run in ((a, c, ab + bc), (b, d, bc + cd)))
    return np.asarray(b + f * (m + f * (3.0 * (c - b) - 2.0 * m - k + f * (2.0 * (b - c) + m + k))))


@dataclass(frozen=True)
class Correspondences:
    """The four steps of Fig. 9 on one pair of contours.

    Attributes:
        footage, frame: the pair: the first frame and this one.
        transfer: "ours" or "to the letter".
        first, second: its views.
        curvature: ((N,), (N',)) of both contours, times their lengths.
        samples: ((4,), (4,)) indices of p_i and of the sample nearest to p'_j in eq. (3).
        places: (4,) p'_j between samples, see `CurvatureMatches`.
        errors: (4,) of eq. (3), mean over the neighbourhood.
        H: (3, 3) of the four.
        applied: (2, 2) px, the contacts through H.
        refined: (2, 2) px, on the outline.
    """

    footage: Footage
    frame: int
    transfer: str
    first: View
    second: View
    curvature: tuple[Floats, Floats]
    samples: tuple[list[int], list[int]]
    places: list[float]
    errors: list[float]
    H: Floats
    applied: Floats
    refined: Floats

    @property
    def points(self) -> tuple[Floats, Floats]:
        """((4, 2), (4, 2)) px: p_i and p'_j."""
        second = np.array([cubic_point(self.second.outer.points, place) for place in self.places])
        return self.first.outer.points[self.samples[0]], second


_HEAD = (
    "object", "transfer", "point", "first view: (x, y) px, sample", "curvature x length",
    "second view: (x, y) px, sample", "curvature x length ", "error of eq. (3)", "off by, px",
)  # fmt: skip


def find_correspondences(footage: Footage, frame: int) -> Correspondences | str:
    """What `transfer.homography` does between the first frame and another, laid open; or why it refuses."""
    try:
        first, second, grasp = _pair_of_views(footage, frame)
        description = homography.describe(grasp, first)
        moved = homography.apply(description, second)
        selected, matched, v = _match_samples(description, second)
    except Refused as error:
        return str(error)
    if moved.homography is None or any(map(math.isnan, matched.places)):
        return "a selected point has no match, and another peak took its place"
    H, curvature, samples = moved.homography, (description.curvature, v), (selected, matched.samples)
    ends = apply_homography(H, grasp.contacts), moved.grasp.contacts
    found = curvature, samples, matched.places, matched.errors, H, *ends
    return Correspondences(footage, frame, "ours", first, second, *found)


def find_literal_correspondences(footage: Footage, frame: int) -> Correspondences | str:
    """The same of the paper's transfer to the letter."""
    letter = LiteralHomography()
    try:
        first, second, grasp = _pair_of_views(footage, frame)
        description = letter.describe(grasp, first)
        v, places, errors = letter.matches(description, second.outer, None)
        H = letter.homography(description, second.outer, None)
        refined = letter.applied(description, second, H).grasp.contacts
    except Refused as error:
        return str(error)
    curvature = description.curvature * first.outer.length, v * second.outer.length
    samples, scaled = (description.samples, places.astype(int).tolist()), (errors * second.outer.length).tolist()
    found = curvature, samples, places.tolist(), scaled, H, apply_homography(H, grasp.contacts), refined
    return Correspondences(footage, frame, "to the letter", first, second, *found)


def _pair_of_views(footage: Footage, frame: int) -> tuple[View, View, Grasp]:
    """The first frame's view and another's, and the grasp on the first."""
    views = footage.silhouettes[0], footage.silhouettes[frame]
    for view in views:
        if isinstance(view, str):
            raise StrategyError(view)
    first, second = (view for view in views if isinstance(view, View))
    return first, second, Grasp(footage.on_silhouette)


def _match_samples(
    description: homography.HomographyDescription, second: View
) -> tuple[list[int], CurvatureMatches, Floats]:
    """Step 1: selected samples, their matches, and the second contour's curvature."""
    outline, current = description.outline, second.outer
    arc2, v2 = kernels.curvature_vector(current.points, current.clipped, homography.SMOOTHING)
    length, selected = description.arc.item(-1), description.peaks[:4]
    kappa = arc2.item(-1) / length
    ways = alignments_of_points(outline.points, description.arc, current.points, arc2, current.area)
    shift = choose_alignment(ways, description.view, second).shift * length
    spacing = homography.NEIGHBOURHOOD * length / homography.RADIUS
    matched = kernels.match_curvature(
        CurvatureVector(description.arc, description.curvature),
        selected,
        CurvatureVector(arc2, v2),
        [kappa * (description.arc.item(i) + shift) for i in selected],
        MatchWindow(kappa, homography.SEARCH * length, homography.RADIUS, spacing, homography.MAX_ERROR),
    )
    return selected, matched, v2


def table_two(found: Sequence[Correspondences | RefusedPair]) -> Table:
    """Table II as numbers; of a pair that was refused, see `RefusedPair`."""
    rows: list[Row] = []
    for c in found:
        if isinstance(c, tuple):
            rows.append((*c[:2], "all", f"refused: {c[2]}", *[None] * 5))
            continue
        true = apply_homography(c.footage.H[c.frame], c.points[0])
        for k, (i, j) in enumerate(zip(*c.samples, strict=True)):
            p, q = c.points[0][k], c.points[1][k]
            off = float(np.hypot(*(q - true[k])))
            places = _format_sample(p, i), float(c.curvature[0][i]), _format_sample(q, j), float(c.curvature[1][j])
            rows.append((c.footage.part.name, c.transfer, f"p_{k + 1}", *places, c.errors[k], off))
    return Table(
        "II",
        f"Selected points on the first contour and their correspondences, {_pair_description(found)}",
        _HEAD,
        tuple(rows),
        (
            "The paper shows pictures and prints no numbers here; the pictures of this run are of the same pairs.",
            "Curvature times the contour's length has no unit; a circle has 2 pi throughout. Eq. (3) is the mean over "
            f"its {2 * homography.RADIUS + 1} values, to the letter their sum in the same unit.",
            "Off by: from where the true motion takes the selected point. Curvature is matched between two views of "
            "which the second is tilted, and under perspective it is not the same: this is the strategy's own error.",
            *(["-: the pair was refused."] if any(isinstance(c, tuple) for c in found) else []),
        ),
    )


def table_five(found: Sequence[Correspondences | RefusedPair]) -> Table:
    """Table V, whose printed values are missing from the text: all steps of the homography transfer."""
    rows: list[Row] = []
    for c in found:
        if isinstance(c, tuple):
            rows.append((*c[:2], "all", f"refused: {c[2]}", None, None))
            continue
        name, H = (c.footage.part.name, c.transfer), c.footage.H[c.frame]
        true = apply_homography(H, c.points[0])
        for k, (p, q) in enumerate(zip(*c.points, strict=True)):
            off = float(np.hypot(*(q - true[k])))
            rows.append((*name, f"p_{k + 1} and p'_{k + 1}", _format_point(p), _format_point(q), off))
        for k, line in enumerate(c.H.tolist()):
            rows.append((*name, f"H, row {k + 1}", " ".join(f"{v:.6g}" for v in line), "", None))
        truth = c.footage.truth("homography", c.frame)
        for step, contacts in (("H p_g", c.applied), ("refined p'_g", c.refined)):
            for k in range(2):
                off = float(np.hypot(*(contacts[k] - truth[k])))
                places = _format_point(c.footage.on_silhouette[k]), _format_point(contacts[k])
                rows.append((*name, f"{step}{k + 1}", *places, off))
    return Table(
        "V",
        f"Grasp transfer based on a homography, {_pair_description(found)}",
        ("object", "transfer", "step", "first view, (x, y) px", "second view, (x, y) px", "off by, px"),
        tuple(rows),
        (
            "The printed table is missing from the text at hand.",
            "Off by: from where the true motion takes the point of the first view. Refinement moves the contacts along "
            "their line onto the outline; along the outline it corrects nothing.",
            "-: nothing to measure.",
        ),
    )


def _pair_description(found: Sequence[Correspondences | RefusedPair]) -> str:
    for c in found:
        if isinstance(c, Correspondences):
            return f"{c.footage.kind} contours, frame 0 to frame {c.frame}, {c.footage.motion}"
    return "no pair was answered"


def _format_sample(p: Floats, index: int) -> str:
    return f"{_format_point(p)}, {index}"


def _format_point(p: Floats) -> str:
    return f"({p[0]:.2f}, {p[1]:.2f})"
