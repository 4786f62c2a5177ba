# SPDX-License-Identifier: Apache-2.0
"""The edge of the NumPy definitions: arguments of the types and shapes that compiled kernels take, or TypeError."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

COLUMNS = {"starts": None, "places": None, "grasps": None, "H": 3, "image": None, "edges": None, "hidden": None}
"""Of arrays of two dimensions other than points: how many columns, or any number."""
POINTS = frozenset(
    [
        "points",
        "points1",
        "points2",
        "normals",
        "queries",
        "contacts",
        "directions",
        "targets",
        "target_normals",
        "bends",
    ]
)
POINTS |= {"first", "second", "chain"}
"""Arrays of shape (N, 2)."""
ANY_SHAPE = frozenset(["seen_area", "strongest_edges", "surface_evidence"])
"""Kernels that take arrays of any shape and check their size themselves."""
TAKEN = {
    "Floats": np.float64,
    "Ints": np.int64,
    "NDArray[np.int64]": np.int64,
    "NDArray[np.int32]": np.int32,
    "NDArray[np.bool_]": np.bool_,
    "NDArray[np.uint8]": np.uint8,
}
"""What an annotation asks of an array. Of images nothing is converted."""
RECORDS = {
    "CurvatureVector": ("Floats", "Floats"),
    "RankedCandidates": ("Points", "Points", "NDArray[np.bool_]", "Ints", "Floats"),
    "AlignmentSteps": ("Floats", "Floats", "Ints", "float"),
    "WrenchSpace": ("float",) * 4,
    "RankingLimits": ("float", "float", "int"),
    "MatchWindow": ("float", "float", "int", "float", "float"),
    "TraceOptions": ("bool", "int", "float", "int", "float", "float", "float", "float"),
}
LENGTHS = {"line": 4, "reference": 8, "ahead": 2}
"""Of tuples of numbers."""


def typed(kernel: Callable[P, R]) -> Callable[P, R]:
    """The kernel, its arguments converted as compiled kernels convert them."""
    signature = inspect.signature(kernel)
    asked = {name: str(p.annotation) for name, p in signature.parameters.items()}

    @functools.wraps(kernel)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        bound = signature.bind(*args, **kwargs)
        for name, value in bound.arguments.items():
            bound.arguments[name] = _taken(kernel.__name__, name, asked[name], value)
        return kernel(*bound.args, **bound.kwargs)

    return checked


def _taken(kernel: str, name: str, asked: str, value: Any) -> Any:
    kind = asked.removesuffix(" | None")
    if value is None and kind != asked:
        return None
    if kind in RECORDS:
        if not isinstance(value, tuple) or len(value) != len(RECORDS[kind]):
            raise TypeError(f"{name} is a {kind}, not {type(value).__name__}")
        items = [_taken(kernel, f"{name}[{i}]", each, value[i]) for i, each in enumerate(RECORDS[kind])]
        return type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    if kind in TAKEN or kind in ("Image", "Points"):
        return _array(kernel, name, kind, value)
    if kind.startswith(("list[", "Sequence[")) and not isinstance(value, (list, tuple)):
        raise TypeError(f"{name} is a list, not {type(value).__name__}")
    if kind in ("list[int]", "list[float]"):
        return [_number(name, kind[5:-1], each) for each in value]
    if kind == "Sequence[Floats]":
        return [_array(kernel, name, "Floats", each) for each in value]
    if name in LENGTHS:
        if not isinstance(value, (list, tuple)) or len(value) != LENGTHS[name]:
            raise TypeError(f"{name} has {LENGTHS[name]} numbers")
        return tuple(_number(name, "float", each) for each in value)
    return _number(name, kind, value) if kind in ("int", "float", "bool") else value


def _number(name: str, kind: str, value: Any) -> Any:
    types: dict[str, tuple[type, ...]] = {"bool": (bool, np.bool_), "int": (int, np.integer)}
    given: object = value  # what is asked for decides, not what it was
    if not isinstance(given, types.get(kind, (int, np.integer, float, np.floating))):
        raise TypeError(f"{name} is of type {kind}, not {type(value).__name__}")
    if kind == "int" and not -(2**63) <= value < 2**63:
        raise TypeError(f"{name} has more than 64 bits")
    return {"float": np.float64, "bool": bool, "int": int}[kind](value)


def _array(kernel: str, name: str, kind: str, value: Any) -> Any:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
        raise TypeError(f"{name} is an array of numbers, not {type(value).__name__}")
    if kind == "Image" or kind == "NDArray[np.uint8]":
        if value.dtype not in ((np.uint8, np.float32) if kind == "Image" else (np.uint8,)):
            raise TypeError(f"{name} is an image of bytes, not of {value.dtype}")
        if name == "hidden":  # it may be laid out anyhow: it is copied
            value = np.ascontiguousarray(value)
        if not value.flags.c_contiguous:
            raise TypeError(f"{name} is an image whose pixels lie in a row")
    else:
        value = np.ascontiguousarray(value, dtype=TAKEN.get(kind, np.float64))
    if kernel in ANY_SHAPE:
        return value
    points = kind == "Points" or (name in POINTS and kind != "Ints")
    dimensions = 2 if points or name in COLUMNS else 1
    columns = 2 if points else COLUMNS.get(name)
    if value.ndim != dimensions or (columns and value.shape[1] != columns) or (name == "H" and len(value) != 3):
        raise TypeError(f"{name} has another shape than {value.shape}")
    return value
