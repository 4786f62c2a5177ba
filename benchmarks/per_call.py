# SPDX-License-Identifier: Apache-2.0
"""Time per call through the Python API, each on a contour not seen before, and growth with the contour's length."""

from __future__ import annotations

import common

# isort: split
import argparse
from typing import Any

import cv2
import numpy as np

import grasptrack as gt
from grasptrack import kernels
from grasptrack.simulation import SHAPES, Camera, tilting_path
from grasptrack.transfer import homography

STRATEGIES = {"rrp": "RRP transfer", "grasp-line": "grasp-line transfer", "homography": "homography transfer"}
TARGETS = {"RRP transfer": 3.0, "grasp-line transfer": 8.0, "homography transfer": 35.0, "analysis": 20.0}
LENGTHS = (300, 3000, 30000)


def resampled(polygon: np.ndarray, count: int) -> np.ndarray:
    """(count, 2) points at equal arc length."""
    closed = np.concatenate([polygon, polygon[:1]])
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    at = np.linspace(0.0, s[-1], count, endpoint=False)
    return np.column_stack([np.interp(at, s, closed[:, 0]), np.interp(at, s, closed[:, 1])])


def views(count: int, calls: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """A reference outline and as many others of a gently moving part, points corresponding, with sensor-like noise."""
    rng = np.random.default_rng(count)
    plain = resampled(SHAPES["bracket"]().outer, count)
    path = tilting_path(calls + 1, tilt=0.12, reach=0.2, zoom=0.08, turn=0.25, distance=4.4, seed=5)
    projected = [gt.Contour(plain).transformed(H).points for H in path.table_to_image(Camera())]
    smooth = np.fft.rfftfreq(count) < 40.0 / count
    for points in projected:
        noise = np.fft.irfft(np.fft.rfft(rng.normal(0.0, 1.0, (count, 2)), axis=0) * smooth[:, None], count, axis=0)
        points.flags.writeable = True
        points += 0.05 * noise / noise.std()
    return projected[0], projected[1:]


def time_calls(count: int, calls: int) -> dict[str, float]:
    """Median us of each call on outlines of `count` points.

    Every call gets a contour that was made for it alone, and the reference keeps nothing that a transfer could use. A
    transfer is the whole of it: the grasp described in the reference and found in the other outline.
    """
    first, others = views(count, 2 * calls)
    reference = gt.Contour(first)
    grasp = gt.synthesize(reference)[0]
    spots = grasp.on(reference)
    described = homography.describe(grasp, reference)

    def on(contour: gt.Contour) -> gt.Grasp:
        return gt.Grasp(kernels.point_at(contour.points, contour.offsets, spots))

    def pairs(strategy: str) -> list[tuple[gt.Grasp, gt.Contour, gt.Contour, str]]:
        return [(grasp, reference, contour, strategy) for contour in map(gt.Contour, others)]

    times = {"construction of a Contour": common.each_once(gt.Contour, [(p,) for p in others])}
    for strategy, name in STRATEGIES.items():
        carried = [carries(*arguments) for arguments in pairs(strategy)]
        if not all(carried):
            print(f"note: {strategy} refused {carried.count(False)} of {len(carried)} outlines of {count} points")
        pool = [arguments for arguments, served in zip(pairs(strategy), carried, strict=True) if served]
        times[name] = common.each_once(gt.transfer, pool)
        if strategy == "homography":
            served = [contour for _, _, contour, _ in pool]
            times["- describe"] = common.each_once(homography.describe, [(on(c), c) for c in again(served)])
            times["- apply"] = common.each_once(homography.apply, [(described, c) for c in again(served)])
    times["analysis"] = common.each_once(gt.analyze, [(on(c), c) for c in map(gt.Contour, others)])
    return {name: 1e6 * s for name, s in times.items()}


def again(contours: list[gt.Contour]) -> list[gt.Contour]:
    """The same outlines, made anew."""
    return [gt.Contour(c.points) for c in contours]


def carries(*arguments: Any) -> bool:
    """Whether a transfer succeeds; a refusal costs another time than an answer."""
    try:
        gt.transfer(*arguments)
    except gt.TransferError:
        return False
    return True


def time_opencv(count: int, calls: int) -> dict[str, float]:
    """Median us of OpenCV calls that do comparable work on the same outlines."""
    first, others = views(count, calls)
    a = first.astype(np.float32)
    pool = [(p.astype(np.float32),) for p in others]
    chains = [(np.rint(p).astype(np.int32),) for p in others]
    whole = np.rint(first).astype(np.int32)
    four = [0, count // 4, count // 2, 3 * count // 4]
    return {
        "cv2.moments (polygon)": 1e6 * common.each_once(cv2.moments, pool),
        "cv2.minAreaRect": 1e6 * common.each_once(cv2.minAreaRect, pool),
        "cv2.fitEllipse": 1e6 * common.each_once(cv2.fitEllipse, pool),
        "cv2.matchShapes": 1e6 * common.each_once(lambda p: cv2.matchShapes(whole, p, 1, 0.0), chains),
        "cv2.getPerspectiveTransform": 1e6
        * common.each_once(lambda p: cv2.getPerspectiveTransform(a[four], p[four]), pool),
        "cv2.findHomography, 4 points": 1e6 * common.each_once(lambda p: cv2.findHomography(a[four], p[four]), pool),
        "cv2.findHomography, all points, RANSAC": 1e6
        * common.each_once(lambda p: cv2.findHomography(a, p, cv2.RANSAC, 2.0), pool[: max(5, len(pool) // 10)]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=2000, help="calls on 300 points; fewer on longer outlines")
    calls = parser.parse_args().calls
    common.heading("Per call, two fingers, each on a contour not seen before: median us")
    measured = {n: time_calls(n, max(60, calls * 300 // n)) for n in LENGTHS}
    rows = []
    for name in measured[300]:
        us = [measured[n][name] for n in LENGTHS]
        target = TARGETS.get(name)
        verdict = "" if target is None else ("yes" if us[0] <= target else "NO")
        linear = "yes" if us[2] <= us[0] * LENGTHS[2] / LENGTHS[0] else "NO"
        rows.append([name, us[0], target or "", verdict, us[1], us[2], us[1] / us[0], us[2] / us[1], linear])
    head = ["call", "300 pts", "target", "met", "3,000 pts", "30,000 pts", "first x10", "next x10", "at most linear"]
    common.table(head, rows)
    print("Comparable work in OpenCV on the same outlines: median us")
    peers = {n: time_opencv(n, max(60, calls * 300 // n // 4)) for n in LENGTHS}
    common.table(
        ["call", *(f"{n:,} pts" for n in LENGTHS)], [[name, *(peers[n][name] for n in LENGTHS)] for name in peers[300]]
    )


if __name__ == "__main__":
    main()
