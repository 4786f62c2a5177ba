# SPDX-License-Identifier: Apache-2.0
"""One step on plain outlines, without images: choose a grasp, transfer it to another view, analyse it."""

import numpy as np
from grasptrack.bench.simulation import SHAPES, Camera, tilting_path
from numpy.typing import NDArray

import grasptrack as gt
from grasptrack.geometry.homographies import apply_homography

# Two views of a bracket: frontal, and a few frames later from nearer and slightly tilted.
views: list[NDArray[np.float64]] = list(tilting_path(60, seed=8).table_to_image(Camera()))
frontal, later = views[0], views[4]
corners = SHAPES["bracket"]().outer
sides = np.roll(corners, -1, axis=0) - corners
part = gt.Contour(np.concatenate([corners + k / 8 * sides for k in range(8)], axis=1).reshape(-1, 2))
reference, current = part.transformed(frontal), part.transformed(later)  # point i of one is point i of the other

grasps = gt.synthesize(reference, fingers=2, friction=0.5)
print(f"{len(grasps)} stable grasps, the best is {grasps[0]}")

truth = apply_homography(later @ np.linalg.inv(frontal), grasps[0].contacts)
for strategy in ("rrp", "grasp-line", "homography"):
    try:
        carried = gt.transfer(grasps[0], reference, current, strategy)
    except gt.TransferError as reason:
        print(f"{strategy:10s}  {reason}")
        continue
    judged = gt.analyze(carried.grasp, current)
    off = np.hypot(*(carried.grasp.contacts - truth).T).max()
    print(f"{strategy:10s}  {carried.grasp}  off by {off:.3f} px, {'stable' if judged.stable else judged.reason}")
