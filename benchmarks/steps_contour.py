# SPDX-License-Identifier: Apache-2.0
"""Every step that works on an outline, each call on one not seen before, and OpenCV's calls on the same outlines."""

from __future__ import annotations

import common

# isort: split
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np

import grasptrack as gt
from grasptrack import kernels
from grasptrack.bench.simulation import SHAPES, Camera, demo_scene, tilting_path
from grasptrack.geometry.homographies import apply_homography
from grasptrack.snake.active_contour import Snake
from grasptrack.tracking.estimator import Hypothesis, estimate_pose
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.target import build_pyramid
from grasptrack.transfer import grasp_line, homography, rrp
from grasptrack.transfer.alignment import find_alignments

LENGTHS = (100, 300, 1000, 3000, 10000, 30000)
TRANSFERS = {"RRP": rrp, "grasp line": grasp_line, "homography": homography}
STRATEGIES = {"RRP": "rrp", "grasp line": "grasp-line", "homography": "homography"}
TARGETS = {"RRP: transfer": 3.0, "grasp line: transfer": 8.0, "homography: transfer": 35.0, "analysis": 20.0}
"""us on 300 points."""
SYNTHESIS_UP_TO = 3000
"""Points of an outline that grasps are chosen on: the tracker's have 1600 at most."""

Measured = dict[str, np.ndarray]
"""us of each call, by the name of the step."""
Errors = dict[str, float]
"""px, median, by the name of the step."""


class Views(NamedTuple):
    """Outlines of a gently moving part whose points correspond, and the homographies (3, 3) from the first to each."""

    first: np.ndarray
    others: list[np.ndarray]
    H: list[np.ndarray]


def resampled(polygon: np.ndarray, count: int) -> np.ndarray:
    """(count, 2) points at equal arc length."""
    closed = np.concatenate([polygon, polygon[:1]])
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    at = np.linspace(0.0, s[-1], count, endpoint=False)
    return np.column_stack([np.interp(at, s, closed[:, 0]), np.interp(at, s, closed[:, 1])])


def views(count: int, calls: int) -> Views:
    """A reference outline and as many others, with sensor-like noise of 0.05 px."""
    rng = np.random.default_rng(count)
    plain = resampled(SHAPES["bracket"]().outer, count)
    path = tilting_path(calls + 1, tilt=0.12, reach=0.2, zoom=0.08, turn=0.25, distance=4.4, seed=5)
    projected = []
    smooth = np.fft.rfftfreq(count) < 40.0 / count
    matrices = list(path.table_to_image(Camera()))
    for H in matrices:
        noise = np.fft.irfft(np.fft.rfft(rng.normal(0.0, 1.0, (count, 2)), axis=0) * smooth[:, None], count, axis=0)
        projected.append(gt.Contour(plain).transformed(H).points + 0.05 * noise / noise.std())
    back = np.linalg.inv(matrices[0])
    return Views(projected[0], projected[1:], [H @ back for H in matrices[1:]])


def made(outlines: Iterable[np.ndarray]) -> list[gt.Contour]:
    """A new contour of each outline, which keeps nothing that a step could use."""
    return [gt.Contour(points) for points in outlines]


def time_steps(seen: Views) -> tuple[Measured, Errors]:
    """Every step on outlines of one length."""
    reference = gt.Contour(seen.first)
    grasp = gt.synthesize(reference)[0]
    spots = grasp.on(reference)
    us: Measured = {}
    errors: Errors = {}

    def on(contour: gt.Contour) -> gt.Grasp:
        return gt.Grasp(kernels.point_at(contour.points, contour.offsets, spots))

    def clock(name: str, call: Callable[..., object], pool: Iterable[tuple[object, ...]]) -> None:
        us[name] = 1e6 * common.each(call, list(pool))

    def vector(c: gt.Contour) -> tuple[np.ndarray, np.ndarray]:
        return kernels.curvature_vector(c.points, c.clipped, homography.SMOOTHING)

    clock("construction of a Contour", gt.Contour, ((p,) for p in seen.others))
    clock("curvature", vector, ((c,) for c in made(seen.others)))
    curves = [(c.points, *vector(c)) for c in made(seen.others)]
    apart = [homography.SEPARATION * float(arc[-1]) for _, arc, _ in curves]
    peaks = zip(curves, apart, strict=True)
    clock("peaks", kernels.select_points, ((*c, a, homography.PROMINENCE) for c, a in peaks))
    clock("alignment", find_alignments, ((reference, c) for c in made(seen.others)))
    for name, module in TRANSFERS.items():
        described = module.describe(grasp, reference)
        clock(f"{name}: describe", module.describe, ((on(c), c) for c in made(seen.others)))
        served, off = [], []
        for points, H in zip(seen.others, seen.H, strict=True):
            try:
                contacts = module.apply(described, gt.Contour(points)).grasp.contacts
            except gt.TransferError:  # a refusal costs another time than an answer
                continue
            served.append(points)
            off.extend(np.hypot(*(contacts - apply_homography(H, grasp.contacts)).T))
        if len(served) < len(seen.others):
            short = f"{len(seen.others) - len(served)} of {len(seen.others)}"
            common.say(f"Note: {name} refused {short} outlines of {len(seen.first)} points; the others are timed.")
        clock(f"{name}: apply", module.apply, ((described, c) for c in made(served)))
        whole = ((grasp, reference, c, STRATEGIES[name]) for c in made(served))
        clock(f"{name}: transfer", gt.transfer, whole)
        errors[f"{name}: transfer"] = float(np.median(off)) if off else np.nan
    clock("analysis", gt.analyze, ((on(c), c) for c in made(seen.others)))
    if len(seen.first) <= SYNTHESIS_UP_TO:
        clock("synthesis, 50 grasps", gt.synthesize, ((c,) for c in made(seen.others[:100])))
    return us, errors


def time_on_image(count: int, calls: int) -> Measured:
    """A pose estimate and the snake's step, of an outline of `count` points on rendered images."""
    frames = list(demo_scene(240, colour=False))[:20]
    outline = gt.View(gt.Contour(resampled(frames[0].outline[0], count)))
    grasp = gt.synthesize(gt.Contour(resampled(frames[0].outline[0], 300)))[0].snapped(outline)
    follower = Follower(frames[0].image, outline, grasp.contacts)
    target, state = follower.target, follower.state

    def estimate(levels: list[np.ndarray], H: np.ndarray) -> None:
        estimate_pose(target, state, levels, Hypothesis("", target.pose(H), state.P))

    order = [*frames, *frames[-2:0:-1]]
    pool = [order[i % len(order)] for i in range(calls)]
    looks = [(build_pyramid(f.image), np.asarray(f.H_current_reference)) for f in pool]
    us = {"pose estimate": 1e6 * common.each(estimate, looks)}
    snake = Snake(outline, frames[0].image, contacts=grasp.contacts)

    def step(image: np.ndarray) -> None:
        snake.predict()
        snake.update(image)

    us["snake's step"] = 1e6 * common.each(step, [(f.image,) for f in pool])
    return us


def time_opencv(seen: Views) -> tuple[Measured, Errors]:
    """OpenCV's calls that do comparable work, not the same work."""
    count = len(seen.first)
    a = seen.first.astype(np.float32)
    pool = [p.astype(np.float32) for p in seen.others]
    chains = [np.rint(p).astype(np.int32) for p in seen.others]
    whole = np.rint(seen.first).astype(np.int32)
    four = [0, count // 4, count // 2, 3 * count // 4]
    few = pool[: max(20, len(pool) // 10)]
    grasp = gt.synthesize(gt.Contour(resampled(seen.first, 300)))[0].contacts

    def off(fit: Callable[[np.ndarray], np.ndarray]) -> float:
        found = [(fit(p), H) for p, H in zip(few, seen.H, strict=False)]
        both = [apply_homography(G, grasp) - apply_homography(H, grasp) for G, H in found]
        return float(np.median(np.hypot(*np.concatenate(both).T)))

    fits: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "cv2.getPerspectiveTransform": lambda p: cv2.getPerspectiveTransform(a[four], p[four]),
        "cv2.findHomography, 4 points": lambda p: cv2.findHomography(a[four], p[four])[0],
        "cv2.findHomography, all points, RANSAC": lambda p: cv2.findHomography(a, p, cv2.RANSAC, 2.0)[0],
    }
    us = {
        "cv2.moments": 1e6 * common.each(cv2.moments, [(p,) for p in pool]),
        "cv2.minAreaRect": 1e6 * common.each(cv2.minAreaRect, [(p,) for p in pool]),
        "cv2.fitEllipse": 1e6 * common.each(cv2.fitEllipse, [(p,) for p in pool]),
        "cv2.matchShapes": 1e6 * common.each(lambda p: cv2.matchShapes(whole, p, 1, 0.0), [(c,) for c in chains]),
        **{name: 1e6 * common.each(fit, [(p,) for p in few]) for name, fit in fits.items()},
    }
    return us, {name: off(fit) for name, fit in fits.items()}


def run(most: int) -> None:
    """Measure and show; `most` calls on the shorter outlines, fewer on longer ones."""
    common.heading("Steps over the outline's length")
    common.say("Two fingers, each call on an outline that was not seen before.")
    ours: dict[int, Measured] = {}
    theirs: dict[int, Measured] = {}
    errors: dict[int, Errors] = {}
    for count in LENGTHS:
        calls = max(100, min(most, most * 300 // count))
        seen = views(count, calls)
        ours[count], off = time_steps(seen)
        ours[count] |= time_on_image(count, min(calls, 300))
        theirs[count], other = time_opencv(seen)
        errors[count] = off | other
    show(ours, 50)
    show(ours, 99)
    common.say("Comparable work in OpenCV on the same outlines, median us.")
    show(theirs, 50)
    common.say(
        "Accuracy: median distance of the contacts from the truth, px. The outlines have 0.05 px of noise and are seen "
        "under a tilt of up to 7 degrees."
    )
    names = list(errors[LENGTHS[0]])
    common.table(["call", *(f"{n:,} points" for n in LENGTHS)], [[m, *(errors[n][m] for n in LENGTHS)] for m in names])
    common.say("Growth: the time of one length over that of the one before, which is about a third of it; linear is 3.")
    growth = []
    for name in ours[LENGTHS[0]]:
        medians = [float(np.median(ours[n][name])) for n in LENGTHS if name in ours[n]]
        ratios = [b / a for a, b in pairwise(medians)]
        linear = "yes" if medians[-1] <= 1.2 * medians[0] * LENGTHS[len(medians) - 1] / LENGTHS[0] else "NO"
        growth.append([name, *ratios, *[np.nan] * (len(LENGTHS) - 1 - len(ratios)), linear])
    common.table(["step", *(f"{n:,}" for n in LENGTHS[1:]), "at most linear"], growth)
    common.say("Targets on 300 points, median us.")
    got = {name: float(np.median(ours[300][name])) for name in TARGETS}
    rows = [[name, got[name], limit, "yes" if got[name] <= limit else "NO"] for name, limit in TARGETS.items()]
    common.table(["step", "us", "target", "met"], rows)


def show(measured: dict[int, Measured], percent: float) -> None:
    """A table of steps and lengths."""
    name = "median us" if percent == 50 else f"{percent:g}th percentile, us"
    rows = [
        [step, *(float(np.percentile(m[step], percent)) if step in m else np.nan for m in measured.values())]
        for step in measured[LENGTHS[0]]
    ]
    common.table([name, *(f"{n:,} points" for n in measured)], rows)
