# SPDX-License-Identifier: Apache-2.0
"""`grasptrack cameras`: what is attached, by the name under which it is a source."""

from __future__ import annotations

import typer


def cameras() -> None:
    """List the cameras that are attached, each by its name as a SOURCE; and what would have to be installed to see more.

    \b
    Examples:
      grasptrack cameras
      grasptrack track pylon:40012345 --set ExposureTime=2000
    """
    from grasptrack.io.cameras.attached import list_cameras

    listings = list_cameras()
    found = [camera for listing in listings for camera in listing.cameras]
    for camera in found:
        typer.echo(f"{camera.source_name:32}  {camera.model}")
    if not found:
        typer.echo("no camera is attached")
    for listing in listings:
        if listing.note:
            typer.echo(f"  {listing.kind}: {listing.note}")
