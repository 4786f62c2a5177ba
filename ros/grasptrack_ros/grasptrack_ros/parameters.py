# SPDX-License-Identifier: Apache-2.0
"""Parameters of a node from a data class: declared by its fields, read into it."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from rcl_interfaces.msg import ParameterDescriptor

Parameters = TypeVar("Parameters")


def declare_parameters(node: Any, kind: type) -> None:
    """Every field of the data class as a parameter with its default; an empty tuple stands for a list of numbers."""
    for field in dataclasses.fields(kind):
        if node.has_parameter(field.name):
            continue
        if field.default == ():  # an empty list has no type of its own
            node.declare_parameter(field.name, None, ParameterDescriptor(dynamic_typing=True))
        else:
            node.declare_parameter(field.name, field.default)


def read_parameters(node: Any, kind: type[Parameters]) -> Parameters:
    """The data class as the node's parameters say."""
    told = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        value = node.get_parameter(field.name).value
        told[field.name] = value if field.default != () else tuple(map(float, () if value is None else value))
    return kind(**told)
