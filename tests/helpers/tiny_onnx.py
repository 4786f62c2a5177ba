# SPDX-License-Identifier: Apache-2.0
"""A net of two nodes as ONNX, written byte by byte: how far an image's channels lie above their mean, in 0 to 1."""

from __future__ import annotations

from pathlib import Path


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


def _tensor_type(name: str, shape: tuple[int, ...]) -> bytes:
    dimensions = b"".join(_bytes(1, _number(1, n)) for n in shape)
    return _bytes(1, name) + _bytes(2, _bytes(1, _number(1, 1) + _bytes(2, dimensions)))


def write_brightness_net(path: Path, side: int) -> None:
    """A model (1, 3, side, side) -> (1, 1, side, side): the sigmoid of the channels' mean."""
    axes = _bytes(5, _bytes(1, "axes") + _number(20, 7) + _number(8, 1))
    keep = _bytes(5, _bytes(1, "keepdims") + _number(20, 2) + _number(3, 1))
    mean = _bytes(1, "image") + _bytes(2, "mean") + _bytes(4, "ReduceMean") + axes + keep
    sigmoid = _bytes(1, "mean") + _bytes(2, "map") + _bytes(4, "Sigmoid")
    graph = _bytes(1, mean) + _bytes(1, sigmoid) + _bytes(2, "brightness")
    graph += _bytes(11, _tensor_type("image", (1, 3, side, side))) + _bytes(12, _tensor_type("map", (1, 1, side, side)))
    path.write_bytes(_number(1, 7) + _bytes(8, _bytes(1, "") + _number(2, 11)) + _bytes(7, graph))
