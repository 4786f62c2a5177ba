# SPDX-License-Identifier: Apache-2.0
"""Where regions come from beside this package's own search: one protocol for nets, a user's function, other packages.

`segmenter_for` turns what a user names into a segmenter: "classical" (nothing beside the own search), "onnx:FILE" (a net
that maps salient objects, run by OpenCV), "sam:ENCODER,DECODER" or "sam:FOLDER" (one that is asked by clicks), the name of a
model or of an entry point `grasptrack.segmenters`, an object that follows the protocol, or one with `segment(image)`, or a
function of an image, that returns one mask.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, cast, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError
from grasptrack.first_image import FirstImage
from grasptrack.plugins import load_plugin, plugin_names
from grasptrack.segmentation.models import MODELS, installed_files, model_named
from grasptrack.segmentation.promptable import PromptableNet, net_of_files
from grasptrack.segmentation.regions import Region, Segmenter
from grasptrack.typing import Pixels

CLASSICAL = "classical"


@runtime_checkable
class MaskSegmenter(Protocol):
    """Your own segmentation, a network or a model of the object, in the place of this one."""

    def segment(self, image: NDArray[Any]) -> NDArray[Any]:
        """(H, W) nonzero on objects, of an image (H, W) or (H, W, 3)."""
        ...


class OneMask:
    """A user's function of an image, or an object's `segment`, as a segmenter of one region."""

    def __init__(self, segment: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
        self._segment = segment

    def segment(self, image: NDArray[Any]) -> NDArray[Any]:
        """(H, W) nonzero on objects."""
        return np.asarray(self._segment(image))

    def regions(self, image: Pixels, hints: FirstImage) -> Sequence[Region]:
        """See Segmenter."""
        return [Region(self.segment(image))]


class SalientNet:
    """A net that maps how salient each pixel is (U^2-Net, ISNet), run by OpenCV on the image and on its mirror image.

    Args:
        path: of the ONNX file.
        side: px, side of the square that the net takes.

    Raises:
        InputError: no file, or none that OpenCV can read as a net.
    """

    MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
    """Of ImageNet's colours, red first: what such nets were trained on."""

    def __init__(self, path: str | Path, side: int = 320) -> None:
        self.path, self.side = Path(path), side
        self._net = _read_net(self.path)

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy reads the file again."""
        return SalientNet, (self.path, self.side)

    def regions(self, image: Pixels, hints: FirstImage) -> Sequence[Region]:
        """The map of the image, and that of its mirror image; a net knows nothing of hints, which choose afterwards."""
        plain, mirrored = self.saliency(image), self.saliency(image[:, ::-1])[:, ::-1]
        return [Region(plain, is_vote=True), Region(mirrored, is_vote=True)]

    def saliency(self, image: Pixels) -> NDArray[np.float32]:
        """(H, W) 0 to 1, how salient each pixel of an image (H, W) or BGR (H, W, 3) is.

        Raises:
            InputError: the net does not map an image to an image.
        """
        colours = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        small = cv2.resize(colours, (self.side, self.side), interpolation=cv2.INTER_LINEAR)[:, :, ::-1]
        bright = np.asarray(small, dtype=np.float32) / np.float32(max(float(small.max()), 1.0))
        scaled = (bright - np.array(self.MEAN, np.float32)) / np.array(self.DEVIATION, np.float32)
        try:
            self._net.setInput(np.ascontiguousarray(scaled.transpose(2, 0, 1)[None], dtype=np.float32))
            found = np.asarray(self._net.forward())
        except cv2.error:
            shape = f"(1, 3, {self.side}, {self.side})"
            raise InputError(f'the model "{self.path}" does not run on an image of the shape {shape}') from None
        if found.ndim != 4 or found.shape[1] != 1 or min(found.shape[2:]) < 8:
            raise InputError(f'the model "{self.path}" gives {found.shape}, not a map (1, 1, h, w)', shape=found.shape)
        plane = found[0, 0].astype(np.float32)
        if plane.min() < -1e-3 or plane.max() > 1.0 + 1e-3:  # logits
            plane = 1.0 / (1.0 + np.exp(-np.clip(plane, -30.0, 30.0)))
        size = (image.shape[1], image.shape[0])
        large = np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)
        return np.clip(large, 0.0, 1.0)


def _read_net(path: Path) -> Any:
    if not path.is_file():
        raise InputError(f'there is no model file "{path}"', path=str(path))
    try:
        return cv2.dnn.readNetFromONNX(str(path))
    except cv2.error:  # its text names files of OpenCV's own
        raise InputError(f'"{path}" cannot be read as an ONNX model', path=str(path)) from None


def segmenter_for(what: Any) -> Segmenter | None:
    """The segmenter that a user means; None where the own search is all.

    Args:
        what: see the module.

    Raises:
        InputError: no such model or segmenter, or one that cannot be had.
    """
    if what is None or (isinstance(what, str) and what == CLASSICAL):
        return None
    if isinstance(what, str):
        if what.startswith("onnx:"):
            return SalientNet(what[len("onnx:") :])
        if what.startswith("sam:"):
            return net_of_files(what[len("sam:") :])
        what = _named(what)
    if isinstance(what, type):
        what = what()
    if isinstance(what, Segmenter):
        return what
    if isinstance(what, MaskSegmenter):
        return OneMask(what.segment)
    if callable(what):
        return OneMask(cast(Callable[[NDArray[Any]], NDArray[Any]], what))
    raise InputError(f"a segmenter has regions(image, hints) or segment(image), or is a function; not {what!r}")


def _named(name: str) -> Any:
    """A model, or a segmenter that a package registered.

    Raises:
        InputError: none of that name, or it cannot be had.
    """
    model = model_named(name)
    if model is not None:
        files = installed_files(model)
        return SalientNet(files[0], model.side) if model.side is not None else PromptableNet(files[0], files[1])
    found = load_plugin("grasptrack.segmenters", name)
    if found is None:
        known = (
            CLASSICAL,
            "onnx:FILE",
            "sam:ENCODER,DECODER",
            *(m.name for m in MODELS),
            *plugin_names("grasptrack.segmenters"),
        )
        choices = ", ".join(known)
        raise InputError(f'unknown segmenter "{name}"; choose from {choices}', name=name)
    return found
