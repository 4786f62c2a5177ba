# SPDX-License-Identifier: Apache-2.0
"""Verbs that the distribution grasptrack-bench adds: listed always, loaded when one is run, or named as missing."""

from typing import Any

import typer

from grasptrack.cli import help_groups
from grasptrack.cli.help_groups import with_options
from grasptrack.errors import InputError, bench_hint
from grasptrack.plugins import load_plugin

SHORT_HELP = {
    "servo": "Approach a grasp, close and lift, in a physics simulation.",
    "pick": "Empty trays of parts, in a physics simulation.",
    "compare": "Compare two evaluations.",
    "evaluate": "Measure every method, and write a report.",
}
"""By name, in the order of the list."""


class Verbs(help_groups.GroupedVerbs):
    """All verbs. Those of grasptrack-bench are known by name until one of them is asked for."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The verb that the arguments begin with."""
        if args and args[0] in SHORT_HELP:
            self.add_command(load_verb(args[0]), args[0])
        return super().resolve_command(ctx, args)


def load_verb(name: str) -> Any:
    """The command of a verb of grasptrack-bench."""
    verbs = load_plugin("grasptrack.verbs", name)
    if verbs is None:
        raise InputError(f'"{name}" is a verb of grasptrack-bench, {bench_hint()}', name=name)
    if not isinstance(verbs, typer.Typer):
        function, verbs = verbs, typer.Typer(rich_markup_mode=None, add_completion=False)
        verbs.command(name, cls=help_groups.GroupedCommand)(with_options(function))
    command: Any = typer.main.get_command(verbs)
    command.name = name
    command.rich_help_panel, command.short_help = help_groups.MEASURE, SHORT_HELP[name]
    return command
