# SPDX-License-Identifier: Apache-2.0
"""Use your own segmentation: pass a mask to each update."""

import cv2
import numpy as np

import grasptrack as gt
from grasptrack.demo import demo_scene


def segment(image: np.ndarray) -> np.ndarray:
    """Replace it with your network or colour rule; here, whatever is more blue than red."""
    blue, _, red = cv2.split(cv2.GaussianBlur(image, (5, 5), 0))
    return np.where(blue > red, 255, 0).astype(np.uint8)


tracker = gt.GraspTracker(strategy="homography")
for frame in demo_scene(frames=60):
    result = tracker.update(frame.image, time=frame.time, mask=segment(frame.image))
    where = "" if result.contacts is None else "  ".join(f"({x:6.2f}, {y:6.2f})" for x, y in result.contacts)
    print(f"{frame.index:3d}  {result.status:8s}  {where}{result.reason}")
