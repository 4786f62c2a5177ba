# SPDX-License-Identifier: Apache-2.0
"""Modules under the names that they had before 0.2, with a DeprecationWarning; to be removed in 0.3."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from types import ModuleType

MOVED = {
    "analysis": "grasp.force_closure",
    "bench.approach.film": "bench.approach.runs",
    "bench.approach.looking": "bench.approach.trial",
    "bench.approach.radial": "bench.approach.choosing",
    "bench.approach.refusal": "bench.approach.truth",
    "bench.approach.refusal_radial": "bench.approach.truth",
    "bench.approach.trials": "bench.approach.runs",
    "bench.baselines.region": "bench.baselines.base",
    "bench.baselines.silhouette": "bench.baselines.paper",
    "bench.baselines.visp_template": "bench.baselines.direct",
    "bench.fill": "bench.run_folder",
    "bench.homographies": "bench.records",
    "bench.metrics.curves": "bench.metrics.integrity",
    "bench.metrics.truth": "bench.metrics.score",
    "bench.objects": "bench.real",
    "bench.paper.contours": "bench.paper.footage",
    "bench.paper.images": "bench.paper.footage",
    "bench.paper.objects": "bench.paper.footage",
    "bench.parts": "bench.scenes",
    "bench.physics.drawing": "bench.physics.images",
    "bench.physics.engine": "bench.physics.model",
    "bench.physics.linkage": "bench.physics.model",
    "bench.physics.offscreen": "bench.physics.images",
    "bench.physics.planar": "bench.physics.images",
    "bench.physics.prisms": "bench.physics.part",
    "bench.physics.resolved": "bench.physics.serial",
    "bench.report.closing_table": "bench.report.tables",
    "bench.report.comparison_sentences": "bench.report.comparison_page",
    "bench.report.report": "bench.report.run",
    "bench.sequence": "bench.method",
    "bench.simulation.appearance": "bench.simulation.textures",
    "bench.simulation.courses": "bench.simulation.paths",
    "bench.simulation.coverage": "bench.simulation.render",
    "bench.simulation.distractors": "bench.simulation.lookalikes",
    "bench.simulation.hand": "bench.simulation.occluders",
    "bench.simulation.isolines": "bench.simulation.outlines",
    "bench.simulation.mixtures": "bench.simulation.disturbances",
    "bench.simulation.occlusion_events": "bench.simulation.occluders",
    "bench.simulation.photo": "bench.simulation.masks",
    "bench.simulation.setting": "bench.simulation.effects",
    "bench.simulation.shapes_plates": "bench.simulation.shapes",
    "bench.simulation.shapes_smooth": "bench.simulation.shapes",
    "bench.simulation.shapes_tools": "bench.simulation.shapes",
    "bench.simulation.shutter": "bench.simulation.camera",
    "bench.simulation.sides": "bench.simulation.render",
    "bench.simulation.silhouette": "bench.simulation.masks",
    "bench.simulation.still": "bench.simulation.scene",
    "bench.simulation.surfaces": "bench.simulation.textures",
    "bench.simulation.tables": "bench.simulation.textures",
    "bench.simulation.texture": "bench.simulation.textures",
    "bench.simulation.truth": "bench.simulation.scene",
    "calibration": "geometry.cameras",
    "closing": "grasp.closure_probability",
    "contour": "geometry.contours",
    "evaluation": "bench",
    "grasp.synthesis.reasons": "grasp.synthesis.limits",
    "grasp.synthesis.rectangles": "grasp.synthesis.limits",
    "grasp.synthesis.result": "grasp.contacts",
    "grasp.synthesis.terms": "grasp.synthesis.candidates",
    "hand": "grasp.hand",
    "io.camera": "io.sources",
    "io.grasps": "io.json_results",
    "io.inspection": "io.json_results",
    "io.plain_yaml": "io.calibration",
    "io.tally": "io.run",
    "io.transferred": "io.json_results",
    "io.video_source": "io.video",
    "matching.judgement": "matching.rating",
    "observation": "segmentation",
    "pair": "tracking.image_pair",
    "projective": "geometry.homographies",
    "segmentation.objects": "segmentation.first_look",
    "servo.aim": "servo.law",
    "servo.begin": "servo.self_calibration",
    "servo.explore": "servo.self_calibration",
    "servo.geometry": "servo.camera",
    "servo.knowledge": "servo.self_calibration",
    "servo.poses": "servo.observation",
    "servo.refine": "servo.estimate",
    "servo.sighting": "servo.observation",
    "servo.textbook": "servo.estimate",
    "servo.unseen": "servo.loss",
    "simulation": "bench.simulation",
    "snake.edge_search": "snake.fit",
    "snake.motion_model": "snake.shape_space",
    "snake.result": "snake.active_contour",
    "snake.verification": "snake.fit",
    "suitability": "trackability",
    "synthesis": "grasp.synthesis",
    "trackability.advice": "trackability.report",
    "trackability.contact_visibility": "trackability.result",
    "trackability.edges": "trackability.appearance",
    "trackability.relief": "trackability.appearance",
    "trackability.settled": "trackability.evidence",
    "trackability.strategies": "trackability.evidence",
    "trackability.symmetry": "trackability.evidence",
    "trackability.words": "trackability.report",
    "tracking.distance": "tracking.plane",
    "tracking.shutter": "tracking.state",
    "tracking.surface": "tracking.selection",
    "view.fingers": "view.panel",
    "view.geometry": "view.draw",
    "view.grasp_panel": "view.panel",
    "view.grasp_text": "view.grasps",
    "view.inspect_text": "view.inspect",
    "view.layout": "view.panel",
    "view.report.axis": "view.report.chart",
    "view.report.parts": "bench.report.pages",
    "view.report.theme": "view.report.palette",
    "view.strip": "view.draw",
}
"""Below `grasptrack`: a module that moved with all that is below it, and where it is now."""


class _Alias(Loader):
    """Loads a module that moved by giving out the one that it is now."""

    def __init__(self, old: str, new: str) -> None:
        self._old, self._new = old, new

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        warnings.warn(f"{self._old} is now {self._new}", DeprecationWarning, stacklevel=2)
        module = import_module(self._new)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self._spec  # importing under another name has set that of the alias


class _Finder(MetaPathFinder):
    """Finds modules under their former names."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        root, _, below = fullname.partition(".")
        parts = below.split(".")
        heads = (".".join(parts[:n]) for n in range(len(parts), 0, -1))
        head = next((h for h in heads if h in MOVED), None)
        if root != "grasptrack" or head is None:
            return None
        return spec_from_loader(fullname, _Alias(fullname, f"grasptrack.{MOVED[head]}{below[len(head) :]}"))


def install() -> None:
    """Once; asked first, for an empty folder of the former name would be found as a namespace."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())
