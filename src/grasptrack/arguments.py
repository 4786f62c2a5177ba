# SPDX-License-Identifier: Apache-2.0
"""What the public functions ask of their arguments' types, said once beside each of them: another type is an InputError.

Ranges are checked where the value is used. These checks come first, so that a comparison or a conversion further in
never meets what it cannot compare or convert.
"""

from __future__ import annotations

import functools
import inspect
import math
import numbers
import operator
from collections.abc import Callable, Iterable
from types import EllipsisType
from typing import Any, NoReturn, TypeVar

from grasptrack.errors import InputError

Check = Callable[[Any], str]
"""Says what a value should have been; empty where it is that."""
Target = TypeVar("Target", bound=Callable[..., Any])
LARGEST = 2**31
"""Whole numbers of anything are below it."""
FEW = 16
"""Numbers of an array that are looked at one by one: NumPy's calls would cost more."""


def checked(other: Check | None = None, /, **checks: Check) -> Callable[[Target], Target]:
    """A function, or a class for the arguments that make it, whose arguments by these names are checked first.

    Args:
        other: checks the arguments that are not named.
        **checks: by the arguments' names.

    Raises, when called:
        InputError: an argument of another type; the message names it.
    """

    def decorate(target: Target) -> Target:
        if isinstance(target, type):
            setattr(target, "__init__", _with_checks(target.__init__, other, checks))  # type: ignore[misc]  # noqa: B010
            return target
        return _with_checks(target, other, checks)  # type: ignore[return-value]

    return decorate


def _with_checks(function: Callable[..., Any], other: Check | None, checks: dict[str, Check]) -> Callable[..., Any]:
    names = list(inspect.signature(function).parameters)
    unknown = checks.keys() - set(names)
    if unknown:
        raise TypeError(f"{function.__qualname__} has no parameter {', '.join(sorted(unknown))}")
    by_place = [None if name in ("self", "cls") else checks.get(name, other) for name in names]
    by_name = {name: check for name, check in zip(names, by_place, strict=True) if check is not None}

    @functools.wraps(function)
    def guarded(*args: Any, **kwargs: Any) -> Any:
        for check, value in zip(by_place, args, strict=False):
            if check is not None and check(value):
                refuse(args, kwargs)
        if kwargs:
            for name in by_name.keys() & kwargs.keys():
                if by_name[name](kwargs[name]):
                    refuse(args, kwargs)
        return function(*args, **kwargs)

    def refuse(args: tuple[Any, ...], kwargs: dict[str, Any]) -> NoReturn:
        given = dict(zip(names, args, strict=False)) | kwargs
        name, wanted = next(
            (name, told) for name, check in by_name.items() if name in given and (told := check(given[name]))
        )
        value = given[name]
        raise InputError(f"{name} must be {wanted}, not {_in_words(value)}", name=name, value=value)

    return guarded


def _in_words(value: object) -> str:
    """A value in a few words, whatever it is."""
    import numpy as np

    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype}, shape {value.shape}"
    if isinstance(value, (str, bytes, float, bool, complex)) or value is None:
        text = repr(value)
        return text if len(text) <= 40 else f"{text[:37]}..."
    return f"a value of type {type(value).__name__}"


# --- checks --------------------------------------------------------------------------------------


def optional(check: Check) -> Check:
    """The same, or None."""

    def or_none(value: Any) -> str:
        wanted = "" if value is None else check(value)
        return f"{wanted}, or None" if wanted else ""

    return or_none


def number(value: Any) -> str:
    """A real number, infinite and NaN included: those who ask for a range refuse them."""
    if type(value) is float:
        return ""
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        try:
            float(value)
            return ""
        except OverflowError:
            pass
    return "a number"


def finite(value: Any) -> str:
    """A finite number."""
    return "" if not number(value) and math.isfinite(value) else "a finite number"


def whole(value: Any) -> str:
    """A whole number."""
    try:
        fits = not isinstance(value, bool) and -LARGEST < operator.index(value) < LARGEST
    except TypeError:
        fits = False
    return "" if fits else "a whole number"


def truth(value: Any) -> str:
    """True or False."""
    return "" if isinstance(value, bool) or type(value).__name__ in ("bool", "bool_") else "True or False"  # NumPy's


def text(value: Any) -> str:
    """A string."""
    return "" if isinstance(value, str) else "a string"


def function(value: Any) -> str:
    """What can be called."""
    return "" if callable(value) else "a function"


def several(value: Any) -> str:
    """What can be gone through, and is no text."""
    return "" if isinstance(value, Iterable) and not isinstance(value, (str, bytes)) else "a sequence"


def each(check: Check) -> Check:
    """A list or tuple of such."""

    def all_of_them(value: Any) -> str:
        if not isinstance(value, (list, tuple)):
            return "a list"
        wanted = next(filter(None, map(check, value)), "")
        return wanted and f"a list, each {wanted}"

    return all_of_them


def instance(*types: type) -> Check:
    """An object of one of these types."""
    names = " or ".join(f"a {t.__name__}" for t in types)

    def of_these(value: Any) -> str:
        return "" if isinstance(value, types) else names

    return of_these


def array(*shape: int | EllipsisType | None, unbounded: bool = False) -> Check:
    """An array of numbers, or what NumPy makes one of.

    Args:
        *shape: that it has, None being any length, and ... in front any number of axes; without any, every shape will do.
        unbounded: entries may be infinite or NaN.
    """
    marks = ", ".join("n" if n is None else "..." if n is ... else str(n) for n in shape)
    named = f" of shape ({marks})" if shape else ""
    open_ended = bool(shape) and shape[0] is ...
    last = shape[1:] if open_ended else shape
    wanted = f"an array of {'' if unbounded else 'finite '}numbers{named}"

    def of_numbers(value: Any) -> str:
        import numpy as np  # late: what is checked loads quickly

        try:
            made = value if isinstance(value, np.ndarray) else np.asarray(value)
        except (ValueError, TypeError, OverflowError):
            return wanted
        if made.dtype.kind not in "buif":
            return wanted
        sides = made.shape[made.ndim - len(last) :] if open_ended else made.shape
        if (
            shape
            and sides != last
            and (len(sides) != len(last) or any(n not in (None, m) for n, m in zip(last, sides, strict=True)))
        ):
            return wanted
        if unbounded or made.dtype.kind != "f":
            return ""
        if made.size <= FEW:
            return "" if all(map(math.isfinite, made.ravel().tolist())) else wanted
        return "" if bool(np.isfinite(made).all()) else wanted

    return of_numbers
