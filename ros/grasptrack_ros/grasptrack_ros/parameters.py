# SPDX-License-Identifier: Apache-2.0
"""Parameters of a node from a data class: declared by its fields, read into it."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from rcl_interfaces.msg import ParameterDescriptor

from grasptrack.errors import InputError

Parameters = TypeVar("Parameters")


def declare_parameters(node: Any, kind: type) -> None:
    """Every field of the data class as a parameter with its default.

    ROS lets each have any type: a node whose file says `linear: 1` would otherwise not even start. `read_parameters` looks.
    """
    for field in dataclasses.fields(kind):
        if not node.has_parameter(field.name):
            default = None if field.default == () else field.default  # an empty list has no type of its own
            node.declare_parameter(field.name, default, ParameterDescriptor(dynamic_typing=True))


def read_parameters(node: Any, kind: type[Parameters]) -> Parameters:
    """The data class as the node's parameters say; whole numbers serve as numbers.

    Raises:
        InputError: a parameter of another type.
    """
    told = {f.name: _read(f.name, f.default, node.get_parameter(f.name).value) for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    return kind(**told)


def _read(name: str, default: Any, value: Any) -> Any:
    """A value of the default's type; a tuple stands for a list of numbers."""
    if isinstance(default, tuple):
        values = () if value is None else value
        if hasattr(values, "__len__") and all(map(_is_number, values)):
            return tuple(map(float, values))
        wanted = "a list of numbers"
    elif isinstance(default, float):
        if _is_number(value):
            return float(value)
        wanted = "a number"
    elif type(value) is type(default):
        return value
    else:
        wanted = {bool: "true or false", int: "a whole number", str: "a text"}[type(default)]
    raise InputError(f"the parameter {name} is {wanted}, not {value!r}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
