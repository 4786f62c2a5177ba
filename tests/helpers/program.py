# SPDX-License-Identifier: Apache-2.0
"""The command line with the verbs of grasptrack-bench loaded, for tests that look into it."""

from typing import Any

import typer

from grasptrack.cli import bench_verbs
from grasptrack.cli.main import app


def whole_program() -> Any:
    """The program as a command of the parser."""
    program: Any = typer.main.get_command(app)
    for name in bench_verbs.SHORT_HELP:
        program.add_command(bench_verbs.load_verb(name), name)
    return program
