# SPDX-License-Identifier: Apache-2.0
"""Two single views, any turn, scale 0.4 to 2.5, tilt to 60 degrees: how often the match is right, ambiguous, wrong, none."""

from __future__ import annotations

import itertools
import math
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import fields
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack import kernels
from grasptrack.demo.run import accept_limit
from grasptrack.errors import AmbiguousError, GraspTrackError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, rotation_about_z, similarity_transform
from grasptrack.grasp.synthesis import synthesize
from grasptrack.kernels.results import AlignmentSteps
from grasptrack.matching import Sampled, judge_hypotheses, match_outlines
from grasptrack.matching.rating import MAX_DEPTH, MAX_STRETCH, perturb_homography, rate_homography
from grasptrack.tracking.image_pair import transfer_between_images
from grasptrack.typing import Floats
from grasptrack_bench.simulation import SHAPES, Conditions, Path, Pinhole, Scene, Shape, shape_from_mask
from research.studies import common

CAMERA = Pinhole(640, 480, focal=320.0 / math.tan(math.radians(30.0)))
"""60 degrees across: an object that fills 60 % of it is near."""
BINS = (0.0, 15.0, 30.0, 45.0, 60.0)
NOISE = 0.2
"""px, of the outlines, at points 1 px apart."""
ALIKE = 0.01
"""sqrt(area), rms: what lies on itself so well has a second alignment, ..."""
AWAY = 0.04
"""... if it moves some point of the outline by more than this: by as much as makes an answer wrong."""

CUTS = 0.1, 0.2, 0.3
"""Shares of the second outer contour's points that a straight cut takes."""
USED = 5
"""Every so many-th silhouette, and all built-in shapes, were looked at while the match was made."""
SLIDE = 0.2
"""sqrt(area): an outline that may slide along itself as far as this has a second alignment too."""


class Views(NamedTuple):
    """How two views see the part: homographies from its plane to either image, and the tilt of the second in degrees."""

    first: Floats
    second: Floats
    tilt: float

    @property
    def between(self) -> Floats:
        """From the first image to the second."""
        return self.second @ np.linalg.inv(self.first)


def sample_pose(shape: Shape, share: float, tilt: float, rng: np.random.Generator, aside: float) -> Path:
    """A camera over which the part, seen from the front, is as wide as a share of the view."""
    distance = 2.0 * shape.radius() * CAMERA.matrix[0, 0] / (share * CAMERA.width)
    turn, azimuth = rng.uniform(0.0, 2.0 * math.pi, 2)
    target = rng.uniform(-aside, aside, 2) * shape.radius()
    return Path(target[None], *(np.array([v]) for v in (distance, turn, math.radians(tilt), azimuth)))


def sample_poses(shape: Shape, rng: np.random.Generator, tilt: float) -> tuple[Path, Path]:
    """The first view from the front, the second from anywhere."""
    while True:
        one = rng.uniform(0.25, 0.6)
        other = one * math.exp(rng.uniform(math.log(0.4), math.log(2.5)))
        if 0.12 <= other <= 0.6:
            return sample_pose(shape, one, 0.0, rng, 0.0), sample_pose(shape, other, tilt, rng, 0.15)


def noisy_outline(shape: Shape, H: Floats, rng: np.random.Generator, noise: float) -> View:
    """The part's outline in an image at about one point per px, from a random first point."""
    contours = []
    for i, polygon in enumerate(shape.polygons):
        fine = apply_homography(H, kernels.resample(np.ascontiguousarray(polygon), 4000, 0.0))
        start = np.roll(fine, -int(rng.integers(len(fine))), axis=0)
        count = max(12, round(float(kernels.arc_length(np.ascontiguousarray(start))[-1])))
        points = kernels.resample(np.ascontiguousarray(start), count, 0.0)
        contours.append(Contour.trusted(points + rng.normal(0.0, noise, points.shape), hole=i > 0))
    return View(contours)


def second_alignments(shape: Shape) -> list[Floats]:
    """Homographies of the part's plane, other than the identity, that lay its true outline on itself within `ALIKE`.

    From 71 turns of the whitened outline, each laid down by Gauss-Newton on all eight parameters: no step of the match
    that decides where to begin is used.
    """
    scale = 400.0
    a = Sampled(noisy_outline(shape, np.diag([scale, scale, 1.0]), np.random.default_rng(0), 0.0))
    _, x, y, theta, major, minor, *_ = kernels.polygon_moments(a.outer, np.array([0, len(a.outer)]))
    white = np.diag([major**-0.5, minor**-0.5, 1.0]) @ similarity_transform(1.0, -theta, (x, y), (0.0, 0.0))
    turns = (rotation_about_z(turn) for turn in 2.0 * math.pi * np.arange(1, 72) / 72)
    starts = [(np.linalg.inv(white) @ turn @ white).ravel() for turn in turns]
    own = a.points, a.normals, a.points, a.normals, a.offsets
    reaches, damping = np.array([0.3, 0.2, 0.15] + [0.1] * 5), np.array([1e-3] * 4 + [1e-4] * 4)
    coarse = kernels.align_projective(
        np.array(starts), *own, AlignmentSteps(reaches * a.size, damping, np.full(8, 4), 0.02 * a.size)
    )
    coarse = coarse[np.isfinite(coarse[:, 9])]
    fine = kernels.align_projective(
        np.ascontiguousarray(coarse[:, :9]),
        *own,
        AlignmentSteps(np.full(8, 0.05 * a.size), np.full(8, 1e-6), np.ones(8, np.int64), 0.1),
    )
    unit = np.array([[scale, 0.0, -a.centre[0]], [0.0, scale, -a.centre[1]], [0.0, 0.0, 1.0]])
    found = []
    for row in fine[fine[:, 9] <= ALIKE * a.size]:
        H = row[:9].reshape(3, 3)
        if np.hypot(*(apply_homography(H, a.outer) - a.outer).T).max() > AWAY * a.size:
            found.append(np.linalg.inv(unit) @ H @ unit)
    # a slide: as far as a fifth of sqrt(area), the outline stays on itself
    for row in perturb_homography(np.eye(3), a, (-SLIDE, SLIDE)):
        moved = rate_homography(row.reshape(3, 3), a, a)
        if moved is not None and moved.misfit <= ALIKE * a.size:
            found.append(np.linalg.inv(unit) @ row.reshape(3, 3) @ unit)
    return found


def is_plausible_view(H: Floats, points: Floats) -> bool:
    """Whether a camera within the stated tilt could have seen the first view so."""
    in_front, determinant, ratio = kernels.distortion(H, points)
    depth = np.abs(points @ H[2, :2] + H[2, 2])
    return bool(in_front > 0 and determinant > 0 and ratio <= MAX_STRETCH and depth.max() <= MAX_DEPTH * depth.min())


def has_second(views: Views, alignments: list[Floats], shape: Shape) -> bool:
    """Whether the second view could also be one of the part laid on itself otherwise."""
    points = apply_homography(views.first, shape.outer)
    back = np.linalg.inv(views.first)
    return any(is_plausible_view(views.second @ S @ back, points) for S in alignments)


def contacts_of(view: View) -> Floats:
    """The best grasp of two fingers; the outline's ends where there is none."""
    best = synthesize(view, 2, 0.5, top=1)
    if best:
        return best[0].contacts
    points = view.outer.points
    return points[[int(points[:, 0].argmin()), int(points[:, 0].argmax())]]


def has_wrong_contact(H: Floats, views: Views, contacts: Floats, size: float) -> bool:
    """Whether a contact is farther from its true place than the limit."""
    gap = apply_homography(H, contacts) - apply_homography(views.between, contacts)
    return bool(np.hypot(*gap.T).max() > accept_limit(size**2))


class OutcomeTally:
    """Counts of outcomes by tilt, of pairs with one alignment and with more."""

    def __init__(self) -> None:
        self.counts: dict[tuple[bool, int], Counter[str]] = defaultdict(Counter)
        self.told: list[str] = []
        self.times: list[float] = []

    def add(self, name: str, tilt: float, second: bool, what: str) -> None:
        """Count one pair."""
        part = min(int(np.searchsorted(BINS, tilt, side="right")) - 1, len(BINS) - 2)
        self.counts[second, part][what] += 1
        if what == "wrong" or (not second and what != "matched"):
            self.told.append(f"{name} at {tilt:.0f} degrees: {what}{' (has a second alignment)' if second else ''}")

    def show(self, title: str) -> None:
        """Print the table."""
        common.begin_section(title)
        rows = []
        for second in (False, True):
            parts = [self.counts[second, i] for i in range(len(BINS) - 1)]
            labels = [f"{low:.0f} to {high:.0f}" for low, high in itertools.pairwise(BINS)]
            for label, part in zip([*labels, "all"], [*parts, sum(parts, Counter())], strict=True):
                total = sum(part.values())
                cells = [part[what] for what in ("matched", "ambiguous", "wrong", "none")]
                share = 100.0 * part["matched"] / total if total else float("nan")
                rows.append(["two or more" if second else "one", label, total, *cells, share])
        head = ("true alignments", "tilt, degrees", "pairs", "matched", "ambiguous", "wrong", "none", "matched %")
        common.add_table(head, rows)
        if self.times:
            middle, late = np.percentile(self.times, [50, 99])
            common.add_paragraph(f"A match takes {middle:.1f} ms, median, and {late:.1f} ms at the 99th percentile.")
        for line in self.told:
            print(line)


class ViewPair(NamedTuple):
    """Two views of a part: poses of both cameras and what they see, and whether the part has a second alignment there."""

    shape: Shape
    paths: tuple[Path, Path]
    views: Views
    second: bool
    rng: np.random.Generator


def sample_pairs(shapes: dict[str, Shape], count: int, *stream: int) -> Iterator[ViewPair]:
    """So many pairs of each part, drawn by the numbers of a stream."""
    for name, shape in shapes.items():
        rng = np.random.default_rng((*stream, len(name), *name.encode()))
        alignments = second_alignments(shape)
        for _ in range(count):
            tilt = float(rng.uniform(BINS[0], BINS[-1]))
            paths = sample_poses(shape, rng, tilt)
            first, second = (path.table_to_image(CAMERA)[0] for path in paths)
            views = Views(first, second, tilt)
            yield ViewPair(shape, paths, views, has_second(views, alignments, shape), rng)


def show_outlines(shapes: dict[str, Shape], count: int, seed: int, title: str) -> None:
    """Pairs of outlines."""
    tally = OutcomeTally()
    for shape, _, views, more, rng in sample_pairs(shapes, count, seed):
        first, second = (noisy_outline(shape, H, rng, NOISE) for H in views[:2])
        start = time.perf_counter()
        told = judge_hypotheses(match_outlines(first, second))
        tally.times.append(1e3 * (time.perf_counter() - start))
        what: str = told.status
        if told.best is not None and told.status == "matched":
            what = (
                "wrong" if has_wrong_contact(told.best.homography, views, contacts_of(first), told.best.size) else what
            )
        tally.add(shape.name, views.tilt, more, what)
    tally.show(title)


def show_cut(shapes: dict[str, Shape], count: int, seed: int) -> None:
    """Pairs with one true alignment whose second outline lost a piece to a straight cut."""
    rows = []
    for share in CUTS:
        told: Counter[str] = Counter()
        for shape, _, views, more, rng in sample_pairs(shapes, count, seed, 2):
            first, whole = (noisy_outline(shape, H, rng, NOISE) for H in views[:2])
            angle = rng.uniform(0.0, 2.0 * math.pi)
            if more:
                continue
            way = np.array([math.cos(angle), math.sin(angle)])
            edge = np.quantile(whole.outer.points @ way, 1.0 - share)
            holes = [h for h in whole.contours[1:] if (h.points @ way).max() <= edge]
            second = View([Contour.trusted(whole.outer.points[whole.outer.points @ way <= edge]), *holes])
            found = judge_hypotheses(match_outlines(first, second))
            size = math.sqrt(whole.outer.area)
            right = found.best is not None and not has_wrong_contact(
                found.best.homography, views, contacts_of(first), size
            )
            told["right" if right else "not right"] += 1
            told["wrong" if found.status == "matched" and not right else found.status] += 1
        total = told["right"] + told["not right"]
        cells = [told[what] for what in ("matched", "ambiguous", "wrong", "none")]
        rows.append([f"{100 * share:.0f} %", total, *cells, 100.0 * told["right"] / max(total, 1)])
    common.begin_section("global match, outlines of which a straight cut takes a piece")
    common.add_table(("points cut off", "pairs", "matched", "ambiguous", "wrong", "none", "best one right %"), rows)


def show_images(shapes: dict[str, Shape], count: int, seed: int) -> None:
    """Pairs of rendered images."""
    tally = OutcomeTally()
    for k, (shape, paths, views, more, rng) in enumerate(sample_pairs(shapes, count, seed, 1)):
        names = [field.name for field in fields(Path)]
        path = Path(*(np.concatenate([getattr(p, name) for p in paths]) for name in names))
        scene = Scene(shape, path, camera=CAMERA, conditions=Conditions(), seed=seed + k % count)
        tally.add(shape.name, views.tilt, more, transfer_outcome(scene, views, rng))
    tally.show("global match, rendered images through `tracking.image_pair.transfer_between_images`")


def transfer_outcome(scene: Scene, views: Views, rng: np.random.Generator) -> str:
    """What `pair.transfer_between_images` makes of two images, the reference's outline being the true one."""
    reference = noisy_outline(scene.shape, views.first, rng, 0.0)
    grasps = synthesize(reference, 2, 0.5, top=1)
    if not grasps:
        return "no grasp"
    frames = scene[0], scene[1]
    try:
        pair = transfer_between_images(grasps[0], reference, frames[0].image, frames[1].image, 0.5)
    except AmbiguousError:
        return "ambiguous"
    except GraspTrackError:
        return "none"
    best = pair.outcomes[0]
    if pair.found.status == "ambiguous":
        return "ambiguous"
    if best.reason or best.homography is None:
        return "none"
    size = math.sqrt(abs(frames[1].area))
    return "wrong" if has_wrong_contact(best.homography, views, grasps[0].contacts, size) else "matched"


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__, shapes=",".join(SHAPES), seed=0)
    parser.add_argument("--pairs", type=int, default=30, help="of outlines, for each built-in shape")
    parser.add_argument("--silhouettes", type=int, default=4, help="pairs for each silhouette; 0 for none")
    parser.add_argument(
        "--cut", type=int, default=4, help="pairs of each built-in shape with a piece cut off; 0 for none"
    )
    parser.add_argument("--images", type=int, default=4, help="rendered pairs for each built-in shape; 0 for none")
    given = parser.parse_args()
    built_in = {name: SHAPES[name]() for name in given.shapes.split(",")}
    show_outlines(built_in, given.pairs, given.seed, "global match, outlines of the built-in shapes")
    if given.cut:
        show_cut(built_in, given.cut, given.seed)
    files = sorted((common.data_folder() / "silhouettes").glob("*.png")) if given.silhouettes else []
    used, others = files[::USED], [file for i, file in enumerate(files) if i % USED]
    for some, title in ((used, "used in development"), (others, "never used in development")):
        if some:
            shapes = {
                p.stem: shape_from_mask(np.asarray(cv2.imread(str(p), cv2.IMREAD_GRAYSCALE)), p.stem) for p in some
            }
            show_outlines(shapes, given.silhouettes, given.seed, f"global match, outlines of silhouettes {title}")
    if given.images:
        show_images(built_in, given.images, given.seed)
    common.write_sections(given.output)


if __name__ == "__main__":
    main()
