# SPDX-License-Identifier: Apache-2.0
"""Calls of kernels with odd arguments: drawn by a number, made, and judged."""

import warnings
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from grasptrack.errors import InputError
from scene import CLASS, Scene, callable_names, parameters_of
from spoiling import spoiled

REFUSALS = (ValueError, TypeError, InputError)
NAMES = callable_names()


class Call(NamedTuple):
    """A kernel or a method, its arguments, and of a method those of its class, and centres of its texture or None."""

    kernel: str
    arguments: list[Any]
    made_with: list[Any]
    texture: Any = None


def draw_call(seed: int, index: int, odd: bool = True) -> Call:
    """The call of that number: none, one or some of its arguments are spoiled, if they may be odd."""
    rng = np.random.default_rng([seed, index])
    scene = Scene(rng)
    name = NAMES[index % len(NAMES)]
    count = int(rng.choice([0, 1, 1, 1, 2, 3])) * odd

    def spoil(values: list[Any], many: int) -> list[Any]:
        for at in rng.permutation(len(values))[:many]:
            values[at] = spoiled(values[at], rng)
        return values

    arguments = [scene.argument(name.partition(".")[2] or name, p) for p in parameters_of(name)]
    if "." not in name:
        return Call(name, spoil(arguments, count), [])
    made = [scene.argument(CLASS, p) for p in parameters_of(CLASS)]
    texture = scene.argument(CLASS, "centres") if rng.random() < 0.5 else None
    of_class = int(rng.integers(0, 2)) if count else 0
    return Call(name, spoil(arguments, count - of_class), spoil(made, of_class), texture)


def make_call(call: Call, module: ModuleType) -> Any:
    """What a call returns; raises what it raises."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        head, _, method = call.kernel.partition(".")
        if not method:
            return getattr(module, head)(*call.arguments)
        target = getattr(module, head)(*call.made_with)
        if call.texture is not None:
            levels = [np.arange(40 * 48, dtype=np.uint8).reshape(40, 48)]
            target.add_texture(levels, call.texture, 1.0)
        return getattr(target, method)(*call.arguments)


def types_of(call: Call) -> list[Any]:
    """Of all arrays among its arguments."""

    def within(value: Any) -> list[Any]:
        if isinstance(value, np.ndarray):
            return [value.dtype]
        return [each for part in value for each in within(part)] if isinstance(value, (list, tuple)) else []

    return within([call.arguments, call.made_with])


def judge_call(call: Call, module: ModuleType) -> str:
    """How a call ends: "answered", "refused", or "internal: " and what came out raw."""
    try:
        make_call(call, module)
    except REFUSALS:
        return "refused"
    except BaseException as error:
        return f"internal: {type(error).__name__}: {error}"
    return "answered"
