# SPDX-License-Identifier: Apache-2.0
"""Nets that are asked by clicks: an encoder looks at an image once, a decoder answers each set of hints (SAM and its kin).

Three exports to ONNX are known by the names of their inputs and outputs: SAM's own, which MobileSAM uses too; EdgeSAM's; SAM
2's. onnxruntime runs them, the extra `segment`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError, install_hint
from grasptrack.first_image import FirstImage
from grasptrack.nets.salient import probabilities
from grasptrack.segmentation.segmenters import Region
from grasptrack.typing import Bools, Floats, Floats32, Pixels

EMBEDDINGS = ({"image_embeddings"}, {"image_embed", "high_res_feats_0", "high_res_feats_1"})
"""What a decoder takes of its encoder: SAM's and EdgeSAM's, and SAM 2's."""
PROMPTS = {"point_coords", "point_labels"}
OPTIONAL = {"mask_input", "has_mask_input", "orig_im_size"}
MASKS, SCORES = ("low_res_masks", "masks"), ("iou_predictions", "iou", "scores")
"""Names of a decoder's outputs, the first that is there: masks as logits, and their predicted overlaps with the truth."""
SIDE = 1024
"""px, the longer side of what an encoder takes where its file does not say."""
MASK_SIDE = 256
"""px, side of the mask that a decoder may be given where its file does not say."""
MEAN, DEVIATION = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)
"""Of ImageNet's colours, red first, 0 to 255: what these nets were trained on."""
ON, OFF, CORNER, OTHER_CORNER, NO_POINT = 1.0, 0.0, 2.0, 3.0, -1.0
"""Labels of points: on the object, off it, a box's corners, and one that stands for no box."""
GRID = (6, 4)
"""Points that are asked along the longer and the shorter side of the image where nothing is said."""
SAME_MASK = 0.8
"""Overlap of two masks above which they are one."""
MAX_REGIONS = 12
"""Those with the largest predicted overlap first."""
ERROR_LENGTH, SILENT = 160, 4
"""Characters of onnxruntime's errors that are shown, and its level of messages at which it says nothing itself."""
TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(int32)": np.int32,
    "tensor(int64)": np.int64,
}
"""NumPy's types of onnxruntime's."""


class _Frame(NamedTuple):
    """How an image lies in what its encoder saw.

    Attributes:
        scales: px of the encoder's frame per px of the image, along x and y.
        seen: (height, width) px that the encoder takes for the image.
        side: px of the square that embeddings cover.
    """

    scales: tuple[float, float]
    seen: tuple[int, int]
    side: float


class _Mask(NamedTuple):
    """An answer of the decoder: its predicted overlap with the truth, 0 to 1, (h, w) logits over the image alone, and how many
    cells of these there are per px of the image, along x and y."""

    score: float
    logits: Floats32
    cells: tuple[float, float]

    @property
    def covered_cells(self) -> Bools:
        """(h, w) what it covers."""
        return self.logits > 0.0

    def overlap_with(self, other: _Mask) -> float:
        """Intersection over union."""
        both, either = self.covered_cells & other.covered_cells, self.covered_cells | other.covered_cells
        return float(np.count_nonzero(both)) / max(float(np.count_nonzero(either)), 1.0)

    def enlarged_to(self, size: tuple[int, ...]) -> Floats32:
        """(H, W) 0 to 1, of an image of (height, width)."""
        a, b = self.cells
        back = np.array([[a, 0.0, 0.5 * a - 0.5], [0.0, b, 0.5 * b - 0.5]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        large = cv2.warpAffine(self.logits, back, (size[1], size[0]), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return probabilities(np.asarray(large))


class PromptableNet:
    """An encoder and a decoder as ONNX: a segmenter that answers pixels on the object and beside it, and boxes.

    An encoder takes (H, W, 3), red first, 0 to 255, or (1, 3, S, S), normalised with ImageNet's mean and deviation, the image
    at the upper left and zeros round it (SAM), or stretched to the square (SAM 2).
    """

    def __init__(self, encoder: str | Path, decoder: str | Path) -> None:
        self.encoder, self.decoder = Path(encoder), Path(decoder)
        self._encoder, self._decoder = (_open_session(path) for path in (self.encoder, self.decoder))
        self._check_decoder()
        self._check_encoder()
        self._image: NDArray[Any] | None = None
        self._embedding: dict[str, NDArray[Any]] = {}
        self._frame = _Frame((1.0, 1.0), (SIDE, SIDE), SIDE)

    def regions(self, image: Pixels, hints: FirstImage) -> Sequence[Region]:
        """What the decoder answers to the hints, or to a grid of points where they say nothing of the object.

        The image is encoded once; further calls with the same pixels ask the decoder alone.
        """
        self._encode_image(image)
        found: list[_Mask] = []
        for points, labels in _prompts_for(image.shape, hints):
            found += self._decode_prompt(points, labels, image.shape)
        kept: list[_Mask] = []
        for mask in sorted(found, key=lambda mask: -mask.score):
            if (
                len(kept) < MAX_REGIONS
                and mask.covered_cells.any()
                and not any(mask.overlap_with(other) > SAME_MASK for other in kept)
            ):
                kept.append(mask)
        return [Region(mask.enlarged_to(image.shape), mask.score) for mask in kept]

    # --- files -----------------------------------------------------------------------------------

    def _check_decoder(self) -> None:
        inputs, outputs = _node_names(self._decoder.get_inputs()), _node_names(self._decoder.get_outputs())
        embeddings = next((e for e in EMBEDDINGS if e <= set(inputs)), None)
        masks, scores = _first_of(MASKS, outputs), _first_of(SCORES, outputs)
        known = embeddings is not None and embeddings | PROMPTS <= set(inputs) <= embeddings | PROMPTS | OPTIONAL
        if embeddings is None or not (known and masks and scores):
            raise InputError(
                f'"{self.decoder}" is no mask decoder of SAM, EdgeSAM or SAM 2: it takes {", ".join(inputs)} and gives '
                f"{', '.join(outputs)}",
                inputs=inputs,
                outputs=outputs,
            )
        self._needs, self._masks, self._scores = embeddings, masks, scores
        self._stretches = "image_embed" in embeddings
        self._is_sized = "orig_im_size" in inputs
        self._fits_image = self._is_sized and masks == "masks"  # without the encoder's padding

    def _check_encoder(self) -> None:
        inputs, outputs = self._encoder.get_inputs(), _node_names(self._encoder.get_outputs())
        shape = list(inputs[0].shape) if len(inputs) == 1 else []
        self._planar = len(shape) == 4
        if (shape[1:2] != [3] if self._planar else len(shape) != 3 or shape[2] != 3) or inputs[0].type not in TYPES:
            takes = ", ".join(f"{i.name} {tuple(i.shape)}" for i in inputs)
            raise InputError(
                f'"{self.encoder}" is no image encoder: it takes {takes}, not one image (H, W, 3) or (1, 3, H, W)',
                inputs=_node_names(inputs),
            )
        alone = len(outputs) == 1 and len(self._needs) == 1  # some call it otherwise, and there is but one
        if not alone and not self._needs <= set(outputs):
            raise InputError(
                f'"{self.encoder}" gives {", ".join(outputs)}, but "{self.decoder}" takes {", ".join(sorted(self._needs))}: '
                "encoder and decoder of one export are needed",
                outputs=outputs,
            )
        self._renamed = {outputs[0]: next(iter(self._needs))} if alone else {}
        height, width = shape[2:] if self._planar else shape[:2]
        self._size = (height, width) if isinstance(height, int) and isinstance(width, int) else None

    # --- encoder ---------------------------------------------------------------------------------

    def _encode_image(self, image: Pixels) -> None:
        """Run the encoder, unless the image is the last one."""
        if self._image is not None and np.array_equal(self._image, image):
            return
        self._image = None
        given = self._encoder.get_inputs()[0]
        seen, self._frame = self._prepare_image(image)
        values = _run_session(self._encoder, {given.name: seen.astype(TYPES[given.type])}, self.encoder)
        self._embedding = {self._renamed.get(name, name): value for name, value in values.items()}
        self._image = image.copy()

    def _prepare_image(self, image: Pixels) -> tuple[Floats32, _Frame]:
        """What the encoder takes of an image, and how the image lies in it."""
        height, width = image.shape[:2]
        tall, wide = self._size or (SIDE, SIDE)
        least = min(wide / width, tall / height)
        size = (wide, tall) if self._stretches else (max(1, round(width * least)), max(1, round(height * least)))
        colours = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB)
        way = cv2.INTER_AREA if least < 1.0 else cv2.INTER_LINEAR
        small = np.asarray(cv2.resize(colours, size, interpolation=way), dtype=np.float32)
        if self._planar:
            small = np.asarray((small - np.array(MEAN, np.float32)) / np.array(DEVIATION, np.float32), dtype=np.float32)
        if self._planar or self._size is not None:
            padded = np.zeros((tall, wide, 3), np.float32)
            padded[: size[1], : size[0]] = small
            small = padded
        seen = size[::-1] if self._planar else (small.shape[0], small.shape[1])
        frame = _Frame((size[0] / width, size[1] / height), seen, float(max(tall, wide)))
        return np.ascontiguousarray(small.transpose(2, 0, 1)[None] if self._planar else small), frame

    # --- decoder ---------------------------------------------------------------------------------

    def _decode_prompt(self, points: Floats, labels: Floats, size: tuple[int, ...]) -> list[_Mask]:
        """The answers to points (n, 2) px with labels (n,) in the image of (height, width) that was encoded."""
        coords = (points + 0.5) * self._frame.scales - 0.5
        if self._is_sized and not (labels == CORNER).any():
            coords, labels = np.vstack([coords, [[0.0, 0.0]]]), np.append(labels, NO_POINT)
        given: dict[str, NDArray[Any]] = {
            **self._embedding,
            "point_coords": coords[None],
            "point_labels": labels[None],
            "has_mask_input": np.zeros(1),
            "orig_im_size": np.array(self._frame.seen),
        }
        feed = {}
        for each in self._decoder.get_inputs():
            if each.name == "mask_input":
                side = [n if isinstance(n, int) else MASK_SIDE for n in each.shape[-2:]]
                given["mask_input"] = np.zeros((1, 1, *side))
            feed[each.name] = given[each.name].astype(TYPES.get(each.type, np.float32))
        values = _run_session(self._decoder, feed, self.decoder)
        masks, scores = (np.asarray(values[which], np.float32) for which in (self._masks, self._scores))
        scores = scores.ravel()
        if masks.ndim != 4 or masks.shape[0] != 1 or masks.shape[1] != len(scores):
            raise InputError(
                f'"{self.decoder}" gives masks {masks.shape} and {len(scores)} scores, not (1, n, h, w) and n',
                shape=masks.shape,
            )
        covers = self._frame.seen[::-1] if self._fits_image else (self._frame.side, self._frame.side)
        a, b = (f * n / c for f, n, c in zip(self._frame.scales, masks.shape[:1:-1], covers, strict=True))
        shown = masks[0, :, : math.ceil(b * size[0]), : math.ceil(a * size[1])]  # without what was padded
        # Of four, the first answers several points, and the others one that is ambiguous.
        first = 1 if len(scores) == 4 and np.count_nonzero(labels != NO_POINT) == 1 else 0
        return [
            _Mask(float(np.clip(s, 0.0, 1.0)), m, (a, b)) for s, m in zip(scores[first:], shown[first:], strict=True)
        ]


class PromptableFiles:
    """Makes a segmenter of "ENCODER.onnx,DECODER.onnx", or of a folder with one of each."""

    usage = "ENCODER,DECODER"

    def make(self, argument: str) -> PromptableNet:
        """See SegmenterMaker."""
        encoder, comma, decoder = argument.partition(",")
        if comma:
            return PromptableNet(encoder.strip(), decoder.strip())
        folder = Path(argument)
        if not argument or not folder.is_dir():
            raise InputError(
                f'sam: takes ENCODER.onnx,DECODER.onnx or a folder with both, not "{argument}"', given=argument
            )
        models = sorted(folder.glob("*.onnx"))
        found = [[p for p in models if part in p.name.lower()] for part in ("encoder", "decoder")]
        if [len(files) for files in found] != [1, 1]:
            names = ", ".join(p.name for p in models) or "none"
            raise InputError(
                f'"{argument}" has to hold one file *encoder*.onnx and one *decoder*.onnx; its models: {names}',
                given=argument,
            )
        return PromptableNet(found[0][0], found[1][0])


SAM = PromptableFiles()


def _prompts_for(size: tuple[int, ...], hints: FirstImage) -> list[tuple[Floats, Floats]]:
    """Points (n, 2) px and labels (n,) of each question to the decoder."""
    height, width = size[:2]
    off = list(hints.not_at)
    box = hints.box
    if box is None and hints.outline is not None:
        low, high = hints.outline.min(axis=0), hints.outline.max(axis=0)
        box = (float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1]))
    corners = [] if box is None else [(box[0], box[1]), (box[0] + box[2], box[1] + box[3])]
    on = [list(hints.object_at)]
    if not hints.object_at and box is None:
        columns, rows = GRID if width >= height else GRID[::-1]
        grid = [((i + 0.5) * width / columns, (k + 0.5) * height / rows) for k in range(rows) for i in range(columns)]
        on = [[(x, y)] for x, y in grid if hints.hidden is None or not hints.hidden[int(y), int(x)]]
    labels = [OFF] * len(off) + [CORNER, OTHER_CORNER][: len(corners)]
    return [(np.array([*each, *off, *corners], float), np.array([ON] * len(each) + labels)) for each in on]


def _open_session(path: Path) -> Any:
    """A file as onnxruntime runs it."""
    try:
        import onnxruntime
    except ImportError:
        raise InputError(f"onnxruntime runs nets that are asked by clicks: {install_hint('segment')}") from None
    if not path.is_file():
        raise InputError(f'there is no model file "{path}"', path=str(path))
    options = onnxruntime.SessionOptions()
    options.log_severity_level = SILENT
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception:  # onnxruntime's errors share no class of their own, and their text spans lines
        raise InputError(f'"{path}" cannot be read as an ONNX model', path=str(path)) from None


def _run_session(session: Any, feed: dict[str, NDArray[Any]], path: Path) -> dict[str, NDArray[Any]]:
    """All outputs by name."""
    try:
        values = session.run(None, feed)
    except Exception as error:  # see _open_session
        shapes = ", ".join(f"{name} {value.shape}" for name, value in feed.items())
        said = " ".join(str(error).split())[:ERROR_LENGTH]
        raise InputError(f'the model "{path}" does not run on {shapes}: {said}', path=str(path)) from None
    return dict(zip(_node_names(session.get_outputs()), values, strict=True))


def _node_names(nodes: Sequence[Any]) -> list[str]:
    return [node.name for node in nodes]


def _first_of(wanted: Sequence[str], names: Sequence[str]) -> str:
    """The first of the wanted names that is there; empty where none is."""
    return next((name for name in wanted if name in names), "")
