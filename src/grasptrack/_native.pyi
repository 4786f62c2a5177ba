# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels; `grasptrack.kernels.reference` defines each of them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grasptrack.kernels.reference_pose import PoseTarget as PoseTarget

Floats = NDArray[np.float64]
Image = NDArray[np.uint8] | NDArray[np.float32]
Inertia = tuple[float, float, float, float, float, float, float, float, float, float]

def arc_length(points: Floats) -> Floats: ...
def inertia(points: Floats, offsets: NDArray[np.int64]) -> Inertia: ...
def crossings(points: Floats, offsets: NDArray[np.int64], x: float, y: float, ux: float, uy: float) -> Floats: ...
def nearest_crossings(
    points: Floats, offsets: NDArray[np.int64], x: float, y: float, ux: float, uy: float, t1: float, t2: float
) -> tuple[float, float, float, float]: ...
def locate(points: Floats, offsets: NDArray[np.int64], queries: Floats) -> Floats: ...
def point_at(points: Floats, offsets: NDArray[np.int64], places: Floats) -> Floats: ...
def curvature(points: Floats, step: float) -> Floats: ...
def curvature_vector(points: Floats, clipped: NDArray[np.bool_] | None, smoothing: float) -> tuple[Floats, Floats]: ...
def distortion(H: Floats, points: Floats) -> tuple[float, float, float]: ...
def homography_4(source: Floats, target: Floats) -> Floats: ...
def edge_links(edges: NDArray[np.uint8], reach: float, bend: float, loose: float) -> NDArray[np.int64]: ...
def edge_search(image: Image, points: Floats, normals: Floats, reach: float, polarity: int) -> Floats: ...
def contact_frames(points: Floats, offsets: NDArray[np.int64], places: Floats, width: float) -> Floats: ...
def force_closure(
    contacts: Floats, normals: Floats, cx: float, cy: float, rho: float, friction: float
) -> tuple[float, float]: ...
def resample(points: Floats, count: int, smooth: float) -> Floats: ...
def blend_normals(points: Floats) -> Floats: ...
def curvature_peaks(curvature: Floats, arc: Floats, separation: float, prominence: float) -> NDArray[np.int64]: ...
def best_quadrilateral(points: Floats, weights: Floats) -> tuple[int, int, int, int, float]: ...
def select_points(
    points: Floats, arc: Floats, curvature: Floats, separation: float, prominence: float
) -> tuple[list[int], float]: ...
def align_outlines(
    points1: Floats, arc1: Floats, points2: Floats, arc2: Floats, count: int, tie: float
) -> list[tuple[float, float, float]]: ...
def match_curvature(
    v1: Floats,
    arc1: Floats,
    indices: list[int],
    v2: Floats,
    arc2: Floats,
    centres: list[float],
    kappa: float,
    reach: float,
    radius: int,
    step: float,
    tolerance: float,
) -> tuple[list[int], list[float]]: ...
def fit_homography(
    points1: Floats, indices1: list[int], points2: Floats, indices2: list[int]
) -> tuple[Floats, float, float, float]: ...
def refine_contacts(
    H: Floats, contacts: Floats, normals: Floats | None, points: Floats, offsets: NDArray[np.int64]
) -> tuple[Floats, float, float, float]: ...
def grasp_line(points: Floats, offsets: NDArray[np.int64], contacts: Floats) -> tuple[float, ...]: ...
def carry_grasp_line(
    points: Floats,
    offsets: NDArray[np.int64],
    line: tuple[float, ...],
    reference: tuple[float, ...],
    ahead: tuple[float, float],
    least_skewness: float,
) -> tuple[Floats, Floats, float, float, float, float, bool]: ...
def fixed_places(points: Floats, offsets: NDArray[np.int64], queries: Floats) -> Floats: ...
def carry_places(places: Floats, offsets: NDArray[np.int64], points: Floats, current: NDArray[np.int64]) -> Floats: ...
def carry_points(H: Floats, points: Floats) -> tuple[Floats, float]: ...
def carry_normals(H: Floats, points: Floats, normals: Floats) -> Floats: ...
def settle_edges(
    points: Floats, normals: Floats, edges: Floats, fixed: NDArray[np.bool_], fallback: float, outlier: float
) -> tuple[Floats, Floats]: ...
def blur_threshold(
    image: NDArray[np.uint8], left: int, top: int, right: int, bottom: int, level: float, polarity: int
) -> NDArray[np.uint8]: ...
def trace_edges(
    image: NDArray[np.uint8],
    chain: NDArray[np.int32],
    hidden: NDArray[np.uint8] | None,
    hole: bool,
    polarity: int,
    spacing: float,
    most: int,
    smoothing: float,
    reach: float,
    border: float,
    outlier: float,
) -> tuple[Floats, Floats, NDArray[np.bool_], float, float]: ...
def align_projective(
    starts: Floats,
    points: Floats,
    normals: Floats,
    targets: Floats,
    target_normals: Floats,
    offsets: NDArray[np.int64],
    reaches: Floats,
    damping: Floats,
    strides: NDArray[np.int64],
    least_noise: float,
) -> Floats: ...
def outline_gaps(
    points: Floats, normals: Floats, targets: Floats, target_normals: Floats, offsets: NDArray[np.int64], reach: float
) -> Floats: ...
def initial_alignments(first: Floats, second: Floats, bends: Floats, count: int, apart: float, most: int) -> Floats: ...
def closing_triples(
    contacts: Floats, normals: Floats, cx: float, cy: float, rho: float, friction: float
) -> tuple[NDArray[np.int64], Floats, Floats]: ...
def finger_clearance(
    points: Floats,
    offsets: NDArray[np.int64],
    contacts: Floats,
    directions: Floats,
    places: Floats | None,
    width: float,
    depth: float,
    reach: float,
) -> Floats: ...
def opposed_pairs(
    contacts: Floats, normals: Floats, worth: Floats, group: int, friction: float
) -> tuple[NDArray[np.int64], Floats, Floats]: ...
def rank_grasps(
    contacts: Floats,
    normals: Floats,
    usable: NDArray[np.bool_],
    starts: NDArray[np.int64],
    steps: Floats,
    grasps: NDArray[np.int64],
    strength: Floats,
    bound: Floats,
    friction: float,
    cx: float,
    cy: float,
    rho: float,
    most: float,
    gap: float,
    top: int,
) -> tuple[NDArray[np.int64], Floats, Floats]: ...
def retract_state(state: Floats, step: Floats) -> Floats: ...
def advance_state(
    state: Floats, covariance: Floats, seconds: float, drift: float, wander: float, twirl: float
) -> tuple[Floats, Floats]: ...
def expected_sightings(state: Floats, hands: Floats, later: Floats) -> tuple[Floats, Floats]: ...
def filter_sighting(
    state: Floats, covariance: Floats, hand: Floats, points: Floats, noise: Floats, robust: float
) -> tuple[Floats, Floats, Floats, float]: ...
def calibrate_batch(
    origin: Floats,
    known: Floats,
    hands: Floats,
    later: Floats,
    points: Floats,
    noise: Floats,
    start: Floats,
    damping: float,
    steps: int,
    robust: float,
    least_fall: float,
    most_damping: float,
) -> tuple[Floats, Floats, float, bool, float]: ...
def seen_area(G: Floats, points: Floats) -> float: ...
def surface_evidence(
    correlation: Sequence[Floats],
    usual: Sequence[Floats],
    shares: Floats,
    log_prior: Floats,
    match_spread: float,
    chance_spread: float,
    independent: float,
) -> tuple[float, Floats]: ...
def strongest_edges(
    levels: Sequence[NDArray[np.uint8]], A: Floats, points: Floats, normals: Floats, noise: float, reach: int, half: int
) -> tuple[Floats, Floats, Floats, Floats]: ...
