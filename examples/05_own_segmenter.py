# SPDX-License-Identifier: Apache-2.0
"""Use your own segmentation as an object with a method `segment`, called for every image; here also with a hand."""

import cv2
import numpy as np

import grasptrack as gt
from grasptrack.demo import demo_scene


class BlueParts:
    """Replace it with your network: load the weights in `__init__`, run it in `segment`."""

    def segment(self, image: np.ndarray) -> np.ndarray:
        """(H, W) uint8, nonzero on objects: whatever is more blue than red."""
        blue, _, red = cv2.split(cv2.GaussianBlur(image, (5, 5), 0))
        return np.where(blue > red, 255, 0).astype(np.uint8)


hand = gt.Hand(max_opening=gt.Length(1.0, "size"), finger_width=15)  # as wide as the root of the area; 15 px
tracker = gt.GraspTracker(segmenter=BlueParts(), hand=hand)
for frame in demo_scene(frames=60):
    result = tracker.update(frame.image, time=frame.time)
    where = "" if result.contacts is None else "  ".join(f"({x:6.2f}, {y:6.2f})" for x, y in result.contacts)
    print(f"{frame.index:3d}  {result.status:8s}  {where}{result.reason}")
