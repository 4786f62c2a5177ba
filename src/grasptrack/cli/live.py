# SPDX-License-Identifier: Apache-2.0
"""`grasptrack live`: a page in the browser that shows a tracker at work and takes what people tell it."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from grasptrack.cli import first_image, help_groups, options, source_options
from grasptrack.cli.terminal import Interruption, show_run
from grasptrack.errors import InputError, install_hint
from grasptrack.grasp.hand import parse_measure

if TYPE_CHECKING:
    from grasptrack.live.session import LiveSession

BEAT = 0.1
"""s between two looks at whether Ctrl-C was pressed."""
RECORDED_AS = ("mp4", "mcap", "rrd")


def live(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE", help='Folder, "glob", video file, camera:0, rtsp://..., bag:FILE#/topic or one image.'
        ),
    ],
    strategy: options.StrategyName = "auto",
    fingers: options.Fingers = None,
    friction: options.Friction = 0.5,
    grasp: options.GraspText = None,
    resynthesize: options.Resynthesize = False,
    object_: first_image.ObjectTexts = None,
    not_: first_image.NotTexts = None,
    box: first_image.BoxText = None,
    outline: first_image.OutlineText = None,
    choose: first_image.ChooseNumber = None,
    sure: first_image.Sure = 0.9,
    segmenter: first_image.SegmenterName = None,
    background: first_image.BackgroundPath = None,
    length: options.ObjectLength = None,
    min_opening: options.MinOpening = None,
    max_opening: options.MaxOpening = None,
    finger_width: options.FingerWidth = None,
    finger_thickness: options.FingerThickness = None,
    clearance: options.Clearance = None,
    scale: options.Scale = None,
    camera: first_image.CameraPath = None,
    ignore: first_image.IgnorePath = None,
    fps: options.FramesPerSecond = None,
    set_: source_options.Settings = None,
    start: Annotated[
        bool,
        typer.Option(
            "--start",
            rich_help_panel=help_groups.PAGE,
            help="Follow the likeliest object of the first image without asking.",
        ),
    ] = False,
    until_end: Annotated[
        bool,
        typer.Option(
            "--until-end",
            rich_help_panel=help_groups.PAGE,
            help="End where a file ends, instead of waiting for Restart.",
        ),
    ] = False,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            rich_help_panel=help_groups.PAGE,
            help="Address to serve at; any but this machine's own asks for a token.",
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=0,
            max=65535,
            rich_help_panel=help_groups.PAGE,
            help="Number of the port; 0 takes a free one.",
        ),
    ] = 8321,
    output: options.Output = options.OUTPUT / "live",
    record_as: Annotated[
        str,
        typer.Option(
            "--record-as",
            metavar="NAME",
            rich_help_panel=help_groups.OUTPUT,
            help="Kind of recordings: mp4, mcap or rrd.",
        ),
    ] = "mp4",
    quiet: options.Quiet = False,
    risk: options.Risk = 1e-3,
    first_look_ms: first_image.FirstLookMs = None,
    max_megapixels: options.MaxMegapixels = None,
) -> None:
    """Show a tracker at work on a page in the browser, and take what you tell it there.

    The page shows the first image, the object that may be meant and how well it can be tracked; a click takes another one,
    two or three clicks give contacts, and Start follows them. Files are played at their own rate; of a camera the newest image
    counts.

    Serves this machine alone. With --host others may look on and steer: the address that is printed then holds a token.

    Writes grasps.csv (one row for every frame followed), run.json and summary.png, and what you record. Ctrl-C ends it.

    \b
    Examples:
      grasptrack live camera:0
      grasptrack live video.mp4 --start
      grasptrack live photos --fps 10 --port 0
      grasptrack live camera:0 --host 0.0.0.0 --output run
    """
    lengths = options.hand_lengths(min_opening, max_opening, finger_width, finger_thickness, clearance)
    asked = {
        "strategy": options.strategy_choice(strategy),
        "fingers": fingers,
        "friction": options.positive_friction(friction),
        "risk": options.risk_rate(risk),
        "start": start,
        "grasp": grasp,
        **first_image.told_words(object_, not_),
        "box": box,
        "outline": outline,
        "choose": choose,
        "sure": sure,
        "first_look_ms": first_look_ms,
        "segmenter": segmenter,
        "background": background,
        "ignore": ignore,
        "camera": camera,
        "length": length,
        "fps": fps,
        "set": set_,
        **lengths,
        "scale": scale,
        "resynthesize": resynthesize,
        "record_as": options.one_of("--record-as", record_as, RECORDED_AS),
    }
    contacts, count = options.contacts_and_fingers(grasp, fingers)
    if contacts is None:
        options.two_or_three(count)
    said = first_image.first_image(
        object_, not_, box, outline, grasp=contacts, number=choose, sure=sure, first_look_ms=first_look_ms
    )
    hand = options.hand_for_first(scale, lengths, grasp, resynthesize)
    calibration = first_image.load_calibration(camera)
    measure = None if length is None else parse_measure(length, "--length")
    try:
        from grasptrack.live.server import PageServer, bind
    except ImportError as error:
        raise InputError(f"the live page needs {error.name}: {install_hint('live')}") from None

    from grasptrack.io.folder import hold_folder
    from grasptrack.io.sources import open_source
    from grasptrack.live.session import LiveSession
    from grasptrack.live.settings import Settings
    from grasptrack.segmentation.segmenters import segmenter_for

    images = open_source(source, fps, settings=source_options.device_settings(set_))
    settings = Settings(
        strategy=strategy,
        fingers=count,
        friction=friction,
        risk=risk,
        hand=hand,
        segmenter=segmenter_for(segmenter),
        camera=calibration,
        length=None if measure is None else measure.value,
        resynthesize=resynthesize,
    )
    empty = first_image.background_image(background, None)
    said = replace(said, background=empty, ignore=first_image.ignore_mask(ignore))
    settings.tracker(said)  # what does not go together is told before anything is served
    listener = bind(host, port)  # before anything in the folder is replaced
    with hold_folder(output), Interruption() as interruption:
        session = LiveSession(
            images, settings, output, meant=said, at_once=start, options=asked, record_as=f".{record_as}"
        )
        server = PageServer(session, host, listener=listener)
        session.start()
        server.start()
        typer.echo(f"{server.url}  (Ctrl-C ends)")
        begun = False
        try:
            while session.is_running and not (until_end and session.shown.phase in ("ended", "failed")):
                interruption.check()
                shown = session.shown
                begun = begun or shown.image > 0
                if shown.phase == "failed" and not begun:  # as of every verb: there is nothing to look at
                    break
                time.sleep(BEAT)
        except KeyboardInterrupt:
            pass
        finally:
            server.stop()
            summary = session.stop()
    _tell_failure(session)
    if summary is not None and not quiet:
        show_run(summary, output)


def _tell_failure(session: LiveSession) -> None:
    """A source that broke off and was not begun again is bad input, as of every verb; what was computed is there."""
    if session.shown.phase == "failed":
        raise InputError(session.shown.notice[1])
