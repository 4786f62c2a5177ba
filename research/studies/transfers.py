# SPDX-License-Identifier: Apache-2.0
"""The transfers on random outlines, each view sampled on its own: correspondences, contacts, cut outlines, twins."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import grasptrack as gt
from grasptrack import kernels
from grasptrack.errors import AmbiguousError, GraspTrackError, TransferError
from grasptrack.geometry.contours import Contour
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.synthesis import synthesize
from grasptrack.transfer import grasp_line, homography
from grasptrack.typing import Floats
from grasptrack_bench.simulation.outlines import round_corners
from research.studies import common

SIZE, CENTRE = 130.0, (320.0, 240.0)
"""px: the root of an outline's area, and where its centroid is."""
FOCAL = 600.0
"""px, and the distance in px at which a view from the front has this size."""
DENSE = 6000
"""Points of the outline from which views are sampled."""
TURN, ZOOM, SHIFT = math.radians(60.0), 0.12, 30.0
"""Of a whole path, as in the paper's tables."""
FRAME_TURN, FRAME_ZOOM, FRAME_SHIFT, FRAME_TILT = math.radians(2.0), 0.01, 4.0, 1.5
"""Largest change from the last frame, which is the prior; tilt in degrees."""
OFF = 3.0
"""px: contacts farther from the truth are wrong."""
CUTS = 0.1, 0.25, 0.4
"""Shares of the outline's length that a straight border takes."""
ODD = 0.0, 0.005, 0.01, 0.02, 0.04, 0.08
"""Share of the radius by which an outline differs from itself after a half turn."""
NOISE = 0.2
"""px of smooth noise, of the outlines that nearly fit themselves."""


# --- outlines and views --------------------------------------------------------------------------


def random_outline(rng: np.random.Generator) -> Floats:
    """(N, 2) a random outline without symmetry: corners rounded by random radii, or a smooth closed curve."""
    while True:
        if rng.random() < 0.7:
            count = int(rng.integers(5, 11))
            angle = 2.0 * math.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
            corners = np.column_stack([1.4 * np.cos(angle), np.sin(angle)]) * rng.uniform(0.45, 1.4, (count, 1))
            points = round_corners(corners, rng.uniform(0.0, 0.12, count).tolist())
        else:
            points = wave_outline(rng.uniform(-1.0, 1.0, 8), rng.uniform(0.0, 2.0 * math.pi, 8))
        try:
            outline = Contour(points)
        except GraspTrackError:  # it crosses itself
            continue
        return dense_outline(outline)


def wave_outline(sizes: Floats, phases: Floats) -> Floats:
    """(600, 2) an oval whose radius has waves k = 1, 2, ... of given sizes (K,) and phases (K,) rad."""
    t = np.linspace(0.0, 2.0 * math.pi, 600, endpoint=False)
    k = np.arange(1, len(sizes) + 1)
    radius = 1.0 + (0.35 * sizes / np.sqrt(k) * np.cos(np.outer(t, k) + phases)).sum(axis=1)
    return np.asarray(np.column_stack([1.5 * np.cos(t), np.sin(t)]) * np.maximum(radius, 0.25)[:, None])


def twin_outline(rng: np.random.Generator, odd: float) -> Floats:
    """(N, 2) an outline that a half turn maps to itself but for a share of its radius."""
    while True:
        sizes = rng.uniform(-1.0, 1.0, 8)
        sizes[::2] = 0.0
        waves = rng.normal(0.0, 1.0, 3), rng.uniform(0.0, 2.0 * math.pi, 3)
        points = wave_outline(sizes, rng.uniform(0.0, 2.0 * math.pi, 8))
        t = np.linspace(0.0, 2.0 * math.pi, len(points), endpoint=False)
        wave = np.cos(np.outer(t, [3.0, 5.0, 7.0]) + waves[1]) @ waves[0]
        try:
            return dense_outline(Contour(points * (1.0 + odd * wave / wave.std())[:, None]))
        except GraspTrackError:
            continue


def dense_outline(outline: Contour) -> Floats:
    """(`DENSE`, 2) px of the usual size and place."""
    area, x, y, *_ = kernels.polygon_moments(outline.points, outline.offsets)
    scale = SIZE / math.sqrt(area)
    return kernels.resample(np.ascontiguousarray(scale * (outline.points - (x, y)) + CENTRE), DENSE, 0.0)


class Pose(NamedTuple):
    """Of the object in a view: turn, log of the zoom, shift in px, tilt in degrees about an axis at an angle in rad."""

    turn: float
    zoom: float
    x: float
    y: float
    tilt: float
    axis: float

    @property
    def homography(self) -> Floats:
        """(3, 3) from the view from the front."""
        tilt = math.radians(self.tilt)
        u, v = math.cos(self.axis), math.sin(self.axis)
        c, s = math.cos(tilt), math.sin(tilt)
        rows = [
            [c + u * u * (1 - c), u * v * (1 - c), 0.0],
            [u * v * (1 - c), c + v * v * (1 - c), 0.0],
            [0.0, 0.0, 1.0],
        ]
        rows[2][:2] = [-s * v / FOCAL, s * u / FOCAL]
        there = similarity_transform(
            math.exp(self.zoom), self.turn, (0.0, 0.0), (CENTRE[0] + self.x, CENTRE[1] + self.y)
        )
        return np.asarray(there @ np.array(rows) @ similarity_transform(1.0, 0.0, CENTRE, (0.0, 0.0)))

    def frame_before(self, rng: np.random.Generator) -> Pose:
        """The pose a frame earlier."""
        spread = FRAME_TURN, FRAME_ZOOM, FRAME_SHIFT, FRAME_SHIFT
        turn, zoom, x, y = (value + rng.uniform(-s, s) for value, s in zip(self[:4], spread, strict=True))
        return Pose(turn, zoom, x, y, max(0.0, self.tilt - rng.uniform(0.0, FRAME_TILT)), self.axis)


def random_pose(rng: np.random.Generator, tilt: float, turn: float = TURN) -> Pose:
    """Any pose of a path."""
    x, y = rng.uniform(-SHIFT, SHIFT, 2)
    return Pose(rng.uniform(-turn, turn), rng.uniform(-ZOOM, ZOOM), x, y, tilt, rng.uniform(0.0, 2.0 * math.pi))


def sample_outline(outline: Floats, count: int, rng: np.random.Generator) -> Floats:
    """(count, 2) px at equal steps of a dense outline (N, 2), from anywhere between its points."""
    arc = kernels.arc_length(outline)
    at = np.mod(rng.uniform(0.0, arc[-1]) + np.arange(count) * (arc[-1] / count), arc[-1])
    closed = np.append(outline, outline[:1], axis=0)
    return np.column_stack([np.interp(at, arc, closed[:, i]) for i in range(2)])


def add_noise(points: Floats, noise: float, rng: np.random.Generator) -> Floats:
    """Points (N, 2) with smooth noise of some px."""
    smooth = np.fft.rfftfreq(len(points)) < 40.0 / len(points)
    waves = np.fft.rfft(rng.normal(0.0, 1.0, points.shape), axis=0) * smooth[:, None]
    random = np.fft.irfft(waves, len(points), axis=0)
    return np.asarray(points + noise * random / random.std())


def cut_outline(outline: Floats, share: float, angle: float) -> tuple[Floats, Floats] | None:
    """What a straight border leaves of a dense outline (N, 2), and (N,) px how far each of its points is inside.

    None where the border leaves more than one piece.
    """
    depth = outline @ np.array([math.cos(angle), math.sin(angle)])
    inside = np.quantile(depth, 1.0 - share) - depth
    kept = inside > 0.0
    starts = np.flatnonzero(kept & ~np.roll(kept, 1))
    if len(starts) != 1:
        return None
    order = np.roll(np.arange(len(outline)), -int(starts[0]))
    return outline[order[: np.count_nonzero(kept)]], inside


# --- one pair ------------------------------------------------------------------------------------


class TransferCase(NamedTuple):
    """Pairs of a kind: tilt in degrees, whether the last frame is the prior, share that is cut."""

    name: str
    tilt: float
    prior: bool
    cut: float = 0.0


CASES = (
    TransferCase("4 DoF, no prior", 0.0, False),
    TransferCase("4 DoF, last frame", 0.0, True),
    TransferCase("30 degrees, no prior", 30.0, False),
    TransferCase("30 degrees, last frame", 30.0, True),
    *(TransferCase(f"4 DoF, last frame, {100 * cut:.0f} % cut", 0.0, True, cut) for cut in CUTS),
    *(TransferCase(f"30 degrees, last frame, {100 * cut:.0f} % cut", 30.0, True, cut) for cut in CUTS),
)


class Answer(NamedTuple):
    """What the homography made of a pair: px off of its four points and of the worst contact, or why it refused."""

    points: Floats
    contact: float
    refusal: str


def transfer_pair(case: TransferCase, count: int, seed: int) -> Answer | None:
    """Transfer by the homography between two views; None where a pair has no such grasp, or no four peaks."""
    rng = np.random.default_rng([seed, CASES.index(case)])
    outline, pose = random_outline(rng), random_pose(rng, case.tilt)
    H, prior = pose.homography, pose.frame_before(rng).homography if case.prior else None
    reference = Contour(sample_outline(outline, count, rng))
    seen = apply_homography(H, outline)
    spacing = float(kernels.arc_length(seen)[-1]) / count
    clipped: NDArray[np.bool_] | None = None
    border: Callable[[Floats], Floats] | None = None
    if case.cut:
        angles = rng.uniform(0.0, 2.0 * math.pi, 20)
        angle, found = next(((a, c) for a in angles if (c := cut_outline(seen, case.cut, a)) is not None), (0.0, None))
        if found is None:
            return None
        way = np.array([math.cos(angle), math.sin(angle)])
        limit = float((seen @ way + found[1])[0])
        seen = found[0]
        border = lambda points: limit - points @ way  # noqa: E731
    points = sample_outline(seen, max(24, round(float(kernels.arc_length(seen)[-1]) / spacing)), rng)
    if border is not None:  # what lies on the chord that closes it
        ends = np.array([seen[-1], seen[0]])
        along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
        off = np.abs((points - ends[0]) @ np.array([-along[1], along[0]]))
        clipped = off < 1e-6
    current = Contour.trusted(points, clipped=clipped)
    grasp = next(
        (
            g
            for g in synthesize(reference, friction=1.0, top=50)
            if border is None or border(apply_homography(H, g.contacts)).min() > 0.05 * SIZE
        ),
        None,
    )
    if grasp is None:
        return None
    try:
        peaks = homography.describe(grasp, reference).peaks[:4]
    except TransferError:
        return None
    try:
        moved = gt.transfer(grasp, reference, current, "homography", prior)
    except TransferError as error:
        return Answer(np.empty(0), math.nan, type(error).__name__)
    four = reference.points[peaks]
    assert moved.homography is not None
    off = np.hypot(*(apply_homography(moved.homography, four) - apply_homography(H, four)).T)
    contact = np.hypot(*(moved.grasp.contacts - apply_homography(H, grasp.contacts)).T).max()
    return Answer(off, float(contact), "")


def show_pairs(pairs: int, points: int, seed: int, workers: int) -> None:
    """The table of pairs."""
    common.begin_section(f"Homography transfer: random outlines of {points} points")
    common.add_paragraph(
        "Each view is sampled on its own, from anywhere between points. Correspondences: the four points through the "
        f"homography that was found against their true places. The contact is the worse of two; wrong is above {OFF:g} px."
    )
    rows: list[list[object]] = []
    for case in CASES:
        seeds = range(seed, seed + pairs)
        found = [a for a in common.run_all(partial(transfer_pair, case, points), seeds, workers) if a is not None]
        good = [a for a in found if not a.refusal]
        off, contact = np.concatenate([a.points for a in good]), np.array([a.contact for a in good])
        low, high = np.percentile(off, (50, 95)).tolist()
        worst = [float(np.percentile(contact, p)) for p in (50, 95, 100)]
        wrong = 100.0 * float((contact > OFF).mean())
        rows.append([case.name, len(found), 100.0 * len(good) / len(found), low, high, *worst, wrong])
        refused = Counter(a.refusal for a in found if a.refusal)
        rows[-1].append(", ".join(f"{name} {n}" for name, n in refused.most_common()) or "none")
    heads = ["pairs", "n", "answered, %", "correspondences, px", "95 %", "contact, px", "95 %", "largest", "wrong, %"]
    common.add_table([*heads, "refusals"], rows)


# --- outlines that fit, or nearly fit, themselves turned -----------------------------------------


def transfer_turned(odd: float | None, strategy: str, tilt: float, seed: int) -> tuple[str, float] | None:
    """What a transfer without a prior makes of a pair at any turn, and the overlap of the outline with its half turn.

    `odd` is as for `twin_outline`, None for a random outline; the tilt of the second view is in degrees.
    """
    rng = np.random.default_rng([seed, 0 if odd is None else 1 + round(1e4 * odd)])
    outline = random_outline(rng) if odd is None else twin_outline(rng, odd)
    noise = 0.0 if odd is None else NOISE
    H = random_pose(rng, tilt, math.pi).homography
    reference = Contour.trusted(add_noise(sample_outline(outline, 300, rng), noise, rng))
    current = Contour.trusted(add_noise(sample_outline(apply_homography(H, outline), 300, rng), noise, rng))
    grasp: Grasp | None = None
    for candidate in synthesize(reference, friction=1.0, top=20):
        try:
            {"homography": homography, "grasp-line": grasp_line}[strategy].describe(candidate, reference)
        except TransferError:
            continue
        grasp = candidate
        break
    if grasp is None:
        return None
    overlap = half_turn_overlap(outline)
    try:
        moved = gt.transfer(grasp, reference, current, strategy)
    except AmbiguousError:
        return "ambiguous", overlap
    except TransferError:
        return "refused", overlap
    truth = apply_homography(H, grasp.contacts)
    off = np.hypot(*(moved.grasp.contacts - truth).T).max()
    if off > 0.04 * SIZE and np.hypot(*(moved.grasp.contacts[::-1] - truth).T).max() <= 0.04 * SIZE:
        return "right", overlap  # a grasp that maps to itself
    return "wrong" if off > 0.1 * SIZE else "right", overlap


def half_turn_overlap(outline: Floats) -> float:
    """Intersection over union of an outline (N, 2) and itself after a half turn about its centroid."""
    import cv2

    few = outline[:: len(outline) // 600]
    _, x, y, *_ = kernels.polygon_moments(few, np.array([0, len(few)], dtype=np.int64))
    masks = []
    for sign in (1.0, -1.0):
        mask = np.zeros((480, 640), dtype=np.uint8)
        cv2.fillPoly(mask, [np.rint(sign * (few - (x, y)) + CENTRE).astype(np.int32)], 1)
        masks.append(mask.astype(bool))
    return float((masks[0] & masks[1]).sum() / (masks[0] | masks[1]).sum())


def show_turned(pairs: int, seed: int, workers: int) -> None:
    """What is said of outlines at any turn, without a prior."""
    common.begin_section("Transfers without a prior: outlines at any turn")
    common.add_paragraph(
        f"Outlines that differ from themselves after a half turn by a share of their radius, with {NOISE:g} px of noise, "
        f"and random ones without noise. Wrong is above {0.1 * SIZE:g} px: it counts which end is which. 'Overlap' is that of "
        "an outline with its half turn, in the middle of all and of those that were called ambiguous."
    )
    rows: list[list[object]] = []
    for strategy in ("homography", "grasp-line"):
        for tilt in (0.0, 15.0):
            for odd in (*ODD, None):
                work = partial(transfer_turned, odd, strategy, tilt)
                found = [a for a in common.run_all(work, range(seed, seed + pairs), workers) if a is not None]
                share = Counter(what for what, _ in found)
                count = [100.0 * share[what] / len(found) for what in ("right", "ambiguous", "refused", "wrong")]
                unsure = [overlap for what, overlap in found if what == "ambiguous"]
                name = "random" if odd is None else f"odd by {100 * odd:g} %"
                middle = float(np.median([overlap for _, overlap in found]))
                of_unsure = float(np.median(unsure)) if unsure else math.nan
                rows.append([strategy, tilt, name, len(found), *count, middle, of_unsure])
    heads = [
        "strategy", "tilt", "outline", "n", "right, %", "ambiguous, %", "refused, %", "wrong, %", "overlap",
        "if ambiguous",
    ]  # fmt: skip
    common.add_table(heads, rows)


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__, workers=1)
    parser.add_argument("--pairs", type=int, default=600, help="outlines of each kind")
    parser.add_argument("--points", type=int, nargs="+", default=[300], help="points of an outline")
    parser.add_argument("--seed", type=int, default=1, help="of the first outline")
    args = parser.parse_args()
    for points in args.points:
        show_pairs(args.pairs, points, args.seed, args.workers)
    show_turned(args.pairs, args.seed, args.workers)
    common.write_sections(args.output)


if __name__ == "__main__":
    main()
