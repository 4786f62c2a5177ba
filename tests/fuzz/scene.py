# SPDX-License-Identifier: Apache-2.0
"""Good arguments for every exported kernel, found by the names of its parameters."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np

import _grasptrack_native as native
import reference
from grasptrack.kernels import POSE_NUMBERS
from grasptrack.kernels.results import (
    AlignmentSteps,
    CurvatureVector,
    MatchWindow,
    PlaneViews,
    RankedCandidates,
    RankingLimits,
    TraceOptions,
    WrenchSpace,
)

CLASS = "PoseTarget"
METHODS = (
    "hide", "add_texture", "solve", "repeats", "follow", "moved", "difference", "placed", "joined",
    "plane_cost", "plane_modes", "open_tilts", "pixel_aspect",
)  # fmt: skip


def callable_names() -> list[str]:
    """Every exported kernel, and every method of the class that is made from arguments."""
    return sorted([*reference.__all__, CLASS, *(f"{CLASS}.{method}" for method in METHODS)])


def parameters_of(name: str) -> list[str]:
    """Names of the parameters of a kernel or method, in order."""
    head, _, method = name.partition(".")
    found = getattr(native, head)
    target = getattr(found, method or "__init__") if isinstance(found, type) else found
    return re.findall(r"(?:\(|, )(\w+): ", target.__nb_signature__[0][0])


class Scene:
    """An outline with a hole, an image of it and what else kernels ask for, all drawn by one generator."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        n, m = int(rng.integers(8, 40)), int(rng.integers(4, 10))
        self.outer = self._oddly(self._star(n, 14.0) + 20.0)
        n = len(self.outer)
        hole = self._star(m, 3.0)[::-1] + 20.0
        self.points = np.ascontiguousarray(np.concatenate([self.outer, hole]))
        self.offsets = np.array([0, n, n + m], dtype=np.int64)
        self.normals = reference.blend_normals(self.points)
        self.image = np.clip(rng.normal(120, 40, (40, 48)), 0, 255).astype(np.uint8)
        self.H = np.eye(3) + rng.normal(0, 1, (3, 3)) * [[0.02, 0.02, 1], [0.02, 0.02, 1], [1e-4, 1e-4, 0]]
        self.levels = [self.image, np.ascontiguousarray(self.image[::2, ::2])]

    def _oddly(self, points: np.ndarray) -> np.ndarray:
        """The contour as some write it: its first point repeated, points doubled, all in one place, a regular polygon."""
        way = self.rng.integers(12)
        if way == 0:
            return np.concatenate([points, points[:1]])
        if way == 1:
            return np.repeat(points, 2, axis=0)
        if way == 2:
            return np.repeat(points[:1], len(points), axis=0)
        if way == 3:
            angle = np.linspace(0, 2 * np.pi, int(self.rng.integers(9, 400)))
            return 20.0 + 10.0 * np.column_stack([np.cos(angle), np.sin(angle)])
        if way == 4:
            return np.rint(points)
        return points

    def _star(self, n: int, size: float) -> np.ndarray:
        angle = 2 * np.pi * np.arange(n) / n
        radius = size * self.rng.uniform(0.8, 1.2, n)
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])

    def covariance(self, n: int) -> np.ndarray:
        """(n, n) positive definite."""
        A = self.rng.normal(0, 1, (n, n))
        return A @ A.T + np.eye(n)

    def curvature(self) -> CurvatureVector:
        """Arc length of the outer contour, and a curvature of some peaks."""
        n = len(self.outer)
        return CurvatureVector(reference.arc_length(self.outer), self.rng.normal(0, 6, n))

    def places(self, k: int = 3) -> np.ndarray:
        """(k, 2) contour and position."""
        return np.array([[0.0, self.rng.uniform(0, self.offsets[1])] for _ in range(k)])

    def argument(self, kernel: str, name: str) -> Any:
        """A good argument for a parameter of a kernel."""
        make = SPECIAL.get(f"{kernel}.{name}") or USUAL[name]
        return make(self)


def _numbers(s: Scene) -> dict[str, float]:
    return {name: float(s.rng.uniform(0.05, 0.9)) for name in POSE_NUMBERS}


def _views(s: Scene) -> PlaneViews:
    poses, spread = np.array([s.H + s.rng.normal(0, 1e-3, (3, 3)) for _ in range(2)]), np.array([s.covariance(8)] * 2)
    return PlaneViews(poses, spread, s.outer, 48.0, 40.0, 1.0, np.zeros(3), s.covariance(3), 4.0)


Maker = Callable[[Scene], Any]
SAMPLES = 36

USUAL: dict[str, Maker] = {
    "A": lambda s: s.H,
    "G": lambda s: s.H,
    "H": lambda s: s.H,
    "P": lambda s: s.covariance(8),
    "Q": lambda s: s.covariance(8),
    "ahead": lambda s: (0.0, 0.0) if s.rng.random() < 0.5 else (0.3, -2.0),
    "apart": lambda s: 0.02,
    "arc": lambda s: s.curvature().arc,
    "arc1": lambda s: s.curvature().arc,
    "arc2": lambda s: s.curvature().arc,
    "aspect": lambda s: s.rng.uniform(0.5, 2.0),
    "before": lambda s: s.levels,
    "bend": lambda s: s.rng.normal(0, 0.1, (3, 8)),
    "bends": lambda s: s.rng.normal(0, 0.1, (3, 2)),
    "bias": lambda s: 1.0,
    "blur_share": lambda s: 0.2,
    "bottom": lambda s: 30,
    "bound": lambda s: s.rng.random(4),
    "camera": lambda s: 2.0,
    "candidates": lambda s: RankedCandidates(
        s.outer,
        s.normals[: len(s.outer)],
        np.ones(len(s.outer), dtype=np.bool_),
        np.array([0, len(s.outer)], dtype=np.int64),
        np.array([2.0]),
    ),
    "centre": lambda s: np.array([20.0, 20.0]),
    "centres": lambda s: s.rng.uniform(8, 30, (9, 2)),
    "chain": lambda s: np.rint(s.outer).astype(np.int32),
    "chance_spread": lambda s: 0.3,
    "clipped": lambda s: s.rng.random(len(s.outer)) < 0.1,
    "contacts": lambda s: s.outer[[0, len(s.outer) // 2]] + 0.1,
    "contrast": lambda s: s.rng.normal(0, 20, SAMPLES),
    "correlation": lambda s: [s.rng.uniform(0, 1, 5), s.rng.uniform(0, 1, 3)],
    "count": lambda s: int(2 ** s.rng.integers(3, 9)),
    "current": lambda s: s.offsets,
    "curvature": lambda s: s.curvature().curvature,
    "cx": lambda s: 20.0,
    "cy": lambda s: 20.0,
    "d": lambda s: s.rng.normal(0, 1, 8),
    "depth": lambda s: 4.0,
    "directions": lambda s: np.array([[1.0, 0.0], [-1.0, 0.0]]),
    "edge_width": lambda s: 1.0,
    "edges": lambda s: (s.rng.random((40, 48)) < 0.15).astype(np.uint8),
    "first": lambda s: s.H,
    "friction": lambda s: 0.5,
    "gain": lambda s: 1.0,
    "grasps": lambda s: s.rng.integers(0, len(s.outer), (4, 2)),
    "group": lambda s: 1,
    "half": lambda s: 4,
    "height": lambda s: 40.0,
    "hidden": lambda s: None if s.rng.random() < 0.5 else (s.rng.random((40, 48)) < 0.1).astype(np.uint8),
    "image": lambda s: s.image,
    "independent": lambda s: 4.0,
    "indices": lambda s: [0, len(s.outer) // 2],
    "indices1": lambda s: [0, 2, 4, 6],
    "places2": lambda s: [0.0, 2.25, 4.0, 6.5],
    "inner": lambda s: s.rng.uniform(0, 255, (SAMPLES, 6)),
    "inner_spread": lambda s: 10.0,
    "inside": lambda s: s.rng.uniform(0, 255, (SAMPLES, 16)),
    "last": lambda s: s.H,
    "left": lambda s: 3,
    "level": lambda s: 128.0,
    "levels": lambda s: s.levels,
    "limits": lambda s: RankingLimits(6.0, 1.0, 3),
    "line": lambda s: reference.grasp_line(s.points, s.offsets, s.points[[0, 4]])[:4],
    "log_prior": lambda s: np.log(np.array([0.5, 0.3, 0.2])),
    "loose": lambda s: 1.2,
    "maps": lambda s: np.array([s.H, np.eye(3)]),
    "match_spread": lambda s: 0.1,
    "most": lambda s: 5,
    "nodes": lambda s: s.rng.normal(0, 1, (5, 2)),
    "noise": lambda s: 2.0,
    "normal_noise": lambda s: np.full(SAMPLES, 0.02),
    "normals": lambda s: s.normals,
    "nuisance": lambda s: np.array([0.0, 0.1, 0.0, 0.0]),
    "nuisance_covariance": lambda s: s.covariance(4),
    "numbers": _numbers,
    "offsets": lambda s: s.offsets,
    "options": lambda s: TraceOptions(False, 1, 1.0, 200, 2.0, 5.0, 1.0, 2.0),
    "other": lambda s: s.H + 0.001,
    "outside": lambda s: np.ones((SAMPLES, 16)),
    "places": lambda s: s.places(),
    "points": lambda s: s.points,
    "points1": lambda s: s.outer,
    "points2": lambda s: s.outer,
    "polarity": lambda s: int(s.rng.integers(-1, 2)),
    "prominence": lambda s: 1.0,
    "queries": lambda s: s.points[:3] + 0.5,
    "radius": lambda s: 15.0,
    "reach": lambda s: 6.0,
    "readout": lambda s: 0.3,
    "readout_variance": lambda s: 0.01,
    "reference": lambda s: (400.0, 20.0, 20.0, 0.3),
    "rho": lambda s: 12.0,
    "right": lambda s: 40,
    "second": lambda s: s.H,
    "separation": lambda s: 2.0,
    "shares": lambda s: np.array([0.0, 0.3, 0.6]),
    "sides": lambda s: 0.4,
    "smooth": lambda s: float(s.rng.uniform(0, 8)),
    "smoothing": lambda s: float(s.rng.uniform(0.01, 0.2)),
    "space": lambda s: WrenchSpace(0.5, 20.0, 20.0, 12.0),
    "start": lambda s: s.H,
    "starts": lambda s: s.H.reshape(1, 9),
    "steps": lambda s: AlignmentSteps(np.array([9.0, 5.0]), np.array([0.1, 0.0]), np.array([2, 1]), 0.1),
    "strength": lambda s: s.rng.uniform(0, 0.4, 4),
    "stride": lambda s: 1.0,
    "strides": lambda s: np.array([1.0, 2.0]),
    "surface": lambda s: s.rng.uniform(8, 30, (40, 2)),
    "surface_value": lambda s: s.rng.uniform(0, 255, 40),
    "target_normals": lambda s: s.normals,
    "targets": lambda s: s.points,
    "theta": lambda s: np.array([0.1, 0.0, 0.0]),
    "tie": lambda s: 0.05,
    "top": lambda s: 2,
    "usual": lambda s: [np.full(5, 0.8), np.full(3, 0.7)],
    "views": _views,
    "weights": lambda s: s.rng.random(7),
    "whole": lambda s: 0.0 if s.rng.random() < 0.5 else 80.0,
    "width": lambda s: 5.0,
    "window": lambda s: MatchWindow(1.0, 10.0, 3, 1.0, 0.5),
    "worth": lambda s: s.rng.random(len(s.outer)),
}
"""By the name of a parameter."""


def _on_circle(s: Scene) -> np.ndarray:
    angle = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    return 20.0 + 10.0 * np.column_stack([np.cos(angle), np.sin(angle)])


SPECIAL: dict[str, Maker] = {
    "plane_modes.starts": lambda s: s.rng.uniform(-0.5, 0.5, (2, 3)),
    "open_tilts.starts": lambda s: s.rng.uniform(-0.5, 0.5, (2, 2)),
    "solve.lag": lambda s: np.full(8, s.rng.choice([0.0, 0.5, np.inf])),
    **{f"{k}.points": lambda s: s.outer for k in ("arc_length", "blend_normals", "curvature_vector", "resample")},
    "select_points.points": lambda s: s.outer,
    "best_quadrilateral.points": lambda s: s.outer[:7],
    "best_quadrilateral.weights": lambda s: s.rng.random(7),
    "edge_links.bend": lambda s: 0.7,
    "first_crossing.points": lambda s: s.outer,
    "initial_alignments.first": lambda s: s.outer,
    "initial_alignments.second": lambda s: s.outer * 1.1,
    "match_curvature.first": lambda s: s.curvature(),
    "match_curvature.second": lambda s: s.curvature(),
    "match_curvature.centres": lambda s: [1.0, 20.0],
    "refine_contacts.normals": lambda s: None if s.rng.random() < 0.5 else np.array([[1.0, 0.0], [0.0, 1.0]]),
    "opposed_pairs.contacts": lambda s: s.outer,
    "opposed_pairs.normals": lambda s: s.normals[: len(s.outer)],
    "closing_triples.contacts": lambda s: s.outer,
    "closing_triples.normals": lambda s: s.normals[: len(s.outer)],
    **{f"{k}.normals": lambda s: np.array([[1.0, 0.0], [-1.0, 0.0]]) for k in ("carried_angles", "force_closure")},
    "finger_clearance.places": lambda s: None if s.rng.random() < 0.5 else s.places(2),
    "strongest_edges.reach": lambda s: 8,
    "PoseTarget.points": _on_circle,
    "PoseTarget.normals": lambda s: (_on_circle(s) - 20.0) / 10.0,
    "PoseTarget.depth": lambda s: np.arange(1.0, 17.0),
}
"""By kernel and parameter, where the name alone says too little."""
