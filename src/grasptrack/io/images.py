# SPDX-License-Identifier: Apache-2.0
"""Image files: a source of one, of a folder, or of those that a pattern names; sizes by headers; JPEG and PNG to write.

Images come in 8 bits, see `pixels.EightBits`, and are turned as their EXIF says, as viewers do.

OpenCV reads what has more than 8 bits or comes in long sequences; Pillow reads AVIF, GIF, HEIC and what moves.
"""

from __future__ import annotations

import contextlib
import glob
import io
import itertools
import os
import re
import warnings
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import arguments
from grasptrack.errors import InputError, SourceError
from grasptrack.images import array_of_picture
from grasptrack.io.base import UNREAD, Image, Source
from grasptrack.io.headers import (
    MULTIPLIED,
    TIFF,
    format_for_pillow,
    image_size_in_header,
    is_whole_image,
    largest_value,
    orientation_of,
    pages_of,
    tiff_directories,
)
from grasptrack.io.limits import check_size
from grasptrack.io.pixels import EightBits
from grasptrack.plugins import import_extra

SUFFIXES = frozenset(
    {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".pbm", ".pnm"}
    | {".webp", ".gif", ".avif", ".heic", ".heif", ".jp2", ".j2k"}
)
NAMED = "jpg, png, tif, bmp, pgm, ppm, webp, gif, avif, heic, jp2"


def natural_key(name: str) -> tuple[list[str | int], str]:
    """Sorts img2 before img10."""
    parts = re.split(r"([0-9]+)", name)
    return [int(p) if i % 2 else p.casefold() for i, p in enumerate(parts)], name


def is_image_file(path: Path) -> bool:
    """Whether the name is that of an image; hidden files are not meant."""
    return path.suffix.lower() in SUFFIXES and not path.name.startswith(".")


def images_in(folder: Path) -> list[Path]:
    """The images of a folder in natural order of names; other files are passed over."""
    try:
        found = [p for p in folder.iterdir() if is_image_file(p) and p.is_file()]
    except OSError as error:
        raise SourceError(f'folder "{folder}" cannot be read: {error.strerror}', path=str(folder)) from None
    if not found:
        raise SourceError(f'folder "{folder}" holds no image ({NAMED})', path=str(folder))
    return sorted(found, key=lambda p: natural_key(p.name))


def images_matching(pattern: str) -> list[Path]:
    """The images that a pattern with *, ? or [] names, in natural order."""
    files = files_matching(pattern)
    found = [path for path in files if is_image_file(path)]
    if not found:
        why = f"{len(files)} other files do, and videos are opened one at a time" if files else _bracket_hint(pattern)
        raise SourceError(f'no image matches "{pattern}" ({NAMED})' + (f"; {why}" if why else ""), pattern=pattern)
    return found


def files_matching(pattern: str) -> list[Path]:
    """The files that a pattern names, in natural order; hidden ones are not meant."""
    found = [path for path in map(Path, glob.glob(pattern, recursive=True)) if path.is_file()]  # noqa: PTH207
    return sorted(found, key=lambda p: natural_key(p.as_posix()))


def _bracket_hint(pattern: str) -> str:
    """What to write where a pattern's brackets were meant as they are."""
    if "[" not in pattern:
        return ""
    real = next((str(p) for p in (Path(pattern), *Path(pattern).parents) if "[" in str(p) and p.exists()), "")
    written = pattern.replace(real, glob.escape(real), 1) if real else pattern.replace("[", "[[]")
    return f'in a pattern [ ] stand for one character of those between them; where a bracket is meant write "{written}"'


def read_image(path: Path) -> Image:
    """An image as its file has it: any depth, grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4)."""
    return decode_image(read_file(path), f'image "{path}"')


def read_file(path: Path) -> bytes:
    """What an image's file holds."""
    try:
        if path.is_char_device():  # it may have no end
            raise SourceError(f'image "{path}" is a device, not a file', path=str(path))
        return path.read_bytes()
    except OSError as error:
        raise SourceError(f'image "{path}" cannot be read: {error.strerror}', path=str(path)) from None


def decode_image(data: bytes, name: str) -> Image:
    """The same from a file's content."""
    if not data:
        raise SourceError(f"{name} is empty", name=name)
    size = image_size_in_header(data)
    if size is not None:
        check_size(*size, name)
    if not is_whole_image(data):
        raise SourceError(f"{name} is truncated", name=name)
    if (count := count_images(data, name)) > 1:
        raise SourceError(f"{name} holds {count} images: it is a sequence of its own, to be given alone", name=name)
    if format_for_pillow(data):
        return next(_pictures_in(data, name))[0]
    if size is None:  # OpenCV reads more formats, of which nothing tells the size beforehand
        raise SourceError(f"{name} cannot be read: it is damaged, or no image ({NAMED})", name=name)
    # IMREAD_UNCHANGED alone keeps alpha, and alone ignores EXIF rotation; no JPEG has alpha.
    upright = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR
    flags = upright if data.startswith(b"\xff\xd8") else cv2.IMREAD_UNCHANGED
    try:
        image: Image | None = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except (cv2.error, MemoryError):
        image = None
    image = _tiff_page(image, data, 0) if data[:4] in TIFF else image
    if image is None or image.size == 0:
        raise SourceError(f"{name} cannot be read: it is damaged, or no image of a kind that is read", name=name)
    if (white := largest_value(data)) < 255:
        image = cv2.convertScaleAbs(image, alpha=255.0 / max(white, 1))
    image = image[:, :, 0] if image.ndim == 3 and image.shape[2] == 1 else image
    return _turned_upright(image, orientation_of(data))


@contextlib.contextmanager
def _without_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _open_picture(data: bytes, name: str) -> Any:
    """A file as Pillow's image, whose pixels are not read yet."""
    from PIL import Image as Pictures

    if format_for_pillow(data) == "HEIF":
        import_extra("pillow_heif", "heif", name).register_heif_opener()
    try:
        with _without_warnings():  # sizes have a limit of our own
            picture = Pictures.open(io.BytesIO(data))
    except Exception:  # whatever a decoder raises
        raise SourceError(f"{name} cannot be read: it is damaged, or no image ({NAMED})", name=name) from None
    check_size(*picture.size, name)
    return picture


NO_DURATION = 0.1
"""s that an image is shown of which its file says 0: browsers agree."""


def _pictures_in(data: bytes, name: str) -> Generator[tuple[Image, float | None], None, None]:
    """The images of a file that Pillow reads, upright, with the times in s at which they are shown, or None."""
    from PIL import ImageOps

    picture, time = _open_picture(data, name), 0.0
    for k in range(bool(picture.info.get("default_image")), getattr(picture, "n_frames", 1)):
        try:
            picture.seek(k)
            picture.load()
            shown = array_of_picture(ImageOps.exif_transpose(picture))
        except Exception:  # whatever a decoder raises
            raise SourceError(f"{name} cannot be read: it is damaged", name=name, page=k) from None
        lasts = picture.info.get("duration")
        yield shown, None if lasts is None else time
        time += 0.001 * (lasts or 0.0) or NO_DURATION


def _tiff_page(image: Image | None, data: bytes, page: int) -> Image | None:
    """A page as OpenCV reads it, but for its alpha, which OpenCV drops of grey and multiplies 8-bit colours by.

    Pillow also reads small tiles, of which OpenCV makes nothing.
    """
    told = next(itertools.islice(tiff_directories(data), page, None), None)
    if image is not None and told is not None:
        channels = 1 if image.ndim == 2 else image.shape[2]
        if channels == told.samples and (channels < 4 or image.dtype != np.uint8):
            return image[:, :, :3] if channels == 4 and told.extra == MULTIPLIED else image
    with contextlib.suppress(Exception), _without_warnings():  # whatever a decoder raises
        picture = _open_picture(data, "")
        picture.seek(page)
        return array_of_picture(picture)
    return image


def count_images(data: bytes, name: str) -> int:
    """How many images of its own a file holds."""
    if not format_for_pillow(data):
        return len(pages_of(data))
    picture = _open_picture(data, name)
    try:
        return int(getattr(picture, "n_frames", 1)) - bool(picture.info.get("default_image"))
    except Exception:  # whatever a decoder raises
        raise SourceError(f"{name} cannot be read: it is damaged", name=name) from None


def _turned_upright(image: Image, orientation: int) -> Image:
    """An image as it is to be seen, by the numbers of EXIF."""
    image = image.swapaxes(0, 1) if 5 <= orientation <= 8 else image
    down, across = orientation in (3, 4, 7, 8), orientation in (2, 3, 6, 7)
    return np.ascontiguousarray(image[:: -1 if down else 1, :: -1 if across else 1])


class ImageSource(Source):
    """Image files, in the order given."""

    def __init__(self, spec: str, paths: Sequence[Path], kind: str, fps: float | None = None) -> None:
        super().__init__(spec, fps)
        self.kind = kind
        self.count = len(paths)
        self.exact = True
        self.names = tuple(p.name for p in paths)
        self.files = tuple(paths)

    def _read_images(self) -> Generator[tuple[Image, float | None, str], None, None]:
        to_eight = EightBits()
        for k, path in enumerate(self.files):  # of those before the first only one is read, which sets the scale
            yield UNREAD if 0 < k < self.first else to_eight(read_image(path)), None, path.name


class PagesSource(Source):
    """The images of one file, in order: a TIFF of several pages, a WebP or PNG that moves, a HEIC or AVIF of several images."""

    kind = "stack"

    def __init__(self, path: Path, count: int, fps: float | None = None) -> None:
        super().__init__(str(path), fps)
        self.exact = True
        self._path, self.count = path, count
        self.files = (path,)

    def _read_images(self) -> Generator[tuple[Image, float | None, str], None, None]:
        data, to_eight = read_file(self._path), EightBits()
        pages = self._tiff_pages(data) if data[:4] in TIFF else _pictures_in(data, f'"{self._path}"')
        for k, (image, time) in enumerate(pages):
            yield UNREAD if 0 < k < self.first else to_eight(image), time, f"image {k} of {self._path.name}"

    def _tiff_pages(self, data: bytes) -> Generator[tuple[Image, None], None, None]:
        if (size := image_size_in_header(data)) is not None:
            check_size(*size, f'image "{self._path}"')
        for k, page in enumerate(pages_of(data)):
            if 0 < k < self.first:
                yield UNREAD, None
                continue
            found: Sequence[Image] = ()
            with contextlib.suppress(cv2.error, MemoryError):
                name_of: Any = os.fsencode(self._path)  # of a name that is no text OpenCV dies
                found = cv2.imreadmulti(name_of, page, 1, flags=cv2.IMREAD_UNCHANGED)[1]
            image = _tiff_page(found[0] if found else None, data, page)
            if image is None:
                raise SourceError(f'"{self._path}": page {page} cannot be read', path=str(self._path), page=page)
            yield image, None


# --- images as files -------------------------------------------------------------------------------

QUALITY = 88
# Of OpenCV's ways to write PNG the fastest: a third of its default's time, and no larger.
_FAST = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
if hasattr(cv2, "IMWRITE_PNG_FILTER"):  # OpenCV 4.12
    _FAST += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB]


@arguments.checked(image=arguments.array(unbounded=True), quality=arguments.whole)
def encode_jpeg(image: NDArray[Any], quality: int = QUALITY) -> bytes:
    """The bytes of a JPEG file.

    Args:
        image: (H, W) or BGR (H, W, 3), 8 bit.
        quality: 1 to 100; more is larger and truer.

    Raises:
        InputError: a quality out of range, or no such image.
    """
    if not 1 <= quality <= 100:
        raise InputError(f"the quality of a JPEG is 1 to 100, not {quality}", quality=quality)
    try:
        good, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    except cv2.error:
        good, data = False, np.empty(0, np.uint8)
    if not good:
        raise InputError(f"an image of {image.shape}, {image.dtype}, has no JPEG", shape=image.shape)
    return data.tobytes()


def encode_image(image: NDArray[np.uint8], quality: int | None) -> tuple[bytes, str]:
    """The bytes of a file of a grey (H, W) or BGR (H, W, 3) image, and its format: "jpeg" of a quality, 1 to 100, or "png"."""
    if quality is None:
        return cv2.imencode(".png", image, _FAST)[1].tobytes(), "png"
    return encode_jpeg(image, quality), "jpeg"
