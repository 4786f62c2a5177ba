# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of every frame: compiled where it could be compiled, NumPy elsewhere, of the same names.

`BACKEND` is "native" or "numpy". GRASPTRACK_BACKEND=numpy in the environment asks for NumPy. What each kernel computes
is said in `grasptrack.kernels.reference`.
"""

import os
import warnings
from typing import Literal

BACKEND: Literal["native", "numpy"]

try:
    if os.environ.get("GRASPTRACK_BACKEND") == "numpy":
        raise ImportError
    # The compiled functions themselves, not wrappers: a call costs a third of a microsecond.
    from grasptrack._native import (
        align_outlines,
        arc_length,
        best_quadrilateral,
        blend_normals,
        carry_grasp_line,
        carry_normals,
        carry_places,
        closing_triples,
        contact_frames,
        crossings,
        curvature,
        curvature_peaks,
        curvature_vector,
        distortion,
        edge_links,
        edge_search,
        finger_rooms,
        fit_homography,
        fixed_places,
        force_closure,
        grasp_line,
        homography_4,
        inertia,
        lay_outlines,
        locate,
        match_curvature,
        nearest_crossings,
        opposed_pairs,
        outline_gaps,
        outline_starts,
        outline_support,
        point_at,
        projective_step,
        rank_grasps,
        refine_contacts,
        register_outline,
        resample,
        select_points,
        settle_edges,
        soft_threshold,
        trace_edges,
    )

    BACKEND = "native"
except ImportError as error:
    from grasptrack.kernels.reference import (
        align_outlines,
        arc_length,
        best_quadrilateral,
        blend_normals,
        carry_grasp_line,
        carry_normals,
        carry_places,
        closing_triples,
        contact_frames,
        crossings,
        curvature,
        curvature_peaks,
        curvature_vector,
        distortion,
        edge_links,
        edge_search,
        finger_rooms,
        fit_homography,
        fixed_places,
        force_closure,
        grasp_line,
        homography_4,
        inertia,
        lay_outlines,
        locate,
        match_curvature,
        nearest_crossings,
        opposed_pairs,
        outline_gaps,
        outline_starts,
        outline_support,
        point_at,
        projective_step,
        rank_grasps,
        refine_contacts,
        register_outline,
        resample,
        select_points,
        settle_edges,
        soft_threshold,
        trace_edges,
    )

    BACKEND = "numpy"
    if str(error):
        warnings.warn(
            f"compiled kernels are missing: NumPy takes their place, which is slow ({error})",
            RuntimeWarning,
            stacklevel=2,
        )

__all__ = [
    "BACKEND",
    "align_outlines",
    "arc_length",
    "best_quadrilateral",
    "blend_normals",
    "carry_grasp_line",
    "carry_normals",
    "carry_places",
    "closing_triples",
    "contact_frames",
    "crossings",
    "curvature",
    "curvature_peaks",
    "curvature_vector",
    "distortion",
    "edge_links",
    "edge_search",
    "finger_rooms",
    "fit_homography",
    "fixed_places",
    "force_closure",
    "grasp_line",
    "homography_4",
    "inertia",
    "lay_outlines",
    "locate",
    "match_curvature",
    "nearest_crossings",
    "opposed_pairs",
    "outline_gaps",
    "outline_starts",
    "outline_support",
    "point_at",
    "projective_step",
    "rank_grasps",
    "refine_contacts",
    "register_outline",
    "resample",
    "select_points",
    "settle_edges",
    "soft_threshold",
    "trace_edges",
]
