# SPDX-License-Identifier: Apache-2.0
"""Every step of the product, over the outline's length and over the image's size, with OpenCV's calls beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np

import grasptrack as gt
from grasptrack import kernels
from grasptrack.demo import STRATEGIES
from grasptrack.first_image import FirstImage
from grasptrack.geometry.homographies import apply_homography
from grasptrack.segmentation.first_look import find_objects
from grasptrack.segmentation.localization import localize_contour
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.segmentation.silhouettes import trace_silhouettes
from grasptrack.snake.active_contour import Snake
from grasptrack.tracking.estimator import estimate_pose
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.pose import Hypothesis
from grasptrack.tracking.target import build_pyramid
from grasptrack.transfer import TransferStrategy, homography, strategy_named
from grasptrack.transfer.alignment import find_alignments
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.baselines import available_baselines
from grasptrack_bench.method import MethodStart
from grasptrack_bench.metrics.score import Score
from grasptrack_bench.simulation import SHAPES, Pinhole, SceneFrame, bracket_scene, tilting_path
from research.studies import common
from research.studies.loop import strategy_maker
from research.studies.transfers import add_noise

LENGTHS = (100, 300, 1000, 3000, 10000, 30000)
TRANSFERS = {"RRP": "rrp", "grasp line": "grasp-line", "homography": "homography"}
TARGETS = {"RRP: transfer": 3.0, "grasp line: transfer": 8.0, "homography: transfer": 35.0, "analysis": 20.0}
"""us on 300 points."""
SYNTHESIS_UP_TO = 3000
"""Points of an outline that grasps are chosen on: the tracker's have 1600 at most."""
SIZES = ((640, 480), (1280, 960), (2000, 1500), (4000, 3000))
LENGTH, BEGIN = 240, 40
"""Frames of the whole scene, and the one to begin with: from there it turns and shifts as a hand would move it."""
SLOW = ("paper-grasp-line", "paper-homography", "paper-rrp", "visp")
"""Peers left out: the first three are measured as steps of ours, the last by `loop`."""

Measured = dict[str, Floats]
"""Times of each call, by the name of the step: us over the outline's length, ms over the image's size."""
Errors = dict[str, float]
"""px, median, by the name of the step."""


class Clock:
    """Times of steps by their names."""

    def __init__(self, per_second: float) -> None:
        self.taken: Measured = {}
        self._per_second = per_second

    def __call__(self, name: str, call: Callable[..., object], pool: Iterable[tuple[object, ...]]) -> None:
        """Time a step over a pool of arguments, which is made before."""
        self.taken[name] = self._per_second * common.time_calls(call, list(pool))

    def estimate(self, follower: Follower, images: Sequence[Pixels], H: Iterable[Floats]) -> None:
        """Time a pose estimate, begun at H (3, 3) of each image."""
        state = follower.state

        def run_estimate(levels: Any, at: Floats) -> None:
            estimate_pose(state, levels, Hypothesis("", state.target.pose(at), state.P))

        self("pose estimate", run_estimate, ((build_pyramid(i), np.asarray(h)) for i, h in zip(images, H, strict=True)))

    def snake(self, view: gt.View, contacts: Floats, first: Pixels, images: Sequence[Pixels]) -> None:
        """Time a snake's step."""
        snake = Snake(view, first, contacts=contacts)

        def step_snake(image: Pixels) -> None:
            snake.predict()
            snake.update(image)

        self("snake's step", step_snake, ((image,) for image in images))


# --- over the outline's length -------------------------------------------------------------------


class StepViews(NamedTuple):
    """Outlines of a gently moving part whose points correspond, and the homographies (3, 3) from the first to each."""

    first: Floats
    others: list[Floats]
    H: list[Floats]


def noisy_views(count: int, calls: int) -> StepViews:
    """A reference outline and as many others, with sensor-like noise of 0.05 px."""
    rng = np.random.default_rng(count)
    plain = kernels.resample(np.ascontiguousarray(SHAPES["bracket"]().outer), count, 0.0)
    path = tilting_path(calls + 1, tilt=0.12, reach=0.2, zoom=0.08, turn=0.25, distance=4.4, seed=5)
    matrices = list(path.table_to_image(Pinhole()))
    projected = [add_noise(gt.Contour(plain).transformed(H).points, 0.05, rng) for H in matrices]
    back = np.linalg.inv(matrices[0])
    return StepViews(projected[0], projected[1:], [H @ back for H in matrices[1:]])


def new_contours(outlines: Iterable[Floats]) -> list[gt.Contour]:
    """A new contour of each outline, which keeps nothing that a step could use."""
    return [gt.Contour(points) for points in outlines]


def time_on_outlines(seen: StepViews) -> tuple[Measured, Errors]:
    """Every step on outlines of one length."""
    reference, clock = gt.Contour(seen.first), Clock(1e6)
    grasp = gt.synthesize(reference)[0]
    spots = grasp.on(reference)
    errors: Errors = {}

    def snap_grasp(contour: gt.Contour) -> gt.Grasp:
        return gt.Grasp(kernels.point_at(contour.points, contour.offsets, spots))

    def compute_curvature(c: gt.Contour) -> tuple[Floats, Floats]:
        return kernels.curvature_vector(c.points, c.clipped, homography.SMOOTHING)

    clock("construction of a Contour", gt.Contour, ((p,) for p in seen.others))
    clock("curvature", compute_curvature, ((c,) for c in new_contours(seen.others)))
    curves = [(c.points, *compute_curvature(c)) for c in new_contours(seen.others)]
    apart = [homography.SEPARATION * float(arc[-1]) for _, arc, _ in curves]
    peaks = zip(curves, apart, strict=True)
    clock("peaks", kernels.select_points, ((*c, a, homography.PROMINENCE) for c, a in peaks))
    clock("alignment", find_alignments, ((reference, c) for c in new_contours(seen.others)))
    for name, strategy in TRANSFERS.items():
        module: TransferStrategy = strategy_named(strategy)
        described = module.describe(grasp, gt.View(reference))
        clock(f"{name}: describe", module.describe, ((snap_grasp(c), c) for c in new_contours(seen.others)))
        served, off = [], []
        for points, H in zip(seen.others, seen.H, strict=True):
            try:
                contacts = module.apply(described, gt.View(gt.Contour(points))).grasp.contacts
            except gt.TransferError:  # a refusal costs another time than an answer
                continue
            served.append(points)
            off.extend(np.hypot(*(contacts - apply_homography(H, grasp.contacts)).T))
        if len(served) < len(seen.others):
            short = f"{len(seen.others) - len(served)} of {len(seen.others)}"
            common.add_paragraph(
                f"Note: {name} refused {short} outlines of {len(seen.first)} points; the others are timed."
            )
        clock(f"{name}: apply", module.apply, ((described, c) for c in new_contours(served)))
        clock(f"{name}: transfer", gt.transfer, ((grasp, reference, c, strategy) for c in new_contours(served)))
        errors[f"{name}: transfer"] = float(np.median(off)) if off else np.nan
    clock("analysis", gt.analyze, ((snap_grasp(c), c) for c in new_contours(seen.others)))
    if len(seen.first) <= SYNTHESIS_UP_TO:
        clock("synthesis, 50 grasps", gt.synthesize, ((c,) for c in new_contours(seen.others[:100])))
    return clock.taken, errors


def time_with_images(count: int, calls: int) -> Measured:
    """A pose estimate and the snake's step, of an outline of `count` points on rendered images."""
    frames = list(bracket_scene(240, colour=False))[:20]
    polygon, clock = np.ascontiguousarray(frames[0].outline[0]), Clock(1e6)
    outline = gt.View(gt.Contour(kernels.resample(polygon, count, 0.0)))
    grasp = gt.synthesize(gt.Contour(kernels.resample(polygon, 300, 0.0)))[0].snapped(outline)
    order = [*frames, *frames[-2:0:-1]]
    pool = [order[i % len(order)] for i in range(calls)]
    images = [f.image for f in pool]
    clock.estimate(Follower(frames[0].image, outline, grasp.contacts), images, (f.H_current_reference for f in pool))
    clock.snake(outline, grasp.contacts, frames[0].image, images)
    return clock.taken


def time_opencv_on_outlines(seen: StepViews) -> tuple[Measured, Errors]:
    """OpenCV's calls that do comparable work, not the same work."""
    count, clock = len(seen.first), Clock(1e6)
    a = seen.first.astype(np.float32)
    pool = [p.astype(np.float32) for p in seen.others]
    chains = [np.rint(p).astype(np.int32) for p in seen.others]
    whole = np.rint(seen.first).astype(np.int32)
    four = [0, count // 4, count // 2, 3 * count // 4]
    few = pool[: max(20, len(pool) // 10)]
    grasp = gt.synthesize(gt.Contour(kernels.resample(seen.first, 300, 0.0)))[0].contacts
    fits: dict[str, Callable[[Any], Any]] = {
        "cv2.getPerspectiveTransform": lambda p: cv2.getPerspectiveTransform(a[four], p[four]),
        "cv2.findHomography, 4 points": lambda p: cv2.findHomography(a[four], p[four])[0],
        "cv2.findHomography, all points, RANSAC": lambda p: cv2.findHomography(a, p, cv2.RANSAC, 2.0)[0],
    }
    clock("cv2.moments", cv2.moments, ((p,) for p in pool))
    clock("cv2.minAreaRect", cv2.minAreaRect, ((p,) for p in pool))
    clock("cv2.fitEllipse", cv2.fitEllipse, ((p,) for p in pool))
    clock("cv2.matchShapes", lambda p: cv2.matchShapes(whole, p, 1, 0.0), ((c,) for c in chains))
    errors: Errors = {}
    for name, fit in fits.items():
        clock(name, fit, ((p,) for p in few))
        both = [apply_homography(fit(p), grasp) - apply_homography(H, grasp) for p, H in zip(few, seen.H, strict=False)]
        errors[name] = float(np.median(np.hypot(*np.concatenate(both).T)))
    return clock.taken, errors


def show_outlines(most: int, lengths: Sequence[int]) -> None:
    """Measure and show; `most` calls on the shorter outlines, fewer on longer ones."""
    common.begin_section("Steps over the outline's length")
    common.add_paragraph("Two fingers, each call on an outline that was not seen before.")
    ours: list[Measured] = []
    theirs: list[Measured] = []
    errors: list[Errors] = []
    for count in lengths:
        calls = max(min(most, 100), min(most, most * 300 // count))
        seen = noisy_views(count, calls)
        measured, off = time_on_outlines(seen)
        ours.append(measured | time_with_images(count, min(calls, 300)))
        others, other = time_opencv_on_outlines(seen)
        theirs.append(others)
        errors.append(off | other)
    heads = [f"{n:,} points" for n in lengths]
    show_steps(ours, "us", heads, (50,))
    common.add_paragraph("Comparable work in OpenCV on the same outlines, median us.")
    show_steps(theirs, "us", heads, (50,))
    common.add_paragraph(
        "Accuracy: median distance of the contacts from the truth, px. The outlines have 0.05 px of noise and are seen "
        "under a tilt of up to 7 degrees."
    )
    common.add_table(["call", *heads], [[m, *(e[m] for e in errors)] for m in errors[0]])
    steeper = []
    for name in ours[0]:
        medians = [float(np.median(m[name])) for m in ours if name in m]
        if medians[-1] > 1.2 * medians[0] * lengths[len(medians) - 1] / lengths[0]:
            steeper.append(name)
    told = (
        f"More than linearly: {', '.join(steeper)}."
        if steeper
        else "Every step grows at most linearly with the length."
    )
    common.add_paragraph(told)
    if 300 in lengths:
        common.add_paragraph("Targets on 300 points, median us.")
        got = {name: float(np.median(ours[list(lengths).index(300)][name])) for name in TARGETS}
        rows = [[name, got[name], limit, "yes" if got[name] <= limit else "NO"] for name, limit in TARGETS.items()]
        common.add_table(["step", "us", "target", "met"], rows)


# --- over the image's size -----------------------------------------------------------------------


def path_between(wire: gt.LiveWire, one: Floats, other: Floats) -> None:
    """A click, and the pointer elsewhere."""
    wire.start(*one.tolist())
    wire.path_to(*other.tolist())


def time_on_images(frames: list[SceneFrame], order: list[SceneFrame]) -> tuple[Measured, Floats]:
    """The steps of an update by themselves, and the contacts that the tracker chooses in the first frame."""
    first, clock = frames[0], Clock(1e3)
    result = gt.GraspTracker(strategy="homography").update(first.image)
    assert result.contacts is not None and result.view is not None, result.reason
    contacts, view = result.contacts, result.view
    images = [f.image for f in order]
    clock("first look: all objects", find_objects, ((image,) for image in images[: max(3, len(order) // 20)]))
    some = images[: max(3, len(order) // 20)]
    wires = [gt.LiveWire(image) for image in some]
    clock("live wire: gradients of the image", gt.LiveWire, ((image,) for image in some))
    clock("live wire: first path after a click", path_between, ((wire, *contacts[:2]) for wire in wires))
    clock("live wire: path to the pointer", path_between, ((wire, *contacts[:2]) for wire in wires))
    observer = OutlineDetector()
    observer.set_image(first.image)
    observer.choose_object(observer.find_objects(FirstImage())[0])
    outer = view.outer.points[:: max(1, len(view.outer) // 64)]
    centres = np.array([c.points.mean(axis=0) for c in view.contours[1:]]).reshape(-1, 2)

    def find_near(image: Pixels, H: Floats) -> None:
        found = next(iter(observer.views_near(image, apply_homography(H, outer), apply_homography(H, centres))))
        observer.learn_levels(found)

    to_first = np.linalg.inv(first.H_current_reference)
    moves = [f.H_current_reference @ to_first for f in order]
    clock("search near the prediction", find_near, zip(images, moves, strict=True))
    chains = []
    for image in images:
        _, binary = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
        chains.append(trace_silhouettes(np.asarray(binary, np.uint8), 1e-3 * image.size)[0].outer)

    def trace_edges(image: Pixels, chain: Any) -> None:
        localize_contour(image, chain, hole=False, polarity=1)

    clock("edge tracing of one outline", trace_edges, zip(images, chains, strict=True))
    clock("pyramid of the image", build_pyramid, ((image,) for image in images))
    clock.estimate(Follower(first.image, view, contacts), images, moves)
    clock.snake(view, contacts, first.image, images)
    return clock.taken, contacts


def time_opencv_on_images(order: list[SceneFrame]) -> Measured:
    """OpenCV's calls that every method of one's own would begin with."""
    clock = Clock(1e3)

    def find_by_otsu(image: Pixels) -> None:
        _, binary = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
        cv2.findContours(binary, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)

    clock("cv2.GaussianBlur, 5x5", lambda image: cv2.GaussianBlur(image, (5, 5), 0), ((f.image,) for f in order))
    clock("cv2.threshold, Otsu, and cv2.findContours", find_by_otsu, ((f.image,) for f in order))
    clock("cv2.Canny", lambda image: cv2.Canny(image, 50, 150), ((f.image,) for f in order))
    return clock.taken


def show_images(updates: int, sizes: Sequence[tuple[int, int]]) -> None:
    """Measure and show; `updates` images of the smallest size, fewer of larger ones."""
    common.begin_section("Steps over the image's size")
    common.add_paragraph(f"The demonstration's scene, grey, to and fro from frame {BEGIN} of {LENGTH}: gentle motion.")
    steps: list[Measured] = []
    opencv: list[Measured] = []
    whole: list[dict[str, Score]] = []
    peers = {name: make for name, make in available_baselines().items() if name not in SLOW}
    for width, height in sizes:
        scale = width * height / (sizes[0][0] * sizes[0][1])
        count = max(8, round(30 / np.sqrt(scale)))
        scene = bracket_scene(LENGTH, width=width, height=height, colour=False)
        frames = [scene[BEGIN + i] for i in range(count)]
        calls = max(2 * count, round(updates / np.sqrt(scale)))
        there = [*frames, *frames[-2:0:-1]]
        order = [there[i % len(there)] for i in range(calls)]
        measured, contacts = time_on_images(frames, order)
        steps.append(measured)
        opencv.append(time_opencv_on_images(order))
        start, few = MethodStart(contacts, order[0].outline, (width, height)), order[: max(4, calls // 6)]
        runs = {name: common.score_alone(strategy_maker(name), start, order) for name in STRATEGIES}
        whole.append(runs | {name: common.score_alone(make, start, few) for name, make in peers.items()})
    heads = [f"{w}x{h}" for w, h in sizes]
    common.add_paragraph("Steps, ms.")
    show_steps(steps, "ms", heads, (50,), growth=True)
    common.add_paragraph("Comparable work in OpenCV on the same images, ms.")
    show_steps(opencv, "ms", heads, (50,), growth=True)
    common.add_paragraph("A whole update: of each strategy, and of what a user would otherwise pick, ms.")
    taken = [{name: common.update_latencies(score) for name, score in scores.items()} for scores in whole]
    show_steps(taken, "ms", heads, (50, 99), growth=True)
    common.add_paragraph(
        "Growth is the time at the largest size over that at the smallest, which has 39 times fewer pixels."
    )
    common.add_paragraph(
        "Accuracy of these updates: px between the contacts and their true places, of the frames that were located."
    )
    figures: dict[str, Callable[[Score], float]] = {
        "median px": lambda score: score.error_percentile(50),
        "largest px": lambda score: score.error_percentile(100),
        "located, %": lambda score: 100.0 * score.located,
    }
    for what, figure in figures.items():
        common.add_table([what, *heads], [[name, *(figure(scores[name]) for scores in whole)] for name in whole[0]])


def show_steps(
    measured: list[Measured], unit: str, heads: list[str], percents: Sequence[int], *, growth: bool = False
) -> None:
    """A table of steps for each percentile."""
    for percent in percents:
        rows = []
        for name in measured[0]:
            times = [float(np.percentile(m[name], percent)) if name in m else np.nan for m in measured]
            rows.append([name, *times, *([times[-1] / times[0]] if growth else [])])
        title = f"median {unit}" if percent == 50 else f"{percent}th percentile, {unit}"
        common.add_table([title, *heads, *(["growth"] if growth else [])], rows)


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__)
    parser.add_argument(
        "--calls", type=int, default=1000, help="calls of each step on 300 points; fewer on long outlines"
    )
    parser.add_argument(
        "--updates", type=int, default=120, help="images of each step at 640x480; fewer at larger sizes"
    )
    parser.add_argument("--largest", type=int, default=len(SIZES), help="lengths and sizes, counted from the smallest")
    args = parser.parse_args()
    show_outlines(args.calls, LENGTHS if args.largest >= len(SIZES) else LENGTHS[: args.largest])
    show_images(args.updates, SIZES[: args.largest])
    common.write_sections(args.output)


if __name__ == "__main__":
    main()
