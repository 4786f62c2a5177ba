# SPDX-License-Identifier: Apache-2.0
"""What nobody should hand in: arguments spoiled in value, length, type and layout, by a seeded generator."""

from collections.abc import Mapping
from typing import Any

import numpy as np

NUMBERS = (np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 1e-300, 1e300, -1e300, 1e-9, 1e9, 2.0**31, 2.0**53, 2.0**63, 0.5)
WHOLES = (0, -1, 1, 2, 7, 2**31 - 1, 2**31, -(2**31), 2**53, 2**63 - 1, -(2**63), 2**70, 1000003)


def spoiled(value: Any, rng: np.random.Generator) -> Any:
    """A value like the given one, and wrong in some way."""
    if rng.random() < 0.03:
        return [None, "text", b"bytes", object(), {}, [], 1 + 2j][rng.integers(7)]
    if isinstance(value, np.ndarray):
        return _spoiled_array(value, rng)
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return WHOLES[rng.integers(len(WHOLES))] if rng.random() < 0.8 else float(NUMBERS[rng.integers(len(NUMBERS))])
    if isinstance(value, float):
        return NUMBERS[rng.integers(len(NUMBERS))]
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*_spoiled_items(list(value), rng))
    if isinstance(value, tuple):
        return tuple(_spoiled_items(list(value), rng))
    if isinstance(value, list):
        return _spoiled_list(value, rng)
    if isinstance(value, Mapping):
        key = list(value)[rng.integers(len(value))]
        return {**value, key: spoiled(value[key], rng)}
    return np.full((3, 2), NUMBERS[rng.integers(len(NUMBERS))])


def _spoiled_items(items: list[Any], rng: np.random.Generator) -> list[Any]:
    at = rng.integers(len(items)) if items else 0
    return [spoiled(item, rng) if i == at else item for i, item in enumerate(items)]


def _spoiled_list(items: list[Any], rng: np.random.Generator) -> list[Any]:
    way = rng.integers(4)
    if way == 0:
        return items[: rng.integers(len(items) + 1)]
    if way == 1:
        return items * 2
    return _spoiled_items(items, rng)


def _spoiled_array(array: np.ndarray, rng: np.random.Generator) -> Any:
    way = int(rng.integers(16))
    if way <= 5:
        return _spoiled_values(array, rng)
    if way == 6:
        return array[: rng.integers(len(array) + 1)].copy() if array.ndim else array
    if way == 7:
        return np.concatenate([array, array]) if array.ndim else array
    if way == 8:
        return np.repeat(array, rng.integers(1, 4), axis=0) if array.ndim else array
    if way == 9:
        return array.astype([np.float32, np.int32, np.complex128, object, np.bool_, np.uint8, "U3"][rng.integers(7)])
    if way == 10:
        return [np.asfortranarray(array), array[::-1], array[::2], array.T, array.ravel(), array[None]][rng.integers(6)]
    if way == 11:
        out = array.copy()
        out.flags.writeable = False
        return out
    if way == 12 and array.dtype.kind == "f":
        return array * 10.0 ** int(rng.integers(-320, 309))
    if way == 13:
        return np.full_like(array, array.flat[0] if array.size else 0)
    if way == 14:
        return np.zeros((0, *array.shape[1:]), dtype=array.dtype)
    return np.empty((int(rng.integers(0, 5)),) * int(rng.integers(0, 4)), dtype=array.dtype) * 0


def _spoiled_values(array: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    out = np.array(array)
    if not out.size:
        return out
    many = out.size if rng.random() < 0.15 else int(rng.integers(1, 4))
    at = rng.integers(0, out.size, many)
    if out.dtype.kind == "f":
        out.flat[at] = np.array(NUMBERS)[rng.integers(len(NUMBERS), size=many)]
    elif out.dtype.kind in "iu":
        limits = np.iinfo(out.dtype)
        out.flat[at] = rng.choice(np.array([limits.min, limits.max, 0, 1], dtype=out.dtype), many)
    elif out.dtype.kind == "b":
        out.flat[at] = ~out.flat[at]
    return out
