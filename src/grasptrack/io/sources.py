# SPDX-License-Identifier: Apache-2.0
"""Any source of images from its name alone."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

from grasptrack.errors import SourceError
from grasptrack.io.bags.paths import is_bag
from grasptrack.io.base import Frame, Source
from grasptrack.io.images import ImageSource, images_in, images_matching, is_image_file
from grasptrack.io.video import VideoSource

__all__ = ["Frame", "Source", "open_source"]

_OPENERS = {
    "camera": "cameras.v4l:open_webcam",
    "pylon": "cameras.pylon:open_pylon",
    "genicam": "cameras.genicam:open_genicam",
    "realsense": "cameras.realsense:open_realsense",
    **dict.fromkeys(("rtsp", "rtsps", "http", "https", "udp"), "streams:open_stream"),
    "bag": "bags.source:open_bag",
    "ros2": "ros2:open_topic",
}
"""What opens a source, by what stands before the colon; loaded when it is asked for."""
_KINDS = "a folder, a glob, a video file, camera:0 or an image"


def open_source(
    spec: str | os.PathLike[str], fps: float | None = None, *, settings: Mapping[str, str] | None = None
) -> Source:
    """Frames of a folder, a glob, a video file, one image, a camera, a stream or a recording, whichever the name says.

    Folders and globs are read in natural order of names (jpg, png, tif, bmp, pgm; other files are passed over) and have
    no times unless `fps` gives them. Deeper images come scaled to 8 bits by one factor for the sequence
    (`grasptrack.io.images`), transparent parts black; grey stays (H, W), colour is BGR (H, W, 3).

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
    if colon and kind in _OPENERS:
        return _opener(_OPENERS[kind])(text, fps, settings)
    if text == "-":
        return _opener("piped:open_piped")(text, fps, settings)
    path = Path(text)
    try:
        path.exists()
    except OSError as error:
        raise SourceError(f'"{text[:80]}" cannot be looked for: {error.strerror}', path=text) from None
    if path.is_char_device():
        return _opener(_OPENERS["camera"])(text, fps, settings)
    if is_bag(path):
        return _opener(_OPENERS["bag"])(text, fps, settings)
    if settings:
        raise SourceError(f'"{text}" has no settings: --set is for cameras, streams and bags', settings=dict(settings))
    if path.is_dir():
        return ImageSource(text, images_in(path), "folder", fps)
    if path.is_file():
        return ImageSource(text, [path], "image", fps) if is_image_file(path) else VideoSource(path, fps)
    if any(c in text for c in "*?["):
        return ImageSource(text, images_matching(text), "glob", fps)
    if path.exists():
        raise SourceError(f'"{text}" is neither a file nor a folder', path=text)
    if colon and kind.isalpha() and len(kind) > 1:
        raise SourceError(f'"{kind}:" is no kind of source; there are {", ".join(sorted(_OPENERS))}', spec=text)
    raise SourceError(f'"{text}" does not exist: give {_KINDS}', path=text)


def _opener(name: str) -> Callable[[str, float | None, Mapping[str, str] | None], Source]:
    module, _, function = name.partition(":")
    found: Callable[[str, float | None, Mapping[str, str] | None], Source]
    found = getattr(import_module(f"grasptrack.io.{module}"), function)
    return found
