# SPDX-License-Identifier: Apache-2.0
"""Choose a grasp on each object in an image for a hand measured in mm, and print the terms of each grasp's quality.

Replace `still_life()` with `cv2.imread("photo.jpg")` for your own image; `find_objects(image, mask=...)` takes your masks.
"""

from pathlib import Path

import grasptrack as gt
from grasptrack.demo import still_life
from grasptrack.segmentation.first_look import find_objects
from grasptrack.view.grasps import Planned, write_grasps

PX_PER_MM = 3.2
hand = gt.Hand(
    max_opening=gt.Length(50, "mm"),
    finger_width=gt.Length(5, "mm"),
    finger_thickness=gt.Length(5, "mm"),
    clearance=gt.Length(2, "mm"),
    px_per_mm=PX_PER_MM,
)

image = still_life()
views = [found.view for found in find_objects(image)]  # outlines, the most outstanding object first
planned: list[Planned] = []
for number, view in enumerate(views, start=1):
    beside = [other for other in views if other is not view]
    grasps = gt.synthesize(view, fingers=2, friction=0.5, top=10, hand=hand, neighbours=beside)
    planned.append(Planned(view, beside, hand.in_px(1.0), grasps))  # lengths in mm do not depend on the object
    print(f"object {number}: {len(grasps)} grasps {grasps.reason}")
    for grasp in grasps[:3]:
        contacts = "  ".join(f"({x:5.1f}, {y:5.1f})" for x, y in grasp.contacts)
        terms = "  ".join(f"{name} {value:.2f}" for name, value in grasp.terms._asdict().items())
        way = "spread " if grasp.spread else "squeeze"
        print(f"  {way} {contacts}  {grasp.opening / PX_PER_MM:4.1f} mm  quality {grasp.quality:.2f} = {terms}")

for name, shown in (("grasps.png", planned[:1]), ("objects.png", planned)):
    path, title = Path(name), f"{len(shown)} of {len(views)} parts on a table"
    write_grasps(path, image, shown, fingers=2, friction=0.5, title=title, px_per_mm=PX_PER_MM)
print("grasps.png: the first object; objects.png: the best grasp on each")
