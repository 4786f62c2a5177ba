# SPDX-License-Identifier: Apache-2.0
"""Any source of images from its name alone."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path

from grasptrack import arguments
from grasptrack.errors import SourceError, bench_hint
from grasptrack.io.bags.source import is_bag, open_bag
from grasptrack.io.base import Frame, Source
from grasptrack.io.cameras.attached import open_webcam
from grasptrack.io.headers import format_for_pillow
from grasptrack.io.images import (
    ImageSource,
    PagesSource,
    count_images,
    images_in,
    images_matching,
    is_image_file,
    read_file,
)
from grasptrack.io.live import SCHEMES, open_stream
from grasptrack.io.piped import open_piped
from grasptrack.io.video import VideoSource
from grasptrack.plugins import is_installed, load_plugin, plugin_names

__all__ = ["Frame", "Source", "open_source"]

Opener = Callable[[str, float | None, Mapping[str, str] | None], Source]
"""Makes a source of its name, frames/s or None, and settings or None."""
_OPENERS: dict[str, Opener] = {"camera": open_webcam, **dict.fromkeys(SCHEMES, open_stream), "bag": open_bag}
"""By what stands before the colon; entry points "grasptrack.sources" add more."""
_KINDS = "a folder, a glob, a video file, camera:0 or an image"


@arguments.checked(fps=arguments.optional(arguments.number), settings=arguments.optional(arguments.instance(Mapping)))
def open_source(
    spec: str | os.PathLike[str], fps: float | None = None, *, settings: Mapping[str, str] | None = None
) -> Source:
    """Frames of a folder, a glob, a video file, one image, a camera, a stream or a recording, whichever the name says.

    Folders and globs are read in natural order of names (other files than `io.images.SUFFIXES` are passed over) and have no
    times unless `fps` gives them. Deeper images come scaled to 8 bits by one factor for the sequence
    (`grasptrack.io.pixels.EightBits`), transparent parts black; grey stays (H, W), colour is BGR (H, W, 3).

    Args:
        spec: a path, a pattern with ``*``, ``?`` or ``[]``; ``camera:0``, ``/dev/video0``, ``pylon:SERIAL``,
            ``genicam:FILE.cti#SERIAL``, ``realsense:SERIAL``; ``rtsp://...``, ``http://...``, ``udp://...``; ``ros2:/topic``;
            ``bag:FILE#/topic``, or the path of a bag or an MCAP file; ``-``, images or a video from the standard input.
        fps: frames/s: frame i gets the time i / fps, in place of any times of the source's own.
        settings: of a device or a stream, by the name that it gives them, such as ``ExposureTime``; others have none.

    Returns:
        What iterates over `Frame`s and can be used in a ``with`` statement.

    Raises:
        SourceError: nothing there, or nothing that can be read; while iterating, a frame that cannot be read or is of
            another size than the frames before it.
    """
    try:
        text = os.fsdecode(spec)
    except TypeError:
        raise SourceError(f"a source is a path, a pattern or camera:0, not {type(spec).__name__}") from None
    if "\0" in text:
        raise SourceError("the source's name holds a character that no file's name can have (NUL)")
    if not text:
        raise SourceError("the source has no name: give " + _KINDS)
    kind, colon, _ = text.partition(":")
    opener: Opener | None = (_OPENERS.get(kind) or load_plugin("grasptrack.sources", kind)) if colon else None
    path = Path(text)
    if opener is None and text == "-":
        opener = open_piped
    if opener is None:
        try:
            path.exists()
        except OSError as error:
            raise SourceError(f'"{text[:80]}" cannot be looked for: {error.strerror}', path=text) from None
        if path.is_char_device():
            opener = open_webcam
        elif is_bag(path):
            opener = open_bag
    if opener is not None:
        return opener(text, fps, settings)
    if settings:
        raise SourceError(f'"{text}" has no settings: --set is for cameras, streams and bags', settings=dict(settings))
    if path.is_dir():
        return ImageSource(text, images_in(path), "folder", fps)
    if path.is_file():
        return _open_file(text, path, fps)
    if any(c in text for c in "*?["):
        return ImageSource(text, images_matching(text), "glob", fps)
    if path.exists():
        raise SourceError(f'"{text}" is neither a file nor a folder', path=text)
    if colon and kind.isalpha() and len(kind) > 1:
        if kind == "sim":
            raise SourceError('"sim:" is the simulated hand of grasptrack-bench, ' + bench_hint("sim"), spec=text)
        known = ", ".join(sorted({*_OPENERS, *plugin_names("grasptrack.sources")}))
        raise SourceError(f'"{kind}:" is no kind of source; there are {known}', spec=text)
    raise SourceError(f'"{text}" does not exist: give {_KINDS}', path=text)


def _open_file(text: str, path: Path, fps: float | None) -> Source:
    if not is_image_file(path):
        return VideoSource(path, fps)
    data = read_file(path)
    kind = format_for_pillow(data)
    if kind == "HEIF" and not is_installed("pillow_heif"):
        return VideoSource(path, fps)  # FFmpeg reads those that have no tiles
    if (count := count_images(data, f'image "{path}"')) > 1:
        return VideoSource(path, fps) if kind == "GIF" else PagesSource(path, count, fps)
    return ImageSource(text, [path], "image", fps)
