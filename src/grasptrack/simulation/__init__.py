# SPDX-License-Identifier: Apache-2.0
"""Scenes with exact ground truth. They know nothing of the tracker."""

from grasptrack.simulation.camera import Camera, Path, similarity_path, tilting_path
from grasptrack.simulation.render import Bar, Conditions, Renderer
from grasptrack.simulation.scene import Scene, SceneFrame, demo_scene
from grasptrack.simulation.shapes import SHAPES, Shape
from grasptrack.simulation.still import still_life
from grasptrack.simulation.texture import Texture, brushed, plain, wood

__all__ = [
    "SHAPES",
    "Bar",
    "Camera",
    "Conditions",
    "Path",
    "Renderer",
    "Scene",
    "SceneFrame",
    "Shape",
    "Texture",
    "brushed",
    "demo_scene",
    "plain",
    "similarity_path",
    "still_life",
    "tilting_path",
    "wood",
]
