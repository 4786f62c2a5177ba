# SPDX-License-Identifier: Apache-2.0
"""Time per call through the Python API, each on a contour not seen before, and growth with the contour's length."""

from __future__ import annotations

import common

# isort: split
import argparse
from collections.abc import Callable

import cv2
import numpy as np

import grasptrack as gt
from grasptrack.simulation import SHAPES, Camera, tilting_path
from grasptrack.transfer import grasp_line, homography, rrp, transfer

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
    """Median us of each call on outlines of `count` points."""
    first, others = views(count, 2 * calls)
    reference = gt.Contour(first)
    grasp = gt.synthesize(reference)[0]
    spots = grasp.on(reference)
    fresh = lambda: [gt.Contour(points) for points in others]  # noqa: E731
    rng = np.random.default_rng(1)

    def on(contour: gt.Contour) -> gt.Grasp:
        from grasptrack import kernels

        return gt.Grasp(kernels.point_at(contour.points, contour.offsets, spots))

    described = {m: m.describe(grasp, reference) for m in (rrp, grasp_line, homography)}
    step = np.eye(3)
    step[:2, 2] = rng.normal(0.0, 1.0, 2)

    def transfer_by(module: object) -> Callable[[gt.Contour], object]:
        apply, description = module.apply, described[module]  # type: ignore[attr-defined, index]
        return lambda contour: _or_reason(apply, description, contour)

    times = {"construction of a Contour": common.each_once(gt.Contour, [(p,) for p in others])}
    for name, module in (("RRP", rrp), ("grasp-line", grasp_line), ("homography", homography)):
        carry, pool = transfer_by(module), fresh()
        refused = sum(isinstance(carry(c), gt.GraspTrackError) for c in fresh()[:50])
        if refused > 5:
            print(f"note: {name} refused {refused} of 50 outlines of {count} points")
        times[f"{name} transfer"] = common.each_once(carry, [(c,) for c in pool])
        times[f"transfer(...), {name}"] = common.each_once(
            _transfer_or_reason, [(grasp, reference, c, name.lower()) for c in fresh()]
        )
    times["analysis"] = common.each_once(gt.analyze, [(on(c), c) for c in fresh()])
    return {name: 1e6 * s for name, s in times.items()}


def _transfer_or_reason(*arguments: object) -> object:
    return _or_reason(transfer, *arguments)


def _or_reason(call: Callable[..., object], *arguments: object) -> object:
    try:
        return call(*arguments)
    except gt.TransferError as reason:
        return reason


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
        rows.append([name, us[0], target or "", verdict, us[1], us[2], us[1] / us[0], us[2] / us[1]])
    head = ["call", "300 pts", "target", "met", "3,000 pts", "30,000 pts", "growth x10", "growth x100"]
    common.table(head, rows)
    print("Comparable work in OpenCV on the same outlines: median us")
    peers = {n: time_opencv(n, max(60, calls * 300 // n // 4)) for n in LENGTHS}
    common.table(
        ["call", *(f"{n:,} pts" for n in LENGTHS)], [[name, *(peers[n][name] for n in LENGTHS)] for name in peers[300]]
    )


if __name__ == "__main__":
    main()
