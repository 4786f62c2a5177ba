# SPDX-License-Identifier: Apache-2.0
"""Every step that works on an image, the whole update of each strategy, and what OpenCV offers on the same images."""

from __future__ import annotations

import common

# isort: split
import time
from collections.abc import Callable, Iterable

import cv2
import numpy as np

from grasptrack import GraspTracker
from grasptrack.bench.baselines import available_baselines
from grasptrack.bench.demo import STRATEGIES
from grasptrack.bench.method import Start
from grasptrack.bench.metrics.score import Score, Truth
from grasptrack.bench.simulation import SceneFrame, demo_scene
from grasptrack.geometry.homographies import apply_homography
from grasptrack.segmentation.candidate import Candidate
from grasptrack.segmentation.localization import localize_contour
from grasptrack.segmentation.objects import find_objects
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.segmentation.silhouettes import trace_silhouettes
from grasptrack.snake.active_contour import Snake
from grasptrack.tracking.estimator import Hypothesis, estimate_pose
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.target import build_pyramid

SIZES = ((640, 480), (1280, 960), (2000, 1500), (4000, 3000))
LENGTH, BEGIN = 240, 40
"""Frames of the whole scene, and the one to begin with: from there it turns and shifts as a hand would move it."""
SLOW = ("paper-grasp-line", "paper-homography", "paper-rrp", "visp")
"""Peers left out: the first three are measured as steps of ours, the last by `benchmarks/loop.py`."""

Measured = dict[str, np.ndarray]
"""ms of each call, by the name of the step."""


def time_steps(frames: list[SceneFrame], order: list[SceneFrame]) -> tuple[Measured, list[TrackResult]]:
    """The steps of an update by themselves, and the first result of the tracker on these frames."""
    first = frames[0]
    result = GraspTracker(strategy="homography").update(first.image)
    assert result.contacts is not None and result.view is not None, result.reason
    grasp, view = result.contacts, result.view
    to_first = np.linalg.inv(first.H_current_reference)
    ms: Measured = {}

    def clock(name: str, call: Callable[..., object], pool: Iterable[tuple[object, ...]]) -> None:
        ms[name] = 1e3 * common.each(call, list(pool))

    clock("first look: all objects", find_objects, ((f.image,) for f in order[: max(3, len(order) // 20)]))
    observer = OutlineDetector()
    observer.look(first.image)
    chosen: Candidate = observer.first(False)[0]
    observer.choose(chosen)
    outer = view.outer.points[:: max(1, len(view.outer) // 64)]
    centres = np.array([c.points.mean(axis=0) for c in view.contours[1:]]).reshape(-1, 2)

    def near(image: np.ndarray, H: np.ndarray) -> None:
        found = next(observer.near(image, apply_homography(H, outer), apply_homography(H, centres)))
        observer.believe(found)

    moves = [f.H_current_reference @ to_first for f in order]
    clock("search near the prediction", near, ((f.image, H) for f, H in zip(order, moves, strict=True)))
    chains = []
    for frame in order:
        _, binary = cv2.threshold(frame.image, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
        chains.append(trace_silhouettes(np.asarray(binary, np.uint8), 1e-3 * frame.image.size)[0].outer)

    def edges(image: np.ndarray, chain: np.ndarray) -> None:
        localize_contour(image, chain, hole=False, polarity=1)

    clock("edge tracing of one outline", edges, ((f.image, c) for f, c in zip(order, chains, strict=True)))
    follower = Follower(first.image, view, grasp)
    target, state = follower.target, follower.state
    clock("pyramid of the image", build_pyramid, ((f.image,) for f in order))

    def estimate(levels: list[np.ndarray], H: np.ndarray) -> None:
        estimate_pose(target, state, levels, Hypothesis("", target.pose(H), state.P))

    pool = ((build_pyramid(f.image), H) for f, H in zip(order, moves, strict=True))
    clock("pose estimate", estimate, pool)
    snake = Snake(view, first.image, contacts=grasp)

    def step(image: np.ndarray) -> None:
        snake.predict()
        snake.update(image)

    clock("snake's step", step, ((f.image,) for f in order))
    return ms, [result]


def time_tracker(order: list[SceneFrame], strategy: str) -> tuple[np.ndarray, Score]:
    """ms of every update after the first, which also chooses a grasp, and its score."""
    tracker, score, taken = GraspTracker(strategy=strategy), Score(strategy), []
    for i, frame in enumerate(order):
        start = time.perf_counter()
        result = tracker.update(frame.image, time=i / 30.0)
        taken.append(1e3 * (time.perf_counter() - start))
        score.add(result, Truth.of_scene(frame))
    return np.array(taken[1:]), score


def time_peer(name: str, order: list[SceneFrame], contacts: np.ndarray) -> tuple[np.ndarray, Score]:
    """The same of what a user would otherwise pick."""
    height, width = order[0].image.shape[:2]
    peer, score, taken = (
        available_baselines()[name](Start(contacts, order[0].outline, (width, height))),
        Score(name),
        [],
    )
    for i, frame in enumerate(order):
        start = time.perf_counter()
        result = peer.update(frame.image, i / 30.0)
        taken.append(1e3 * (time.perf_counter() - start))
        score.add(result, Truth.of_scene(frame))
    return np.array(taken[1:]), score


def time_opencv(order: list[SceneFrame]) -> Measured:
    """OpenCV's calls that every method of one's own would begin with."""
    pool = [(f.image,) for f in order]

    def otsu(image: np.ndarray) -> None:
        _, binary = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
        cv2.findContours(binary, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)

    return {
        "cv2.GaussianBlur, 5x5": 1e3 * common.each(lambda image: cv2.GaussianBlur(image, (5, 5), 0), pool),
        "cv2.threshold, Otsu, and cv2.findContours": 1e3 * common.each(otsu, pool),
        "cv2.Canny": 1e3 * common.each(lambda image: cv2.Canny(image, 50, 150), pool),
    }


def run(updates: int) -> None:
    """Measure and show; `updates` images of the smallest size, fewer of larger ones."""
    common.heading("Steps over the image's size")
    common.say(f"The demonstration's scene, grey, to and fro from frame {BEGIN} of {LENGTH}: gentle motion.")
    steps: list[Measured] = []
    opencv: list[Measured] = []
    whole: list[dict[str, tuple[np.ndarray, Score]]] = []
    peers = [name for name in available_baselines() if name not in SLOW]
    for width, height in SIZES:
        scale = width * height / (SIZES[0][0] * SIZES[0][1])
        count = max(8, round(30 / np.sqrt(scale)))
        scene = demo_scene(LENGTH, width=width, height=height, colour=False)
        frames = [scene[BEGIN + i] for i in range(count)]
        calls = max(2 * count, round(updates / np.sqrt(scale)))
        there = [*frames, *frames[-2:0:-1]]
        order = [there[i % len(there)] for i in range(calls)]
        measured, (first,) = time_steps(frames, order)
        steps.append(measured)
        opencv.append(time_opencv(order))
        runs = {strategy: time_tracker(order, strategy) for strategy in STRATEGIES}
        assert first.contacts is not None
        contacts = first.contacts
        few = order[: max(4, calls // 6)]
        whole.append(runs | {name: time_peer(name, few, contacts) for name in peers})
    common.say("Steps, ms. The first look is taken a few times only; its 99th percentile is nearly its largest.")
    show(steps)
    common.say("Comparable work in OpenCV on the same images, ms.")
    show(opencv)
    common.say("A whole update: of each strategy, and of what a user would otherwise pick, ms.")
    show([{name: taken for name, (taken, _) in m.items()} for m in whole])
    common.say("Growth is the time at the largest size over that at the smallest, which has 39 times fewer pixels.")
    common.say(
        "Accuracy of these updates: px between the contacts and their true places, of the frames that were located."
    )
    head = [f"{w}x{h}" for w, h in SIZES]
    for what, figure in (
        ("median px", lambda score: score.error_percentile(50)),
        ("largest px", lambda score: score.error_percentile(100)),
        ("located, %", lambda score: 100.0 * score.located),
    ):
        common.table([what, *head], [[name, *(figure(m[name][1]) for m in whole)] for name in whole[0]])


def show(measured: list[Measured]) -> None:
    """A table of medians and one of 99th percentiles over the sizes, ms."""
    for what, percent in (("median ms", 50), ("99th percentile, ms", 99)):
        rows = []
        for name in measured[0]:
            ms = [float(np.percentile(m[name], percent)) for m in measured]
            rows.append([name, *ms, ms[-1] / ms[0]])
        common.table([what, *(f"{w}x{h}" for w, h in SIZES), "growth"], rows)
