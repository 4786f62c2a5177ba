# SPDX-License-Identifier: Apache-2.0
"""Image files: a source of one, of a folder, or of those that a pattern names; sizes by headers; JPEG and PNG to write.

Depth: 8-bit values stay as they are. Deeper images are scaled to 8 bits by one factor for the whole sequence, that of
the smallest usual full scale (1 for fractions, else 255 for float images, 10, 12, 14 or 16 bits) that holds the first
image's largest value, so that a dark 12-bit recording is not left with a dozen grey levels; what is brighter later on
saturates, as in a camera. Only where much of an image would, as after a first one that was nearly black, the scale rises.
Alpha: what is transparent shows black. EXIF rotation is applied, as viewers do.
"""

from __future__ import annotations

import contextlib
import glob
import os
import re
import struct
from collections.abc import Generator, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import arguments
from grasptrack.errors import InputError, SourceError
from grasptrack.io.base import UNREAD, Image, Source
from grasptrack.io.limits import check_size


def is_whole_image(data: bytes) -> bool:
    """False for a JPEG or PNG without its end marker; True where the format keeps none."""
    if data.startswith(b"\xff\xd8"):
        return data.find(b"\xff\xd9", _scan_of(data)) > 0
    if data.startswith(b"\x89PNG"):
        return b"IEND" in data
    return True


def _scan_of(data: bytes) -> int:
    """Where the first scan of a JPEG begins; what comes before may hold a thumbnail with an end marker of its own."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        at += 1 if data[at + 1] == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return at


SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".pgm"})
NAMED = "jpg, png, tif, bmp, pgm"
_FULL_SCALES = {"u": (1023.0, 4095.0, 16383.0, 65535.0), "f": (1.0, 255.0, 1023.0, 4095.0, 16383.0, 65535.0)}


def natural_key(name: str) -> tuple[list[str | int], str]:
    """Sorts img2 before img10."""
    parts = re.split(r"([0-9]+)", name)
    return [int(p) if i % 2 else p.casefold() for i, p in enumerate(parts)], name


def is_image_file(path: Path) -> bool:
    """Whether the name is that of an image; hidden files are not meant."""
    return path.suffix.lower() in SUFFIXES and not path.name.startswith(".")


def images_in(folder: Path) -> list[Path]:
    """The images of a folder in natural order of names; other files are passed over.

    Raises:
        SourceError: none there, or the folder cannot be listed.
    """
    try:
        found = [p for p in folder.iterdir() if is_image_file(p) and p.is_file()]
    except OSError as error:
        raise SourceError(f'folder "{folder}" cannot be read: {error.strerror}', path=str(folder)) from None
    if not found:
        raise SourceError(f'folder "{folder}" holds no image ({NAMED})', path=str(folder))
    return sorted(found, key=lambda p: natural_key(p.name))


def images_matching(pattern: str) -> list[Path]:
    """The images that a pattern with *, ? or [] names, in natural order.

    Raises:
        SourceError: none.
    """
    found = [p for p in map(Path, glob.glob(pattern, recursive=True)) if is_image_file(p) and p.is_file()]  # noqa: PTH207
    if not found:
        raise SourceError(f'no image matches "{pattern}" ({NAMED})', pattern=pattern)
    return sorted(found, key=lambda p: natural_key(p.as_posix()))


def read_image(path: Path) -> Image:
    """An image as its file has it: any depth, grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4).

    Raises:
        SourceError: missing, truncated, no image, or above the limit of size (`grasptrack.io.limits`).
    """
    return decode_image(read_file(path), f'image "{path}"')


def read_file(path: Path) -> bytes:
    """What an image's file holds.

    Raises:
        SourceError: it cannot be read.
    """
    try:
        if path.is_char_device():  # it may have no end
            raise SourceError(f'image "{path}" is a device, not a file', path=str(path))
        return path.read_bytes()
    except OSError as error:
        raise SourceError(f'image "{path}" cannot be read: {error.strerror}', path=str(path)) from None


def decode_image(data: bytes, name: str) -> Image:
    """The same from a file's content.

    Raises:
        SourceError: truncated, no image, or above the limit of size.
    """
    if not data:
        raise SourceError(f"{name} is empty", name=name)
    size = image_size_in_header(data)
    if size is not None:
        check_size(*size, name)
    if not is_whole_image(data):
        raise SourceError(f"{name} is truncated", name=name)
    if len(pages := pages_of(data)) > 1:
        raise SourceError(
            f"{name} holds {len(pages)} images: it is a sequence of its own, to be given alone", name=name
        )
    if size is None:  # OpenCV reads more formats, of which nothing tells the size beforehand
        raise SourceError(f"{name} cannot be read: it is damaged, or no image ({NAMED})", name=name)
    # IMREAD_UNCHANGED alone keeps alpha, and alone ignores EXIF rotation; no JPEG has alpha.
    upright = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR
    flags = upright if data.startswith(b"\xff\xd8") else cv2.IMREAD_UNCHANGED
    try:
        image: Image | None = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except (cv2.error, MemoryError):
        image = None
    if image is None or image.size == 0:
        raise SourceError(f"{name} cannot be read: it is damaged, or no image", name=name)
    return image[:, :, 0] if image.ndim == 3 and image.shape[2] == 1 else image


SATURATED = 0.05
"""Share of an image's values from which on the first image's scale is not that of the sequence: no glint takes as much."""


class EightBits:
    """Images of any depth as uint8, grey (H, W) or BGR (H, W, 3).

    Args:
        full: value of deeper images that becomes 255; None takes the one that suits the first of them.
    """

    def __init__(self, full: float | None = None) -> None:
        self._full, self._told = full, full is not None

    def __call__(self, image: Image) -> NDArray[np.uint8]:
        """The image in 8 bits, (H, W) or (H, W, 3)."""
        plain = image
        if image.ndim == 3 and image.shape[2] == 4:
            opaque = np.iinfo(image.dtype).max if image.dtype.kind == "u" else 1.0
            plain = image[:, :, :3]
            if image[:, :, 3].min() < opaque and image[:, :, 3].any():  # where all is transparent, alpha is not meant
                plain = (plain * (image[:, :, 3:] / opaque)).astype(image.dtype)
        if plain.dtype == np.uint8:
            return np.ascontiguousarray(plain)
        if plain.dtype == np.bool_:
            return plain.astype(np.uint8) * np.uint8(255)
        values = np.nan_to_num(plain.astype(np.float32), posinf=0.0, neginf=0.0)
        if self._full is None or (not self._told and np.count_nonzero(values > self._full) > SATURATED * values.size):
            peak = float(values.max(initial=0.0))
            self._full = next((s for s in _FULL_SCALES["f" if plain.dtype.kind == "f" else "u"] if s >= peak), peak)
        scaled: NDArray[np.uint8] = np.clip(values * (255.0 / self._full) + 0.5, 0.0, 255.0).astype(np.uint8)
        return scaled


class ImageSource(Source):
    """Image files, in the order given."""

    def __init__(self, spec: str, paths: Sequence[Path], kind: str, fps: float | None = None) -> None:
        super().__init__(spec, fps)
        self.kind = kind
        self.count = len(paths)
        self.exact = True
        self.names = tuple(p.name for p in paths)
        self.files = tuple(paths)

    def _read(self) -> Generator[tuple[Image, float | None, str], None, None]:
        yield from read_all(self.files, self.first)


class PagesSource(Source):
    """The images of one TIFF, in order.

    Args:
        path: of the file.
        pages: their indices, as `pages_of` gives them.
        size: width and height in px, which all of them have.
        fps: as for every source.
    """

    kind = "stack"

    def __init__(
        self, path: Path, pages: Sequence[int], size: tuple[int, int] | None, fps: float | None = None
    ) -> None:
        super().__init__(str(path), fps)
        self.exact = True
        if size is not None:
            check_size(*size, f'image "{path}"')
        self._path, self._pages, self.count = path, tuple(pages), len(pages)
        self.files = (path,)

    def _read(self) -> Generator[tuple[Image, float | None, str], None, None]:
        to_eight = EightBits()
        for k, page in enumerate(self._pages):
            name = f"page {page} of {self._path.name}"
            if 0 < k < self.first:
                yield UNREAD, None, name
                continue
            found: Sequence[Image] = ()
            with contextlib.suppress(cv2.error, MemoryError):
                name_of: Any = os.fsencode(self._path)  # of a name that is no text OpenCV dies
                found = cv2.imreadmulti(name_of, page, 1, flags=cv2.IMREAD_UNCHANGED)[1]
            if not found:
                raise SourceError(f'"{self._path}": {name} cannot be read', path=str(self._path), page=page)
            yield to_eight(found[0]), None, name


def read_all(paths: Iterable[Path], first: int = 0) -> Generator[tuple[Image, float | None, str], None, None]:
    """The images of a sequence in 8 bits, without times; of those before `first` only one is read, which sets the scale."""
    to_eight = EightBits()
    for k, path in enumerate(paths):
        yield UNREAD if 0 < k < first else to_eight(read_image(path)), None, path.name


# --- sizes by headers ------------------------------------------------------------------------------

_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG that begin a frame and tell its size."""
_PORTABLE = re.compile(rb"P[1-6fF](?:\s|#[^\n\r]*[\n\r])+(\d{1,9})(?:\s|#[^\n\r]*[\n\r])+(\d{1,9})\s")
_TIFF, _MOST_PAGES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), 100_000
_TIFF_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}


def image_size_in_header(data: bytes) -> tuple[int, int] | None:
    """Width and height in px that a file claims; None where it is of another format, or has no whole header."""
    try:
        if data.startswith(b"\x89PNG"):
            return _read_pair(">II", data, 16)
        if data.startswith(b"\xff\xd8"):
            return _jpeg_size(data)
        if data.startswith(b"BM"):
            return _bmp_size(data)
        if data[:4] in _TIFF:
            return _tiff_size(data)
        if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp_size(data)
        found = _PORTABLE.match(data)
        return (int(found[1]), int(found[2])) if found else None
    except (struct.error, IndexError):
        return None


def _read_pair(layout: str, data: bytes, at: int) -> tuple[int, int]:
    first, second = struct.unpack_from(layout, data, at)
    return abs(int(first)), abs(int(second))  # a BMP's height is negative where its first row is the upper one


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:  # a decoder looks for the next marker as well
            at += 1
            continue
        marker = data[at + 1]
        if marker in _JPEG_FRAMES:
            height, width = _read_pair(">HH", data, at + 5)
            return width, height
        if marker in (0xFF, 0x00, 0x01) or 0xD0 <= marker <= 0xD8:
            at += 1 if marker == 0xFF else 2
            continue
        if marker in (0xD9, 0xDA):
            return None
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def _bmp_size(data: bytes) -> tuple[int, int]:
    head = int.from_bytes(data[14:18], "little")
    return _read_pair("<HH", data, 18) if head == 12 else _read_pair("<ii", data, 18)


def _tiff_size(data: bytes) -> tuple[int, int] | None:
    """The first directory's; of BigTIFF too."""
    first = next(_tiff_directories(data), None)
    return None if first is None else first.size


class _TiffDirectory(NamedTuple):
    """Width and height in px, None where they are not told, and whether it is a smaller copy of another one."""

    size: tuple[int, int] | None
    is_reduced: bool


def _tiff_directories(data: bytes) -> Iterator[_TiffDirectory]:
    order = "<" if data[:1] == b"I" else ">"
    big = data[2:4] in (b"+\0", b"\0+")
    (at,) = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)
    seen: set[int] = set()
    while at and at not in seen and len(seen) < _MOST_PAGES:
        seen.add(at)
        (count,) = struct.unpack_from(order + ("Q" if big else "H"), data, at)
        at += 8 if big else 2
        told = {254: 0}
        for entry in range(min(count, 4096)):
            place = at + entry * (20 if big else 12)
            tag, kind = struct.unpack_from(order + "HH", data, place)
            if tag in (254, 256, 257) and kind in _TIFF_TYPES:
                (told[tag],) = struct.unpack_from(order + _TIFF_TYPES[kind], data, place + (12 if big else 8))
        yield _TiffDirectory((told[256], told[257]) if len(told) == 3 else None, bool(told[254] & 1))
        (at,) = struct.unpack_from(order + ("Q" if big else "I"), data, at + count * (20 if big else 12))


def pages_of(data: bytes) -> list[int]:
    """Indices of the pages of a TIFF that are images of their own, as large as the first; of another format one."""
    if data[:4] not in _TIFF:
        return [0]
    pages: list[_TiffDirectory] = []
    with contextlib.suppress(struct.error):  # the last directory may be cut off
        pages.extend(_tiff_directories(data))
    return [k for k, page in enumerate(pages) if not page.is_reduced and page.size == pages[0].size] or [0]


def _webp_size(data: bytes) -> tuple[int, int] | None:
    if len(data) < 30:
        return None
    kind = data[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if kind == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if kind == b"VP8 ":
        width, height = _read_pair("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None


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
    """The bytes of a file, and its format: "png" or "jpeg".

    Args:
        image: grey (H, W) or BGR (H, W, 3).
        quality: 1 to 100, of a JPEG; None for PNG.

    Raises:
        InputError: as of `encode_jpeg`.
    """
    if quality is None:
        return cv2.imencode(".png", image, _FAST)[1].tobytes(), "png"
    return encode_jpeg(image, quality), "jpeg"
