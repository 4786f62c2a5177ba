# SPDX-License-Identifier: Apache-2.0
"""Scenes with exact ground truth. They know nothing of the tracker."""

from grasptrack.bench.simulation.camera import Camera
from grasptrack.bench.simulation.conditions import Conditions, Glare, Shadow
from grasptrack.bench.simulation.courses import bounded_path
from grasptrack.bench.simulation.distractors import Distractor
from grasptrack.bench.simulation.disturbances import DISTURBANCES, Disturbance, is_applicable
from grasptrack.bench.simulation.hand import bar_over, hand_over
from grasptrack.bench.simulation.lookalikes import mirrored_shape, near_twin
from grasptrack.bench.simulation.occluders import irregular_over, parallel_bar
from grasptrack.bench.simulation.occlusion_events import Bar, Cover, Drifting, Laid
from grasptrack.bench.simulation.outlines import Shape
from grasptrack.bench.simulation.paths import Path, similarity_path, tilting_path
from grasptrack.bench.simulation.photo import part_of_photo
from grasptrack.bench.simulation.render import Renderer
from grasptrack.bench.simulation.scene import Guest, Scene, SceneFrame, demo_scene
from grasptrack.bench.simulation.shapes import SHAPES
from grasptrack.bench.simulation.shutter import RollingShutter
from grasptrack.bench.simulation.silhouette import shape_from_mask
from grasptrack.bench.simulation.still import still_life
from grasptrack.bench.simulation.surfaces import (
    SURFACES,
    blank_texture,
    brushed_texture,
    picture_texture,
    printed_texture,
)
from grasptrack.bench.simulation.tables import (
    TABLES,
    gravel_texture,
    pebble_texture,
    plain_texture,
    stone_texture,
    wood_texture,
    woven_texture,
)
from grasptrack.bench.simulation.texture import Texture

__all__ = [
    "DISTURBANCES",
    "SHAPES",
    "SURFACES",
    "TABLES",
    "Bar",
    "Camera",
    "Conditions",
    "Cover",
    "Distractor",
    "Disturbance",
    "Drifting",
    "Glare",
    "Guest",
    "Laid",
    "Path",
    "Renderer",
    "RollingShutter",
    "Scene",
    "SceneFrame",
    "Shadow",
    "Shape",
    "Texture",
    "bar_over",
    "blank_texture",
    "bounded_path",
    "brushed_texture",
    "demo_scene",
    "gravel_texture",
    "hand_over",
    "irregular_over",
    "is_applicable",
    "mirrored_shape",
    "near_twin",
    "parallel_bar",
    "part_of_photo",
    "pebble_texture",
    "picture_texture",
    "plain_texture",
    "printed_texture",
    "shape_from_mask",
    "similarity_path",
    "still_life",
    "stone_texture",
    "tilting_path",
    "wood_texture",
    "woven_texture",
]
