# SPDX-License-Identifier: Apache-2.0
"""Scenes with exact ground truth. They know nothing of the tracker."""

from grasptrack_bench.simulation.camera import Pinhole
from grasptrack_bench.simulation.conditions import Conditions, Shadow
from grasptrack_bench.simulation.disturbances import DISTURBANCES, is_applicable
from grasptrack_bench.simulation.frame import SceneFrame
from grasptrack_bench.simulation.lookalikes import Distractor, mirrored_shape, near_twin
from grasptrack_bench.simulation.masks import part_of_photo, shape_from_mask
from grasptrack_bench.simulation.occluders import Bar
from grasptrack_bench.simulation.outlines import Shape
from grasptrack_bench.simulation.paths import Path, similarity_path, tilting_path
from grasptrack_bench.simulation.render import Renderer
from grasptrack_bench.simulation.scene import Guest, Scene, bracket_scene
from grasptrack_bench.simulation.shapes import SHAPES
from grasptrack_bench.simulation.textures import TextureMap, brushed_texture, plain_texture, stone_texture, wood_texture

__all__ = [
    "DISTURBANCES", "SHAPES", "Bar", "Conditions", "Distractor", "Guest", "Path", "Pinhole", "Renderer", "Scene",
    "SceneFrame", "Shadow", "Shape", "TextureMap", "bracket_scene", "brushed_texture", "is_applicable",
    "mirrored_shape", "near_twin", "part_of_photo", "plain_texture", "shape_from_mask", "similarity_path",
    "stone_texture", "tilting_path", "wood_texture",
]  # fmt: skip
