# SPDX-License-Identifier: Apache-2.0
"""`grasptrack models`: which models segmenters can run, and how to get one."""

from __future__ import annotations

from typing import Annotated

import typer

from grasptrack.errors import InputError

models = typer.Typer(
    help="List models for --segmenter, and download one on request.",
    rich_markup_mode=None,
    invoke_without_command=True,
)


@models.callback()
def _list_models(context: typer.Context) -> None:
    """List models for --segmenter: what each does, its licence, size, hash, and whether it is here.

    \b
    Examples:
      grasptrack models
      grasptrack models get u2netp
    """
    if context.invoked_subcommand is not None:
        return
    from grasptrack.segmentation.models import MODELS, model_path, models_folder

    typer.echo(f"{'name':8} {'what':24} {'licence':11} {'MB':>6}  here  hash")
    for model in MODELS:
        here = "yes" if model_path(model).is_file() else "no"
        typer.echo(
            f"{model.name:8} {model.what:24} {model.licence:11} {model.megabytes:6g}  {here:4}  {model.digest[:20]}..."
        )
    typer.echo(f"kept in {models_folder()}")


@models.command(short_help="Download one model.")
def get(name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the model, as u2netp.")]) -> None:
    """Download a model, say where from, and check its hash."""
    from grasptrack.segmentation.models import MODELS, download_model, model_named

    model = model_named(name)
    if model is None:
        raise InputError(f'unknown model "{name}"; choose from {", ".join(m.name for m in MODELS)}', name=name)
    typer.echo(f"{model.name}: {model.megabytes:g} MB, {model.licence}, from {model.url}")
    typer.echo(f"kept as {download_model(model)}, {model.digest.partition(':')[0]} checked")
