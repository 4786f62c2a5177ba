# SPDX-License-Identifier: Apache-2.0
"""Any source of images from its name alone; a camera as one, through OpenCV."""

from __future__ import annotations

import os
import time
from collections.abc import Generator
from pathlib import Path

from grasptrack.errors import SourceError
from grasptrack.io.base import Frame, Image, Source
from grasptrack.io.images import ImageSource, images_in, images_matching, is_image_file
from grasptrack.io.video import VideoSource

__all__ = ["CameraSource", "Frame", "Source", "open_source"]


MOST_CAMERAS = 99
"""OpenCV takes the hundreds of a camera's number for a way to talk to it."""


class CameraSource(Source):
    """`camera:0` and so on; endless. Times are s since the first image, by a clock that never goes back."""

    kind = "camera"

    def __init__(self, spec: str, fps: float | None = None) -> None:
        super().__init__(spec, fps)
        number = spec.partition(":")[2]
        if not number.isdecimal():
            raise SourceError(f'a camera is named by its number, as in camera:0, not "{spec}"', spec=spec)
        if int(number) > MOST_CAMERAS:
            raise SourceError(
                f"there is no camera {number[:12]}: they are numbered from 0 to {MOST_CAMERAS}", spec=spec
            )
        self._number = int(number)

    def _read(self) -> Generator[tuple[Image, float | None, str], None, None]:
        import cv2

        try:
            camera = cv2.VideoCapture(self._number)
        except cv2.error:
            raise SourceError(f"camera {self._number} cannot be opened", camera=self._number) from None
        try:
            if not camera.isOpened():
                raise SourceError(
                    f"camera {self._number} cannot be opened: it is missing or in use", camera=self._number
                )
            index, start = 0, 0.0
            while True:
                good, image = camera.read()
                now = time.perf_counter()
                if not good or image is None:
                    raise SourceError(f"camera {self._number} gave no image after {index} frames", frame=index)
                start = start if index else now
                yield image, now - start, f"frame {index} of camera {self._number}"
                index += 1
        finally:
            camera.release()


def open_source(spec: str | os.PathLike[str], fps: float | None = None) -> Source:
    """Frames of a folder, a glob, a video file, a camera or one image, whichever the name turns out to be.

    Folders and globs are read in natural order of names (jpg, png, tif, bmp, pgm; other files are passed over) and have
    no times unless `fps` gives them. Deeper images come scaled to 8 bits by one factor for the sequence
    (`grasptrack.io.images`), transparent parts black; grey stays (H, W), colour is BGR (H, W, 3).

    Args:
        spec: a path, a pattern with ``*``, ``?`` or ``[]``, or ``camera:0``.
        fps: frames/s: frame i gets the time i / fps, in place of any times of the source's own.

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
        raise SourceError("the source has no name: give a folder, a glob, a video file, camera:0 or an image")
    if text.startswith("camera:"):
        return CameraSource(text, fps)
    path = Path(text)
    try:
        path.exists()
    except OSError as error:
        raise SourceError(f'"{text[:80]}" cannot be looked for: {error.strerror}', path=text) from None
    if path.is_dir():
        return ImageSource(text, images_in(path), "folder", fps)
    if path.is_file():
        return ImageSource(text, [path], "image", fps) if is_image_file(path) else VideoSource(path, fps)
    if any(c in text for c in "*?["):
        return ImageSource(text, images_matching(text), "glob", fps)
    if path.exists():
        raise SourceError(f'"{text}" is neither a file nor a folder', path=text)
    raise SourceError(f'"{text}" does not exist: give a folder, a glob, a video file, camera:0 or an image', path=text)
