# SPDX-License-Identifier: Apache-2.0
"""Equality of values that hold arrays, where NumPy's own answer is an array and no truth value; NaN equals NaN."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

Class = TypeVar("Class", bound=type)


def are_equal(first: object, second: object) -> bool:
    """Whether two values are equal, arrays and what holds arrays included.

    Arrays are equal where shapes and entries are. Records of this package are equal where the fields are that take part in
    a comparison; what measures the clock does not, see `dataclasses.field`.
    """
    if first is second:
        return True
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return _arrays_equal(first, second)
    if isinstance(first, float) and isinstance(second, float):
        return first == second or (first != first and second != second)
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return first.keys() == second.keys() and all(are_equal(first[key], second[key]) for key in first)
    if isinstance(first, (list, tuple)) and isinstance(second, (list, tuple)):
        alike = isinstance(first, list) is isinstance(second, list) and len(first) == len(second)
        if not (alike and all(map(are_equal, first, second))):
            return False
        plain = type(first) in (list, tuple) or type(second) in (list, tuple)  # a list of results equals a list
        return plain or _parts_equal(first, second)
    if is_record(first) and is_record(second):
        return _parts_equal(first, second)
    return bool(first == second)


def compared_by_value(cls: Class) -> Class:
    """A class whose objects are equal where their public parts are; works for data classes, named tuples and plain classes."""

    def equals(self: object, other: object) -> bool:
        return are_equal(self, other) if _of_one_kind(self, other) else NotImplemented

    def differs(self: object, other: object) -> bool:
        return not are_equal(self, other) if _of_one_kind(self, other) else NotImplemented

    _set_method(cls, "__eq__", equals)
    _set_method(cls, "__ne__", differs)  # a tuple has one of its own, which would be found first
    _set_method(cls, "__hash__", lambda self: hash(_hashable_key(self)))
    return cls


def _set_method(cls: type, name: str, function: Callable[..., object]) -> None:
    function.__name__, function.__qualname__ = name, f"{cls.__qualname__}.{name}"
    setattr(cls, name, function)


def _of_one_kind(first: object, second: object) -> bool:
    return isinstance(second, type(first)) or isinstance(first, type(second))


def _arrays_equal(first: object, second: object) -> bool:
    if not isinstance(first, np.ndarray) or not isinstance(second, np.ndarray) or first.shape != second.shape:
        return False
    inexact = first.dtype.kind in "fc" and second.dtype.kind in "fc"
    return bool(np.array_equal(first, second, equal_nan=inexact))


def is_record(value: object) -> bool:
    """Whether it is an object of a class of this package."""
    return type(value).__module__.partition(".")[0] == "grasptrack" and not isinstance(value, type)


def _parts_equal(first: object, second: object) -> bool:
    """Of two that are neither arrays nor numbers: their attributes, besides what they hold as a sequence."""
    if not _of_one_kind(first, second):
        return not (is_record(first) or is_record(second))
    mine, other = public_parts(first), public_parts(second)
    return mine.keys() == other.keys() and all(are_equal(mine[name], other[name]) for name in mine)


def public_parts(value: object, *, whole: bool = False) -> dict[str, Any]:
    """What is public of a record, by name: fields of data classes and named tuples, or else attributes.

    `whole` adds the fields that take no part in a comparison.
    """
    if dataclasses.is_dataclass(value):
        return {f.name: getattr(value, f.name) for f in dataclasses.fields(value) if f.compare or whole}
    if whole and hasattr(value, "_asdict"):
        return dict(value._asdict())
    slots = [n for c in type(value).__mro__ for n in _slots_of(c)] if is_record(value) else []
    names = [n for n in (*slots, *getattr(value, "__dict__", {})) if not n.startswith("_")]
    late = {n for c in type(value).__mro__ for n, part in vars(c).items() if isinstance(part, cached_property)}
    return {name: getattr(value, name, None) for name in sorted(set(names) - late)}


def _slots_of(cls: type) -> tuple[str, ...]:
    slots = cls.__dict__.get("__slots__", ())
    return (slots,) if isinstance(slots, str) else tuple(slots)


def _hashable_key(value: object) -> object:
    """The same for equal values."""
    if isinstance(value, np.ndarray):
        numbers = value.astype(np.float64) if value.dtype.kind in "biuf" else np.zeros(0)
        return value.shape, (np.nan_to_num(numbers) + 0.0).tobytes()  # -0 is 0
    if isinstance(value, float) and value != value:
        return "nan"
    if isinstance(value, Mapping):
        return frozenset((key, _hashable_key(part)) for key, part in value.items())
    if isinstance(value, (list, tuple)):
        return tuple(map(_hashable_key, value))
    if is_record(value):
        return tuple((name, _hashable_key(part)) for name, part in public_parts(value).items())
    return value
