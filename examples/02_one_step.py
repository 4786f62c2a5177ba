# SPDX-License-Identifier: Apache-2.0
"""One step on plain outlines, without images: choose a grasp, transfer it to another view, analyse it."""

import numpy as np

import grasptrack as gt
from grasptrack.demo import demo_scene

# Two views of a bracket: frontal, and some frames later from nearer, turned and slightly tilted.
scene = demo_scene(60)
frontal, later = scene[0], scene[22]
corners = frontal.outline[0]
sides = np.roll(corners, -1, axis=0) - corners
reference = gt.Contour(np.concatenate([corners + k / 8 * sides for k in range(8)], axis=1).reshape(-1, 2))
current = reference.transformed(later.H_current_reference)  # point i of one is point i of the other

grasps = gt.synthesize(reference, fingers=2, friction=0.5)
print(f"{len(grasps)} stable grasps, the best is {grasps[0]}")

truth = later.true_contacts(grasps[0].contacts)
for strategy in ("rrp", "grasp-line", "homography"):
    try:
        carried = gt.transfer(grasps[0], reference, current, strategy)
    except gt.TransferError as reason:
        print(f"{strategy:10s}  {reason}")
        continue
    judged = gt.analyze(carried.grasp, current)
    off = np.hypot(*(carried.grasp.contacts - truth).T).max()
    print(f"{strategy:10s}  {carried.grasp}  off by {off:.3f} px, {'stable' if judged.stable else judged.reason}")
