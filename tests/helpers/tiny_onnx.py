# SPDX-License-Identifier: Apache-2.0
"""Nets of a few nodes as ONNX, written byte by byte: one that maps brightness, and stand-ins for nets that answer clicks."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from grasptrack.nets import models

Dimensions = Sequence[int | str]
KINDS = {np.dtype(np.float32): 1, np.dtype(np.int64): 7}


def _varint(value: int) -> bytes:
    out = bytearray()
    while True:
        value, low = value >> 7, value & 0x7F
        out.append(low | (0x80 if value else 0))
        if not value:
            return bytes(out)


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, value: bytes | str) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return _varint(field << 3 | 2) + _varint(len(data)) + data


def _tensor_type(name: str, shape: Dimensions) -> bytes:
    dimensions = b"".join(_bytes(1, _number(1, n) if isinstance(n, int) else _bytes(2, n)) for n in shape)
    return _bytes(1, name) + _bytes(2, _bytes(1, _number(1, 1) + _bytes(2, dimensions)))


def _attribute(name: str, value: int | str | list[int]) -> bytes:
    if isinstance(value, int):
        told = _number(20, 2) + _number(3, value)
    elif isinstance(value, str):
        told = _number(20, 3) + _bytes(4, value)
    else:
        told = _number(20, 7) + b"".join(_number(8, each) for each in value)
    return _bytes(5, _bytes(1, name) + told)


class Net:
    """Nodes and constants, written when all is said.

    Each method that makes a node returns the name of its output.
    """

    def __init__(self) -> None:
        self._graph = bytearray()
        self._count = 0

    def constant(self, value: object, kind: type = np.float32) -> str:
        array = np.asarray(value, dtype=kind)
        self._count += 1
        name = f"constant{self._count}"
        told = b"".join(_number(1, n) for n in array.shape) + _number(2, KINDS[array.dtype])
        self._graph += _bytes(5, told + _bytes(8, name) + _bytes(9, array.tobytes()))
        return name

    def integers(self, *values: int) -> str:
        return self.constant(values, np.int64)

    def node(self, kind: str, *inputs: str, to: str | None = None, **attributes: int | str | list[int]) -> str:
        self._count += 1
        name = to or f"value{self._count}"
        told = b"".join(_bytes(1, each) for each in inputs) + _bytes(2, name) + _bytes(4, kind)
        self._graph += _bytes(
            1, told + b"".join(_attribute(key.rstrip("_"), value) for key, value in attributes.items())
        )
        return name

    def write(self, path: Path, inputs: dict[str, Dimensions], outputs: dict[str, Dimensions]) -> None:
        graph = bytes(self._graph) + _bytes(2, "net")
        graph += b"".join(_bytes(11, _tensor_type(name, shape)) for name, shape in inputs.items())
        graph += b"".join(_bytes(12, _tensor_type(name, shape)) for name, shape in outputs.items())
        path.write_bytes(_number(1, 7) + _bytes(8, _bytes(1, "") + _number(2, 13)) + _bytes(7, graph))


def write_brightness_net(path: Path, side: int) -> None:
    """A model (1, 3, side, side) -> (1, 1, side, side): the sigmoid of the channels' mean."""
    net = Net()
    mean = net.node("ReduceMean", "image", axes=[1], keepdims=1)
    net.node("Sigmoid", mean, to="map")
    net.write(path, {"image": (1, 3, side, side)}, {"map": (1, 1, side, side)})


SIDE, CELL = 1024, 4
EMBEDDED = (1, 3, SIDE // CELL, SIDE // CELL)
SCORES = (0.7, 0.95, 0.4)
"""Predicted overlaps of the masks below."""
NEAR = (0.1, 0.5, 8.0)
"""Colour distance, in deviations of ImageNet's colours, to which each of three masks reaches: grain, object, everything."""


def write_encoder(path: Path, form: str, name: str = "image_embeddings") -> None:
    """An encoder that keeps the colours of cells of 4 by 4 px.

    Args:
        form: "sam" takes (H, W, 3) of any size, 0 to 255, and pads; "fixed" takes (684, 1024, 3); "edge" takes a square that
            is normalised; "sam2" does, and gives three embeddings.
        name: of the embeddings.
    """
    net = Net()
    image = "image"
    shape: Dimensions = (1, 3, SIDE, SIDE)
    if form in ("sam", "fixed"):
        shape = ("image_height", "image_width", 3) if form == "sam" else (684, SIDE, 3)
        mean, deviation = net.constant((123.675, 116.28, 103.53)), net.constant((58.395, 57.12, 57.375))
        normal = net.node("Div", net.node("Sub", "input_image", mean), deviation)
        planes = net.node("Unsqueeze", net.node("Transpose", normal, perm=[2, 0, 1]), net.integers(0))
        size = net.node("Slice", net.node("Shape", "input_image"), net.integers(0), net.integers(2))
        more = net.node("Sub", net.integers(SIDE, SIDE), size)
        image = net.node("Pad", planes, net.node("Concat", net.integers(0, 0, 0, 0, 0, 0), more, axis=0))
    names = ("high_res_feats_0", "high_res_feats_1", "image_embed") if form == "sam2" else (name,)
    for each in names:
        net.node("AveragePool", image, to=each, kernel_shape=[CELL, CELL], strides=[CELL, CELL])
    net.write(path, {"input_image" if form in ("sam", "fixed") else "image": shape}, dict.fromkeys(names, EMBEDDED))


def write_decoder(path: Path, form: str, *, low: bool = True, masks: int = 3) -> None:
    """A decoder whose masks hold what has nearly the colour of a point on the object, rather than of one beside it, in the box.

    Args:
        form: "sam" has SAM's names, "edge" EdgeSAM's, "sam2" those of SAM 2.
        low: SAM's decoder gives `low_res_masks`, too.
        masks: 3, or 4 with one more before them, which is as the second.
    """
    net = Net()
    far = net.constant(1e3)
    embedded = {"sam": "image_embeddings", "edge": "image_embeddings", "sam2": "high_res_feats_0"}[form]
    cells = net.node("Reshape", embedded, net.integers(1, 3, -1))  # (1, 3, P)
    points = net.node("Reshape", "point_coords", net.integers(-1, 2))
    labels = net.node("Reshape", "point_labels", net.integers(-1, 1))
    side = SIDE // CELL

    def chosen(label: float) -> str:
        return net.node("Cast", net.node("Equal", labels, net.constant(label)), to_=1)

    def axis(k: int) -> str:
        return net.node("Gather", points, net.integers(k), axis=1)  # (n, 1)

    def nearest(at: str, chosen: str) -> str:
        """(P,) colour distance to the nearest of points (n, 2) that are chosen (n, 1)."""
        scaled = net.node("Div", net.node("Add", at, net.constant(0.5)), net.constant(CELL))
        whole = net.node("Cast", net.node("Floor", scaled), to_=7)
        whole = net.node("Max", net.node("Min", whole, net.integers(side - 1)), net.integers(0))
        x, y = (net.node("Gather", whole, net.integers(k), axis=1) for k in (0, 1))
        index = net.node("Squeeze", net.node("Add", net.node("Mul", y, net.integers(side)), x), net.integers(1))
        colours = net.node("Transpose", net.node("Gather", cells, index, axis=2), perm=[2, 1, 0])  # (n, 3, 1)
        apart = net.node("ReduceL2", net.node("Sub", cells, colours), axes=[1], keepdims=0)  # (n, P)
        away = net.node("Mul", net.node("Sub", net.constant(1.0), chosen), far)
        return net.node("ReduceMin", net.node("Add", apart, away), axes=[0], keepdims=0)

    corner, other = chosen(2.0), chosen(3.0)
    boxed = net.node("ReduceMax", corner, axes=[0], keepdims=1)  # (1, 1)
    edges = []
    for k in (0, 1):
        low_edge, high_edge = (
            net.node("ReduceSum", net.node("Mul", axis(k), each), net.integers(0)) for each in (corner, other)
        )
        edges.append((low_edge, high_edge))
    middle = net.node("Concat", *(net.node("Mul", net.node("Add", a, b), net.constant(0.5)) for a, b in edges), axis=1)
    near = net.node("Min", nearest(points, chosen(1.0)), nearest(middle, boxed))
    off = net.node("Sub", nearest(points, chosen(0.0)), near)
    grid = np.indices((side, side)).reshape(2, -1).astype(np.float32) * CELL + 0.5 * CELL - 0.5
    outside = []
    for (low_edge, high_edge), at in zip(edges, (grid[1], grid[0]), strict=True):
        places = net.constant(at[None])
        outside += [net.node("Sub", low_edge, places), net.node("Sub", places, high_edge)]
    beyond = net.node("Mul", net.node("Relu", net.node("Max", *outside)), boxed)  # (1, P)
    planes = []
    for reach in ((NEAR[1],) if masks == 4 else ()) + NEAR:
        inside = net.node("Min", net.node("Sub", net.constant(reach), near), off)
        planes.append(net.node("Sub", net.node("Mul", inside, net.constant(20.0)), beyond))
    small = net.node("Reshape", net.node("Concat", *planes, axis=0), net.integers(1, masks, side, side))
    scores = net.constant([((0.99,) if masks == 4 else ()) + SCORES])

    inputs: dict[str, Dimensions] = {"point_coords": (1, "num_points", 2), "point_labels": (1, "num_points")}
    given: dict[str, Dimensions] = {"mask_input": (1, 1, side, side), "has_mask_input": (1,)}
    plane: Dimensions = (1, masks, side, side)
    score: Dimensions = (1, masks)
    if form == "edge":
        net.node("Identity", small, to="masks")
        net.node("Identity", scores, to="scores")
        net.write(path, {"image_embeddings": EMBEDDED, **inputs}, {"scores": score, "masks": plane})
        return
    net.node("Identity", scores, to="iou_predictions")
    if form == "sam2":
        net.node("Identity", small, to="masks")
        names = ("image_embed", "high_res_feats_0", "high_res_feats_1")
        inputs = {**dict.fromkeys(names, EMBEDDED), **inputs, **given}
        net.write(path, inputs, {"masks": plane, "iou_predictions": score})
        return
    large = net.node("Resize", small, "", net.constant([1.0, 1.0, CELL, CELL]), mode="linear")
    size = net.node("Cast", "orig_im_size", to_=7)
    net.node("Slice", large, net.integers(0, 0), size, net.integers(2, 3), to="masks")
    outputs: dict[str, Dimensions] = {"masks": (1, masks, "height", "width"), "iou_predictions": score}
    if low:
        net.node("Identity", small, to="low_res_masks")
        outputs["low_res_masks"] = plane
    inputs = {"image_embeddings": EMBEDDED, **inputs, **given, "orig_im_size": (2,)}
    net.write(path, inputs, outputs)


def write_pair(folder: Path, form: str) -> tuple[Path, Path]:
    """Encoder and decoder of one form."""
    folder.mkdir(parents=True, exist_ok=True)
    encoder, decoder = folder / "tiny.encoder.onnx", folder / "tiny.decoder.onnx"
    write_encoder(encoder, form)
    write_decoder(decoder, "sam" if form == "fixed" else form)
    return encoder, decoder


def register_models(monkeypatch: pytest.MonkeyPatch, made: Sequence[models.NetModel]) -> None:
    """Models that are listed and found by their names, in the place of those that are."""
    monkeypatch.setattr(models, "MODELS", tuple(made))
    monkeypatch.setattr("grasptrack.segmentation.segmenters.load_plugin", lambda _, name: models.model_named(name))
