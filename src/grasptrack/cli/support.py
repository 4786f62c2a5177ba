# SPDX-License-Identifier: Apache-2.0
"""`grasptrack doctor`, `cameras` and `models`: what is installed and what is wrong with it, what is attached, what segments."""

import importlib.metadata as metadata
import platform
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from grasptrack.cli import help_groups
from grasptrack.cli.terminal import tell_line
from grasptrack.errors import InputError, install_hint, own_pip
from grasptrack.plugins import version_of

EXTRAS = {
    "live": "grasptrack live: the page in the browser",
    "heif": "photos in HEIC, as phones take them",
    "bags": "bags of ROS and MCAP files as sources",
    "foxglove": "--record run.mcap",
    "rerun": "--record run.rrd",
    "zenoh": "ros2:/topic as a source",
    "pylon": "pylon: cameras by Basler",
    "genicam": "genicam: cameras with a GenTL producer",
    "realsense": "realsense: cameras by Intel",
    "ur": "ur: arms by Universal Robots",
    "segment": "nets that OpenCV cannot run, by ONNX Runtime",
    "sim": "grasptrack servo and evaluate: physics",
    "cluster": "evaluations on more than one machine",
}
"""What each extra is for, in the order in which they are told."""
OPENCV = ("opencv-python-headless", "opencv-python", "opencv-contrib-python-headless", "opencv-contrib-python")


FIRST_STEPS = """Choose a grasp on a flat object once, then find the same physical contacts in every image that follows.

Three steps to begin with:
  grasptrack demo              a rendered scene with known truth, tracked
  grasptrack track video.mp4   your own images; also a folder, a photo, camera:0, rtsp://...
  grasptrack live camera:0     a page in the browser: click the object, look on, record"""


class Remark(NamedTuple):
    """One line; its mark is "ok", "--" for what is not installed, or "!!" for what is wrong."""

    mark: str
    name: str
    text: str


def tell_first_steps() -> int:
    """Tell what the program does, three steps to begin with, what they lack, and where all else is said."""
    lacks = any(name == "live" and mark != "ok" for mark, name, _ in examine_extras())
    typer.echo(FIRST_STEPS + (f"\n  (which needs: {install_hint('live')})\n" if lacks else "\n"))
    typer.echo("All verbs: grasptrack --help. What is installed, and what is wrong: grasptrack doctor.")
    return 0


def doctor() -> None:
    """Say what is installed, what each extra would add, and what is wrong: for you, and for whoever is asked for help.

    Looks at versions and permissions only: opens no camera, sends nothing anywhere. Ends with status 1 where
    something is wrong.

    \b
    Examples:
      grasptrack doctor
    """
    wrong = 0
    for title, findings in (
        ("here", examine_program()),
        ("extras", examine_extras()),
        ("nets", examine_nets()),
        ("cameras", examine_cameras()),
    ):
        tell_line(title)
        for mark, name, text in findings:
            wrong += mark == "!!"
            tell_line(f"  {mark}  {name:12} {text}")
    if wrong:
        raise typer.Exit(1)


def examine_program() -> Iterator[Remark]:
    """The program, Python, and the libraries that it always needs."""
    version = metadata.version("grasptrack")
    try:
        from grasptrack import kernels

        yield Remark("ok", "grasptrack", f"{version}, kernels {kernels.BACKEND}, {kernels.BUILD}")
    except ImportError as error:
        yield Remark("!!", "grasptrack", f"{version}: {error}")
    yield Remark("ok", "Python", f"{platform.python_version()}, {sys.executable}")
    yield Remark("ok", "system", platform.platform())
    yield from _examine_opencv()
    for package in ("numpy", "av", "matplotlib"):
        found = version_of(package)
        yield Remark("ok" if found else "!!", package, found or "not installed")


def _examine_opencv() -> Iterator[Remark]:
    built = [f"{name} {version_of(name)}" for name in OPENCV if version_of(name)]
    try:
        from grasptrack.io.results import software_versions

        loaded = software_versions()["opencv"]
    except ImportError as error:
        yield Remark("!!", "OpenCV", f"cannot be loaded: {error}")
        return
    if len(built) > 1:
        remedy = f"uninstall both, then install one: {own_pip()} uninstall {' '.join(b.split()[0] for b in built)}"
        yield Remark("!!", "OpenCV", f"{' and '.join(built)} overwrite each other; {remedy}")
    else:
        yield Remark("ok", "OpenCV", f"{loaded} ({built[0] if built else 'of the system'})")


def examine_extras() -> Iterator[Remark]:
    """Each extra: what it is for, and what of it is not installed."""
    needed = extra_requirements()
    for extra, purpose in EXTRAS.items():
        missing = [r for r in needed.get(extra, []) if not version_of(re.split(r"[<>=!~ \[;]", r)[0])]
        if missing:
            yield Remark("--", extra, f"{purpose}: {install_hint(extra)} adds {', '.join(missing)}")
        else:
            yield Remark("ok", extra, purpose)


def examine_nets() -> Iterator[Remark]:
    """The small net that finds more objects than the own search."""
    from grasptrack.nets.models import U2NETP, is_installed

    there, how = is_installed(U2NETP), f"finds more objects: grasptrack models get {U2NETP.name} brings it"
    yield Remark("ok" if there else "--", U2NETP.name, "for --segmenter" if there else how)


def examine_cameras() -> Iterator[Remark]:
    """Video devices, and whether this user may read them."""
    import os

    nodes = sorted(Path("/dev").glob("video*"))
    for node in nodes:
        good = os.access(node, os.R_OK | os.W_OK)
        why = "" if good else ": no permission; add the user to the group video, then log in again"
        yield Remark("ok" if good else "!!", str(node), f"may {'' if good else 'not '}be opened{why}")
    if not nodes:
        yield Remark("--", "/dev/video*", "no camera of Video4Linux is attached")
    yield Remark("ok" if shutil.which("v4l2-ctl") else "--", "v4l2-ctl", "sets what --set does not reach (v4l-utils)")


def extra_requirements() -> dict[str, list[str]]:
    """What each extra of this package asks for."""
    found: dict[str, list[str]] = {}
    for line in metadata.requires("grasptrack") or []:
        extra = re.search(r"extra\s*==\s*[\"']([\w-]+)[\"']", line)
        if extra is not None:
            found.setdefault(extra[1], []).append(line.partition(";")[0].strip())
    return found


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
        tell_line(f"{camera.source_name:32}  {camera.model}")
    if not found:
        tell_line("no camera is attached")
    for listing in listings:
        if listing.note:
            tell_line(f"  {listing.kind}: {listing.note}")


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

    tell_line(f"{'name':10} {'what':22} {'licence':10} {'MB':>6}  here  {'hash':27} from")
    for model in MODELS:
        here = "yes" if is_installed(model) else "no"
        for file in model.files:
            named = f"{model.name:10} {model.what:22} {model.licence:10}" if file is model.files[0] else " " * 44
            tell_line(f"{named} {file.megabytes:6g}  {here:4}  {file.digest[:24]}... {file.url}")
    tell_line(f"kept in {models_folder()}")


@models.command(cls=help_groups.GroupedCommand, short_help="Download one model.")
def get(name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the model, as u2netp.")]) -> None:
    """Download a model, say where from, and check its hash."""
    from grasptrack.nets.models import MODELS, download_model, model_named

    model = model_named(name)
    if model is None:
        raise InputError(f'unknown model "{name}"; choose from {", ".join(m.name for m in MODELS)}', name=name)
    for file in model.files:
        tell_line(f"{model.name}: {file.megabytes:g} MB, {model.licence}, from {file.url}")
    for file, path in zip(model.files, download_model(model), strict=True):
        tell_line(f"kept as {path}, {file.digest.partition(':')[0]} checked")
