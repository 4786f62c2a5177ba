# SPDX-License-Identifier: Apache-2.0
"""Scenes with exact ground truth. They know nothing of the tracker."""

from grasptrack.simulation.camera import Camera
from grasptrack.simulation.conditions import Conditions, Glare, Shadow
from grasptrack.simulation.courses import course
from grasptrack.simulation.covers import Bar, Cover, Drifting, Laid
from grasptrack.simulation.distractors import Distractor
from grasptrack.simulation.disturbances import DISTURBANCES, Disturbance, applicable
from grasptrack.simulation.hand import bar_over, hand_over
from grasptrack.simulation.occluders import irregular_over, parallel_bar
from grasptrack.simulation.outlines import Shape
from grasptrack.simulation.paths import Path, similarity_path, tilting_path
from grasptrack.simulation.photo import part_of_photo
from grasptrack.simulation.render import Renderer
from grasptrack.simulation.scene import Guest, Scene, SceneFrame, demo_scene
from grasptrack.simulation.shapes import SHAPES
from grasptrack.simulation.shutter import RollingShutter
from grasptrack.simulation.silhouette import silhouette
from grasptrack.simulation.still import still_life
from grasptrack.simulation.surfaces import SURFACES, blank, brushed, pictured, printed
from grasptrack.simulation.tables import TABLES, gravel, pebbles, plain, stone, wood, woven
from grasptrack.simulation.texture import Texture
from grasptrack.simulation.twins import mirrored, near_twin

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
    "applicable",
    "bar_over",
    "blank",
    "brushed",
    "course",
    "demo_scene",
    "gravel",
    "hand_over",
    "irregular_over",
    "mirrored",
    "near_twin",
    "parallel_bar",
    "part_of_photo",
    "pebbles",
    "pictured",
    "plain",
    "printed",
    "silhouette",
    "similarity_path",
    "still_life",
    "stone",
    "tilting_path",
    "wood",
    "woven",
]
