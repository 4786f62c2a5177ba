# SPDX-License-Identifier: Apache-2.0
"""What is learned of an outline's grey levels, and when it is forgotten."""

import numpy as np

from grasptrack.first_image import FirstImage
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack_bench.simulation import SHAPES, Conditions, Scene, similarity_path


def test_levels_are_those_of_an_outline_of_the_image_at_hand() -> None:
    """Outlines are known by their ids, and Python gives the id of one that is gone to another."""
    scene = Scene(SHAPES["bracket"](), similarity_path(3, seed=1), conditions=Conditions(noise=1.0), seed=1)
    observer = OutlineDetector()
    observer.set_image(scene[0].image)
    candidate = observer.find_objects(FirstImage())[0]
    observer.choose_object(candidate)
    lighter = np.clip(scene[1].image.astype(int) + 20, 0, 255).astype(np.uint8)
    (view, *_) = next(observer.views_anywhere(observer.set_image(lighter), candidate.view.outer.area, 0))
    before = observer.grey_levels
    observer.set_image(scene[2].image)
    observer.learn_levels(view)
    assert observer.grey_levels == before
    (view, *_) = next(observer.views_anywhere(observer.set_image(lighter), candidate.view.outer.area, 0))
    observer.learn_levels(view)
    assert observer.grey_levels[0] > before[0] + 2.0 and observer.grey_levels[1] > before[1] + 2.0
