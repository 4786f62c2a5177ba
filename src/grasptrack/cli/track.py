# SPDX-License-Identifier: Apache-2.0
"""`grasptrack track`: carry a grasp through a sequence of images."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from grasptrack.cli import first_image, help_groups, options
from grasptrack.cli.advice import PICTURE, BackgroundVerdict, advice_for, note_candidates, tell_of_picture
from grasptrack.cli.help_groups import as_asked
from grasptrack.cli.terminal import Interruption, ProgressBar, RunInterruptedError, show_rows, show_run
from grasptrack.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grasptrack.io.base import Frame
    from grasptrack.io.results import RunSummary
    from grasptrack.segmentation.candidate import Candidate
    from grasptrack.tracking.result import TrackResult
    from grasptrack.tracking.scene import SceneResult

APART = 4
"""Images between those that a first look asks where it is not sure: a camera moves little from one to the next."""

LOOK_EVERY = 2.0
"""s between looks for parts that come into view, of a source that waits."""
LONGEST = 1000
"""Characters of options that are printed; an outline may have many more."""


def track(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE", help='Folder, "glob", video file, camera:0, rtsp://..., bag:FILE#/topic, - or one image.'
        ),
    ],
    *,
    grasp: options.FollowedGrasp,
    first: first_image.MaskedFrames,
    hand: options.HandSize,
    known: options.KnownGeometry,
    scene: options.PartsOptions,
    images: options.SourceOptions,
    start: int = help_groups.option_or(
        0, help_groups.SOURCE, "FRAME", "Index, from 0, of the image to start with, which is the first one then.", min=0
    ),
    output: options.Output = options.OUTPUT_FOLDER / "track",
    recording: options.RecordingOptions,
    publish: options.Publish = None,
    no_video: options.NoVideo = False,
    quiet: options.Quiet = False,
    max_megapixels: options.MaxMegapixels = None,
) -> None:
    """Track a grasp through a sequence of images, or say for each image why not.

    The grasp is chosen in the first image with an object, for a hand as in `grasptrack synthesize`.

    Contacts are reported where the probability that they are wrong is below --risk. Wrong means that one is off by more than
    3 px and 4 % of the root of the object's area, or than --tolerance, or that it is another object. Other frames are lost,
    with a reason.

    Where SOURCE is a pattern that names videos, as "*.mp4", each has a folder of its own below --output, and one table sums up.

    On a belt, --wait --next follows one object after another, each with its own grasp_id, from where it lies whole in view to
    where it leaves the image. One that comes back is a new one; one hidden, blurred or lost in plain view is not given up.

    With --length, the object's length as a caliper measures it, every frame gives its distance, in that unit.

    With --part FILE --all every instance of parts on file is followed: grasps.csv has a row for each in every frame, with its
    instance_id, and overlay.mp4 shows all of them. Equals that move so far that one may be taken for another are lost.

    Where the choice of the object is not sure, candidates.png shows the likeliest, numbered, and --choose takes one.

    Writes grasps.csv (one row for every frame), run.json, overlay.mp4 and summary.png. Ctrl-C keeps what was computed.
    --record adds a file for Foxglove or rerun, --jsonl a line of JSON for every frame; --publish sends it over TCP or
    WebSocket. Says first how well the object can be tracked, as `grasptrack inspect` does.

    Of a live source the newest image is taken, and what comes in the meantime is dropped. One that goes away is opened again.

    \b
    Examples:
      grasptrack track video.mp4
      grasptrack track photos --fps 30 --output run
      grasptrack track "images/*.png" --object 320,240 --no-video
      grasptrack track video.mp4 --grasp "193,308 157,99" --strategy rrp
      grasptrack track camera:0 --ignore fingers.png
      grasptrack track "camera:0?size=1280x720&fps=30" --set exposure=200 --record run.mcap
      grasptrack track video.mp4 --object 320,240 --not 300,180 --segmenter u2netp
      grasptrack track video.mp4 --outline "120,80 420,90 430,300 110,310"
      grasptrack track video.mp4 --risk 1e-5 --tolerance 2%
      grasptrack track video.mp4 --start 2 --wait --next
      grasptrack track camera:0 --publish tcp://0.0.0.0:5555
      grasptrack track video.mp4 --camera camera.yaml --length 120mm
      grasptrack track video.mp4 --part flange.part --all
      grasptrack track photos --max-opening 85mm --finger-width 12mm --scale 4.2
    """
    if videos := _videos_of(source):
        if recording.files() or recording.jsonl or publish or first.mask is not None:
            raise InputError(
                f'"{source}" names {len(videos)} videos: --record, --jsonl, --publish and --masks are for one at a time'
            )
        given: dict[str, Any] = {"grasp": grasp, "first": first, "hand": hand, "known": known, "images": images}
        given["scene"] = scene
        given |= {"recording": recording, "start": start, "no_video": no_video, "quiet": True}
        _track_each(videos, output, quiet, partial(track, **given))
        return
    if scene.has_parts():
        scene.refuse_unsuited(grasp, first, hand, known, recording)
        if publish is not None:
            raise InputError("--publish is for following one object: leave it out, or --all")
        reading = (source, images, start)
        _track_scene(reading, scene, (grasp.risk, first.ignore, known.belt), (output, recording, no_video, quiet))
        return
    asked = {**as_asked(grasp, hand, images, known), **first.as_written(), **recording.as_written()}
    asked |= {"publish": publish, "start": start, "video": not no_video}
    said = first.first_image(grasp.given_contacts())
    tracking = first_image.tracker_settings(grasp, first, hand, known)

    from grasptrack.files import keep_inputs
    from grasptrack.io.bags.source import METADATA
    from grasptrack.io.live import LiveSource
    from grasptrack.io.masks import open_masks
    from grasptrack.io.recording import tracking_options
    from grasptrack.io.run import FILES, run_track
    from grasptrack.io.sources import open_source

    settings = images.camera_settings()
    frames = open_source(source, images.fps, settings=settings).start_at(start)
    if first.mask is not None and first.segmenter is not None:
        raise InputError("--masks and --segmenter both say where the object is: give one of them")
    segmentation = None if first.mask is None else open_masks(first.mask, frames)
    asks = not (frames.live or frames.kind == "stdin" or grasp.wait)  # who waits for a sure choice asks no other image
    more = _later_images(source, settings, start) if asks else ()
    tracker = tracking.make_tracker(replace(first.with_images(said), more=more))
    beside = [output / name for name in (*FILES, PICTURE)]
    keep_inputs([*beside, *recording.files()], [*frames.files, *first.files(), *(segmentation or ())])
    quiet = quiet or recording.jsonl == "-"  # the standard output is for the lines
    publisher = options.open_publisher(publish, quiet)
    recordings = recording.open_recordings(asked)
    done, chosen, notes = 0, False, list[str]()
    looked_at: NDArray[Any] | None = None
    seen: list[Candidate] = []
    foretells = not quiet and frames.kind != "image"  # of one image there is no run to foretell
    with Interruption() as interruption, BackgroundVerdict() as verdict:
        if isinstance(frames, LiveSource):
            frames.on_wait = interruption.raise_if_pressed
            frames.catches_up = True
        try:
            with ProgressBar(quiet) as progress:

                def report_frame(frame: Frame, result: TrackResult) -> None:
                    nonlocal done, chosen, looked_at, seen
                    if not done:
                        notes.extend(first_image.scaling_notes(tracking.camera, frame.image.shape))
                    if tracker.candidates and not chosen:
                        chosen, looked_at, seen = result.reason_code != "waiting", frame.image, tracker.candidates
                        if result.view is not None and result.view.is_clipped:
                            notes.append(
                                "the object is cut by the border of its first image: the part in view is followed"
                            )
                    done += 1
                    if foretells and result.located and not verdict.is_begun and tracker.first_scene is not None:
                        verdict.begin(tracker.first_scene)
                    progress.print(verdict.take_lines())
                    progress.show_progress("tracking", done, frames.count and frames.count - start)
                    interruption.raise_if_pressed()

                summary = run_track(
                    frames,
                    tracker,
                    output,
                    video=not no_video,
                    options=asked,
                    masks=segmentation,
                    recordings=recordings,
                    publish=None if publisher is None else publisher.publish,
                    on_frame=report_frame,
                )
                progress.print(verdict.wait_for_lines(interruption.raise_if_pressed))
        except KeyboardInterrupt:
            raise RunInterruptedError(f'interrupted after {done} frames; what was computed is in "{output}"') from None
    if not summary.grasps:
        raise InputError(_nothing_to_track(summary))
    if frames.shortfall:
        notes.append(f'"{source}": {frames.shortfall}')
    notes += [f"recorded: {each.path}" for each in recordings if str(each.path) != "-"]
    if frames.recorded_with not in ("", tracking_options(asked)):
        again = frames.recorded_with if len(frames.recorded_with) <= LONGEST else f'in its metadata, "{METADATA}"'
        notes.append(f"recorded with other options; those that give the same digits: {again}")
    notes += note_candidates(seen, looked_at, output, first.sure, meant=said.is_settled, segmenter=first.segmenter)
    tell_of_picture(output)
    notes += advice_for(summary.codes, summary.frames)
    if not quiet:
        show_run(summary, output, notes)


def _track_scene(
    reading: tuple[str, options.SourceOptions, int],
    scene: options.PartsOptions,
    said: tuple[float, str | None, str | None],
    writing: tuple[Path, options.RecordingOptions, bool, bool],
) -> None:
    """Follow every instance of parts on file: what is read, the parts, risk, what is ignored and the belt; what is written."""
    from grasptrack.files import keep_inputs
    from grasptrack.io.parts import load_parts, part_files
    from grasptrack.io.run import FILES, run_track
    from grasptrack.io.sources import open_source
    from grasptrack.tracking.scene import SceneTracker

    (source, images, start), (risk, ignore, belt), (output, recording, no_video, quiet) = reading, said, writing
    files = part_files(scene.part or [])
    frames = open_source(source, images.fps, settings=images.camera_settings()).start_at(start)
    every = scene.look_every or (None if frames.live else LOOK_EVERY)
    parts, ignored = load_parts(files, same_tilt=scene.same_tilt), first_image.read_ignored(ignore)
    tracker = SceneTracker(parts, risk=risk, ignore=ignored, belt=first_image.parse_belt(belt), look_every=every)
    read = [*frames.files, *files, *([] if ignore is None else [Path(ignore)])]
    keep_inputs([*(output / name for name in FILES), *recording.files()], read)
    asked = {"parts": list(map(str, files)), "risk": risk, "ignore": ignore, "belt": belt}
    asked |= {"look_every": every, "start": start, "same_tilt": scene.same_tilt}
    recordings = recording.open_recordings(asked)
    quiet, done = quiet or recording.jsonl == "-", 0
    known: dict[int, list[int]] = {}
    names: dict[int, str] = {}
    with Interruption() as interruption, ProgressBar(quiet) as progress:

        def report_frame(frame: Frame, told: SceneResult) -> None:
            nonlocal done
            done += 1
            for number, result in told.results.items():
                first, _, located = known.get(number, [frame.index, 0, 0])
                known[number], names[number] = [first, frame.index, located + result.located], result.part_id
            progress.show_progress("tracking", done, frames.count and frames.count - start)
            interruption.raise_if_pressed()

        try:
            run_track(
                frames, tracker, output, video=not no_video, options=asked, recordings=recordings, on_frame=report_frame
            )
        except KeyboardInterrupt:
            raise RunInterruptedError(f'interrupted after {done} frames; what was computed is in "{output}"') from None
    if not known:
        raise InputError(f'"{source}": no instance of {", ".join(map(str, files))} was found')
    if not quiet:
        rows = [[str(number), names[number], *map(str, each)] for number, each in known.items()]
        heads = ("instance", "<part", "from frame", "to frame", "located")
        show_rows(f"Instances in {done} frames", heads, rows, [f"{output}: {', '.join(FILES[: 3 - no_video])}"])


def _videos_of(source: str) -> dict[str, Path]:
    """The videos that a pattern names where it names no image, each by the name of its folder; else none."""
    from grasptrack.io.images import files_matching, is_image_file

    if not any(c in source for c in "*?[") or Path(source).exists():
        return {}
    files = files_matching(source)
    if any(is_image_file(path) for path in files):
        return {}
    for name_of in (lambda p: p.stem, lambda p: p.name, lambda p: "-".join(p.parts).strip("/-")):
        named = {name_of(path): path for path in files}
        if len(named) == len(files):
            break
    return named


def _track_each(videos: Mapping[str, Path], output: Path, quiet: bool, track_one: Callable[..., None]) -> None:
    """Track videos one after another; one that cannot be tracked keeps none of the others from it."""
    import json

    rows, failed = [], dict[str, str]()
    for number, (name, path) in enumerate(videos.items(), 1):
        if not quiet:
            typer.echo(f"{number} of {len(videos)}: {path}")
        figures: dict[str, Any] = {}
        try:
            track_one(str(path), output=output / name)
            figures = json.loads((output / name / "run.json").read_bytes())
        except InputError as error:
            failed[name] = str(error)
        counts = figures.get("counts", {})
        cells = [figures.get("frames", ""), *(counts.get(s, "") for s in ("tracked", "unstable", "lost", "searching"))]
        rows.append([name, *map(str, cells)])
    if not quiet:
        heads = ("<video", "frames", "tracked", "unstable", "lost", "searching")
        show_rows("Videos, each in a folder of its own", heads, rows, [*failed.values(), f"folders: {output}"])
    if failed:
        first = next(iter(failed.values()))
        raise InputError(f"{len(failed)} of {len(videos)} videos could not be tracked to their end, the first: {first}")


def _later_images(source: str, settings: Mapping[str, str], start: int) -> Iterator[NDArray[Any]]:
    """Every so many images of a source after the one to start with; it is opened when they are asked for."""
    from grasptrack.io.sources import open_source

    with open_source(source, settings=settings).start_at(start) as again:
        for k, frame in enumerate(again):
            if k and k % APART == 0:
                yield frame.image


def _nothing_to_track(summary: RunSummary) -> str:
    reasons = summary.reasons.get("searching", {})
    why = next(iter(reasons), "")
    if summary.object_seen or "waiting" in summary.codes:
        return f"no frame has a grasp to track: {why}"
    frames = "the only frame" if summary.frames == 1 else f"any of the {summary.frames} frames"
    return f"no object in {frames}" + (f": {why}" if why else "")
