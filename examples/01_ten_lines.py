# SPDX-License-Identifier: Apache-2.0
"""Track a grasp through a sequence in ten lines. Replace `demo_scene` with `gt.open_source("video.mp4")` for your images."""

import grasptrack as gt
from grasptrack.demo import demo_scene

tracker = gt.GraspTracker(fingers=2, strategy="auto")
for frame in demo_scene(frames=60):
    result = tracker.update(frame.image, time=frame.time)
    if result.status == "tracked":
        contacts = "  ".join(f"({x:6.2f}, {y:6.2f})" for x, y in result.contacts)
        print(f"{frame.index:3d}  {contacts}  margin {result.analysis.margin:.2f}  confidence {result.confidence:.2f}")
    else:
        print(f"{frame.index:3d}  {result.status}: {result.reason}")
