# SPDX-License-Identifier: Apache-2.0
"""Scenes with exact ground truth. They know nothing of the tracker."""

from grasptrack.bench.simulation.camera import Camera
from grasptrack.bench.simulation.conditions import Conditions, Glare, Shadow
from grasptrack.bench.simulation.courses import course
from grasptrack.bench.simulation.distractors import Distractor
from grasptrack.bench.simulation.disturbances import DISTURBANCES, Disturbance, applicable
from grasptrack.bench.simulation.hand import bar_over, hand_over
from grasptrack.bench.simulation.lookalikes import mirrored, near_twin
from grasptrack.bench.simulation.occluders import irregular_over, parallel_bar
from grasptrack.bench.simulation.occlusion_events import Bar, Cover, Drifting, Laid
from grasptrack.bench.simulation.outlines import Shape
from grasptrack.bench.simulation.paths import Path, similarity_path, tilting_path
from grasptrack.bench.simulation.photo import part_of_photo
from grasptrack.bench.simulation.render import Renderer
from grasptrack.bench.simulation.scene import Guest, Scene, SceneFrame, demo_scene
from grasptrack.bench.simulation.shapes import SHAPES
from grasptrack.bench.simulation.shutter import RollingShutter
from grasptrack.bench.simulation.silhouette import silhouette
from grasptrack.bench.simulation.still import still_life
from grasptrack.bench.simulation.surfaces import SURFACES, blank, brushed, pictured, printed
from grasptrack.bench.simulation.tables import TABLES, gravel, pebbles, plain, stone, wood, woven
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
