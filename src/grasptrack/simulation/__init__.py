# SPDX-License-Identifier: Apache-2.0
"""Scenes with exact ground truth. They know nothing of the tracker."""

from grasptrack.simulation.camera import Camera, Path, similarity_path, tilting_path
from grasptrack.simulation.conditions import Conditions, Shadow
from grasptrack.simulation.covers import Bar, Cover, Laid
from grasptrack.simulation.outlines import Shape
from grasptrack.simulation.render import Renderer
from grasptrack.simulation.scene import Guest, Scene, SceneFrame, demo_scene
from grasptrack.simulation.shapes import SHAPES
from grasptrack.simulation.still import still_life
from grasptrack.simulation.surfaces import brushed
from grasptrack.simulation.tables import plain, wood
from grasptrack.simulation.texture import Texture

__all__ = [
    "SHAPES",
    "Bar",
    "Camera",
    "Conditions",
    "Cover",
    "Guest",
    "Laid",
    "Path",
    "Renderer",
    "Scene",
    "SceneFrame",
    "Shadow",
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
