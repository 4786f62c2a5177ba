# SPDX-License-Identifier: Apache-2.0
"""NumPy definition of every kernel: what the compiled ones must equal, and what runs where nothing was compiled.

Throughout, `points` is float64 (N, 2) px, a concatenation of closed contours whose first point is not repeated, and
`offsets` int64 (C + 1,) says that contour c is ``points[offsets[c]:offsets[c + 1]]``. With t = (tx, ty) the tangent
along a contour's direction, (ty, -tx) points out of the material and (-ty, tx) into it, for outer contours and holes. A
position on a contour of n points is a vertex index plus the fraction of the segment that follows, in [0, n).
"""

from grasptrack.kernels.reference_alignment import align_outlines
from grasptrack.kernels.reference_contact import contact_frames
from grasptrack.kernels.reference_curve import arc_length, blend_normals, curvature, curvature_vector, resample
from grasptrack.kernels.reference_edges import edge_search
from grasptrack.kernels.reference_evidence import carry_normals, settle_edges
from grasptrack.kernels.reference_filtering import advance_state, filter_sighting
from grasptrack.kernels.reference_fingers import finger_clearance
from grasptrack.kernels.reference_grasp_line import carry_grasp_line, grasp_line
from grasptrack.kernels.reference_homography import carry_points, distortion, fit_homography, homography_4
from grasptrack.kernels.reference_inertia import inertia
from grasptrack.kernels.reference_laying import align_projective, outline_gaps
from grasptrack.kernels.reference_lines import crossings, nearest_crossings
from grasptrack.kernels.reference_links import edge_links
from grasptrack.kernels.reference_matching import match_curvature
from grasptrack.kernels.reference_opposed import opposed_pairs
from grasptrack.kernels.reference_outline import trace_edges
from grasptrack.kernels.reference_peaks import best_quadrilateral, curvature_peaks, select_points
from grasptrack.kernels.reference_places import carry_places, fixed_places, locate, point_at
from grasptrack.kernels.reference_pose import PoseTarget, strongest_edges
from grasptrack.kernels.reference_pose_estimate import seen_area, surface_evidence
from grasptrack.kernels.reference_ranking import rank_grasps
from grasptrack.kernels.reference_refine import refine_contacts
from grasptrack.kernels.reference_searching import calibrate_batch
from grasptrack.kernels.reference_sightings import expected_sightings, retract_state
from grasptrack.kernels.reference_starts import initial_alignments
from grasptrack.kernels.reference_threshold import blur_threshold
from grasptrack.kernels.reference_triples import closing_triples
from grasptrack.kernels.reference_wrench import force_closure

__all__ = [
    "PoseTarget",
    "advance_state",
    "align_outlines",
    "align_projective",
    "arc_length",
    "best_quadrilateral",
    "blend_normals",
    "blur_threshold",
    "calibrate_batch",
    "carry_grasp_line",
    "carry_normals",
    "carry_places",
    "carry_points",
    "closing_triples",
    "contact_frames",
    "crossings",
    "curvature",
    "curvature_peaks",
    "curvature_vector",
    "distortion",
    "edge_links",
    "edge_search",
    "expected_sightings",
    "filter_sighting",
    "finger_clearance",
    "fit_homography",
    "fixed_places",
    "force_closure",
    "grasp_line",
    "homography_4",
    "inertia",
    "initial_alignments",
    "locate",
    "match_curvature",
    "nearest_crossings",
    "opposed_pairs",
    "outline_gaps",
    "point_at",
    "rank_grasps",
    "refine_contacts",
    "resample",
    "retract_state",
    "seen_area",
    "select_points",
    "settle_edges",
    "strongest_edges",
    "surface_evidence",
    "trace_edges",
]
