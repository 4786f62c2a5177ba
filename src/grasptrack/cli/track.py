# SPDX-License-Identifier: Apache-2.0
"""`grasptrack track`: carry a grasp through a sequence of images."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from grasptrack.cli import first_image, help_groups, options, source_options
from grasptrack.cli.advice import advice_for
from grasptrack.cli.candidates import note_candidates
from grasptrack.cli.terminal import Interruption, ProgressBar, RunInterruptedError, show_run
from grasptrack.cli.verdict import Verdict
from grasptrack.errors import InputError
from grasptrack.grasp.hand import parse_measure

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grasptrack.io.base import Frame
    from grasptrack.io.run import RunSummary
    from grasptrack.tracking.result import TrackResult

APART = 4
"""Images between those that a first look asks where it is not sure: a camera moves little from one to the next."""

LONGEST = 1000
"""Characters of options that are printed; an outline may have many more."""


def track(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE", help='Folder, "glob", video file, camera:0, rtsp://..., bag:FILE#/topic, - or one image.'
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
    masks: Annotated[
        str | None,
        typer.Option(
            metavar="DIR",
            rich_help_panel=help_groups.OBJECT,
            help="Your own segmentation, one mask per frame, matched by name or by order.",
        ),
    ] = None,
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
    output: options.Output = options.OUTPUT / "track",
    record: source_options.RecordPaths = None,
    record_quality: source_options.RecordQuality = None,
    jsonl: source_options.JsonlPath = None,
    outline_in_jsonl: source_options.OutlineInJsonl = False,
    no_video: options.NoVideo = False,
    quiet: options.Quiet = False,
    risk: options.Risk = 1e-3,
    first_look_ms: first_image.FirstLookMs = None,
    max_megapixels: options.MaxMegapixels = None,
) -> None:
    """Track a grasp through a sequence of images, or say for each image why not.

    The grasp is chosen in the first image with an object, for a hand as in `grasptrack synthesize`.

    Contacts are reported where the probability that they are wrong is below --risk. Wrong means that one is off by more than
    3 px and 4 % of the root of the object's area, or that it is another object. Other frames are lost, with a reason.

    With --length, the object's length as a caliper measures it, every frame gives its distance, in that unit.

    Where the choice of the object is not sure, candidates.png shows the likeliest, numbered, and --choose takes one.

    Writes grasps.csv (one row for every frame), run.json, overlay.mp4 and summary.png. Ctrl-C keeps what was computed.
    --record adds a file for Foxglove or rerun, --jsonl a line of JSON for every frame. Says first how well the object can be
    tracked, as `grasptrack inspect` does.

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
      grasptrack track video.mp4 --risk 1e-5
      grasptrack track video.mp4 --camera camera.yaml --length 120mm
      grasptrack track photos --max-opening 85mm --finger-width 12mm --scale 4.2
    """
    lengths = options.hand_lengths(min_opening, max_opening, finger_width, finger_thickness, clearance)
    asked = {
        "strategy": options.strategy_choice(strategy),
        "fingers": fingers,
        "friction": options.positive_friction(friction),
        "risk": options.risk_rate(risk),
        "grasp": grasp,
        **first_image.told_words(object_, not_),
        "box": box,
        "outline": outline,
        "choose": choose,
        "sure": sure,
        "masks": masks,
        "first_look_ms": first_look_ms,
        "segmenter": segmenter,
        "background": background,
        "ignore": ignore,
        "camera": camera,
        "length": length,
        "fps": fps,
        "set": set_,
        "record": record,
        "record_quality": record_quality,
        "jsonl": jsonl,
        **lengths,
        "scale": scale,
        "resynthesize": resynthesize,
        "video": not no_video,
    }
    contacts, count = options.contacts_and_fingers(grasp, fingers)
    said = first_image.first_image(
        object_, not_, box, outline, grasp=contacts, number=choose, sure=sure, first_look_ms=first_look_ms
    )
    hand = options.hand_for_first(scale, lengths, grasp, resynthesize)
    calibration = first_image.load_calibration(camera)
    measure = None if length is None else parse_measure(length, "--length")

    from grasptrack.io.bags.mcap import METADATA
    from grasptrack.io.live import LiveSource
    from grasptrack.io.masks import open_masks
    from grasptrack.io.recorders.again import tracking_options
    from grasptrack.io.run import run_track
    from grasptrack.io.sources import open_source
    from grasptrack.segmentation.segmenters import segmenter_for
    from grasptrack.tracking.tracker import GraspTracker

    settings = source_options.device_settings(set_)
    images = open_source(source, fps, settings=settings)
    if masks is not None and segmenter is not None:
        raise InputError("--masks and --segmenter both say where the object is: give one of them")
    segmentation = None if masks is None else open_masks(masks, images)
    said = replace(
        said,
        ignore=first_image.ignore_mask(ignore),
        background=first_image.background_image(background, masks),
        more=() if images.live or images.kind == "stdin" else _later_images(source, settings),
    )
    tracker = GraspTracker(
        **said.arguments(),
        fingers=count,
        strategy=strategy,
        friction=friction,
        resynthesize=resynthesize,
        hand=hand,
        segmenter=segmenter_for(segmenter),
        camera=calibration,
        risk=risk,
        length=None if measure is None else measure.value,
    )
    recordings = source_options.open_recordings(record, record_quality, jsonl, outline_in_jsonl, asked)
    quiet = quiet or jsonl == "-"  # the standard output is for the lines
    done, notes, looks = 0, list[str](), list[Any]()
    foretells = not quiet and images.kind != "image"  # of one image there is no run to foretell
    with Interruption() as interruption, Verdict() as verdict:
        if isinstance(images, LiveSource):
            images.on_wait = interruption.check
            images.catches_up = True
        try:
            with ProgressBar(quiet) as progress:

                def report_frame(frame: Frame, result: TrackResult) -> None:
                    nonlocal done
                    if not done:
                        notes.extend(first_image.scaling_notes(calibration, frame.image.shape))
                    if not looks and tracker.candidates:
                        looks.append(frame.image)
                        if result.view is not None and result.view.is_clipped:
                            notes.append(
                                "the object is cut by the border of its first image: the part in view is followed"
                            )
                    done += 1
                    if foretells and result.located and not verdict.is_begun and tracker.first_scene is not None:
                        verdict.begin(tracker.first_scene)
                    progress.print(verdict.take())
                    progress.tell("tracking", done, images.count)
                    interruption.check()

                summary = run_track(
                    images,
                    tracker,
                    output,
                    video=not no_video,
                    options=asked,
                    masks=segmentation,
                    recordings=recordings,
                    on_frame=report_frame,
                )
                progress.print(verdict.wait(interruption.check))
        except KeyboardInterrupt:
            raise RunInterruptedError(f'interrupted after {done} frames; what was computed is in "{output}"') from None
    if not summary.grasps:
        raise InputError(_nothing_to_track(summary))
    if images.shortfall:
        notes.append(f'"{source}": {images.shortfall}')
    notes += [f"recorded: {recording.path}" for recording in recordings if str(recording.path) != "-"]
    if images.recorded_with not in ("", tracking_options(asked)):
        again = images.recorded_with if len(images.recorded_with) <= LONGEST else f'in its metadata, "{METADATA}"'
        notes.append(f"recorded with other options; those that give the same digits: {again}")
    first = looks[0] if looks else None
    notes += note_candidates(tracker.candidates, first, output, sure, meant=said.is_settled)
    notes += advice_for(summary.codes, summary.frames)
    if not quiet:
        show_run(summary, output, notes)


def _later_images(source: str, settings: Mapping[str, str]) -> Iterator[NDArray[Any]]:
    """Every so many images of a source after its first; it is opened when they are asked for."""
    from grasptrack.io.sources import open_source

    with open_source(source, settings=settings) as again:
        for k, frame in enumerate(again):
            if k and k % APART == 0:
                yield frame.image


def _nothing_to_track(summary: RunSummary) -> str:
    reasons = summary.reasons.get("searching", {})
    why = next(iter(reasons), "")
    if summary.object_seen:
        return f"no frame has a grasp to track: {why}"
    frames = "the only frame" if summary.frames == 1 else f"any of the {summary.frames} frames"
    return f"no object in {frames}" + (f": {why}" if why else "")
