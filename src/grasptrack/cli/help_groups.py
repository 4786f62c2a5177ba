# SPDX-License-Identifier: Apache-2.0
"""Options in groups: dataclasses whose fields are options, and a help that shows commands and options under headings, in one
order in all verbs, with defaults and ranges in one form.

The heading of an option or a verb is its `rich_help_panel`. Typer itself heeds that only where rich formats the help, and
loading rich would cost more than all else in `--help`.
"""

import dataclasses
import inspect
import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, ExitStack
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

T = TypeVar("T")

GRASP = "Grasp"
OBJECT = "Object"
HAND = "Hand (L: 120px, 30% of the root of the object's area, or 40mm with --scale)"
SOURCE = "Camera and source"
SCENE = "Scene"
ROBOT = "Robot"
METHODS = "Methods"
PAGE = "Page"
OUTPUT = "Output"
LIMITS = "Limits"
PROCESSES = "Processes"
OPTION_GROUPS = (GRASP, OBJECT, HAND, SOURCE, SCENE, ROBOT, METHODS, PAGE, OUTPUT, LIMITS, PROCESSES)
"""In the order in which every verb shows them."""

TRACK = "Track"
CHOOSE = "Choose a grasp"
MEASURE = "Simulate and measure"
SUPPORT = "Support"
VERB_GROUPS = (TRACK, CHOOSE, MEASURE, SUPPORT)

_TERM = 30
"""Characters of the longest name beside which its text stands; that of a longer one begins below."""


class GroupedCommand(TyperCommand):
    """A verb."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Arguments, then the options of each group."""
        _write_options(self, ctx, formatter)


class GroupedVerbs(TyperGroup):
    """Verbs under one name."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Options, then verbs."""
        _write_options(self, ctx, formatter)
        self.format_commands(ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """The verbs of each group, in the order in which they were added."""
        verbs = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        rows = [
            (getattr(verb, "rich_help_panel", None), (name, verb.get_short_help_str(formatter.width)))
            for name, verb in verbs
            if verb is not None and not verb.hidden
        ]
        _write_sections(formatter, rows, VERB_GROUPS, "Commands")


def _write_options(command: Any, ctx: Any, formatter: Any) -> None:
    arguments, rows = [], []
    for param in command.get_params(ctx):
        record = param.get_help_record(ctx)
        if record is None:
            continue
        if param.param_type_name == "argument":
            arguments.append((None, (record[0], _in_one_form(param, record[1]))))
        else:
            rows.append((getattr(param, "rich_help_panel", None), (record[0], _in_one_form(param, record[1]))))
    _write_sections(formatter, arguments, (), "Arguments")
    _write_sections(formatter, rows, OPTION_GROUPS, "Options")


def _in_one_form(param: Any, text: str) -> str:
    """The text of an option: a default in words without the parentheses that Typer adds, a range in words."""
    text = text.replace("\\[", "[")  # older ones escape brackets for rich even where it does not print them
    default = getattr(param, "show_default", None)
    if isinstance(default, str):
        text = text.replace(f"default: ({default})", f"default: {default}")
    text = re.sub(r"\b(\d+)<=x<=(\d+)(?=[];])", r"\1 to \2", text)
    return re.sub(r"\bx>=(\d+)(?=[];])", r"at least \1", text)


def _write_sections(
    formatter: Any, rows: Sequence[tuple[str | None, tuple[str, str]]], groups: Iterable[str], rest: str
) -> None:
    """Each group that has rows, then under the heading `rest` those of none; texts begin in one column."""
    width = max((len(name) for _, (name, _) in rows if len(name) <= _TERM), default=0)
    for group in (*groups, None):
        members = [(name.ljust(width), text) for heading, (name, text) in rows if heading == group]
        if members:
            with formatter.section(group or rest):
                formatter.write_dl(members, col_max=_TERM)


def option(panel: str, metavar: str | None, text: str, *names: str, **more: Any) -> Any:
    """An option as `Annotated` takes it.

    Args:
        panel: heading under which the help shows it, one of `OPTION_GROUPS`.
        metavar: stands for its value in the help; None for a flag.
        text: what the help says of it.
        *names: on the command line; without, the field's.
        **more: as of `typer.Option`.
    """
    return typer.Option(..., *names, metavar=metavar, rich_help_panel=panel, help=text, **more)


def option_or(default: Any, panel: str, metavar: str | None, text: str, *names: str, **more: Any) -> Any:
    """An option as the default of a field or of a verb's parameter: what it is where nothing is asked, then as of `option`."""
    return dataclasses.field(default=default, metadata={"option": option(panel, metavar, text, *names, **more)})


_until_end: ContextVar[ExitStack] = ContextVar("until_end")


def hold_until_end(output: Path) -> None:
    """Make a folder, and keep other runs out of it until the verb that is at work has ended."""
    from grasptrack.files import hold_folder

    _until_end.get().enter_context(hold_folder(output))


def open_until_end(held: AbstractContextManager[T]) -> T:
    """Enter a context, and leave it when the verb that is at work has ended."""
    return _until_end.get().enter_context(held)


def with_options(verb: Callable[..., None]) -> Callable[..., None]:
    """A verb, each parameter that is a dataclass replaced by those of its fields that are options.

    A field that is neither `Annotated` nor made by `option_or` is no option of this verb, and keeps its default.
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
            parameters.append(_parameter_of(name, types[name], parameter.default))

    def run(**values: Any) -> None:
        for name, (group, members) in groups.items():
            values[name] = group(**{member: values.pop(member) for member in members})
        with ExitStack() as until_end:
            before = _until_end.set(until_end)
            try:
                verb(**values)
            finally:
                _until_end.reset(before)

    run.__name__, run.__doc__, run.__module__ = verb.__name__, verb.__doc__, verb.__module__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    setattr(run, "__signature__", inspect.Signature(parameters))  # noqa: B010
    return run


def _options_of(group: Any) -> list[inspect.Parameter]:
    types = get_type_hints(group, include_extras=True)
    made = (_parameter_of(field.name, types[field.name], field) for field in dataclasses.fields(group))
    return [parameter for parameter in made if get_origin(parameter.annotation) is Annotated]


def _parameter_of(name: str, kind: Any, default: Any) -> inspect.Parameter:
    """A parameter as Typer takes it, of a type and a default or a field."""
    if isinstance(default, dataclasses.Field):
        kind = Annotated[kind, default.metadata["option"]] if default.metadata else kind
        default = default.default
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)


def as_asked(*groups: Any) -> dict[str, Any]:
    """The options of some groups as they were written, by name, for the record of a run; pixels in one text."""
    asked: dict[str, Any] = {}
    for group in groups:
        for parameter in _options_of(type(group)):
            names = get_args(parameter.annotation)[1].param_decls or [parameter.name]
            asked[names[0].lstrip("-").replace("-", "_")] = getattr(group, parameter.name)
    return asked
