# SPDX-License-Identifier: Apache-2.0
"""Dataclasses as groups of options: a verb takes a few of them, and the command line sees the options that are their fields."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer


def option(panel: str, metavar: str | None, text: str, *names: str, **more: Any) -> Any:
    """An option as `Annotated` takes it.

    Args:
        panel: heading under which the help shows it, of `help_groups`.
        metavar: stands for its value in the help; None for a flag.
        text: what the help says of it.
        *names: on the command line; without, the field's.
        **more: as of `typer.Option`.
    """
    return typer.Option(..., *names, metavar=metavar, rich_help_panel=panel, help=text, **more)


def with_options(verb: Callable[..., None]) -> Callable[..., None]:
    """A verb, each parameter that is a dataclass replaced by those of its fields that are options.

    A field without `Annotated` is no option of this verb, and keeps its default.
    """
    parameters: list[inspect.Parameter] = []
    groups: dict[str, tuple[Any, list[str]]] = {}
    types = get_type_hints(verb, include_extras=True)
    for name, parameter in inspect.signature(verb).parameters.items():
        if dataclasses.is_dataclass(types[name]):
            members = _options_of(types[name])
            groups[name] = types[name], [member.name for member in members]
            parameters += members
        else:
            parameters.append(parameter.replace(annotation=types[name], kind=inspect.Parameter.KEYWORD_ONLY))

    def run(**values: Any) -> None:
        for name, (group, members) in groups.items():
            values[name] = group(**{member: values.pop(member) for member in members})
        verb(**values)

    run.__name__, run.__doc__, run.__module__ = verb.__name__, verb.__doc__, verb.__module__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    setattr(run, "__signature__", inspect.Signature(parameters))  # noqa: B010
    return run


def _options_of(group: Any) -> list[inspect.Parameter]:
    types = get_type_hints(group, include_extras=True)
    return [
        inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=types[field.name]
        )
        for field in dataclasses.fields(group)
        if get_origin(types[field.name]) is Annotated
    ]


def as_asked(*groups: Any) -> dict[str, Any]:
    """The options of some groups as they were written, by name, for the record of a run; pixels in one text."""
    asked: dict[str, Any] = {}
    for group in groups:
        types = get_type_hints(type(group), include_extras=True)
        for field in dataclasses.fields(group):
            if get_origin(types[field.name]) is not Annotated:
                continue
            names = get_args(types[field.name])[1].param_decls or [field.name]
            value = getattr(group, field.name)
            asked[names[0].lstrip("-").replace("-", "_")] = value
    return asked
