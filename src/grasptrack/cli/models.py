# SPDX-License-Identifier: Apache-2.0
"""`grasptrack models`: which models segmenters can run, and how to get one."""

from __future__ import annotations

from typing import Annotated

import typer

from grasptrack.cli import help_groups
from grasptrack.errors import InputError

models = typer.Typer(
    help="List models for --segmenter, and download one on request.",
    cls=help_groups.GroupedVerbs,
    rich_markup_mode=None,
    invoke_without_command=True,
)


@models.callback()
def _list_models(context: typer.Context) -> None:
    """List models for --segmenter: what each does, its licence, size, hash, where it comes from, and whether it is here.

    \b
    Examples:
      grasptrack models
      grasptrack models get u2netp
    """
    if context.invoked_subcommand is not None:
        return
    from grasptrack.nets.models import MODELS, is_installed, models_folder

    typer.echo(f"{'name':10} {'what':22} {'licence':10} {'MB':>6}  here  {'hash':27} from")
    for model in MODELS:
        here = "yes" if is_installed(model) else "no"
        for file in model.files:
            named = f"{model.name:10} {model.what:22} {model.licence:10}" if file is model.files[0] else " " * 44
            typer.echo(f"{named} {file.megabytes:6g}  {here:4}  {file.digest[:24]}... {file.url}")
    typer.echo(f"kept in {models_folder()}")


@models.command(cls=help_groups.GroupedCommand, short_help="Download one model.")
def get(name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the model, as u2netp.")]) -> None:
    """Download a model, say where from, and check its hash."""
    from grasptrack.nets.models import MODELS, download_model, model_named

    model = model_named(name)
    if model is None:
        raise InputError(f'unknown model "{name}"; choose from {", ".join(m.name for m in MODELS)}', name=name)
    for file in model.files:
        typer.echo(f"{model.name}: {file.megabytes:g} MB, {model.licence}, from {file.url}")
    for file, path in zip(model.files, download_model(model), strict=True):
        typer.echo(f"kept as {path}, {file.digest.partition(':')[0]} checked")
