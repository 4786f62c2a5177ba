# SPDX-License-Identifier: Apache-2.0
"""Scenes with exact ground truth. They know nothing of the tracker."""

from grasptrack_bench.simulation.camera import Camera, RollingShutter
from grasptrack_bench.simulation.conditions import Conditions, Glare, Shadow
from grasptrack_bench.simulation.disturbances import DISTURBANCES, Disturbance, is_applicable
from grasptrack_bench.simulation.lookalikes import Distractor, mirrored_shape, near_twin
from grasptrack_bench.simulation.masks import part_of_photo, shape_from_mask
from grasptrack_bench.simulation.occluders import (
    Bar,
    Cover,
    Drifting,
    Laid,
    bar_over,
    hand_over,
    irregular_over,
    parallel_bar,
)
from grasptrack_bench.simulation.outlines import Shape
from grasptrack_bench.simulation.paths import Path, bounded_path, similarity_path, tilting_path
from grasptrack_bench.simulation.render import Renderer
from grasptrack_bench.simulation.scene import Guest, Scene, SceneFrame, bracket_scene
from grasptrack_bench.simulation.shapes import SHAPES
from grasptrack_bench.simulation.textures import (
    SURFACES,
    TABLES,
    Texture,
    blank_texture,
    brushed_texture,
    gravel_texture,
    pebble_texture,
    picture_texture,
    plain_texture,
    printed_texture,
    stone_texture,
    wood_texture,
    woven_texture,
)

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
    "bracket_scene",
    "brushed_texture",
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
    "stone_texture",
    "tilting_path",
    "wood_texture",
    "woven_texture",
]
