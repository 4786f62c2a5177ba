# SPDX-License-Identifier: Apache-2.0
"""`grasptrack`: the verbs, and the one place where errors become a line and an exit status.

Status 0: done. 2: bad input or usage. 3: every strategy of `transfer` refuses, or `find` finds nothing. 130: Ctrl-C. 1: else.
GRASPTRACK_DEBUG=1 shows tracebacks.
"""

import os
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated

import typer

from grasptrack.cli import bench_verbs, help_groups
from grasptrack.cli.demo import demo
from grasptrack.cli.help_groups import with_options
from grasptrack.cli.inspect import inspect
from grasptrack.cli.live import live
from grasptrack.cli.parts import find, parts, teach
from grasptrack.cli.support import cameras, doctor, models, tell_first_steps
from grasptrack.cli.synthesize import synthesize
from grasptrack.cli.terminal import (
    INTERRUPTED,
    RunInterruptedError,
    end_process,
    only_our_errors,
    signals_as_interrupts,
    tell_error,
)
from grasptrack.cli.track import track
from grasptrack.cli.transfer import transfer
from grasptrack.errors import GraspTrackError, InputError, ObservationError

DONE, OTHER, BAD_INPUT = 0, 1, 2

# Paragraphs after \b keep their lines.
_HELP = """Choose a grasp on a flat object once, then find the same physical contacts in every image that follows.

\b
Examples:
  grasptrack demo                   a rendered scene, with errors against ground truth
  grasptrack track video.mp4        also a folder, "images/*.png", camera:0, rtsp://..., an image
  grasptrack track photos --fps 30 --output run --strategy homography
  grasptrack track video.mp4 --grasp "193,308 157,99"
  grasptrack live camera:0          a page in the browser: look on, click the object, record
  grasptrack synthesize photo.jpg   the best grasps on the object in one image
  grasptrack inspect photo.jpg      how well that object can be tracked, before the run
  grasptrack transfer a.png b.png   the same grasp in two views
  grasptrack teach photo.jpg --name flange --output flange.part
  grasptrack find tray.jpg --part flange.part
  grasptrack servo                  look, choose, approach, close and lift, in a physics simulation
  grasptrack evaluate scenes        every method on scenes with exact truth, and a report

Each verb has its own --help. Exit status: 0 done, 2 bad input, 3 from transfer when every strategy
refuses and from find when nothing is found, 130 after Ctrl-C, 1 anything else.
"""

app = typer.Typer(
    name="grasptrack",
    cls=bench_verbs.Verbs,
    help=_HELP,
    add_completion=False,
    rich_markup_mode=None,  # rich alone would cost more than all else in --help
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from grasptrack import kernels
        from grasptrack.io.results import software_versions

        versions = software_versions()
        backend = f"backend {kernels.BACKEND}, {kernels.BUILD}"
        under = f"Python {versions['python']}, NumPy {versions['numpy']}, OpenCV {versions['opencv']}"
        typer.echo(f"grasptrack {versions['grasptrack']} ({backend}; {under})")
        raise typer.Exit


@app.callback()
def _global_options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show version, backend and build, and exit."
        ),
    ] = False,
) -> None:
    pass


def _add_verb(function: Callable[..., None], group: str, short_help: str) -> None:
    app.command(cls=help_groups.GroupedCommand, rich_help_panel=group, short_help=short_help)(with_options(function))


_add_verb(track, help_groups.TRACK, "Track a grasp through a sequence of images.")
_add_verb(live, help_groups.TRACK, "Track on a page in the browser, and take clicks there.")
_add_verb(demo, help_groups.TRACK, "Track a rendered scene and compare with ground truth.")
_add_verb(synthesize, help_groups.CHOOSE, "Choose grasps on an object in one image.")
_add_verb(inspect, help_groups.CHOOSE, "Predict how well the object in an image can be tracked.")
_add_verb(transfer, help_groups.CHOOSE, "Transfer a grasp from one image to another, by every strategy.")
_add_verb(teach, help_groups.CHOOSE, "Teach a part from one image, and keep it on file.")
_add_verb(find, help_groups.CHOOSE, "Find every instance of parts on file in an image.")
_add_verb(parts, help_groups.CHOOSE, "List and draw the parts on file.")
for _name, _short_help in bench_verbs.SHORT_HELP.items():
    app.command(_name, rich_help_panel=help_groups.MEASURE, short_help=_short_help)(lambda: None)
_add_verb(cameras, help_groups.SUPPORT, "List the cameras that are attached.")
app.add_typer(
    models, name="models", rich_help_panel=help_groups.SUPPORT, short_help="Models for --segmenter: list, download."
)
_add_verb(doctor, help_groups.SUPPORT, "Say what is installed, what is missing, and what is wrong.")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the verb of arguments without the program's name, the process's if None; without any it says what to begin with."""
    given = sys.argv[1:] if arguments is None else arguments
    status = run_app(app, given, "grasptrack", tell_first_steps)
    if arguments is None:  # this process has nothing else to do
        end_process(status)
    return status


def run_app(app: typer.Typer, arguments: Sequence[str], program: str, alone: Callable[[], int] | None = None) -> int:
    """Run verbs so that each error becomes a line and an exit status; where there are no arguments, `alone` in their place."""
    with only_our_errors(), signals_as_interrupts() as struck:
        try:
            verbs = partial(app, list(arguments), prog_name=program, standalone_mode=False)
            status = verbs() if arguments or alone is None else alone()
            if status == INTERRUPTED:  # so the parser of the command line tells of Ctrl-C
                raise KeyboardInterrupt
            sys.stdout.flush()
            return status if isinstance(status, int) else DONE
        except (InputError, ObservationError) as error:
            return _report_failure(error, BAD_INPUT, struck.is_set())
        except (KeyboardInterrupt, typer.Abort, RunInterruptedError) as error:
            tell_error(str(error) or "interrupted")
            return INTERRUPTED
        except BrokenPipeError:
            # Whoever read our output has gone; nor can Python's own flush at the end reach it.
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            return OTHER
        except OSError as error:
            from grasptrack.files import is_full_disk

            if not is_full_disk(error):
                return _report_failure(error, OTHER, struck.is_set())
            full = InputError(f'"{error.filename or "a file"}" cannot be written: {error.strerror or error}')
            return _report_failure(full, BAD_INPUT, struck.is_set())
        except Exception as error:
            return _report_failure(error, int(getattr(error, "exit_code", OTHER)), struck.is_set())


def _report_failure(error: Exception, status: int, struck: bool) -> int:
    if struck:  # other code made an error of its own of the signal
        tell_error("interrupted")
        return INTERRUPTED
    if os.environ.get("GRASPTRACK_DEBUG") not in (None, "", "0"):
        raise error
    if hasattr(error, "format_message"):  # usage, as the parser of the command line saw it
        verb = getattr(getattr(error, "ctx", None), "command_path", "grasptrack")
        tell_error(f"{error.format_message().rstrip('.')} (see {verb} --help)")
    elif isinstance(error, (GraspTrackError, OSError)):
        tell_error(str(error))
    else:
        tell_error(f"internal error, {type(error).__name__}: {error} (GRASPTRACK_DEBUG=1 shows where)")
    return status


if __name__ == "__main__":
    sys.exit(main())
