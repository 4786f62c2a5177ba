# SPDX-License-Identifier: Apache-2.0
"""`grasptrack live`: a page in the browser that shows a tracker at work and takes what people tell it."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING, Annotated

import typer

from grasptrack.cli import first_image, help_groups, options
from grasptrack.cli.help_groups import PAGE, as_asked, option_or
from grasptrack.cli.terminal import Interruption, show_run, tell_line
from grasptrack.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from grasptrack.io.publishing import ResultPublisher
    from grasptrack.live.loop import SessionLoop
    from grasptrack.live.state import Shown
    from grasptrack.tracking.result import TrackResult

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
    grasp: options.FollowedGrasp,
    first: first_image.FirstImageOptions,
    hand: options.HandSize,
    known: options.KnownGeometry,
    images: options.SourceOptions,
    scene: options.PartsOptions,
    start: bool = option_or(
        False, PAGE, None, "Follow the likeliest object of the first image without asking.", "--start"
    ),
    until_end: bool = option_or(
        False, PAGE, None, "End where a file ends, instead of waiting for Restart.", "--until-end"
    ),
    servo: str | None = option_or(
        None,
        help_groups.ROBOT,
        "FILE",
        "Move an arm while the page's button is held; FILE (TOML) names the arm, the goal and limits.",
    ),
    host: str = option_or("127.0.0.1", PAGE, "ADDRESS", "Address to serve at; 0.0.0.0 takes all of this machine's."),
    name: str | None = option_or(
        None, PAGE, "HOST", "Name of this machine in the address that is printed, as robot.local."
    ),
    port: int = option_or(8321, PAGE, "N", "Number of the port; 0 takes a free one.", min=0, max=65535),
    output: options.Output = options.OUTPUT_FOLDER / "live",
    publish: options.Publish = None,
    record_as: str = option_or("mp4", help_groups.OUTPUT, "NAME", "Kind of recordings: mp4, mcap or rrd."),
    quiet: options.Quiet = False,
    max_megapixels: options.MaxMegapixels = None,
) -> None:
    """Show a tracker at work on a page in the browser, and take what you tell it there.

    The page shows the first image, the object that may be meant and how well it can be tracked; a click takes another one,
    two or three clicks give contacts, and Start follows them. Files are played at their own rate; of a camera the newest image
    counts.

    With --part FILE --all every instance of parts on file is followed; one of them, which a click or its number chooses, has
    the figures.

    Serves this machine alone; with --host others too. Who has the address that is printed, with its token, may look on and
    steer.

    Writes grasps.csv (one row for every frame followed), run.json and summary.png, and what you record. Ctrl-C ends it.

    \b
    Examples:
      grasptrack live camera:0
      grasptrack live video.mp4 --start
      grasptrack live photos --fps 10 --port 0
      grasptrack live camera:0 --host 0.0.0.0 --output run
      grasptrack live sim:spanner --servo servo.toml
      grasptrack live camera:0 --part flange.part --all
    """
    if name is not None and not re.fullmatch(r"[\w.-]{1,253}|[\da-f.]*(:[\da-f.]*){2,7}", name, re.A | re.I):
        raise InputError("--name is the name or address of a machine, such as robot.local, without http:// or a port")
    options.one_of("--record-as", record_as, RECORDED_AS)
    asked = {**as_asked(grasp, hand, images, known), **first.as_written(), "start": start, "record_as": record_as}
    asked |= {"publish": publish, "servo": servo}
    grasp.finger_count(at_most_three=True)
    if scene.has_parts():
        scene.refuse_unsuited(grasp, first, hand, known)
        given = {"--servo": servo, "--publish": publish, "--record-as": None if record_as == "mp4" else record_as}
        unsuited = next((name for name, value in given.items() if value is not None), None)
        if unsuited:
            raise InputError(f"{unsuited} is for following one object: leave it out, or --all")
        asked |= {"parts": scene.part, "look_every": scene.look_every, "same_tilt": scene.same_tilt}
    said = first.first_image(grasp.given_contacts())
    settings = first_image.tracker_settings(grasp, first, hand, known)
    from grasptrack.plugins import import_extra

    for module in ("starlette", "uvicorn", "websockets"):
        import_extra(module, "live", "the live page")
    from grasptrack.files import hold_folder, keep_inputs
    from grasptrack.io.arms import open_arm
    from grasptrack.io.parts import load_parts, part_files
    from grasptrack.io.recording import try_recorder
    from grasptrack.io.run import FILES
    from grasptrack.io.sources import open_source
    from grasptrack.live.scene_session import SceneSession
    from grasptrack.live.server import PageServer, bind_socket
    from grasptrack.live.servo_desk import ServoDesk
    from grasptrack.live.session import LiveSession
    from grasptrack.live.settings import SceneSettings
    from grasptrack.servo.setup import ServoSetup

    if record_as != "mp4":
        try_recorder(f".{record_as}")
    setup = None if servo is None else ServoSetup.load(servo)
    frames = open_source(source, images.fps, settings=images.camera_settings())
    files = part_files(scene.part or [])
    keep_inputs((output / name for name in FILES), [*frames.files, *first.files(), *files])
    said = first.with_images(said)
    settings.make_tracker(said)  # what does not go together is told before anything is served
    parts, belt = load_parts(files, same_tilt=scene.same_tilt), first_image.parse_belt(known.belt)
    many = SceneSettings(parts, grasp.risk, said.ignore, belt, scene.look_every) if parts else None
    if many is not None:
        many.make_tracker()
    desk = None if setup is None else ServoDesk(setup, open_arm(setup.arm, frames))
    publisher = options.open_publisher(publish, quiet)
    listener = bind_socket(host, port)  # before anything in the folder is replaced
    with hold_folder(output), Interruption() as interruption:
        session: SessionLoop
        if many is not None:
            session = SceneSession(frames, many, output, options=asked)
        else:
            session = LiveSession(
                frames,
                settings,
                output,
                meant=said,
                at_once=start,
                options=asked,
                record_as=f".{record_as}",
                servo=desk,
            )
        if publisher is not None:
            session.add_listener(publish_moments(publisher))
        server = PageServer(session, host, name=name, listener=listener)
        session.start()
        server.start()
        for url in server.urls:
            tell_line(f"{url}  (Ctrl-C ends)")
        begun = False
        try:
            while session.is_running and not (until_end and session.shown.phase in ("ended", "failed")):
                interruption.raise_if_pressed()
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
    if session.shown.phase == "failed":  # bad input, as of every verb; what was computed is there
        raise InputError(session.shown.notice[1])
    if summary is not None and not quiet:
        show_run(summary, output)


def publish_moments(publisher: ResultPublisher) -> Callable[[Shown], None]:
    """A listener of a session that has every result published once, as soon as its object is followed."""
    last: TrackResult | None = None

    def publish_result(shown: Shown) -> None:
        nonlocal last
        followed = shown.phase in ("tracking", "ended") and shown.result is not last
        if followed and shown.result is not None and shown.arrival is not None:
            last = shown.result
            publisher.publish(shown.arrival.frame, last, shown.arrival.at)

    return publish_result
