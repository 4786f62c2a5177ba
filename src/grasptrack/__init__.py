# SPDX-License-Identifier: Apache-2.0
"""Choose a grasp on a flat object once, then find the same physical contacts in every image that follows.

Three depths: `GraspTracker` for a sequence; `synthesize`, `transfer` and `analyze` for one step; every part of a step
in its own module. Names are imported when they are first used, so that `import grasptrack` itself costs nothing.
"""

import sys
from importlib import import_module
from importlib.util import find_spec as _find_spec
from types import ModuleType
from typing import TYPE_CHECKING

from grasptrack.presentation import draw_by as _draw_by

if TYPE_CHECKING:
    from grasptrack.errors import (
        AmbiguousError,
        AxesError,
        ClippedError,
        ConditioningError,
        ContourError,
        CrossingError,
        GraspError,
        GraspTrackError,
        InputError,
        ObservationError,
        ParallelLineError,
        PeaksError,
        SourceError,
        StrategyError,
        TransferError,
    )
    from grasptrack.geometry.cameras import Camera
    from grasptrack.geometry.contours import Contour, View
    from grasptrack.grasp.contacts import Grasp
    from grasptrack.grasp.force_closure import GraspAnalysis, analyze
    from grasptrack.grasp.hand import Hand, Length
    from grasptrack.grasp.synthesis import GraspList, RankedGrasp, synthesize
    from grasptrack.io.calibration import read_camera
    from grasptrack.io.parts import Part
    from grasptrack.io.sources import Frame, open_source
    from grasptrack.segmentation.candidate import Candidate
    from grasptrack.segmentation.first_look import first_look
    from grasptrack.segmentation.live_wire import LiveWire
    from grasptrack.servo import (
        Bounds,
        Closing,
        Command,
        Exploration,
        Gain,
        Goal,
        GraspPose,
        GraspServo,
        HandEye,
        Limits,
        LossPolicy,
        NominalCamera,
    )
    from grasptrack.trackability import Suitability, inspect
    from grasptrack.tracking.instances import Instance, find
    from grasptrack.tracking.result import TrackResult
    from grasptrack.tracking.scene import SceneResult, SceneTracker
    from grasptrack.tracking.tracker import GraspTracker
    from grasptrack.transfer import Transfer, transfer
    from grasptrack.transfer.choice import StrategyChoice, TransferContext, choose_strategy
    from grasptrack.typing import Status, StrategyName
    from grasptrack.view.drawing import Drawing, draw

    __version__: str

if _find_spec("_grasptrack_native") is None:  # said at once, not by whatever is used first; found is not yet loaded
    from grasptrack.errors import without_kernels

    raise without_kernels("there are none")


def _png_of(result: object) -> bytes:
    from grasptrack.view.drawing import draw, png_bytes

    return png_bytes(draw(None, result))  # type: ignore[arg-type]


_draw_by(_png_of)

_HOME = {
    "grasp.force_closure": ("GraspAnalysis", "analyze"),
    "geometry.cameras": ("Camera",),
    "geometry.contours": ("Contour", "View"),
    "errors": (
        "AmbiguousError", "AxesError", "ClippedError", "ConditioningError", "ContourError", "CrossingError",
        "GraspError", "GraspTrackError", "InputError", "ObservationError", "ParallelLineError", "PeaksError",
        "SourceError", "StrategyError", "TransferError",
    ),
    "grasp.contacts": ("Grasp",),
    "grasp.hand": ("Hand", "Length"),
    "io.calibration": ("read_camera",),
    "segmentation.candidate": ("Candidate",),
    "segmentation.first_look": ("first_look",),
    "segmentation.live_wire": ("LiveWire",),
    "io.parts": ("Part",),
    "io.sources": ("Frame", "open_source"),
    "servo": (
        "Bounds", "Closing", "Command", "Exploration", "Gain", "Goal", "GraspPose", "GraspServo", "HandEye", "Limits",
        "LossPolicy", "NominalCamera",
    ),
    "trackability": ("Suitability", "inspect"),
    "grasp.synthesis": ("GraspList", "RankedGrasp", "synthesize"),
    "tracking.instances": ("Instance", "find"),
    "tracking.result": ("TrackResult",),
    "tracking.scene": ("SceneResult", "SceneTracker"),
    "tracking.tracker": ("GraspTracker",),
    "transfer": ("Transfer", "transfer"),
    "transfer.choice": ("StrategyChoice", "TransferContext", "choose_strategy"),
    "typing": ("Status", "StrategyName"),
    "view.drawing": ("Drawing", "draw"),
}  # fmt: skip
_MODULE = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "AmbiguousError", "AxesError", "Bounds", "Camera", "Candidate", "ClippedError", "Closing", "Command",
    "ConditioningError", "Contour", "ContourError", "CrossingError", "Drawing", "Exploration", "Frame", "Gain",
    "Goal", "Grasp", "GraspAnalysis", "GraspError", "GraspList", "GraspPose", "GraspServo", "GraspTrackError",
    "GraspTracker", "Hand", "HandEye", "InputError", "Instance", "Length", "Limits", "LiveWire", "LossPolicy",
    "NominalCamera", "ObservationError", "ParallelLineError", "Part", "PeaksError", "RankedGrasp", "SceneResult",
    "SceneTracker", "SourceError", "Status", "StrategyChoice", "StrategyError", "StrategyName", "Suitability", "TrackResult",
    "Transfer", "TransferContext", "TransferError", "View", "__version__", "analyze", "choose_strategy", "draw", "find",
    "first_look", "inspect", "open_source", "read_camera", "synthesize", "transfer",
]  # fmt: skip


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        value: object = version("grasptrack")
    elif name in _MODULE:
        value = getattr(import_module(f"grasptrack.{_MODULE[name]}"), name)
    else:
        raise AttributeError(f"module 'grasptrack' has no attribute '{name}'")
    if name == "transfer":
        return globals()[name]
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """This package. Its subpackage `transfer` has the name of a function, and is made to answer a call as that does.

    Importing grasptrack.transfer binds the subpackage here under its own name, so that without this
    ``grasptrack.transfer(...)`` would depend on what was imported before.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if name == "transfer" and type(value) is ModuleType:
            value.__class__ = type("CallableModule", (ModuleType,), {"__call__": staticmethod(value.transfer)})
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
