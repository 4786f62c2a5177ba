# SPDX-License-Identifier: Apache-2.0
"""What the strategies see in rendered images: an outline segmented in each, and one that a snake follows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from grasptrack.bench.paper.contours import Footage, Seen, on_grid, transform_view
from grasptrack.bench.paper.objects import Motion, Part, camera_trajectory
from grasptrack.bench.simulation import Scene
from grasptrack.errors import ObservationError, TransferError
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.segmentation.images import Grey
from grasptrack.segmentation.objects import segment_object
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.tracking.strategies import Snakes


def rendered_footage(
    part: Part, motion: Motion, frames: int, seed: int, after: Callable[[], None] = lambda: None
) -> tuple[Footage, list[Grey]]:
    """A trajectory as images, and what was observed in them.

    Args:
        part: the object.
        motion, frames: of the trajectory.
        seed: of trajectory, textures and noise.
        after: called after each frame.

    Returns:
        The footage, and the first image and the one in the middle, (H, W) each.

    Raises:
        ObservationError: no object in the first image.
    """
    return observe_scene(part, motion, Scene(part.shape, camera_trajectory(motion, frames, seed), seed=seed), after)


def observe_scene(
    part: Part, motion: Motion, scene: Scene, after: Callable[[], None] = lambda: None
) -> tuple[Footage, list[Grey]]:
    """As `rendered_footage`, of any scene of the object that begins as the trajectories do.

    Each silhouette is looked for round the last one, and in the whole image where it is not found there. No outline
    is judged: the plain strategies of the paper take what they are given.
    """
    frames = len(scene)
    first = scene[0]
    observer = OutlineDetector()
    observer.look(first.image)
    candidate = observer.first(False)[0]
    grey = observer.choose(candidate)
    last = candidate.view
    grasp = Grasp(part.contacts).snapped(last)
    snake = Snakes(grasp, last, grey)
    silhouettes: list[Seen] = [last]
    tracked: list[Seen] = []
    template: View | None = None
    kept: list[Grey] = [first.image]
    areas = [first.area]
    after()
    for index in range(1, frames):
        frame = scene[index]
        areas.append(frame.area)
        if index == middle_frame(frames):
            kept.append(frame.image)
        grey = observer.look(frame.image)
        found = _find_silhouette(observer, grey, frame.image, last)
        if isinstance(found, View):
            last = found
        silhouettes.append(found)
        try:
            carried = snake.carry(grey, None, None)
        except TransferError as error:
            tracked.append(str(error))
        else:
            tracked.append(carried.view)
            if template is None:
                back = np.asarray(np.linalg.inv(carried.homography), dtype=np.float64)
                template = transform_view(carried.view, back)
        after()
    start: Seen = template if template is not None else "the snake followed no image"
    on_tracked = grasp.contacts if template is None else on_grid(grasp.contacts, template)
    H = np.array([scene.homography(i) for i in range(frames)])
    seen = tuple(silhouettes), (start, *tracked), grasp.contacts, on_tracked
    return Footage(part, "rendered", motion, H, np.array(areas), *seen), kept


def middle_frame(frames: int) -> int:
    """The frame of the reference error: 50 of 100."""
    return frames // 2


def _find_silhouette(observer: OutlineDetector, grey: Grey, image: Grey, last: View) -> Seen:
    """The outline near the last one, or else what stands out in the image; or why there is none."""
    centres = np.array([c.points.mean(axis=0) for c in last.contours[1:]]).reshape(-1, 2)
    view = next(observer.near(grey, last.outer.points, centres), None)
    if view is not None:
        observer.believe(view)
        return view
    try:
        return segment_object(image)
    except ObservationError as error:
        return str(error)
